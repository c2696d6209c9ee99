// Tables sort by their headings: up, down, and back to the order of the page.

const collator = new Intl.Collator("en", { numeric: true });

function sortKey(cell) {
  if (cell === undefined || "missing" in cell.dataset) return null;
  const key = cell.dataset.sort ?? cell.textContent;
  return "sort" in cell.dataset && !Number.isNaN(Number(key)) ? Number(key) : key;
}

// Numbers come before texts; what is missing comes last in either direction.
function compare(a, b, direction) {
  if (a === null || b === null) return (a === null) - (b === null);
  if (typeof a !== typeof b) return direction * (typeof a === "number" ? -1 : 1);
  return direction * (typeof a === "number" ? Math.sign(a - b) || 0 : collator.compare(a, b));
}

function makeSortable(table) {
  const body = table.tBodies[0];
  const original = [...body.rows];
  const headings = [...table.tHead.rows[0].cells];
  const next = { none: "ascending", ascending: "descending", descending: "none" };
  headings.forEach((heading, column) => {
    heading.classList.add("sorts");
    heading.setAttribute("aria-sort", "none");
    makeInnerButton(heading, () => {
      const order = next[heading.getAttribute("aria-sort")];
      headings.forEach((other) => other.setAttribute("aria-sort", "none"));
      heading.setAttribute("aria-sort", order);
      const rows = original.map((row) => ({ row, key: sortKey(row.cells[column]) }));
      const direction = order === "ascending" ? 1 : -1;
      if (order !== "none") rows.sort((one, other) => compare(one.key, other.key, direction));
      body.append(...rows.map((entry) => entry.row));
    });
  });
}
