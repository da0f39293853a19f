/** Tells which quantity each column of a table holds, by its name and its values, as `identify` does (`measured/columns.py`). */

import { text } from "../texts.js";
import { largest, steps, where } from "./arrays.js";
import { general, listed, quote } from "./messages.js";
import { bare, cellsOf, closest, columnOf, isPlace, isPosition, parseName, UNITS, WHOLE_RUN } from "./names.js";
import { isNumber, lastDigits, numberIn } from "./table.js";

/** @typedef {import("./table.js").Table} Table */
/** @typedef {import("./table.js").Row} Row */
/** @typedef {import("./clock.js").Notes} Notes */
/** @typedef {import("./names.js").Column} Column */

/** Largest share of rows with fewer cells than there are names: with more, the names do not belong to the rows. */
const MAX_SHORT_SHARE = 0.5;
/** Smallest number of values by which equal steps tell a time or a row's number from a position. */
const MIN_COUNTED = 10;
/** Quantities of one kind; of several in a file, the first counts, from which a program computed the others. */
const KINDS = [["x", "y"], ["angle", "angle_rate"], ["height"]];

/** @param {Row} row */
const filled = ({ cells }) => cells.filter(Boolean);

/**
 * The columns of a file, by their names and by what they hold.
 * @param {Table} table
 * @param {string[]} asked names for the tracks of columns without names
 * @param {Notes} notes
 * @returns {Column[]}
 */
export function readColumns(table, asked, notes) {
  /** @type {Column[]} */
  let columns = [];
  tablesOf(table).forEach(({ head, rows }, i) => {
    const header = headerOf(table, head, rows);
    const named = header ? byName(table, header, head, rows, notes) : byPosition(table, asked, head, rows, notes);
    let part = splitByCells(table, named);
    if (part.some((one) => isPosition(one) && columns.some(({ track, role }) => track === one.track && role === one.role))) {
      // The same objects in a second table: another run
      part = part.map((column) => ({ ...column, run: column.run || String(i + 1) }));
      columns = columns.map((column) => ({ ...column, run: column.run || "1" }));
    }
    columns.push(...part);
  });
  const kind = KINDS.find((roles) => columns.some(({ role }) => roles.includes(role))) ?? [];
  columns = columns.map((one) => (isPosition(one) && !kind.includes(one.role) ? { ...one, role: "" } : one));
  const counter = columns.find((column) => isPlace(column) && counts(table, column));
  if (!counter) return columns;
  throw table.error(counter.rows[0].line, counter.label, text("file.counts", { value: cellsOf(counter)[0] }));
}

/** The tables of a file, each as the lines above its numbers and the rows of numbers. @param {Table} table */
function tablesOf(table) {
  /** @type {{head: Row[], rows: Row[]}[]} */
  const tables = [{ head: [], rows: [] }];
  table.lines.forEach((line, i) => {
    const { head, rows } = tables[tables.length - 1];
    // A text between rows of numbers is a damaged row, which is refused when it is read, unless names of columns follow
    if (isRow(table, line, head.length > 0) || (rows.length && !beginsTable(table, i))) rows.push(line);
    else if (rows.length) tables.push({ head: [line], rows: [] });
    else head.push(line);
  });
  const whole = tables.filter(({ rows }) => rows.length);
  if (whole.length) return whole;
  const last = table.lines[table.lines.length - 1];
  throw table.error(last.line, "", text("file.noNumbers", { row: quote(filled(last).join(" ")) }));
}

/** Whether most cells of a line are numbers; above all names, one whose first cell is empty has names of tracks.
 * @param {Table} table @param {Row} line @param {boolean} hasHead */
function isRow({ decimalComma }, line, hasHead) {
  const cells = filled(line);
  const numbers = cells.filter((cell) => isNumber(cell, decimalComma)).length;
  return Boolean(line.cells[0] || hasHead) && numbers > 0 && (isNumber(line.cells[0], decimalComma) || 2 * numbers > cells.length);
}

/** Whether a line of text, or one of the next two, has names of columns. @param {Table} table @param {number} i */
const beginsTable = (table, i) => table.lines.slice(i, i + 3).some((line) => !isRow(table, line, true) && namesTimes(line));

/** @param {Row} line */
const namesTimes = (line) => filled(line).length > 1 && line.cells.some((cell) => ["t", "frame"].includes(parseName(cell).role));

