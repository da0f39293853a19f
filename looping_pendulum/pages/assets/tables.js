"use strict";
// Tables that sort by a column: numbers by size, words by the alphabet, gaps last. Those with sentences become cards on a phone.
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

  const SENTENCE = 60;  // characters of a cell from which on a narrow column would be mostly blank

  /** Name every cell after its column, and mark tables with sentences: on a phone the style sheet stacks their cells. */
  function label(table) {
    const names = [...table.tHead.rows[0].cells].map((cell) => cell.textContent.trim());
    const rows = [...table.tBodies].flatMap((body) => [...body.rows]);
    for (const row of rows) [...row.cells].forEach((cell, i) => { cell.dataset.label = names[i] ?? ""; });
    const long = rows.some((row) => [...row.cells].some((cell) => cell.textContent.length > SENTENCE));
    table.classList.toggle("cards", long);
  }

  for (const table of document.querySelectorAll("main table")) if (table.tHead) label(table);

  // On a phone the sections below the figures start folded; a link to one opens it
  const folds = [...document.querySelectorAll("details.fold")];
  for (const fold of folds) fold.open = !window.matchMedia("(max-width: 760px)").matches;
  function unfold() {
    const fold = location.hash && document.getElementById(decodeURIComponent(location.hash.slice(1)))?.querySelector("details.fold");
    if (fold) fold.open = true;
  }
  window.addEventListener("hashchange", unfold);
  unfold();

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
