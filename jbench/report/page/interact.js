
// Filters and legends hide what is of no interest; the address says what is hidden.

const NAMES = ["task", "algorithm", "representation", "source"];
const STATE = "#hide:";
const unwanted = Object.fromEntries(NAMES.map((name) => [name, new Set()]));
const muted = new Map(); // labels of hidden legend entries by the id of their figure

function isUnwanted(tags) {
  return NAMES.some((name) => unwanted[name].has(tags[name]));
}

function isMuted(id, labels) {
  return labels.some((label) => muted.get(id)?.has(label));
}

function labelsOf(figure) {
  return [...figure.querySelectorAll(".legend > li")].map((entry) => entry.textContent);
}

function showFigure(figure) {
  const labels = labelsOf(figure);
  figure.querySelectorAll("[data-of]").forEach((series) => {
    const entries = series.dataset.of.split(" ").map((entry) => labels[entry]);
    series.classList.toggle("gone", isUnwanted(series.dataset) || isMuted(figure.id, entries));
  });
  figure.querySelectorAll("svg[role]").forEach((panel) => {
    const series = [...panel.querySelectorAll("[data-of]")];
    const gone = series.length > 0 && series.every((one) => isUnwanted(one.dataset));
    panel.classList.toggle("gone", gone);
  });
  figure.querySelectorAll(".legend button").forEach((button) => {
    button.setAttribute("aria-pressed", String(!isMuted(figure.id, [button.textContent])));
  });
}

function showAll() {
  document.querySelectorAll("figure").forEach(showFigure);
  document.querySelectorAll("tr[data-tags]").forEach((row) => {
    row.classList.toggle("gone", isUnwanted(row.dataset));
  });
  document.querySelectorAll(".filters input").forEach((input) => {
    input.checked = !unwanted[input.name].has(input.value);
  });
  const count = NAMES.reduce((sum, name) => sum + unwanted[name].size, 0);
  const summary = document.querySelector(".filters summary");
  if (summary) summary.textContent = count ? `Filter (${count} hidden)` : "Filter";
}

function write() {
  const state = new URLSearchParams();
  NAMES.forEach((name) => unwanted[name].forEach((value) => state.append(name, value)));
  muted.forEach((labels, id) => labels.forEach((label) => state.append(`in ${id}`, label)));
  const text = state.toString();
  history.replaceState(null, "", text ? STATE + text : location.pathname + location.search);
}

function read() {
  if (!location.hash.startsWith(STATE)) return;
  NAMES.forEach((name) => unwanted[name].clear());
  muted.clear();
  new URLSearchParams(location.hash.slice(STATE.length)).forEach((value, name) => {
    if (NAMES.includes(name)) unwanted[name].add(value);
    else if (name.startsWith("in ")) toggle(name.slice(3), value);
  });
}

function toggle(id, label) {
  const labels = muted.get(id) ?? new Set();
  if (!labels.delete(label)) labels.add(label);
  muted.set(id, labels);
}

function changed() {
  write();
  showAll();
}

// Pointing at an entry of a legend, or focusing it, makes the other lines faint.
function emphasise(figure, entry) {
  figure.querySelectorAll("[data-of]").forEach((series) => {
    const faint = entry !== null && !series.dataset.of.split(" ").includes(entry);
    series.classList.toggle("faint", faint);
  });
}

function makeLegend(figure) {
  figure.querySelectorAll(".legend > li[data-entry]").forEach((item) => {
    const button = document.createElement("button");
    button.type = "button";
    button.title = "Hide or show";
    button.append(...item.childNodes);
    item.append(button);
    button.addEventListener("click", () => {
      toggle(figure.id, button.textContent);
      changed();
    });
    ["pointerenter", "focus"].forEach((name) =>
      button.addEventListener(name, () => emphasise(figure, item.dataset.entry)),
    );
    ["pointerleave", "blur"].forEach((name) =>
      button.addEventListener(name, () => emphasise(figure, null)),
    );
  });
}

