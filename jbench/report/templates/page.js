// Legends, tips, switches, saved figures, sorted and filtered tables, the theme, and single runs.
const all = (selector, inside = document) => [...inside.querySelectorAll(selector)];
const set = (element, attributes) => {
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  return element;
};
const make = (name, attributes, parent) => set(parent.appendChild(document.createElementNS("http://www.w3.org/2000/svg", name)), attributes);
document.getElementById("theme").onclick = () => {
  const { dataset } = document.documentElement, system = matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
  dataset.theme = (dataset.theme ?? system) === "dark" ? "light" : "dark";
};

// Legends: a click hides a series or shows it, a double click or Shift shows only this one.
for (const figure of all("section:has(> .legend)")) {
  const entries = all(".legend button", figure);
  const isOn = (entry) => entry.getAttribute("aria-pressed") === "true";
  const show = (shown) => {
    entries.forEach((entry) => entry.setAttribute("aria-pressed", shown(entry)));
    const hidden = new Set(entries.filter((entry) => !isOn(entry)).map((entry) => entry.dataset.series));
    for (const mark of all("svg [data-series]", figure)) mark.style.display = hidden.has(mark.dataset.series) ? "none" : "";
  };
  for (const entry of entries) {
    entry.onclick = (event) => {
      const others = entries.some((other) => other !== entry && isOn(other));
      if (event.detail === 2 || event.shiftKey) show(others || !isOn(entry) ? (one) => one === entry : () => true);
      else show((one) => (one === entry ? !isOn(one) : isOn(one)));
    };
  }
}

// Switches exchange the versions of a figure.
for (const button of all("[data-switch]")) {
  const { classList } = button.closest("section");
  button.onclick = () => button.dataset.switch.split(" ").forEach((name) => classList.toggle(name));
}

// Saved figures have colors of their own, because a file has no stylesheet.
const save = (blob, name) => Object.assign(document.createElement("a"), { href: URL.createObjectURL(blob), download: name }).click();
const asFile = (svg) => {
  const { width, height } = svg.viewBox.baseVal;
  const copy = svg.cloneNode(true);
  all(".g", copy).forEach((line) => set(line, { fill: "none", stroke: "var(--line)", "stroke-width": 0.8 }));
  all("[data-series]", copy).filter((mark) => mark.style.display === "none").forEach((mark) => mark.remove());
  const legend = all(".legend button", svg.closest("section")).filter(({ dataset }) => copy.querySelector(`[data-series="${dataset.series}"]`));
  let [x, y] = [width, height - 12];
  for (const { firstChild, textContent } of legend) {
    if (x + 36 + 5.2 * textContent.length > width) [x, y] = [6, y + 14];
    set(copy.appendChild(firstChild.cloneNode(true)), { x, y, width: 25, height: 7 });
    make("text", { x: x + 30, y: y + 7, "font-size": 9, fill: "currentColor" }, copy).textContent = textContent;
    x += 44 + 5.2 * textContent.length;
  }
  const size = { width, height: y + 12 };
  set(copy, { ...size, viewBox: `0 0 ${width} ${size.height}`, "font-family": "sans-serif" });
  copy.prepend(make("rect", { ...size, fill: "#fff" }, copy));
  const colors = { currentColor: "#000", "var(--line)": "#e1e5ea", "var(--soft)": "#566070", "var(--card)": "#fff" };
  return Object.entries(colors).reduce((text, [name, color]) => text.replaceAll(name, color), new XMLSerializer().serializeToString(copy));
};
const drawPng = async (text, name) => {
  const image = new Image();
  image.src = `data:image/svg+xml,${encodeURIComponent(text)}`;
  await image.decode();
  const canvas = Object.assign(document.createElement("canvas"), { width: 1600, height: (1600 * image.height) / image.width });
  canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
  canvas.toBlob((blob) => save(blob, name));
};
for (const button of all("[data-action]")) {
  const figure = button.closest("section"), { action } = button.dataset;
  button.onclick = () => {
    if (action === "enlarge") button.textContent = figure.classList.toggle("enlarged") ? "Reduce" : "Enlarge";
    else all(".panel > svg", figure).filter((svg) => svg.checkVisibility()).forEach((svg, i) => {
      const name = `${figure.id}-${i + 1}.${action}`;
      if (action === "png") drawPng(asFile(svg), name);
      else save(new Blob([asFile(svg)], { type: "image/svg+xml" }), name);
    });
  };
}

