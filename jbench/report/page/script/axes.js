
// Places of values in an SVG, and their names.

function place(axis, value, start, end) {
  const scaled = axis.log ? Math.log10 : (number) => number;
  const [low, high] = axis.limits.map(scaled);
  return start + ((scaled(value) - low) / (high - low)) * (end - start);
}

function inWords(value) {
  if (value !== 0 && Math.abs(value) < 1e-4) return value.toExponential(3);
  return value.toLocaleString("en", { maximumSignificantDigits: 5 });
}

function named(axis, value) {
  const width = Math.abs(axis.limits[1] - axis.limits[0]);
  const tick = (axis.ticks ?? []).find(([at]) => Math.abs(at - value) < width * 1e-6);
  return tick ? tick[1] : inWords(value * axis.unit);
}

function labelled(axis, value) {
  return [axis.label, named(axis, value)].filter((text) => text).join(": ");
}

// Adds to a panel where its values are in the SVG.
function placeValues(panel) {
  const [left, top, right, bottom] = panel.box;
  panel.lines.forEach((line) => {
    line.at = line.x.map((x, i) => [
      place(panel.x, x, left, right),
      place(panel.y, line.y[i], bottom, top),
    ]);
  });
  if (panel.grid) {
    panel.columns = panel.grid.x.map((x) => place(panel.x, x, left, right));
    panel.rows = panel.grid.y.map((y) => place(panel.y, y, bottom, top));
  }
}

function nearest(line, x) {
  let best = 0;
  line.at.forEach((at, i) => {
    if (Math.abs(at[0] - x) < Math.abs(line.at[best][0] - x)) best = i;
  });
  return best;
}

function between(edges, value) {
  return edges.findIndex((edge, i) => i > 0 && (value - edge) * (value - edges[i - 1]) <= 0) - 1;
}
