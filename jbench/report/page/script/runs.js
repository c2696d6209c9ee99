// A click on a run opens a dialog: its learning curve, the path of its robot, and how its settings
// differ from another's.

const HEIGHT = 280; // pixels of the chart of a run
const RETURNS = { label: "return", limits: [-15, 1015], unit: 1, ticks: null, log: false };
const SOLVED = 900; // the return from which a task counts as solved

function settingsTable(parent, heads, rows) {
  const table = make("table", make("div", parent, "scroll"));
  const head = make("tr", make("thead", table));
  heads.forEach((text) => (make("th", head, "", text).scope = "col"));
  const body = make("tbody", table);
  rows.forEach(([name, ...texts]) => {
    const row = make("tr", body);
    make("th", row, "", name).scope = "row";
    texts.forEach((text) => make("td", row, "", text ?? "not set"));
  });
}

function drawChart(svg, panel) {
  const [left, top, right, bottom] = panel.box;
  const text = (content, at) => (makeSvgElement("text", svg, at).textContent = content);
  ticksOf(panel.x, 6).forEach((value) => {
    const x = position(panel.x, value, left, right);
    makeSvgElement("path", svg, { class: "grid", d: `M${x} ${top}V${bottom}` });
    text(textOf(panel.x, value), { x, y: bottom + 14, "text-anchor": "middle" });
  });
  ticksOf(panel.y, 5).forEach((value) => {
    const y = position(panel.y, value, bottom, top);
    makeSvgElement("path", svg, { class: "grid", d: `M${left} ${y}H${right}` });
    text(textOf(panel.y, value), { x: left - 6, y: y + 3, "text-anchor": "end" });
  });
  const solved = position(panel.y, SOLVED, bottom, top);
  makeSvgElement("path", svg, { class: "solved", d: `M${left} ${solved}H${right}` });
  text(panel.x.label, { x: (left + right) / 2, y: bottom + 30, "text-anchor": "middle" });
  panel.lines.forEach((line) => {
    const group = makeSvgElement("g", svg, { class: line.kind });
    makeSvgElement("path", group, { d: `M${line.at.map((at) => at.join(" ")).join("L")}` });
    const few = line.at.length <= 40 ? line.at : [];
    few.forEach(([cx, cy]) => makeSvgElement("circle", group, { cx, cy, r: 2.2 }));
  });
}

class Runs {
  constructor(rows, { runs, settings, steps }) {
    this.rows = rows;
    this.runs = runs.map((run) => ({
      ...run,
      settings: new Map(run.settings.map((index) => settings[index])),
      curves: run.curves.map(([label, at, returns]) => ({ label, x: steps[at], y: returns })),
      paths: run.paths.map(readPath),
    }));
    this.dialog = make("dialog", document.body, "run");
    this.dialog.setAttribute("aria-labelledby", "run-name");
    this.dialog.addEventListener("close", () => {
      document.body.append(tip);
      if (opened.run) this.open(null);
    });
    // A click beside the dialog is one on its backdrop.
    this.dialog.addEventListener("click", (event) => {
      if (event.target === this.dialog) this.dialog.close();
    });
    rows.forEach((row, i) => {
      row.classList.add("opens");
      makeInnerButton(row.cells[0], () => this.open(this.runs[i]));
      row.addEventListener("click", (event) => {
        const reads = !getSelection().isCollapsed || event.target.closest("button");
        if (!reads) this.open(this.runs[i]);
      });
    });
    const path = this.runs.some(({ paths }) => paths.length) ? ", the path of its robot" : "";
    const hint = `Open a run to see its learning curve${path}, and how its settings differ from another's.`;
    this.rows[0].closest("section").querySelector("p").append(` ${hint}`);
    listeners.push(() => this.show());
  }

  open(run, against) {
    opened.run = run?.name ?? null;
    opened.against = against?.name ?? null;
    changed();
  }

  // The first other run of its cell, or of all.
  other(run) {
    const others = this.runs.filter((one) => one !== run);
    return others.find(({ cell }) => cell === run.cell) ?? others[0];
  }

