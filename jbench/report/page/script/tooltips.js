// A tip shows the values under the pointer, or those that the arrow keys select.

const TIP_ROWS = 14;
const REACH = 12; // points of the SVG: maximum distance from the pointer to a value of a line
const MARGIN = 4; // points of the SVG around a panel, whose values can be on its edge

const tip = make("div", document.body, "tip");
tip.setAttribute("role", "status");
tip.hidden = true;
let shownBy = null; // the figure whose values the tip shows, or showed last

class Figure {
  constructor(drawing, panels) {
    this.drawing = drawing;
    this.figure = drawing.closest("figure");
    this.svgs = [...drawing.querySelectorAll("svg[role]")];
    this.svg = this.svgs[0];
    this.panels = panels;
    this.index = -1;
    panels.forEach(setPositions);
    drawing.tabIndex = 0;
    drawing.setAttribute("role", "application");
    const keys = "left and right arrows go through the values, up and down through the panels.";
    drawing.setAttribute("aria-label", `${this.svg.getAttribute("aria-label")}: ${keys}`);
    drawing.addEventListener("pointermove", (event) => this.point(event));
    drawing.addEventListener("pointerdown", (event) => this.point(event));
    drawing.addEventListener("pointerleave", () => this.hasKeyboardFocus() || this.hide());
    drawing.addEventListener("keydown", (event) => this.key(event));
    drawing.addEventListener("focus", () => this.hasKeyboardFocus() && this.step(0));
    drawing.addEventListener("blur", () => this.hide());
  }

  hasKeyboardFocus() {
    return this.drawing.matches(":focus-visible");
  }

  // Finds the panel under the pointer, and the position in its SVG.
  locate(event) {
    this.svg = event.target.closest?.("svg[role]") ?? this.svgs[0];
    const { x, y } = pointIn(this.svg, event);
    const inside = ({ box: [left, top, right, bottom] }) =>
      x >= left - MARGIN && x <= right + MARGIN && y >= top - MARGIN && y <= bottom + MARGIN;
    return { panel: this.panels.find(inside), x, y };
  }

  point(event) {
    if (this.isDragged) return;
    const { panel, x, y } = this.locate(event);
    if (panel) this.show(panel, x, y);
    else this.hide();
  }

  key(event) {
    const direction = { ArrowLeft: -1, ArrowRight: 1, ArrowUp: -1, ArrowDown: 1 }[event.key];
    if (event.key === "Escape") this.hide();
    if (!direction) return;
    event.preventDefault();
    if (["ArrowLeft", "ArrowRight"].includes(event.key)) return this.step(direction, event.shiftKey);
    const shown = this.shownPanels();
    this.chosen = shown.at((shown.indexOf(this.panel) + direction) % shown.length);
    this.index = -1;
    this.step(0);
  }

  shownLines(panel) {
    const labels = labelsOf(this.figure);
    return panel.lines.filter(({ tags, of }) => !isHidden(this.figure, labels, tags, of));
  }

  shownPanels() {
    return this.panels.filter((panel) => panel.grid || this.shownLines(panel).length);
  }

  // The panel whose values the arrow keys select.
  get panel() {
    const shown = this.shownPanels();
    return shown.includes(this.chosen) ? this.chosen : (shown[0] ?? this.panels[0]);
  }

  // The line whose values the arrow keys select.
  longest(panel) {
    return this.shownLines(panel).reduce((a, b) => (b.x.length > a.x.length ? b : a), { x: [] });
  }

  // The horizontal value that the arrow keys have selected.
  value() {
    return this.longest(this.panel).x[this.index];
  }

  goTo(value) {
    const { x } = this.longest(this.panel);
    this.index = x.findIndex((one) => one >= value);
    this.step(0);
  }

  // Moves through the values of the panel's longest line, or its cells; with Shift one by one.
  step(direction, single) {
    const { panel } = this;
    const longest = this.longest(panel);
    const count = panel.grid ? panel.grid.values.flat().length : longest.x.length;
    if (!count) return this.hide();
    const pace = single || panel.grid ? 1 : Math.max(1, Math.round(count / 40));
    const start = panel.grid ? 0 : count - 1;
    this.index = this.index < 0 ? start : this.index + direction * pace;
    this.index = Math.min(count - 1, Math.max(0, this.index));
    if (!panel.grid) return this.show(panel, ...longest.at[this.index]);
    const width = panel.columns.length - 1;
    const [column, row] = [this.index % width, Math.floor(this.index / width)];
    this.show(panel, center(panel.columns, column), center(panel.rows, row));
  }

  show(panel, x, y) {
    shownBy?.hide();
    shownBy = this;
    this.svg = this.svgs[panel.number] ?? this.svgs[0];
    this.mark = makeSvgElement("g", this.svg, { class: "mark" });
    const at = panel.grid ? this.showCell(panel, x, y) : this.showValues(panel, x, y);
    if (!at) return this.hide();
    tip.hidden = false;
    this.moveTip(...at);
  }

  hide() {
    this.mark?.remove();
    if (shownBy !== this) return;
    tip.hidden = true;
    tip.replaceChildren();
  }