/** The line of names; nothing: the columns have none. @param {Table} table @param {Row[]} head @param {Row[]} rows */
function headerOf(table, head, rows) {
  // From the last line up: the names stand right above the numbers, titles further up
  const header = head.findLast(namesTimes);
  if (header) return header;
  const width = largest(rows.map((row) => filled(row).length));
  const comment = table.comments.findLast((line) => namesTimes(line) && line.cells.length === width);
  const last = head.at(-1);
  if (comment || !last || filled(last).length < Math.max(width, 2)) return comment;
  const isTrials = filled(last).some((cell) => ["a", "acceleration"].includes(parseName(cell).label));
  const column = last.cells.find((cell, index) => cell && counts(table, columnOf({ index, rows }), 0.2));
  const key = isTrials ? "file.rowsAreTrials" : column ? "file.nameCounted" : "file.nameTimes";
  const wayOut = text(key, { column: quote(column ?? "") });
  throw table.error(last.line, "", text("file.noTimes", { names: quote(filled(last).join(", ")), wayOut }));
}

/** The columns of a table whose names stand in a line. @param {Table} table @param {Row} header @param {Row[]} head
 * @param {Row[]} rows @param {Notes} notes */
function byName(table, header, head, rows, notes) {
  let { cells } = header;
  // The rows may be numbered, and their numbers have no name
  if (rows.every((row) => row.cells.length === cells.length + 1) && counts(table, columnOf({ rows }))) cells = ["", ...cells];
  const whole = wholeRows(table, cells.findLastIndex(Boolean) + 1, rows, notes);
  const units = head.find((line) => line.line > header.line && filled(line).every((cell) => UNITS.has(bare(cell).toLowerCase())));
  // Tracker writes a name above the first column of its track; all columns up to the next name are that track's
  const above = head.filter(({ line }) => line < header.line).flatMap(({ cells }) => where(cells, Boolean).map((i) => ({ i, name: cells[i] })));
  const titles = new Map(above.map(({ i, name }) => [i, name]));
  if (titles.size === 1) titles.set(0, above[above.length - 1].name); // one name stands anywhere above the only track
  const names = cells.map(parseName);
  const hasGroups = new Set(names.filter(isPosition).map(({ group }) => group)).size !== 1;
  let title = "";
  const columns = withNumberedTracks(names.flatMap((name, index) => {
    title = titles.get(index) ?? title;
    if (!cells[index]) return [];
    const runInTitle = WHOLE_RUN.exec(title)?.[1] ?? "";
    const own = hasGroups ? [name.group, name.track].filter(Boolean).join(" ") : name.track;
    const track = own || (runInTitle ? "" : title);
    const label = track && !own ? `${cells[index]} (${track})` : cells[index];
    const unit = name.unit || bare(units?.cells[index] ?? "");
    return { ...name, index, label, track, unit, run: name.run || runInTitle, rows: whole };
  }));
  const others = columns.filter((column) => {
    const value = column.role === "setting" && cellsOf(column).find(Boolean);
    if (value) notes.assumptions.push(text("assumed.setting", { name: column.label, value }));
    return column.role !== "setting";
  });
  if (others.some(isPosition)) return others;
  const meant = others.map(({ label }) => ({ known: closest(label.toLowerCase()), name: label })).find(({ known }) => known);
  const wayOut = text(meant ? "file.didYouMean" : "file.rename", meant);
  throw table.error(header.line, "", text("file.noCoordinates", { names: quote(others.map(({ label }) => label).join(", ")), wayOut }));
}

/** Whether values begin near zero and grow by equal steps, as times and numbers of rows do; `unrest`: largest difference of a
 * step from their mean, as a share of it. @param {Table} table @param {Column} column */
function counts({ decimalComma }, column, unrest = 0) {
  const cells = cellsOf(column).filter((cell) => isNumber(cell, decimalComma));
  if (cells.length < Math.max(MIN_COUNTED, Math.floor(column.rows.length / 2))) return false;
  const values = cells.map(numberIn);
  const step = (values[values.length - 1] - values[0]) / (values.length - 1);
  const rounding = Math.max(1.01 * largest(lastDigits(cells)), unrest * step);
  return step > 0 && Math.abs(values[0]) <= 1.5 * step && steps(values).every((one) => one > 0 && Math.abs(one - step) <= rounding);
}

/**
 * The rows with as many cells as there are names: where a point is missing, some programs leave its cells out, so that all later
 * ones stand in another's columns.
 * @param {Table} table @param {number} width @param {Row[]} rows @param {Notes} notes
 */
