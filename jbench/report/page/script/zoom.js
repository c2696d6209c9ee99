// A drag across a panel zooms into its horizontal axis; a double click shows all of it again.

const DRAG = 5; // points of the SVG from which a movement is a drag
const LEAST = 0.05; // of an axis: the drawing is as precise as a tenth of a point
const TICKS = 5;

// Limits within an axis, and not too close; all of the axis if they make no sense.
function clamped(axis, limits) {
  const [low, high] = limits.map((limit) => position(axis, limit, 0, 1));
  if (low >= 0 && high <= 1 && high - low >= LEAST) return limits;
  const half = Math.max(high - low, LEAST) / 2;
  const middle = Math.min(Math.max((low + high) / 2, half), 1 - half);
  if (!(low < high && half < 0.5)) return axis.limits;
  return [middle - half, middle + half].map((share) => valueAt(axis, share, 0, 1));
}

function isSame(one, other) {
  return one.every((limit, i) => limit === other[i]);
}

// What moves with the values of a panel: attributes of its lines, areas and markers.
function movingParts(group) {
  const parts = [...group.querySelectorAll("[clip-path], [clip-path] *, [data-of] *")].filter(
    (part) => !part.closest("[data-tick]"),
  );
  // An area is used at 0, with positions in its path; a marker is used at each position.
  const markers = parts.filter((part) => part.matches("use") && Number(part.getAttribute("x")));
  const shapes = new Set(markers.map((marker) => marker.getAttribute("href").slice(1)));
  const paths = parts.filter((part) => part.matches("path") && !shapes.has(part.id));
  const found = (name) => (part) => ({ part, name, value: part.getAttribute(name) });
  return [...markers.map(found("x")), ...paths.map(found("d"))];
}

function replaceTicks(group, panel) {
  const [left, top, right, bottom] = panel.box;
  const drawn = [...group.querySelectorAll("[data-tick=x]")];
  drawn.forEach((tick) => tick.classList.toggle("gone", panel.isZoomed));
  group.querySelector(".ticks")?.remove();
  if (!panel.isZoomed) return;
  const ticks = makeSvgElement("g", group, { class: "ticks" });
  drawn[0].before(ticks);
  const draw = (axis, start, grid, length, label) =>
    ticksOf(axis, TICKS).forEach((value) => {
      const x = position(axis, value, left, right);
      const line = (d, look) => makeSvgElement("path", ticks, { d: `M${x} ${start}${d}`, ...look });
      line(`v${grid}`, { stroke: "#ebebeb", "stroke-width": 0.6 });
      line(`v${length}`, { stroke: "#000000", "stroke-width": 0.8 });
      const look = { x, y: start + label, "font-size": 8, "text-anchor": "middle" };
      makeSvgElement("text", ticks, look).textContent = textOf(axis, value);
    });
  draw(panel.x, bottom, top - bottom, 3.5, 13);
  if (panel.x.opposite) draw({ ...panel.x, unit: panel.x.opposite }, top, 0, -3.5, -6);
}

class Zoom {
  constructor(figure) {
    this.figure = figure;
    this.drawing = figure.drawing;
    this.groups = new Map(
      figure.panels
        .map((panel) => [panel, this.drawing.querySelector(`[data-panel="${panel.number}"]`)])
        // Neither a heat map nor a picture can be stretched.
        .filter(([{ grid }, group]) => !grid && !group.querySelector("image")),
    );
    if (!this.groups.size) return;
    this.groups.forEach((group, panel) => {
      panel.whole = panel.x;
      panel.all = panel.lines;
      panel.parts = movingParts(group);
    });
    this.button = makeButton(figure.figure.querySelector(".saving"), "save", "Reset zoom", () => {
      this.groups.forEach((_, panel) => this.zoom(panel, panel.whole.limits));
      this.drawing.focus();
    });
    const label = `${this.drawing.getAttribute("aria-label")} Plus and minus zoom, 0 shows all of it.`;
    this.drawing.setAttribute("aria-label", label);
    const listen = (name, act) => this.drawing.addEventListener(name, act);
    listen("pointerdown", (event) => this.press(event));
    listen("pointermove", (event) => this.drag(event));
    listen("pointerup", () => this.release());
    listen("pointercancel", () => this.cancel());
    listen("dblclick", (event) => this.reset(event));
    listen("keydown", (event) => this.key(event));
    listeners.push(() => this.show());
  }

