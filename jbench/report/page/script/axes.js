// Positions of values in an SVG, and their texts.

function position(axis, value, start, end) {
  const scaled = axis.log ? Math.log10 : (number) => number;
  const [low, high] = axis.limits.map(scaled);
  return start + ((scaled(value) - low) / (high - low)) * (end - start);
}

function valueAt(axis, at, start, end) {
  const [low, high] = axis.limits;
  const share = (at - start) / (end - start);
  return axis.log ? low * (high / low) ** share : low + share * (high - low);
}

// Named values within the limits of an axis, or round ones, at most about as many as `count`.
function ticksOf({ limits, unit, log, ticks }, count) {
  if (ticks) return ticks.map(([at]) => at).filter((at) => at >= limits[0] && at <= limits[1]);
  const [low, high] = limits.map((limit) => limit * unit);
  const digits = (value) => Number(value.toPrecision(12)) / unit;
  if (log && high / low >= 10) {
    const first = Math.floor(Math.log10(low));
    const decades = Math.floor(Math.log10(high)) - first + 1;
    const powers = Array.from({ length: decades }, (_, i) => 10 ** (first + i));
    const factors = decades > 3 ? [1] : [1, 2, 5];
    const round = powers.flatMap((power) => factors.map((factor) => factor * power));
    return round.filter((value) => value >= low && value <= high).map(digits);
  }
  const rough = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 2.5, 5, 10].find((factor) => factor * power >= rough);
  const [first, last] = [Math.ceil(low / step - 1e-9), Math.floor(high / step + 1e-9)];
  return Array.from({ length: last - first + 1 }, (_, i) => digits((first + i) * step));
}

function inWords(value) {
  if (value !== 0 && Math.abs(value) < 1e-4) return value.toExponential(3);
  return value.toLocaleString("en", { maximumSignificantDigits: 5 });
}

function textOf(axis, value) {
  if (!axis.ticks) return inWords(value * axis.unit);
  // Values that share a name are beside its tick.
  const distance = ([at]) => Math.abs(at - value);
  return axis.ticks.reduce((a, b) => (distance(b) < distance(a) ? b : a))[1];
}

function labeled(axis, value) {
  return [axis.label, textOf(axis, value)].filter((text) => text).join(": ");
}

// Adds the positions of its values to a panel.
function setPositions(panel) {
  const [left, top, right, bottom] = panel.box;
  panel.lines.forEach((line) => {
    line.at = line.x.map((x, i) => [
      position(panel.x, x, left, right),
      position(panel.y, line.y[i], bottom, top),
    ]);
  });
  if (panel.grid) {
    panel.columns = panel.grid.x.map((x) => position(panel.x, x, left, right));
    panel.rows = panel.grid.y.map((y) => position(panel.y, y, bottom, top));
  }
}

// The points of a line within limits.
function within(line, [low, high]) {
  const inside = line.x.map((x) => x >= low && x <= high);
  const kept = (values) => values.filter((_, i) => inside[i]);
  return { ...line, x: kept(line.x), y: kept(line.y), bands: line.bands.map(kept) };
}

// The position of the pointer in an SVG.
function pointIn(svg, event) {
  const matrix = svg.getScreenCTM().inverse();
  return new DOMPoint(event.clientX, event.clientY).matrixTransform(matrix);
}

function nearest(line, x) {
  let best = 0;
  line.at.forEach((at, i) => {
    if (Math.abs(at[0] - x) < Math.abs(line.at[best][0] - x)) best = i;
  });
  return best;
}

function center(edges, i) {
  return (edges[i] + edges[i + 1]) / 2;
}

function between(edges, value) {
  return edges.findIndex((edge, i) => i > 0 && (value - edge) * (value - edges[i - 1]) <= 0) - 1;
}
