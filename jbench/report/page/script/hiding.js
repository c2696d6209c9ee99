// Legends hide and emphasize series; filters hide series, panels and rows.

// Whether there are series with this selector, all of which the filters hide.
function areUnwanted(parent, selector) {
  const series = [...parent.querySelectorAll(selector)];
  return series.length > 0 && series.every((one) => isUnwanted(one.dataset));
}

function showFigure(figure) {
  const labels = labelsOf(figure);
  figure.querySelectorAll("[data-of]").forEach((series) => {
    const of = series.dataset.of.split(" ");
    series.classList.toggle("gone", isHidden(figure, labels, series.dataset, of));
  });
  const panels = [...figure.querySelectorAll("svg[role]")];
  panels.forEach((panel) => panel.classList.toggle("gone", areUnwanted(panel, "[data-of]")));
  const nothing = panels.every((panel) => panel.classList.contains("gone"));
  figure.querySelector(".saving")?.classList.toggle("gone", nothing);
  figure.querySelectorAll(".legend > li[data-entry]").forEach((item) => {
    item.classList.toggle("gone", areUnwanted(figure, `[data-of~="${item.dataset.entry}"]`));
  });
  figure.querySelectorAll(".legend button").forEach((button) => {
    button.setAttribute("aria-pressed", String(!isMuted(figure, button.textContent)));
  });
}

function showHidden() {
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

// Pointing at an entry of a legend, or focusing it, makes the other lines faint.
function emphasize(figure, entry) {
  figure.querySelectorAll("[data-of]").forEach((series) => {
    const faint = entry !== null && !series.dataset.of.split(" ").includes(entry);
    series.classList.toggle("faint", faint);
  });
}

function makeLegend(figure) {
  figure.querySelectorAll(".legend > li[data-entry]").forEach((item) => {
    const button = makeInnerButton(item, () => {
      toggle(figure.id, item.textContent);
      changed();
    });
    button.title = "Hide or show";
    ["pointerenter", "focus"].forEach((name) =>
      button.addEventListener(name, () => emphasize(figure, item.dataset.entry)),
    );
    ["pointerleave", "blur"].forEach((name) =>
      button.addEventListener(name, () => emphasize(figure, null)),
    );
  });
}

function makeChoice(group, name, value) {
  const label = make("label", group);
  const input = make("input", label);
  Object.assign(input, { type: "checkbox", name, value, checked: true });
  label.append(` ${value}`);
  input.addEventListener("change", () => {
    if (input.checked) unwanted[name].delete(value);
    else unwanted[name].add(value);
    changed();
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
    values.forEach((value) => makeChoice(group, name, value));
  });
  box.addEventListener("keydown", (event) => {
    if (event.key !== "Escape") return;
    box.open = false;
    box.firstChild.focus();
  });
  document.querySelector("nav .theme").before(box);
}
