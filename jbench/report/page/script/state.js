// What is hidden, zoomed and open. It is in the page's address, so that a link shows the same.

const NAMES = ["task", "algorithm", "representation", "source"];
const STATE = "#view:";
const unwanted = Object.fromEntries(NAMES.map((name) => [name, new Set()]));
const muted = new Map(); // labels of hidden legend entries by the id of their figure
const zooms = new Map(); // limits of horizontal axes, by figure and number of the panel
const opened = { run: null, against: null }; // names of the run that is open, and of the other one
const listeners = []; // functions that show the state when it has changed

function isUnwanted(tags) {
  return NAMES.some((name) => unwanted[name].has(tags[name]));
}

function isMuted(figure, label) {
  return Boolean(muted.get(figure.id)?.has(label));
}

function labelsOf(figure) {
  return [...figure.querySelectorAll(".legend > li")].map((entry) => entry.textContent);
}

// Returns whether a line is hidden, by its tags and the numbers of its entries among the labels.
function isHidden(figure, labels, tags, of) {
  return isUnwanted(tags) || of.some((entry) => isMuted(figure, labels[entry]));
}

function toggle(id, label) {
  const labels = muted.get(id) ?? new Set();
  if (!labels.delete(label)) labels.add(label);
  muted.set(id, labels);
}

function writeAddress(otherwise = location.pathname + location.search) {
  const state = new URLSearchParams();
  NAMES.forEach((name) => unwanted[name].forEach((value) => state.append(name, value)));
  muted.forEach((labels, id) => labels.forEach((label) => state.append(`in ${id}`, label)));
  zooms.forEach((limits, name) => state.append(`zoom ${name}`, limits.join(" ")));
  Object.entries(opened).forEach(([name, run]) => run && state.append(name, run));
  const text = state.toString();
  history.replaceState(null, "", text ? STATE + text : otherwise);
}

// Whether there is a filter for this value; a link may be of an older report.
function isChoice(name, value) {
  const inputs = [...document.querySelectorAll(".filters input")];
  return inputs.some((input) => input.name === name && input.value === value);
}

function readAddress() {
  if (!location.hash.startsWith(STATE)) return;
  NAMES.forEach((name) => unwanted[name].clear());
  muted.clear();
  zooms.clear();
  Object.assign(opened, { run: null, against: null });
  new URLSearchParams(location.hash.slice(STATE.length)).forEach((value, name) => {
    if (isChoice(name, value)) unwanted[name].add(value);
    else if (name.startsWith("in ")) toggle(name.slice(3), value);
    else if (name in opened) opened[name] = value;
    else if (name.startsWith("zoom ")) zooms.set(name.slice(5), value.split(" ").map(Number));
  });
}

function showState() {
  listeners.forEach((one) => one());
}

function changed() {
  writeAddress();
  showState();
}