function makeFilters() {
  const tagged = [...document.querySelectorAll("[data-of], tr[data-tags]")];
  const choices = NAMES.map((name) => [
    name,
    [...new Set(tagged.map((one) => one.dataset[name]).filter((value) => value))].sort(),
  ]).filter(([, values]) => values.length > 1);
  if (!choices.length) return;
  const box = document.createElement("details");
  box.className = "filters";
  make("summary", box, "", "Filter");
  const form = make("form", box);
  choices.forEach(([name, values]) => {
    const group = make("fieldset", form);
    make("legend", group, "", name);
    values.forEach((value) => {
      const label = make("label", group);
      const input = make("input", label);
      Object.assign(input, { type: "checkbox", name, value, checked: true });
      label.append(` ${value}`);
      input.addEventListener("change", () => {
        if (input.checked) unwanted[name].delete(value);
        else unwanted[name].add(value);
        changed();
      });
    });
  });
  box.addEventListener("keydown", (event) => {
    if (event.key === "Escape") box.open = false;
  });
  document.querySelector("nav .theme").before(box);
}

// A figure is saved as it is shown, with its legend, in the colors of the light page.

const ROW = 14; // points of a row of the legend

function pictureOf(figure) {
  const whole = figure.querySelector(".drawing > svg[role]").cloneNode(false);
  whole.classList.remove("gone");
  const panels = [...figure.querySelectorAll(".drawing > svg[role]:not(.gone)")];
  let [right, bottom] = [0, 0];
  figure.querySelectorAll(".drawing > .defs").forEach((defs) => whole.append(defs.cloneNode(true)));
  panels.forEach((panel) => {
    const { width, height } = panel.viewBox.baseVal;
    const copy = panel.cloneNode(true);
    copy.querySelectorAll(".gone, .mark").forEach((element) => element.remove());
    Object.entries({ x: right, y: 0, width, height }).forEach(([k, v]) => copy.setAttribute(k, v));
    whole.append(copy);
    right += width;
    bottom = Math.max(bottom, height);
  });
  [...figure.querySelectorAll(".legend > li")].forEach((item) => {
    if (isMuted(figure.id, [item.textContent])) return;
    const swatch = item.querySelector("svg").cloneNode(true);
    Object.entries({ x: 8, y: bottom + 2, width: 26, height: 10 }).forEach(([k, v]) =>
      swatch.setAttribute(k, v),
    );
    const place = { x: 40, y: bottom + 10, "font-size": 8, "font-family": "sans-serif" };
    whole.append(swatch);
    makeMark("text", whole, place).textContent = item.textContent;
    bottom += ROW;
  });
  const size = { width: `${right}pt`, height: `${bottom}pt`, viewBox: `0 0 ${right} ${bottom}` };
  Object.entries(size).forEach(([key, value]) => whole.setAttribute(key, value));
  return { text: new XMLSerializer().serializeToString(whole), width: right, height: bottom };
}

function save(blob, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60000);
}

async function savePng(figure) {
  const { text, width, height } = pictureOf(figure);
  const image = new Image();
  image.src = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(text)}`;
  await image.decode();
  const canvas = document.createElement("canvas");
  Object.assign(canvas, { width: width * 4, height: height * 4 }); // 288 dots per inch
  const context = canvas.getContext("2d");
  context.fillStyle = "#ffffff";
  context.fillRect(0, 0, canvas.width, canvas.height);
  context.drawImage(image, 0, 0, canvas.width, canvas.height);
  canvas.toBlob((blob) => save(blob, `${figure.id}.png`));
}

function makeSaving(figure) {
  const foot = make("p", figure.querySelector("figcaption"), "data saving");
  const button = (name, act) => {
    const made = make("button", foot, "save", `Save ${name}`);
    made.type = "button";
    made.addEventListener("click", act);
  };
  button("SVG", () => {
    const { text } = pictureOf(figure);
    save(new Blob([text], { type: "image/svg+xml" }), `${figure.id}.svg`);
  });
  button("PNG", () => savePng(figure));
}

document.querySelectorAll("figure").forEach((figure) => {
  makeLegend(figure);
  makeSaving(figure);
});
makeFilters();
read();
showAll();
window.addEventListener("hashchange", () => {
  read();
  showAll();
});
