// The search loads its index, which browsers refuse for pages opened from a folder.
if (location.protocol === "file:") {
  addEventListener("DOMContentLoaded", () => {
    const note = document.createElement("p");
    note.className = "search-note";
    note.textContent = "The search needs a server: python -m http.server -d build/site";
    document.querySelector("header")?.append(note);
  });
}
