/** Reads a trial's tracked points as `identify` does (`measured/readers.py`), with the same messages (in English). */

import { text } from "../texts.js";
import { largest } from "./arrays.js";
import { count, startOf, timedChannels } from "./clock.js";
import { readColumns } from "./columns.js";
import { clockFaults, withoutCopies, withoutRepeatedRows, withTimeErrors } from "./displaced_rows.js";
import { massOfTrack } from "./masses.js";
import { DataError, dataError, inQuotes, inSentence, listed, quote } from "./messages.js";
import { cellsOf, isPlace, isPosition } from "./names.js";
import { aboutOneAxis, withoutInconsistentRate } from "./rates.js";
import { lastDigits, readTable } from "./table.js";
import { isProject, readProject, sheetsOfProject } from "./tracker_project.js";
import { factorTo, isPixel } from "./units.js";

/** @typedef {import("./clock.js").Channel} Channel */
/** @typedef {import("./clock.js").Notes} Notes */
/** @typedef {import("./clock.js").Series} Series */
/** @typedef {import("./clock.js").Sheet} Sheet */
/** @typedef {import("./names.js").Column} Column */
/** @typedef {import("./masses.js").Places} Places */
/** @typedef {import("./table.js").Table} Table */
/**
 * What is said about a file; `run`: number or name of the run to read, if it has several; a length of "1.4 mm" is that of a pixel.
 * @typedef {{tracks?: Record<string, string>, units?: Record<string, string>, frame_rate?: number | null,
 *   clip_rate?: number | null, run?: string | null}} Options
 */
/** @typedef {{tracks: Record<string, string>, units: Record<string, string>, notes: Notes}} How */
/**
 * `faults`: what the points say against their own times, which nothing but another export puts right; `start`: time by the file's
 * clock that was taken as 0 [s].
 * @typedef {Notes & {channels: Channel[], faults: string[], start: number}} Trial
 */

export { DataError };

/** SI unit of a channel. @param {string} name */
const unitOf = (name) => (name === "angle" ? "rad" : name === "angle_rate" ? "rad/s" : "m");
/** @type {Record<string, string>} */
const DEFAULT_UNITS = { length: "m", time: "s", angle: "rad" };
/** @type {Record<string, string>} */
const KIND_OF_UNIT = { t: "time", x: "length", y: "length", height: "length", angle: "angle" };
/** Largest plausible values; a larger one must be in another unit. @type {Record<string, number>} */
const MAX_VALUE = { m: 1000, light: 20, heavy: 20, rad: 4 * Math.PI, "rad/s": 1000 };

/** Read the bytes of a file, or say in a `DataError` why not.
 * @param {string} file its name @param {Uint8Array} bytes @param {Options} options @returns {Trial} */
export function readTrial(file, bytes, options = {}) {
  const { tracks = {}, run = null, frame_rate: frameRate = null, clip_rate: clipRate = null } = options;
  for (const [key, rate] of Object.entries({ frame_rate: frameRate, clip_rate: clipRate })) {
    const isRate = rate === null || (rate > 0 && rate < Infinity);
    if (!isRate) throw dataError(file, null, "", text("file.rate", { key, value: inSentence(rate) }));
  }
  /** @type {Notes} */
  const notes = { unused: [], assumptions: [] };
  const units = { ...DEFAULT_UNITS, ...options.units };
  const sheets = isProject(file, bytes)
    ? sheetsOfProject(file, bytes, { tracks, units, notes })
    : sheetsOfTable(tableOfPoints(file, bytes), { tracks, units, run, notes });
  for (const sheet of sheets) refuseImplausibleValues(file, sheet);
  const timed = timedChannels(sheets, { file, frameRate, clipRate, notes });
  const start = startOf(timed);
  if (start) notes.assumptions.push(text("assumed.start", { start: inSentence(start, 4) }));
  const fromStart = start ? timed.map((channel) => ({ ...channel, t: channel.t.map((t) => t - start) })) : timed;
  const once = withTimeErrors(withoutCopies(withoutInconsistentRate(fromStart, notes), notes), notes);
  const channels = withoutRepeatedRows(once, notes);
  return { channels, unused: notes.unused, assumptions: [...new Set(notes.assumptions)], faults: clockFaults(channels), start };
}