  show() {
    const find = (name) => this.runs.find((run) => run.name === name);
    const run = find(opened.run);
    if (!run) return this.dialog.close();
    const chooses = this.dialog.open && document.activeElement.matches(".run select");
    if (!this.dialog.open) this.dialog.showModal(); // before the chart, which is as wide
    this.fill(run, find(opened.against) ?? this.other(run));
    this.dialog.querySelector(chooses ? "select" : "button").focus();
  }

  fill(run, other) {
    this.dialog.replaceChildren(tip);
    const box = make("div", this.dialog, "inside");
    const head = make("header", box);
    make("h2", head, "", run.name).id = "run-name";
    makeButton(head, "save", "Close", () => this.dialog.close());
    if (other) this.makeSelect(box, run, other);
    this.makeCurves(box, run, other);
    makePaths(box, run);
    if (other) this.makeDifference(box, run, other);
    const all = make("details", box);
    make("summary", all, "", `All ${run.settings.size} settings`);
    settingsTable(all, ["setting", "value"], [...run.settings]);
    this.makeProvenance(box, run);
  }

  makeSelect(box, run, other) {
    const label = make("label", box, "against", "Compare with ");
    const select = make("select", label);
    this.runs.forEach((one) => {
      if (one !== run) select.append(new Option(one.name, one.name, false, one === other));
    });
    select.addEventListener("change", () => {
      this.open(run, this.runs.find((one) => one.name === select.value));
    });
  }

  makeDifference(box, run, other) {
    const names = [...new Set([...run.settings.keys(), ...other.settings.keys()])];
    const rows = names
      .map((name) => [name, run.settings.get(name), other.settings.get(name)])
      .filter(([, one, another]) => one !== another);
    make("h3", box, "", `Settings that differ: ${rows.length}`);
    if (rows.length) settingsTable(box, ["setting", "this run", "other run"], rows);
  }

  makeCurves(inside, run, other) {
    const kinds = [[run, "this", "this run"], [other, "other", "other run"]];
    const lines = kinds.flatMap(([one, kind, name]) =>
      (one?.curves ?? []).map((curve, i) => ({
        ...curve,
        kind: `${kind} line${i}`,
        label: `${name}: ${curve.label}`,
        color: kind === "this" ? "var(--ink)" : "var(--accent)",
        bands: [],
        tags: {},
        of: [],
      })),
    );
    if (!lines.length) return make("p", inside, "soft", "These runs have no finished episode yet.");
    const figure = make("figure", inside);
    figure.id = "run-curves";
    const legend = make("ul", make("div", figure, "plot"), "legend");
    const drawing = make("div", figure.firstChild, "drawing");
    const end = Math.max(...lines.flatMap(({ x }) => x));
    const unit = end >= 1e6 ? 1e-6 : 1e-3;
    const steps = `control steps (${unit === 1e-6 ? "millions" : "thousands"})`;
    const x = { label: steps, limits: [0, end], unit, ticks: null, log: false };
    const width = drawing.clientWidth;
    const box = [48, 10, width - 12, HEIGHT - 36];
    const panel = { title: "", number: 0, box, x, y: RETURNS, lines, grid: null };
    const title = `Learning curves of ${run.name}${other ? ` and ${other.name}` : ""}`;
    const size = { width, height: HEIGHT, viewBox: `0 0 ${width} ${HEIGHT}` };
    const svg = makeSvg(drawing, { ...size, role: "img", "aria-label": title });
    new Figure(drawing, [panel]);
    drawChart(svg, panel);
    [...lines, { kind: "solved", label: `solved (${SOLVED})` }].forEach(({ kind, label }) => {
      const item = make("li", legend);
      const swatch = makeSvg(item, { viewBox: "0 0 26 10", width: 26, "aria-hidden": "true" });
      makeSvgElement("path", makeSvgElement("g", swatch, { class: kind }), { d: "M0 5.5H26" });
      make("span", item, "", label);
    });
  }

  // The other columns of its row.
  makeProvenance(box, run) {
    const row = this.rows[this.runs.indexOf(run)];
    const heads = [...row.closest("table").tHead.rows[0].cells];
    const pairs = heads.map((head, i) => [head.textContent, row.cells[i].textContent]);
    const all = make("details", box);
    make("summary", all, "", "Command, versions and machine");
    settingsTable(all, ["name", "value"], pairs.slice(1).filter(([, text]) => text));
  }
}
