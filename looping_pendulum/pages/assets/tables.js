"use strict";
// Tables that sort by a column: numbers by size, words by the alphabet, gaps last.
(() => {
  /** Number that a cell begins with, or null: "0.41 mm", "+3.2", "1.2e-05 (+1)". */
  function number(text) {
    const found = /^[+\u2212-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?/i.exec(text);
    return found ? Number(found[0].replace("\u2212", "-")) : null;
  }

  function sort(table, column, header) {
    const body = table.tBodies[0], rows = [...body.rows];
    const texts = new Map(rows.map((row) => [row, row.cells[column].textContent.trim()]));
    const gap = (text) => text === "" || text === "\u2013";
    const numeric = [...texts.values()].every((text) => gap(text) || number(text) !== null);
    const upward = header.getAttribute("aria-sort") !== "ascending";
    rows.sort((a, b) => {
      const [s, t] = [texts.get(a), texts.get(b)];
      if (gap(s) || gap(t)) return Number(gap(s)) - Number(gap(t));
      const order = numeric ? number(s) - number(t) : s.localeCompare(t, "en", { numeric: true });
      return upward ? order : -order;
    });
    for (const cell of table.tHead.rows[0].cells) cell.setAttribute("aria-sort", "none");
    header.setAttribute("aria-sort", upward ? "ascending" : "descending");
    body.append(...rows);
  }

  window.addEventListener("beforeprint", () => { for (const part of document.querySelectorAll("details")) part.open = true; });

  for (const table of document.querySelectorAll("main table")) {
    if (!table.tHead || table.tBodies.length !== 1 || table.tBodies[0].rows.length < 2) continue;
    [...table.tHead.rows[0].cells].forEach((header, column) => {
      const button = document.createElement("button");
      button.type = "button";
      button.append(...header.childNodes);
      header.replaceChildren(button);
      header.setAttribute("aria-sort", "none");
      header.scope = "col";
      button.addEventListener("click", () => sort(table, column, header));
    });
  }
})();