/** Names of the tracks of a file, without saying which is which. @param {string} file @param {Uint8Array} bytes */
export function tracksOf(file, bytes) {
  if (isProject(file, bytes)) return readProject(file, bytes).tracks.map(({ name }) => name);
  const columns = readColumns(tableOfPoints(file, bytes), [], { unused: [], assumptions: [] });
  return [...new Set(columns.filter(isPlace).map(({ track }) => track))];
}

/** @param {string} file @param {Uint8Array} bytes */
function tableOfPoints(file, bytes) {
  const table = readTable(file, bytes);
  if (table.lines.some(({ cells }) => cells[0]?.toLowerCase() === "quantity")) throw table.error(null, "", text("file.eventTable"));
  return table;
}

/** The columns of the chosen run, and those of no run, that are times or positions.
 * @param {Table} table @param {Column[]} columns @param {string | null} run @param {Notes} notes */
function ofOneRun(table, columns, run, notes) {
  const runs = [...new Set(columns.filter(isPosition).map((column) => column.run))];
  const have = listed(runs.map((name) => name || text("file.withoutName")));
  if (run === null && runs.length > 1) throw table.error(null, "", text("file.severalRuns", { have, first: runs.filter(Boolean)[0] }));
  if (run !== null && !runs.includes(run)) {
    throw table.error(null, "", text(runs.some(Boolean) ? "file.otherRuns" : "file.oneRun", { have, wanted: quote(run) }));
  }
  // Positions of no run are a run of their own, while all runs may share a column of times
  const chosen = columns.filter((column) => run === null || column.run === run || !(column.run || isPosition(column)));
  leaveOut(chosen.filter(({ role }) => !role), "unused.otherKind", "unused.otherKinds", notes);
  return chosen.filter(({ role }) => role);
}

/** Count the cells of columns that are not used. @param {Column[]} columns @param {"unused.otherKind" | "unused.notAskedFor"} ofOne
 * @param {"unused.otherKinds" | "unused.severalNotAskedFor"} ofSeveral @param {Notes} notes */
function leaveOut(columns, ofOne, ofSeveral, notes) {
  const names = [...new Set(columns.map(({ label }) => inQuotes(label)))];
  const cells = columns.flatMap(cellsOf).filter(Boolean).length;
  count(notes, "", text(names.length > 1 ? ofSeveral : ofOne, { columns: listed(names) }), cells);
}

/**
 * The channels of a table, by the columns of times or frames that belong to them.
 * @param {Table} table @param {How & {run: string | null}} how @returns {Sheet[]}
 */
function sheetsOfTable(table, { tracks, units, run, notes }) {
  const columns = ofOneRun(table, readColumns(table, Object.values(tracks), notes), run, notes);
  const masses = massOfTrack(table.file, placesOf(table, columns), tracks);
  /** @type {{clock: Column, frame: Column | undefined, channels: Series[]}[]} */
  const timed = [];
  const isOfMass = (/** @type {Column} */ { track }) => Object.hasOwn(masses, track);
  const byTrack = new Set(["x", "y", ...columns.filter(isOfMass).map(({ role }) => role)]);
  const leftOut = columns.filter((one) => isPosition(one) && byTrack.has(one.role) && !isOfMass(one));
  for (const column of columns.filter((one) => isPosition(one) && !leftOut.includes(one))) {
    const { label, track } = column;
    const beside = columns.filter(({ rows }) => rows === column.rows);
    const name = isPlace(column) ? `${masses[track]}_${column.role}` : column.role;
    // The rates of one body about several axes are one channel
    const axes = column.axis ? beside.filter((one) => one.axis && one.track === track) : [column];
    if (column !== axes[0] && new Set(axes.map(({ axis }) => axis)).size === axes.length) continue;
    if (timed.some(({ channels }) => channels.some((one) => one.name === name))) {
      throw table.error(null, label, text("file.second", { name }));
    }
    // Tracker repeats the column of times for each track; the one that belongs to a column stands left of it
    const [frames, times] = ["frame", "t"].map((role) => beside.filter((one) => one.role === role));
    const clocks = times.length ? times : frames;
    if (!clocks.length) throw table.error(null, label, text("file.noTimes", { names: `'${label}'`, wayOut: text("file.nameTimes") }));
    const clock = clocks.findLast(({ index }) => index < column.index) ?? clocks[0];
    const frame = frames.find((one) => one.track === track) ?? frames[0];
    const parts = axes.map((one) => seriesOf(table, one, name, units, notes));
    const series = parts.length > 1 ? aboutOneAxis(table, parts, notes) : parts[0];
    const sheet = timed.find((one) => one.clock === clock && one.frame === frame);
    if (sheet) sheet.channels.push(series);
    else timed.push({ clock, frame, channels: [series] });
  }
  leaveOut(leftOut, "unused.notAskedFor", "unused.severalNotAskedFor", notes);
  if (!timed.length) throw table.error(null, "", text("file.nothing"));
  return timed.map(({ clock, frame: counter, channels }) => {
    const time = clock.role === "t" ? numbersOf(table, clock) : null;
    const factor = time ? factorOf(table, clock, "s", units) : 1;
    const frame = counter ? numbersOf(table, counter) : null;
    const part = frame?.findIndex((number) => number % 1) ?? -1; // not a number, where there is none, is falsy
    if (counter && part >= 0) throw table.error(clock.rows[part].line, counter.label, text("file.wholeFrames"));
    for (const { name, value } of channels) {
      value.forEach((one, i) => {
        const [isThere, isTimed] = [Number.isFinite(one), !time || Number.isFinite(time[i])];
        if (isThere !== isTimed) count(notes, name, text(isThere ? "unused.withoutTime" : "unused.empty"), 1);
      });
    }
    return {
      clock: clock.label,
      lines: clock.rows.map(({ line }) => line),
      time: time && time.map((t) => t * factor),
      rounding: lastDigits(cellsOf(clock)).map((digit) => 0.5 * digit * factor),
      frame,
      channels,
    };
  });
}

