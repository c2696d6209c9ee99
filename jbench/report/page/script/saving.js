// A figure is saved as it is shown, with its legend, in the colors of the light page.

const ROW = 14; // points of a row of the legend

function save(blob, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60000);
}

function pictureOf(figure) {
  const panels = [...figure.querySelectorAll(".drawing > svg[role]:not(.gone)")];
  const whole = panels[0].cloneNode(false);
  ["role", "aria-label"].forEach((name) => whole.removeAttribute(name)); // those of its first panel
  let [x, y, right, bottom, last] = [0, 0, 0, 0, -Infinity];
  panels.forEach((panel) => {
    const { left } = panel.getBoundingClientRect();
    if (left <= last) [x, y] = [0, bottom]; // the first of a row on the page
    const { width, height } = panel.viewBox.baseVal;
    const copy = panel.cloneNode(true);
    copy.querySelectorAll(".gone, .mark").forEach((element) => element.remove());
    setAttributes(copy, { x, y, width, height });
    whole.append(copy);
    [x, last] = [x + width, left];
    [right, bottom] = [Math.max(right, x), Math.max(bottom, y + height)];
  });
  figure.querySelectorAll(".legend > li:not(.gone)").forEach((item) => {
    const label = item.textContent;
    if (isMuted(figure, label)) return;
    const swatch = item.querySelector("svg").cloneNode(true);
    setAttributes(swatch, { x: 8, y: bottom + 2, width: 26, height: 10 });
    whole.append(swatch);
    makeSvgElement("text", whole, { x: 40, y: bottom + 10, "font-size": 8 }).textContent = label;
    bottom += ROW;
  });
  const size = { width: `${right}pt`, height: `${bottom}pt`, viewBox: `0 0 ${right} ${bottom}` };
  setAttributes(whole, { ...size, "font-family": "sans-serif" });
  return { text: new XMLSerializer().serializeToString(whole), width: right, height: bottom };
}

function saveSvg(figure) {
  const { text } = pictureOf(figure);
  save(new Blob([text], { type: "image/svg+xml" }), `${figure.id}.svg`);
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
  makeButton(foot, "save", "Save SVG", () => saveSvg(figure));
  makeButton(foot, "save", "Save PNG", () => savePng(figure));
}

// Large data are packed in their links; a click unpacks them before they are saved.
async function saveUnpacked(event) {
  event.preventDefault();
  const { href, download } = event.currentTarget;
  const packed = Uint8Array.from(atob(href.split(",")[1]), (byte) => byte.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  save(await new Response(stream).blob(), download.replace(/\.gz$/, ""));
}
