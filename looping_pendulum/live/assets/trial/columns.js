/** Tells which quantity each column of a table holds, by its name and its values, as `identify` does (`discrepancy/data/columns.py`). */

import { text } from "../texts.js";
import { largest, steps, where } from "./arrays.js";
import { general, quote } from "./messages.js";
import { bare, closest, isPosition, parseName, UNITS, WHOLE_RUN } from "./names.js";
import { isNumber, lastDigits, numberIn } from "./table.js";

/** @typedef {import("./table.js").Table} Table */
/** @typedef {import("./table.js").Row} Row */
/** @typedef {import("./clock.js").Notes} Notes */
/**
 * `role`: "t", "frame", "object", "run", "setting", or a position, height, angle or rate; "" if it is none of these. `track`: the tracked
 * object, or the axis of an angular rate. `rows`: those that the column stands in.
 * @typedef {{index: number, label: string, role: string, track: string, unit: string, run: string, rows: Row[]}} Column
 */

/** Largest share of rows with fewer cells than there are names: with more, the names do not belong to the rows. */
const MAX_SHORT_SHARE = 0.5;
/** Smallest number of values by which equal steps tell a time or a row's number from a position. */
const MIN_COUNTED = 10;
/** Largest number of lines that a sentence names. */
const MAX_SHOWN = 5;
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
  const counter = columns.find((column) => ["x", "y"].includes(column.role) && counts(table, column));
  if (counter) {
    const [row] = counter.rows;
    throw table.error(row.line, counter.label, text("file.counts", { value: row.cells[counter.index] ?? "" }));
  }
  return columns;
}

/** The tables of a file, each as the lines above its numbers and the rows of numbers. @param {Table} table */
function tablesOf(table) {
  /** @type {{head: Row[], rows: Row[]}[]} */
  const tables = [];
  let current = { head: /** @type {Row[]} */ ([]), rows: /** @type {Row[]} */ ([]) };
  table.lines.forEach((line, i) => {
    // A text between rows of numbers is a damaged row, which is refused when it is read, unless names of columns follow
    if (isRow(table, line, current.head.length > 0) || (current.rows.length && !beginsTable(table, i))) {
      if (!current.rows.length) tables.push(current);
      current.rows.push(line);
      return;
    }
    if (current.rows.length) current = { head: [], rows: [] };
    current.head.push(line);
  });
  if (tables.length) return tables;
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
  const isTrials = filled(last).some((cell) => ["a", "acceleration"].includes(parseName(cell).words));
  const counter = last.cells.findIndex((cell, i) => cell && counts(table, unnamed(i, rows), 0.2));
  const column = counter < 0 ? "" : quote(last.cells[counter]);
  const wayOut = isTrials ? text("file.rowsAreTrials") : column ? text("file.nameCounted", { column }) : text("file.nameTimes");
  throw table.error(last.line, "", text("file.noTimes", { names: quote(filled(last).join(", ")), wayOut }));
}

/** The columns of a table whose names stand in a line. @param {Table} table @param {Row} header @param {Row[]} head
 * @param {Row[]} rows @param {Notes} notes */
function byName(table, header, head, rows, notes) {
  let { cells } = header;
  // The rows may be numbered, and their numbers have no name
  if (rows.every((row) => row.cells.length === cells.length + 1) && counts(table, unnamed(0, rows))) cells = ["", ...cells];
  const width = cells.findLastIndex(Boolean) + 1;
  const whole = wholeRows(table, width, rows, notes);
  const units = head.find((line) => line.line > header.line && filled(line).every((cell) => UNITS.has(bare(cell).toLowerCase())));
  // Tracker writes a name above the first column of its track; all columns up to the next name are that track's
  let titles = new Map(head.filter(({ line }) => line < header.line).flatMap((line) =>
    where(line.cells, Boolean).map((i) => /** @type {const} */ ([i, line.cells[i]]))));
  if (titles.size === 1) titles = new Map([[0, [...titles.values()][0]]]); // one name stands anywhere above the only track
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
    return { index, label, role: name.role, track, unit, run: name.run || runInTitle, rows: whole };
  }));
  for (const { label, index } of columns.filter(({ role }) => role === "setting")) {
    const value = whole.find((row) => row.cells[index])?.cells[index];
    if (value) notes.assumptions.push(text("assumed.setting", { name: label, value }));
  }
  const others = columns.filter(({ role }) => role !== "setting");
  refuseNamesWithoutPositions(table, header, others);
  return others;
}

/** @param {number} index @param {Row[]} rows @returns {Column} */
const unnamed = (index, rows) => ({ index, label: String(index + 1), role: "", track: "", unit: "", run: "", rows });

/** Whether values begin near zero and grow by equal steps, as times and numbers of rows do; `unrest`: largest difference of a
 * step from their mean, as a share of it. @param {Table} table @param {Column} column */
function counts({ decimalComma }, { index, rows }, unrest = 0) {
  const cells = rows.map((row) => row.cells[index] ?? "").filter((cell) => isNumber(cell, decimalComma));
  if (cells.length < Math.max(MIN_COUNTED, Math.floor(rows.length / 2))) return false;
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
  const tooLong = rows.find(({ cells }) => cells.slice(width).some(Boolean));
  if (tooLong) {
    const found = { count: tooLong.cells.length, width };
    throw table.error(tooLong.line, "", text(table.delimiter === "," ? "file.cellsWithCommas" : "file.cells", found));
  }
  const isShort = (/** @type {Row} */ { cells }) => cells.length < width;
  const last = rows.findLastIndex((row) => !isShort(row));
  // Editors trim tabs at the end of a line, so that short rows at the end of a table only lack the track that ended before
  const short = rows.filter((row, i) => isShort(row) && !(table.delimiter === "\t" && last >= 0 && last < i));
  if (short.length > MAX_SHORT_SHARE * rows.length) {
    throw table.error(short[0].line, "", text("file.cells", { count: short[0].cells.length, width }));
  }
  if (!short.length) return rows;
  const shown = short.slice(0, MAX_SHOWN).map(({ line }) => line).join(", ");
  const more = short.length - MAX_SHOWN;
  const lines = more > 0 ? text("fault.more", { shown, count: more }) : shown;
  notes.assumptions.push(text("assumed.shortRows", { count: short.length, all: rows.length, lines }));
  const left = new Set(short);
  return rows.filter((row) => !left.has(row));
}

