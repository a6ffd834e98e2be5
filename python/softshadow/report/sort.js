// Sorts a table by the column whose heading is pressed; again: the other way round.
// Cells without a number come last either way, and what is marked comes first.
function compare(a, b, way, text) {
  const x = a.textContent, y = b.textContent;
  const missing = (x === "" ? 1 : 0) - (y === "" ? 1 : 0);
  return missing || way * (text ? x.localeCompare(y) : Number(x) - Number(y)) || 0;
}
for (const button of document.querySelectorAll("thead button")) {
  button.addEventListener("click", () => {
    const heading = button.parentElement, column = heading.cellIndex;
    const way = heading.getAttribute("aria-sort") === "ascending" ? -1 : 1;
    for (const other of heading.parentElement.cells) other.removeAttribute("aria-sort");
    heading.setAttribute("aria-sort", way > 0 ? "ascending" : "descending");
    const text = heading.classList.contains("text"), body = heading.closest("table").tBodies[0];
    const rows = [...body.rows];
    rows.sort((a, b) => compare(a.cells[column], b.cells[column], way, text));
    body.append(...rows);
  });
}
// Hides the rows that lack one of the words in the field above the table.
for (const field of document.querySelectorAll("input.filter")) {
  const above = field.closest("p"), rows = above.nextElementSibling.querySelector("tbody").rows;
  field.addEventListener("input", () => {
    const words = field.value.toLowerCase().split(/\s+/);
    let left = 0;
    for (const row of rows) {
      const texts = [...row.querySelectorAll(".text")].map((cell) => cell.textContent.toLowerCase());
      row.hidden = !words.every((word) => texts.some((text) => text.includes(word)));
      left += row.hidden ? 0 : 1;
    }
    above.querySelector("span").textContent = `${left} of ${rows.length}`;
  });
}
