// Sorts a table by the column whose heading is pressed; again: the other way round.
// Rows without a number come last either way.
function compare(a, b, way) {
  const x = a.dataset.value, y = b.dataset.value;
  if (x === undefined && y === undefined) return way * a.textContent.localeCompare(b.textContent);
  const missing = (x === "nan" ? 1 : 0) - (y === "nan" ? 1 : 0);
  return missing || way * (Number(x) - Number(y)) || 0;
}
for (const button of document.querySelectorAll("thead button")) {
  button.addEventListener("click", () => {
    const heading = button.parentElement, column = heading.cellIndex;
    const way = heading.getAttribute("aria-sort") === "ascending" ? -1 : 1;
    for (const other of heading.parentElement.cells) other.removeAttribute("aria-sort");
    heading.setAttribute("aria-sort", way > 0 ? "ascending" : "descending");
    const body = heading.closest("table").tBodies[0];
    const rows = [...body.rows].sort((a, b) => compare(a.cells[column], b.cells[column], way));
    body.append(...rows);
  });
}