/** Give tracks without a name a number where there are several: columns "x, y, x, y", or "x, y, x 2, y 2". @param {Column[]} columns */
function withNumberedTracks(columns) {
  const isPlace = (/** @type {Column} */ { role }) => role === "x" || role === "y";
  const others = new Set(columns.filter((one) => isPlace(one) && one.track).map(({ track }) => track));
  /** @type {Map<string, number>} */
  const seen = new Map();
  const numbered = columns.map((column) => {
    if (!isPlace(column) || column.track) return column;
    const key = `${column.role} ${column.run}`;
    const count = (seen.get(key) ?? 0) + 1;
    seen.set(key, count);
    return count > 1 ? { ...column, track: String(count) } : column;
  });
  if (!others.size && ![...seen.values()].some((count) => count > 1)) return numbered;
  const first = ["1", "0", "first"].find((name) => !others.has(name)) ?? "";
  return numbered.map((column) => (isPlace(column) && !column.track ? { ...column, track: first } : column));
}

/** Refuse names of which none is a position, an angle or a height. @param {Table} table @param {Row} header @param {Column[]} columns */
function refuseNamesWithoutPositions(table, header, columns) {
  if (columns.some(isPosition)) return;
  const names = quote(columns.map(({ label }) => label).join(", "));
  const misspelt = columns.find(({ label }) => closest(label.toLowerCase()));
  const meant = misspelt && { known: closest(misspelt.label.toLowerCase()), name: misspelt.label };
  const wayOut = meant ? text("file.didYouMean", meant) : text("file.rename");
  throw table.error(header.line, "", text("file.noCoordinates", { names, wayOut }));
}

/**
 * The columns of a table that does not name them: t, x, y for each track, or t, angle and perhaps its rate.
 * @param {Table} table @param {string[]} asked @param {Row[]} head @param {Row[]} rows @param {Notes} notes
 */
function byPosition(table, asked, head, rows, notes) {
  const width = largest(rows.map((row) => filled(row).length));
  const whole = wholeRows(table, width, rows, notes);
  const titles = head.flatMap(filled);
  /** @type {[string, string][]} */
  let roles;
  if (!asked.length && !titles.length && table.delimiter === " " && (width === 2 || width === 3)) {
    roles = /** @type {[string, string][]} */ ([["t", ""], ["angle", ""], ["angle_rate", ""]]).slice(0, width);
    notes.assumptions.push(text(width > 2 ? "assumed.anglesAndRates" : "assumed.angles"));
  } else if (width === 3 || (width === 5 && (asked.length === 2 || titles.length === 2))) {
    const tracks = [titles, asked].find((names) => names.length === Math.floor(width / 2)) ?? [stem(table.file)];
    roles = [["t", ""], ...tracks.flatMap((track) => /** @type {[string, string][]} */ ([["x", track], ["y", track]]))];
    if (!counts(table, unnamed(0, whole)) && counts(table, unnamed(width - 1, whole))) roles.push(...roles.splice(0, 1));
    notes.assumptions.push(text("assumed.places", { roles: roles.map(([role]) => role).join(", ") }));
  } else {
    throw table.error(rows[0].line, "", text("file.needsNames", { width }));
  }
  return roles.map(([role, track], index) => {
    const label = track ? text("file.columnOf", { number: index + 1, role, track }) : `${index + 1} (${role})`;
    return { index, label, role, track, unit: "", run: "", rows: whole };
  });
}

/** The columns of each object and run where a column says which one a row shows. @param {Table} table @param {Column[]} columns */
function splitByCells({ decimalComma }, columns) {
  for (const role of ["object", "run"]) {
    const by = columns.find((column) => column.role === role);
    if (!by) continue;
    const others = columns.filter((column) => column !== by);
    columns = others;
    /** @type {Map<string, Row[]>} */
    const rowsOf = new Map();
    for (const row of by.rows) {
      const cell = row.cells[by.index] ?? "";
      const name = isNumber(cell, decimalComma) ? general(numberIn(cell)) : cell; // "2" for "2.0"
      const rows = rowsOf.get(name);
      if (rows) rows.push(row);
      else rowsOf.set(name, [row]);
    }
    if (2 * rowsOf.size > by.rows.length && rowsOf.size > 2) continue; // no names: each row has its own
    columns = [...rowsOf].filter(([name]) => name).flatMap(([name, rows]) => others.map((column) => {
      if (role === "run") return { ...column, run: name, rows };
      return { ...column, track: name, label: isPosition(column) ? `${column.label} (${name})` : column.label, rows };
    }));
  }
  return columns;
}

/** Name of a file without its ending. @param {string} file */
export function stem(file) {
  const name = file.slice(Math.max(file.lastIndexOf("/"), file.lastIndexOf("\\")) + 1);
  return name.lastIndexOf(".") > 0 ? name.slice(0, name.lastIndexOf(".")) : name;
}
