/** What came of a run, in words, as buttons and as a table. */

import { fixed, language, text, withUnit } from "./texts.js";

/** @typedef {import("./shown_run.js").DrawnRun} DrawnRun */

const CENTIMETRES = 100;
const TABLE_ROWS = 20;

/** Whether and when the heavy mass halts. @param {DrawnRun} run */
export function resultOf({ halt, dropAtHalt, endOfRun, ending, release, events, modeAtStart }) {
  if (halt !== null && dropAtHalt !== null) {
    return text("halts", { time: fixed(halt, 4), drop: fixed(CENTIMETRES * dropAtHalt, 1) });
  }
  if (release === "held" || release === "drop") return text(release);
  if (ending === "time_up" && events.length === 1 && modeAtStart === "sticking") return text("stays");
  if (ending === "time_up") return text("goesOn", { time: fixed(endOfRun, 1) });
  const end = { ending: text(`event.${ending}`), time: fixed(endOfRun, 3) };
  const [still, again] = ["sticks", "slips"].map((kind) => events.find((event) => event.kind === kind));
  if (still && again) return text("standsForAWhile", { from: fixed(still.time, 3), until: fixed(again.time, 3), ...end });
  return text(release === "vertical" ? "pulledUp" : "neverHalts", end);
}

/** The change against the ghost as numbers. @param {DrawnRun} run @param {DrawnRun | null} ghost */
export function changeOf(run, ghost) {
  if (!ghost || (run.halt === null && ghost.halt === null)) return "";
  if (ghost.halt === null || ghost.dropAtHalt === null) return text("beforeNever");
  const [time, drop] = [fixed(ghost.halt, 4), fixed(CENTIMETRES * ghost.dropAtHalt, 1)];
  if (run.halt === null || run.dropAtHalt === null) return text("before", { time, drop });
  const moreDrop = signed(CENTIMETRES * (run.dropAtHalt - ghost.dropAtHalt), 1);
  return text("change", { time, drop, moreTime: signed(run.halt - ghost.halt, 4), moreDrop });
}

/** @param {number} change @param {number} digits */
function signed(change, digits) {
  return `${change < 0 ? "−" : "+"}${fixed(Math.abs(change), digits)}`;
}

/** @param {import("./shown_run.js").ShownEvent} event */
export function wordsOf({ kind, time }) {
  return [withUnit(fixed(time, 3), "s"), text(`event.${kind}`)].join(": ");
}

/** Fill a list with buttons that go to the events of a run. @param {HTMLElement} list @param {DrawnRun} run
 * @param {(time: number) => void} onTime */
export function showEvents(list, run, onTime) {
  const wanted = run.events.slice(0, TABLE_ROWS);
  const shown = language() + JSON.stringify(wanted);
  if (list.dataset.shown === shown) return;
  list.dataset.shown = shown;
  list.replaceChildren(...wanted.map((event) => {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = wordsOf(event);
    button.addEventListener("click", () => onTime(event.time));
    const item = document.createElement("li");
    item.append(button);
    return item;
  }));
}

/** Fill a table with a run: rows at even times, and one at each event. @param {HTMLTableElement} table @param {DrawnRun} run */
export function fillTable(table, run) {
  const events = run.events.slice(0, TABLE_ROWS);
  const even = Array.from({ length: TABLE_ROWS + 1 }, (_, i) => (i / TABLE_ROWS) * run.end);
  const times = [...new Set([...even, ...events.map(({ time }) => time)])].sort((a, b) => a - b);
  table.createCaption().textContent = text("tableOfRun", { count: events.length });
  table.tBodies[0].replaceChildren(...times.map((time) => {
    const s = run.at(time);
    const happens = events.filter((event) => event.time === time).map(({ kind }) => text(`event.${kind}`));
    const row = document.createElement("tr");
    row.classList.toggle("event", happens.length > 0);
    const lengths = [...s.light, s.drop].map((x) => fixed(CENTIMETRES * x, 1));
    const pulls = [s.lightTension, s.heavyTension].map((pull) => (Number.isNaN(pull) ? "–" : fixed(pull, 3)));
    const first = Object.assign(document.createElement("th"), { scope: "row", textContent: fixed(s.t, 3) });
    row.append(first);
    const numbers = [...lengths, fixed(s.turns, 2), ...pulls];
    for (const words of [...numbers, text(`mode.${s.mode}`), happens.join("; ")]) row.insertCell().textContent = words;
    return row;
  }));
}