/** Values of a column; not a number: none. @param {Table} table @param {Column} column */
const numbersOf = (table, { rows, index, label }) => rows.map((row) => table.number(row, index, label));

/** @param {Table} table @param {Column[]} columns */
function placesOf(table, columns) {
  /** @type {Places} */
  const places = new Map();
  for (const column of columns.filter(isPlace)) {
    const values = numbersOf(table, column).filter(Number.isFinite);
    places.set(column.track, { ...(places.get(column.track) ?? { x: [], y: [] }), [column.role]: values });
  }
  return places;
}

/** One channel in SI units. @param {Table} table @param {Column} column @param {string} name @param {Record<string, string>} units
 * @param {Notes} notes @returns {Series} */
function seriesOf(table, column, name, units, notes) {
  const factor = factorOf(table, column, unitOf(name), units);
  const values = numbersOf(table, column);
  if (!values.some(Number.isFinite)) throw table.error(null, column.label, text("file.noValues", { name }));
  if (!column.unit && KIND_OF_UNIT[column.role] === "length") notes.assumptions.push(text("assumed.lengths", { unit: units.length }));
  const digit = lastDigits(cellsOf(column)).map((one) => one * factor);
  return { name, column: column.label, value: values.map((value) => value * factor), digit };
}

/** @param {Table} table @param {Column} column @param {string} si @param {Record<string, string>} units */
function factorOf(table, column, si, units) {
  let unit = column.unit || units[KIND_OF_UNIT[column.role] ?? ""] || si;
  if (si === "m" && isPixel(unit)) {
    unit = units.length;
    if (unit === DEFAULT_UNITS.length || isPixel(unit)) throw table.error(null, column.label, text("file.pixels"));
  }
  const factor = factorTo(si, unit);
  if (factor !== null) return factor;
  throw table.error(column.unit ? column.rows[0].line - 1 : null, column.label, text("file.unit", { unit: quote(unit), si }));
}

/** Refuse values that must be in another unit than was said. @param {string} file @param {Sheet} sheet */
function refuseImplausibleValues(file, { channels, lines }) {
  for (const { name, column, value } of channels) {
    const unit = unitOf(name);
    const limit = MAX_VALUE[name.split("_")[0]] ?? MAX_VALUE[unit];
    const sizes = value.map((one) => Math.abs(one) || 0);
    const worst = sizes.indexOf(largest(sizes));
    if (sizes[worst] <= limit) continue;
    const [kind, other] = unit.startsWith("rad") ? ["angle", "deg"] : ["length", "cm"];
    const found = { value: inSentence(value[worst]), unit, limit: inSentence(limit, 4), kind, other };
    throw dataError(file, lines[worst], column, text("file.tooLarge", found));
  }
}