// Tips: the title of the mark nearest to the pointer or finger, at once; the browser's own comes late.
// Text and marks stop growing with their panel at 14 pixels.
const fit = new ResizeObserver((panels) => panels.forEach(({ target, contentRect }) =>
  target.style.setProperty("--shrink", Math.min(1, (1.6 * target.querySelector("svg").viewBox.baseVal.width) / contentRect.width))));
const tip = document.body.appendChild(Object.assign(document.createElement("div"), { className: "tip", hidden: true }));
for (const panel of all(".panel")) {
  const marks = all("title", panel).map((title) => [title.parentNode, title.textContent]);
  marks.forEach(([mark]) => mark.querySelector("title").remove());
  fit.observe(panel);
  panel.onpointerleave = () => (tip.hidden = true);
  panel.onpointermove = panel.onpointerdown = ({ clientX, clientY }) => {
    let [nearest, text] = [24, ""];
    for (const [mark, title] of marks) {
      const box = mark.getBoundingClientRect();
      const away = Math.hypot(box.x + box.width / 2 - clientX, box.y + box.height / 2 - clientY);
      if ((box.width || box.x) && away < nearest) [nearest, text] = [away, title];
    }
    tip.hidden = !text;
    tip.textContent = text;
    tip.style.left = `${Math.max(8, Math.min(clientX + 14, innerWidth - tip.offsetWidth - 8))}px`;
    tip.style.top = `${Math.min(clientY + 14, innerHeight - 40)}px`;
  };
}

// Tables: a click on a heading sorts, the fields above filter.
for (const table of all(".sortable")) {
  const body = table.tBodies[0], heads = [...table.tHead.rows[0].cells];
  for (const { cells } of body.rows) heads.forEach((head, i) => (cells[i].dataset.title = head.textContent));
  const value = ({ dataset, textContent }) => (dataset.value === undefined ? textContent : dataset.value === "" ? -Infinity : +dataset.value);
  heads.forEach((head, i) => {
    head.firstChild.onclick = () => {
      const sign = head.ariaSort === "ascending" ? -1 : 1;
      heads.forEach((other) => other.removeAttribute("aria-sort"));
      head.ariaSort = sign > 0 ? "ascending" : "descending";
      const compare = (a, b) => (a > b ? sign : a < b ? -sign : 0);
      body.append(...[...body.rows].sort((a, b) => compare(value(a.cells[i]), value(b.cells[i]))));
    };
  });
  const section = table.closest("section"), fields = all("select, input", section), count = section.querySelector("output");
  const filter = () => {
    const passes = (row) => ({ dataset: { column }, value: text }) =>
      !text || (column ? row.cells[column].textContent === text : row.textContent.toLowerCase().includes(text.toLowerCase()));
    for (const row of body.rows) row.hidden = !fields.every(passes(row));
    count.textContent = `${[...body.rows].filter((row) => !row.hidden).length} of ${body.rows.length}`;
  };
  fields.forEach((field) => (field.oninput = filter));
  if (count) filter();
}