function wholeRows(table, width, rows, notes) {
  const error = (/** @type {Row} */ { line, cells }, /** @type {"file.cells" | "file.cellsWithCommas"} */ key) =>
    table.error(line, "", text(key, { count: cells.length, width }));
  const tooLong = rows.find(({ cells }) => cells.slice(width).some(Boolean));
  if (tooLong) throw error(tooLong, table.delimiter === "," ? "file.cellsWithCommas" : "file.cells");
  const isShort = (/** @type {Row} */ { cells }) => cells.length < width;
  const last = rows.findLastIndex((row) => !isShort(row));
  // Editors trim tabs at the end of a line, so that short rows at the end of a table only lack the track that ended before; where
  // others are short, too, any cell may be missing
  const onlyAtEnd = !rows.slice(0, last + 1).some(isShort);
  const end = table.delimiter === "\t" && last >= 0 && onlyAtEnd ? last + 1 : rows.length;
  const short = rows.slice(0, end).filter(isShort);
  if (short.length > MAX_SHORT_SHARE * rows.length) throw error(short[0], "file.cells");
  if (short.length) {
    const lines = listed(short.map(({ line }) => line));
    notes.assumptions.push(text("assumed.shortRows", { count: short.length, all: rows.length, lines }));
  }
  return rows.filter((row, i) => i >= end || !isShort(row));
}

/** Give tracks without a name a number where there are several: columns "x, y, x, y", or "x, y, x 2, y 2". @param {Column[]} columns */
function withNumberedTracks(columns) {
  const others = new Set(columns.filter((one) => isPlace(one) && one.track).map(({ track }) => track));
  /** @type {Record<string, number>} */
  const seen = {};
  const numbers = columns.map(({ role, run, track }) => (isPlace({ role }) && !track ? (seen[role + run] = (seen[role + run] ?? 0) + 1) : 0));
  const hasSeveral = others.size > 0 || largest(numbers) > 1;
  const first = (hasSeveral && ["1", "0", "first"].find((name) => !others.has(name))) || "";
  return columns.map((column, i) => (numbers[i] ? { ...column, track: numbers[i] > 1 ? String(numbers[i]) : first } : column));
}

/**
 * The columns of a table that does not name them: t, x, y for each track, or t, angle and perhaps its rate.
 * @param {Table} table @param {string[]} asked @param {Row[]} head @param {Row[]} rows @param {Notes} notes
 */
function byPosition(table, asked, head, rows, notes) {
  const width = largest(rows.map((row) => filled(row).length));
  const whole = wholeRows(table, width, rows, notes);
  const titles = head.flatMap(filled);
  const place = (/** @type {string} */ role, track = "") => ({ role, track });
  let places = ["t", "angle", "angle_rate"].slice(0, width).map((role) => place(role));
  if (!asked.length && !titles.length && table.delimiter === " " && (width === 2 || width === 3)) {
    notes.assumptions.push(text(width > 2 ? "assumed.anglesAndRates" : "assumed.angles"));
  } else if (width === 3 || (width === 5 && (asked.length === 2 || titles.length === 2))) {
    const tracks = [titles, asked].find((names) => names.length === Math.floor(width / 2)) ?? [stem(table.file)];
    places = [place("t"), ...tracks.flatMap((track) => [place("x", track), place("y", track)])];
    const [first, last] = [0, width - 1].map((index) => counts(table, columnOf({ index, rows: whole })));
    if (!first && last) places.push(...places.splice(0, 1));
    notes.assumptions.push(text("assumed.places", { roles: places.map(({ role }) => role).join(", ") }));
  } else {
    throw table.error(rows[0].line, "", text("file.needsNames", { width }));
  }
  return places.map(({ role, track }, index) => {
    const label = track ? text("file.columnOf", { number: index + 1, role, track }) : `${index + 1} (${role})`;
    return columnOf({ index, label, role, track, rows: whole });
  });
}

/** The columns of each object and run where columns say which one a row shows. @param {Table} table @param {Column[]} columns */
function splitByCells({ decimalComma }, columns) {
  const [{ rows }] = columns;
  /** @type {{object?: string[], run?: string[]}} */
  const names = {};
  for (const role of /** @type {const} */ (["object", "run"])) {
    const by = columns.find((column) => column.role === role);
    if (!by) continue;
    columns = columns.filter((column) => column !== by);
    const cells = cellsOf(by).map((cell) => (isNumber(cell, decimalComma) ? general(numberIn(cell)) : cell)); // "2" for "2.0"
    // Not where each row has a name of its own
    if (new Set(cells).size <= Math.max(2, rows.length / 2)) names[role] = cells;
  }
  /** @type {Map<string, Row[]>} */
  const parts = new Map();
  rows.forEach((row, i) => {
    const [track, run] = [names.object?.[i], names.run?.[i]];
    if (track === "" || run === "") return;
    const key = JSON.stringify({ track, run }); // without what no column says
    parts.set(key, parts.get(key) ?? []);
    parts.get(key)?.push(row);
  });
  return [...parts].flatMap(([key, own]) => columns.map((column) => {
    const said = JSON.parse(key);
    const label = said.track && isPosition(column) ? `${column.label} (${said.track})` : column.label;
    return { ...column, label, ...said, rows: own };
  }));
}

/** Name of a file without its ending. @param {string} file */
export const stem = (file) => file.replace(/^.*[/\\]/s, "").replace(/(?<=.)\.[^.]*$/s, "");
