/** What came of a run, in words, as buttons and as a table. */

import { EVENTS, MODES, text } from "./texts.js";

/** @typedef {import("./shown_run.js").DrawnRun} DrawnRun */

const CENTIMETRES = 100;
const TABLE_ROWS = 20;

/** Whether and when the heavy mass halts. @param {DrawnRun} run */
export function resultOf({ halt, dropAtHalt, endOfRun, ending, release, events, modeAtStart }) {
  if (halt !== null && dropAtHalt !== null) {
    return text("halts", { time: halt.toFixed(4), drop: (CENTIMETRES * dropAtHalt).toFixed(1) });
  }
  if (release === "held" || release === "drop") return text(release);
  if (ending === "time_up" && events.length === 1 && modeAtStart === "sticking") return text("stays");
  if (ending === "time_up") return text("goesOn", { time: endOfRun.toFixed(1) });
  return text(release === "vertical" ? "pulledUp" : "neverHalts", { ending: EVENTS[ending], time: endOfRun.toFixed(3) });
}

/** The change against the ghost as numbers. @param {DrawnRun} run @param {DrawnRun | null} ghost */
export function changeOf(run, ghost) {
  if (!ghost || (run.halt === null && ghost.halt === null)) return "";
  if (ghost.halt === null || ghost.dropAtHalt === null) return text("beforeNever");
  const [time, drop] = [ghost.halt.toFixed(4), (CENTIMETRES * ghost.dropAtHalt).toFixed(1)];
  if (run.halt === null || run.dropAtHalt === null) return text("before", { time, drop });
  const moreDrop = signed(CENTIMETRES * (run.dropAtHalt - ghost.dropAtHalt), 1);
  return text("change", { time, drop, moreTime: signed(run.halt - ghost.halt, 4), moreDrop });
}

/** @param {number} change @param {number} digits */
function signed(change, digits) {
  return `${change < 0 ? "−" : "+"}${Math.abs(change).toFixed(digits)}`;
}

/** Fill a list with buttons that go to the events of a run. @param {HTMLElement} list @param {DrawnRun} run
 * @param {(time: number) => void} onTime */
export function showEvents(list, run, onTime) {
  const wanted = run.events.slice(0, TABLE_ROWS);
  const shown = JSON.stringify(wanted);
  if (list.dataset.shown === shown) return;
  list.dataset.shown = shown;
  list.replaceChildren(...wanted.map(({ kind, time }) => {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = `${time.toFixed(3)} s: ${EVENTS[kind]}`;
    button.addEventListener("click", () => onTime(time));
    const item = document.createElement("li");
    item.append(button);
    return item;
  }));
}

/** Fill a table with a run. @param {HTMLTableElement} table @param {DrawnRun} run */
export function fillTable(table, run) {
  table.tBodies[0].replaceChildren(...Array.from({ length: TABLE_ROWS + 1 }, (_, i) => {
    const s = run.at((i / TABLE_ROWS) * run.end);
    const row = document.createElement("tr");
    const lengths = [...s.light, s.drop].map((x) => (CENTIMETRES * x).toFixed(1));
    const pulls = [s.lightTension, s.heavyTension].map((pull) => (Number.isNaN(pull) ? "–" : pull.toFixed(3)));
    const numbers = [s.t.toFixed(3), ...lengths, s.turns.toFixed(2), ...pulls];
    for (const words of [...numbers, MODES[/** @type {keyof typeof MODES} */ (s.mode)]]) row.insertCell().textContent = words;
    return row;
  }));
}