// A row of the runs opens the run.
const data = document.getElementById("runs-data");
if (data) {
  const { runs, settings, steps, origins } = JSON.parse(data.textContent), dialog = document.getElementById("run");
  const other = dialog.querySelector("label select");
  const rows = all("tr[data-run]"), runName = (i) => rows[i].lastElementChild.textContent;
  runs.forEach((run, i) => other.add(new Option(runName(i), i)));
  const polyline = (points) => `M${points.map((point) => point.join(" ")).join("L")}`;
  const drawCurve = (svg, [name, number, values]) => {
    const at = steps[number], usual = name.endsWith(" return") ? [0] : [], last = at.at(-1) || 1;
    const top = Math.max(...usual, ...values), bottom = Math.min(...usual, ...values, top - 1e-6 * Math.abs(top) - 1e-12);
    svg.replaceChildren();
    const x = (step) => 40 + (310 * step) / last, y = (value) => 195 - (185 * (value - bottom)) / (top - bottom);
    for (const level of [bottom, (top + bottom) / 2, top]) {
      make("path", { class: "grid", d: `M40 ${y(level)}H350` }, svg);
      make("text", { x: 34, y: y(level) + 4, "text-anchor": "end" }, svg).textContent = +level.toPrecision(3);
    }
    make("text", { x: 350, y: 214, "text-anchor": "end" }, svg).textContent = `${last.toLocaleString("en")} steps`;
    make("path", { class: "mark", d: polyline(at.map((step, i) => [x(step), y(values[i])])) }, svg);
  };
  const drawPaths = (svg, paths) => {
    const read = ({ points }) => points.flatMap((_, i) => (i % 2 ? [] : [[points[i] / 1e4, points[i + 1] / 1e4]]));
    const goals = paths.filter((path) => "x" in path).map((path) => [path.x, path.y]), inside = [...paths.flatMap(read), ...goals];
    const [xs, ys] = [0, 1].map((i) => inside.map((point) => point[i]));
    const middle = (values) => (Math.max(...values) + Math.min(...values)) / 2;
    const extent = Math.max(0.02, ...[xs, ys].map((values) => Math.max(...values) - Math.min(...values)));
    const place = ([x, y]) => [110 + (180 * (x - middle(xs))) / extent, 110 - (180 * (y - middle(ys))) / extent];
    paths.forEach((path, i) => {
      const points = read(path).map(place), [x, y] = points.at(-1), goal = "x" in path ? place([path.x, path.y]) : points[0];
      if ("x" in path) make("circle", { class: "goal", cx: goal[0], cy: goal[1], r: 8 }, svg);
      if ("yaw" in path) make("path", { class: "goal", d: `M${goal.join(" ")}l${60 * Math.cos(path.yaw)} ${-60 * Math.sin(path.yaw)}` }, svg);
      make("path", { class: i < paths.length - 1 ? "first" : "mark", d: polyline(points) }, svg);
      const turn = (-path.heading * 180) / Math.PI;
      make("path", { class: "end", d: "M8 0L-5 5L-2 0L-5 -5Z", transform: `translate(${x} ${y}) rotate(${turn})` }, svg);
    });
    make("text", { x: 8, y: 214 }, svg).textContent = `${Math.round(extent * 100)} cm across`;
  };
  const compare = (run) => {
    const [mine, theirs] = [run, runs[other.value]].map((one) => new Map(one.settings.map((i) => settings[i])));
    const names = [...new Set([...mine.keys(), ...theirs.keys()])];
    const differs = (name) => mine.get(name) !== theirs.get(name);
    const body = dialog.querySelector("tbody");
    body.replaceChildren();
    for (const name of [...names.filter(differs), ...names.filter((name) => !differs(name))]) {
      const row = body.insertRow();
      [name, mine.get(name) ?? "not set", differs(name) ? theirs.get(name) ?? "not set" : "same"].forEach((text) => (row.insertCell().textContent = text));
    }
  };
  const open = (i) => {
    const run = runs[i], [chart, path] = all(".drawings > div", dialog), [curve, svg] = chart.children;
    path.lastElementChild.replaceChildren();
    const facts = [...rows[i].cells].slice(0, -1).filter((cell) => cell.textContent)
      .map(({ className, dataset, textContent }) => (className ? `${dataset.title} ${textContent}` : textContent));
    dialog.querySelector("h2").textContent = runName(i);
    dialog.querySelector(".facts").textContent = [...facts, run.diverged].filter(Boolean).join(", ");
    dialog.querySelector(".origin").textContent = run.origin.map((number) => origins[number]).join("; ");
    chart.hidden = !run.curves.length;
    path.hidden = !run.paths.length;
    curve.replaceChildren(...run.curves.map(([name], i) => new Option(name, i)));
    curve.onchange = () => drawCurve(svg, run.curves[curve.value]);
    if (run.curves.length) curve.onchange();
    if (run.paths.length) drawPaths(path.lastElementChild, run.paths);
    other.value = i > 0 ? i - 1 : Math.min(1, runs.length - 1);
    other.onchange = () => compare(run);
    compare(run);
    dialog.showModal();
  };
  rows.forEach((row, i) => (row.onclick = () => open(i)));
}
