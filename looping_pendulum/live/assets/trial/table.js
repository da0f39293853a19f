/** Reads a plain table of text: one line of names, perhaps with the names of tracks above it (Tracker's export), then numbers. */

import { text } from "../texts.js";

/** A file that is not taken; the message is one line. `field`: the field of the page that can help; `isForm`: whether its columns are
 * not those of a plain table, so that saying what they are can help. */
export class DataError extends Error {
  /** @param {string} message @param {string} [field] @param {boolean} [isForm] */
  constructor(message, field, isForm = false) {
    super(message.replace(/\p{C}/gu, "?"));
    this.field = field;
    this.isForm = isForm;
  }
}

/**
 * `unit`: as its name has it in brackets, or ""; `title`: name of the track above it, or of the last one to its left; `cells`: the
 * text of each row.
 * @typedef {{index: number, name: string, unit: string, title: string, cells: string[]}} Column
 */
/** `lines`: number of each row in the file. @typedef {{file: string, lines: number[], columns: Column[], decimalComma: boolean}} Table */

export const LARGEST_FILE = 20 * 1024 * 1024;
/** Largest number of lines above the numbers: names of tracks, and names of columns. */
const MAX_HEAD = 2;
const MISSING = ["", "-", "nan"];
const NUMBER = /^[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)(e[+-]?[0-9]{1,3})?$/i;
const NAME_AND_UNIT = /^(.*?)\s*(?:[[(]([^[\]()]*)[\])])?$/;
/** Largest number that is read, and of the smallest that is not zero the inverse: squares are finite in any unit. */
const LARGEST_NUMBER = 1e100;
const MAX_QUOTED = 60;

/** @param {string} value of a file, as messages name it */
export const quote = (value) => `'${value.length > MAX_QUOTED ? [value.slice(0, MAX_QUOTED), "..."].join("") : value}'`;

/** The error for a file that is no plain table: what is wrong, and which command makes one of it.
 * @param {string} file @param {number | null} line @param {string} problem @param {boolean} [isForm] as of a `DataError` */
export function notPlain(file, line, problem, isForm = false) {
  const place = [file, ...(line ? [line] : [])].join(":");
  return new DataError(`${place}: ${text("file.notPlain", { problem, file: quote(file) })}`, undefined, isForm);
}

/** @param {string} name of a column */
export const isTime = (name) => ["t", "time"].includes(name.toLowerCase());

/** @param {string} file its name @param {Uint8Array} bytes @returns {Table} */
export function readTable(file, bytes) {
  if (bytes.length > LARGEST_FILE) throw notPlain(file, null, text("file.large"));
  const lines = linesOf(bytes);
  const delimiter = ["\t", ";"].find((one) => lines[0]?.line.includes(one)) ?? ",";
  const cells = lines.map(({ line }) => cellsOf(line, delimiter));
  const head = cells.slice(0, MAX_HEAD).findIndex((row) => row.some((cell) => isTime(nameAndUnit(cell).name)));
  if (head < 0) throw notPlain(file, null, text("file.noTimes"), true);
  const rows = cells.slice(head + 1);
  const numbers = lines.slice(head + 1).map(({ number }) => number);
  if (!rows.length) throw notPlain(file, null, text("file.noRows"));
  const width = cells[head].length;
  const odd = rows.findIndex((row) => row.length !== width);
  if (odd >= 0) throw notPlain(file, numbers[odd], text("file.cells", { count: rows[odd].length, width }));
  let title = "";
  const columns = cells[head].map((cell, index) => {
    // Tracker writes a name above the first column of its track; all columns up to the next name are that track's
    title = (head > 0 && cells[0][index]) || title;
    return { index, ...nameAndUnit(cell), title, cells: rows.map((row) => row[index]) };
  });
  const decimalComma = delimiter !== "," && rows.some((row) => row.some((cell) => cell.includes(",")));
  return { file, lines: numbers, columns, decimalComma };
}

/** The lines of a file that hold anything, with their numbers. @param {Uint8Array} bytes */
export function linesOf(bytes) {
  // Spreadsheets write UTF-16 with a mark
  const whole = new TextDecoder(bytes[0] === 0xff && bytes[1] === 0xfe ? "utf-16le" : "utf-8").decode(bytes);
  // Tracker begins with a comment
  return whole.split(/\r\n|\r|\n/).map((line, i) => ({ line, number: i + 1 })).filter(({ line }) => line.trim() && !line.startsWith("#"));
}

/** The cells of a line, without the quotes of a spreadsheet. @param {string} line @param {string | RegExp} delimiter */
export const cellsOf = (line, delimiter) => line.split(delimiter).map((cell) => cell.trim().replace(/^"(.*)"$/, "$1"));

/** The numbers of a column; not a number: an empty cell. @param {Table} table @param {Column} column */
export function numbersOf({ file, lines, decimalComma }, { name, cells }) {
  return cells.map((cell, i) => {
    if (MISSING.includes(cell.toLowerCase())) return NaN;
    // Beside a decimal comma, a point could separate thousands
    const plain = decimalComma ? cell.replace(".", "?").replace(",", ".") : cell;
    const size = Math.abs(Number(plain));
    if (NUMBER.test(plain) && size < LARGEST_NUMBER) return size * LARGEST_NUMBER < 1 ? 0 : Number(plain);
    throw notPlain(file, lines[i], text("file.number", { column: quote(name), cell: quote(cell) }));
  });
}

/** Split a name such as "light_x [cm]". @param {string} cell */
function nameAndUnit(cell) {
  const [, name = cell, unit = ""] = NAME_AND_UNIT.exec(cell) ?? [];
  return { name, unit };
}
