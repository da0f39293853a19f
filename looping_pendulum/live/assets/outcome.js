/** What came of a run, in words, as buttons and as a table. */

import { html } from "./elements.js";
import { fixed, language, shown, text, withUnit } from "./texts.js";

/** @import { DrawnRun } from "./shown_run.js" */

const CENTIMETRES = 100;
const TABLE_ROWS = 20;

/** How a run ends, in one sentence; in English the one of `runs/outcome.py`. @param {DrawnRun} run */
export function resultOf(run) {
  const { halt, dropAtHalt, endOfRun, ending, release, rests } = run;
  if (halt !== null && dropAtHalt !== null) return text("halts", { time: fixed(halt, 4), place: placeOf(dropAtHalt) });
  if (release === "held" || release === "drop") return text(release);
  const isCut = ending === "time_up";
  const limit = shown(Number(endOfRun.toFixed(3)));
  const end = { ending: text(`event.${ending}`), time: fixed(endOfRun, 3) };
  const last = rests[rests.length - 1];
  const longest = longestOf(rests);
  if (last && last.until === null) {
    // Where a rest as long as this one has ended before, this one may end, too
    if (isCut && longest && longest.length >= endOfRun - last.from) {
      return text("inSteps", { count: rests.length, from: fixed(last.from, 3), time: limit });
    }
    const hangs = release === "vertical";
    if (isCut && last.from === 0 && hangs) return text("stays");
    const light = text(hangs ? "lightHangs" : "lightSwings");
    const then = isCut ? text("soToEnd", { time: limit }) : text("thenEnds", end);
    if (last.from === 0) return text("heldToEnd", { light, then });
    return text("restsAtEnd", { from: fixed(last.from, 3), place: placeOf(last.drop), light, then });
  }
  if (longest) {
    const then = isCut ? text("thenMoves", { time: limit }) : text("thenEnds", end);
    return text(longest.from === 0 ? "heldAtFirst" : "standsForAWhile", { from: fixed(longest.from, 3), until: fixed(longest.until, 3), then });
  }
  if (isCut) return text("goesOn", { time: limit });
  return text(release === "vertical" ? "pulledUp" : "neverHalts", end);
}

/** Why a string that gripped slides again, where that surprises: more friction, and it halts no longer for good; else nothing.
 * @param {DrawnRun} run @param {DrawnRun} withLess */
export function whyNotForGood(run, withLess) {
  const rest = longestOf(run.rests);
  if (withLess.halt === null || run.halt !== null || !rest || rest.from === 0) return "";
  return text("whyNotForGood", { turns: fixed(rest.turns, 2) });
}

/** The longest of the rests that ended. @param {DrawnRun["rests"]} rests */
function longestOf(rests) {
  const ended = rests.flatMap(({ until, ...rest }) => (until === null ? [] : [{ ...rest, until, length: until - rest.from }]));
  return ended.length ? ended.reduce((longest, rest) => (rest.length > longest.length ? rest : longest)) : null;
}

/** Where the heavy mass rests. @param {number} drop below its start [m] */
function placeOf(drop) {
  return text(drop >= 0 ? "below" : "above", { drop: fixed(CENTIMETRES * Math.abs(drop), 1) });
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
  const content = language() + JSON.stringify(wanted);
  if (list.dataset.shown === content) return;
  list.dataset.shown = content;
  list.replaceChildren(...wanted.map((event) => {
    const button = html("button", { type: "button" }, wordsOf(event));
    button.addEventListener("click", () => onTime(event.time));
    return html("li", {}, button);
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
    const lengths = [...s.light, s.drop].map((x) => fixed(CENTIMETRES * x, 1));
    const pulls = [s.lightTension, s.heavyTension].map((pull) => (Number.isNaN(pull) ? "–" : fixed(pull, 3)));
    const cells = [...lengths, fixed(s.turns, 2), ...pulls, text(`mode.${s.mode}`), happens.join("; ")];
    const head = html("th", { scope: "row" }, fixed(s.t, 3));
    return html("tr", { className: happens.length ? "event" : "" }, head, ...cells.map((words) => html("td", {}, words)));
  }));
}
