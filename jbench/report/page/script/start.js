// The page follows the system's choice of light or dark until the button is pressed.

function addThemeButton() {
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const button = makeButton(document.querySelector("nav"), "theme", "", () => {
    const root = document.documentElement;
    const now = root.dataset.theme ?? (dark.matches ? "dark" : "light");
    root.dataset.theme = now === "dark" ? "light" : "dark";
  });
  button.title = "Light or dark";
  button.setAttribute("aria-label", button.title);
}

addThemeButton();
document.querySelectorAll("table.sortable").forEach(makeSortable);
document.querySelectorAll("a[download$='.csv.gz']").forEach((link) => {
  link.addEventListener("click", saveUnpacked);
});
document.querySelectorAll("figure").forEach((figure) => {
  makeLegend(figure);
  makeSaving(figure);
});
makeFilters();
listeners.push(showHidden);
document.querySelectorAll("script.values").forEach((block) => {
  const drawing = block.parentElement.querySelector(".drawing");
  new Zoom(new Figure(drawing, JSON.parse(block.textContent)));
});
document.querySelectorAll("script.runs").forEach((block) => {
  const rows = [...block.parentElement.querySelector("tbody").rows];
  new Runs(rows, JSON.parse(block.textContent));
});
readAddress();
showState();
window.addEventListener("hashchange", () => {
  readAddress();
  showState();
  // A link to a section leaves the state as it is, so the address shows it again.
  writeAddress(location.href);
});
