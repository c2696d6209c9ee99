// The paths of the robot in the first and in the last evaluation of a run, from above.

const PATH_SIZE = 280; // pixels of the drawing, which is a square
const PATH_EDGE = 24; // pixels around the paths, for their marks
const PATH_UNIT = 1e-4; // meters of the unit of the page's data
const CLOSEST = 0.02; // meters: the smallest extent that fills the drawing

function readPath([steps, gained, numbers, heading, target]) {
  const meters = numbers.map((number) => number * PATH_UNIT);
  const points = Array.from({ length: meters.length / 2 }, (_, i) => meters.slice(2 * i, 2 * i + 2));
  return { steps, gained, points, heading, target };
}

// The largest length of 1, 2 or 5 units that is at most `limit`, and its text.
function roundLength(limit) {
  const power = 10 ** Math.floor(Math.log10(limit));
  const length = [5, 2, 1].find((factor) => factor * power <= limit * (1 + 1e-9)) * power;
  const [unit, name] = length >= 1 ? [1, "m"] : length >= 0.01 ? [0.01, "cm"] : [0.001, "mm"];
  return [length, `${inWords(length / unit)} ${name}`];
}

// Functions from meters to pixels, with equal scales of both axes, and the scale in pixels a meter.
function scaleOf(points) {
  const ends = [0, 1].map((axis) => {
    const values = points.map((point) => point[axis]);
    return [Math.min(...values), Math.max(...values)];
  });
  const extent = Math.max(CLOSEST, ...ends.map(([low, high]) => high - low));
  const scale = (PATH_SIZE - 2 * PATH_EDGE) / extent;
  const [x, y] = ends.map(([low, high]) => (low + high) / 2);
  const middle = PATH_SIZE / 2;
  return [([px, py]) => [middle + (px - x) * scale, middle - (py - y) * scale], scale];
}

function drawPath(svg, { points, heading, target: [x, y, yaw] }, kind, at) {
  const group = makeSvgElement("g", svg, { class: kind });
  const positions = points.map(at);
  const [start, end] = [positions[0], positions.at(-1)];
  const goal = x === null ? start : at([x, y]);
  if (x !== null) makeSvgElement("circle", group, { class: "goal", cx: goal[0], cy: goal[1], r: 8 });
  if (yaw !== null) {
    const length = x === null ? PATH_SIZE / 3 : 20;
    const d = `M${goal.join(" ")}l${length * Math.cos(yaw)} ${-length * Math.sin(yaw)}`;
    makeSvgElement("path", group, { class: "goal", d });
  }
  makeSvgElement("path", group, { d: `M${positions.map((one) => one.join(" ")).join("L")}` });
  makeSvgElement("circle", group, { cx: start[0], cy: start[1], r: 3.5 });
  const turn = `translate(${end.join(" ")}) rotate(${(-heading * 180) / Math.PI})`;
  makeSvgElement("path", group, { class: "end", d: "M8 0L-5 5L-2 0L-5 -5Z", transform: turn });
}

function drawScale(svg, scale) {
  const [length, text] = roundLength(PATH_SIZE / 3 / scale);
  const [left, bottom] = [10, PATH_SIZE - 8];
  const d = `M${left} ${bottom - 5}v5h${length * scale}v-5`;
  makeSvgElement("path", makeSvgElement("g", svg, { class: "scale" }), { d });
  makeSvgElement("text", svg, { x: left + 5, y: bottom - 6 }).textContent = text;
}

function captionOf(paths) {
  const said = ({ steps, gained }, look) => {
    const about = [look, gained === null ? "" : `return ${gained}`].filter((text) => text);
    return `${inWords(steps)} control steps${about.length ? ` (${about.join(", ")})` : ""}`;
  };
  const each = paths.map((path, i) => said(path, i < paths.length - 1 ? "thin line" : ""));
  const [x, , yaw] = paths.at(-1).target;
  const evaluations = paths.length > 1 ? "evaluations" : "evaluation";
  return [
    `The robot seen from above, in the first episode of the ${evaluations} after ${each.join(" and ")}.`,
    "A circle is the start; an arrowhead is the end and the robot's heading.",
    x === null ? "" : "A dashed circle is the target of the line with its color.",
    yaw === null ? "" : "A dashed line is the target's direction.",
  ].filter((text) => text).join(" ");
}

function makePaths(inside, { name, paths }) {
  if (!paths.length) return;
  make("h3", inside, "", "Path of the robot");
  const figure = make("figure", inside, "paths");
  const size = { width: PATH_SIZE, viewBox: `0 0 ${PATH_SIZE} ${PATH_SIZE}` };
  const svg = makeSvg(figure, { ...size, role: "img", "aria-label": `Path of the robot of ${name}` });
  const goals = paths.filter(({ target }) => target[0] !== null).map(({ target }) => target);
  const [at, scale] = scaleOf([...paths.flatMap(({ points }) => points), ...goals]);
  drawScale(svg, scale);
  paths.forEach((path, i) => drawPath(svg, path, i < paths.length - 1 ? "first" : "this", at));
  make("p", make("figcaption", figure), "", captionOf(paths));
}