  // Shows the value of a heat map's cell; returns the position of the tip, or null.
  showCell(panel, x, y) {
    const [column, row] = [between(panel.columns, x), between(panel.rows, y)];
    const value = panel.grid.values[row]?.[column];
    if (value === undefined || value === null) return null;
    const [left, right] = [panel.columns[column], panel.columns[column + 1]];
    const [bottom, top] = [panel.rows[row], panel.rows[row + 1]];
    const [x0, y0] = [Math.min(left, right), Math.min(top, bottom)];
    const size = { width: Math.abs(right - left), height: Math.abs(top - bottom) };
    makeSvgElement("rect", this.mark, { x: x0, y: y0, ...size });
    if (panel.title) make("p", tip, "title", panel.title);
    make("p", tip, "", labeled(panel.x, center(panel.grid.x, column)));
    make("p", tip, "", labeled(panel.y, center(panel.grid.y, row)));
    make("p", tip, "near", `${panel.grid.label || "value"}: ${inWords(value)}`);
    return [(left + right) / 2, Math.min(top, bottom)];
  }

  // Shows the values of all lines near here; returns the position of the tip, or null.
  showValues(panel, x, y) {
    const rows = this.shownLines(panel)
      .filter((line) => line.x.length)
      .map((line) => ({ line, i: nearest(line, x) }))
      .filter(({ line, i }) => Math.abs(line.at[i][0] - x) <= REACH)
      .sort((a, b) => b.line.y[b.i] - a.line.y[a.i]);
    if (!rows.length) return null;
    const distance = ({ line, i }) => Math.hypot(line.at[i][0] - x, line.at[i][1] - y);
    const near = rows.reduce((a, b) => (distance(b) < distance(a) ? b : a));
    // Where rows have names, the values of one row belong together.
    if (panel.y.ticks) return this.showNamedRow(panel, near);
    const [nearX] = near.line.at[near.i];
    const [, top, , bottom] = panel.box;
    makeSvgElement("line", this.mark, { x1: nearX, x2: nearX, y1: top, y2: bottom });
    if (panel.title) make("p", tip, "title", panel.title);
    make("p", tip, "", labeled(panel.x, near.line.x[near.i]));
    const list = make("ul", tip);
    const shown = new Set([...rows.slice(0, TIP_ROWS - 1), near]);
    rows.filter((row) => shown.has(row)).forEach((row) => this.addRow(panel, list, row, near));
    if (rows.length > shown.size) make("p", tip, "soft", `and ${rows.length - shown.size} more`);
    return [nearX, Math.min(Math.max(near.line.at[near.i][1], top), bottom)];
  }

  showNamedRow(panel, near) {
    const [x, y] = near.line.at[near.i];
    makeSvgElement("circle", this.mark, { cx: x, cy: y, r: 3.5 }).style.fill = near.line.color;
    const name = textOf(panel.y, near.line.y[near.i]);
    make("p", tip, "title", [panel.title, name].filter((text) => text).join(", "));
    make("p", tip, "", near.line.label);
    const [low, high] = near.line.bands[0]?.[near.i] ?? [];
    const interval = low === undefined ? "" : ` [${inWords(low)}, ${inWords(high)}]`;
    make("p", tip, "near", labeled(panel.x, near.line.x[near.i]) + interval);
    return [x, y];
  }

  addRow(panel, list, { line, i }, near) {
    const item = make("li", list, line === near.line ? "near" : "");
    make("span", item, "swatch").style.background = line.color;
    make("span", item, "", line.label);
    const bands = line.bands
      .map((band) => band[i])
      .filter((band) => band)
      .map(([low, high]) => ` [${inWords(low * panel.y.unit)}, ${inWords(high * panel.y.unit)}]`);
    // Lines that were sampled at other steps show at which.
    const apart = Math.abs(line.at[i][0] - near.line.at[near.i][0]) > 1;
    const where = apart ? ` at ${textOf(panel.x, line.x[i])}` : "";
    make("span", item, "value", textOf(panel.y, line.y[i]) + bands.join("") + where);
    const [cx, cy] = line.at[i];
    const dot = makeSvgElement("circle", this.mark, { cx, cy, r: line === near.line ? 3.5 : 2.5 });
    dot.style.fill = line.color;
  }

  moveTip(x, y) {
    const at = new DOMPoint(x, y).matrixTransform(this.svg.getScreenCTM());
    tip.style.left = "0"; // its width must not depend on its last position
    const { width, height } = tip.getBoundingClientRect();
    const room = { x: document.documentElement.clientWidth - width - 8, y: innerHeight - height - 8 };
    const [right, left] = [at.x + 16, at.x - 16 - width];
    tip.style.left = `${Math.max(8, Math.min(right <= room.x ? right : left, room.x))}px`;
    // Where it has no room beside the value, as on a phone, it is below or above the panel.
    const panel = this.svg.getBoundingClientRect();
    const outside = panel.bottom <= room.y ? panel.bottom : panel.top - height;
    const top = right <= room.x || left >= 8 ? at.y - height / 2 : outside;
    tip.style.top = `${Math.max(8, Math.min(top, room.y))}px`;
  }
}