  nameOf(panel) {
    return `${this.figure.figure.id} ${panel.number}`;
  }

  zoom(panel, limits) {
    const found = clamped(panel.whole, limits);
    const name = this.nameOf(panel);
    if (isSame(found, panel.whole.limits)) zooms.delete(name);
    else zooms.set(name, found.map((limit) => Number(limit.toPrecision(5))));
    changed();
  }

  show() {
    this.groups.forEach((group, panel) => {
      const limits = zooms.get(this.nameOf(panel)) ?? panel.whole.limits;
      this.showPanel(group, panel, clamped(panel.whole, limits));
    });
    this.button.hidden = [...this.groups.keys()].every((panel) => !panel.isZoomed);
  }

  showPanel(group, panel, limits) {
    if (isSame(limits, panel.x.limits)) return;
    this.figure.hide();
    const [left, , right] = panel.box;
    const [start, end] = limits.map((limit) => position(panel.whole, limit, left, right));
    const moved = (x) => (left + ((x - start) / (end - start)) * (right - left)).toFixed(1);
    const path = (d) => d.replace(/(-?[\d.]+) (-?[\d.]+)/g, (_, x, y) => `${moved(x)} ${y}`);
    panel.isZoomed = !isSame(limits, panel.whole.limits);
    panel.parts.forEach(({ part, name, value }) => {
      const move = name === "x" ? moved : path;
      part.setAttribute(name, panel.isZoomed ? move(value) : value);
    });
    panel.x = { ...panel.whole, limits };
    panel.lines = panel.isZoomed ? panel.all.map((line) => within(line, limits)) : panel.all;
    setPositions(panel);
    replaceTicks(group, panel);
  }

  press(event) {
    const { panel, x } = this.figure.locate(event);
    // A finger scrolls the page.
    if (event.button || event.pointerType === "touch" || !this.groups.has(panel)) return;
    this.pressed = { panel, x, svg: this.figure.svg };
  }

  drag(event) {
    if (!this.pressed) return;
    if (!event.buttons) return this.cancel(); // the button was released outside of the drawing
    const { panel, x: start, svg } = this.pressed;
    const [left, top, right, bottom] = panel.box;
    const end = Math.min(Math.max(pointIn(svg, event).x, left), right);
    if (!this.figure.isDragged && Math.abs(end - start) < DRAG) return;
    this.drawing.setPointerCapture(event.pointerId);
    this.figure.isDragged = true;
    this.figure.hide();
    this.area?.remove();
    this.pressed.end = end;
    this.area = makeSvgElement("g", svg, { class: "mark" });
    const x = Math.max(Math.min(start, end), left);
    const width = Math.max(start, end) - x;
    makeSvgElement("rect", this.area, { class: "area", x, y: top, width, height: bottom - top });
  }

  release() {
    const { panel, x, end } = this.pressed ?? {};
    const isDragged = this.figure.isDragged;
    this.cancel();
    if (!isDragged) return;
    const [left, , right] = panel.box;
    const [low, high] = [x, end].sort((a, b) => a - b);
    this.zoom(panel, [low, high].map((at) => valueAt(panel.x, at, left, right)));
  }

  cancel() {
    this.area?.remove();
    this.pressed = null;
    this.figure.isDragged = false;
  }

  reset(event) {
    const { panel } = this.figure.locate(event);
    if (this.groups.has(panel)) this.zoom(panel, panel.whole.limits);
  }

  // Zooms about the value that is shown.
  key(event) {
    const factor = { "+": 0.5, "=": 0.5, "-": 2, 0: Infinity }[event.key];
    const { panel } = this.figure;
    if (event.key === "Escape") this.cancel();
    if (!factor || event.ctrlKey || event.metaKey || !this.groups.has(panel)) return;
    event.preventDefault();
    const value = this.figure.value();
    const share = value === undefined ? 0.5 : position(panel.x, value, 0, 1);
    const limits = [share - factor / 2, share + factor / 2].map((at) => valueAt(panel.x, at, 0, 1));
    this.zoom(panel, Number.isFinite(factor) ? limits : panel.whole.limits);
    this.figure.goTo(value);
  }
}
