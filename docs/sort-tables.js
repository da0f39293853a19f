"use strict";
// Sorts a table inside .sortable by the column whose head is clicked, or chosen by keyboard. A number counts by its value, and in a
// column of numbers a cell without one stays last in both directions.
(() => {
  const text = (row, column) => row.cells[column].textContent;

  const sort = (table, column) => {
    const head = table.tHead.rows[0].cells[column];
    const direction = head.getAttribute("aria-sort") === "ascending" ? -1 : 1;
    const rows = [...table.tBodies[0].rows];
    const numeric = rows.some((row) => !isNaN(text(row, column)));
    rows.sort((a, b) => {
      const [x, y] = [text(a, column), text(b, column)];
      if (!numeric) return direction * x.localeCompare(y);
      return isNaN(x) || isNaN(y) ? isNaN(x) - isNaN(y) : direction * (x - y);
    });
    table.tBodies[0].append(...rows);
    for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", direction > 0 ? "ascending" : "descending");
  };

  for (const table of document.querySelectorAll(".sortable table")) {
    [...table.tHead.rows[0].cells].forEach((head, column) => {
      const button = document.createElement("button");
      button.type = "button";
      button.append(...head.childNodes);
      button.addEventListener("click", () => sort(table, column));
      head.append(button);
    });
  }
})();
