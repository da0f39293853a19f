/** Reads a text table as `identify` does (`measured/delimited.py`): encoding, comments, delimiter, decimal comma. */

import { text } from "../texts.js";
import { largest } from "./arrays.js";
import { begins, textOf, UTF_8_MARK } from "./encoding.js";
import { dataError, quote } from "./messages.js";

/** @typedef {{line: number, cells: string[]}} Row with its number in the file, from 1 */

const LARGEST_FILE = 20 * 1024 * 1024;
/** Largest number that is read, and of the smallest that is not zero the inverse: squares are finite in any unit. */
const LARGEST_NUMBER = 1e100;
const MAX_LINE_LENGTH = 100_000;
const MISSING = new Set(["", "-", "--", "nan", "na", "n/a", "#n/a", "null", "none", "1.#qnan", "-1.#ind"]);
/** The likelier first, where several divide a table equally well; " " stands for any white space. */
const DELIMITERS = ["\t", ";", "|", ",", " "];
/** Number of lines at either end of a table by which its delimiter is told. */
const SAMPLE_LINES = 100;
const DECIMAL_POINT = /^[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]{1,4})?$/;
const DECIMAL_COMMA = /^[+-]?(?:[0-9]+(?:,[0-9]+)?|,[0-9]+)(?:[eE][+-]?[0-9]{1,4})?$/;
const DIGITS = /^[+-]?([0-9]*)[.,]?([0-9]*)(?:[eE]([+-]?[0-9]+))?$/;
const WORDS = /"([^"]*)"|([^\s"]+)/g;
/** Delimiter -> a cell with quotation marks as spreadsheets write them, the rest of the cell and its end. */
const CELLS = Object.fromEntries(DELIMITERS.map((d) => [d, new RegExp(`(?:"((?:[^"]|"")*)(?:"|$))?([^${d}]*)([${d}]?)`, "g")]));
const SEPARATOR_LINE = /^\s*"?sep=(.)"?\s*$/i;
/** First bytes -> what the file is. @type {[number[], import("../texts.js").TextKey][]} */
const OTHER_FORMATS = [
  [[0x50, 0x4b, 3, 4], "file.zip"],
  [[0xd0, 0xcf, 0x11, 0xe0], "file.spreadsheet"],
  [[0x3c, 0x3f, 0x78, 0x6d, 0x6c], "file.xml"],
  [[0x25, 0x50, 0x44, 0x46], "file.pdf"],
];

/** Whether a cell is a number in the file's writing. @param {string} cell @param {boolean} decimalComma */
export const isNumber = (cell, decimalComma) => (decimalComma ? DECIMAL_COMMA : DECIMAL_POINT).test(cell);

/** The number in a cell that is one. @param {string} cell */
export const numberIn = (cell) => Number(cell.replace(",", "."));

/**
 * Lines of cells of a text table. `comments`: lines that began with "#", without it; `lines`: all others that are not empty.
 * @typedef {ReturnType<typeof readTable>} Table
 */

/** @param {string} file its name @param {Uint8Array} bytes */
export function readTable(file, bytes) {
  const numbered = decoded(file, bytes).split(/\r\n|\r|\n/)
    .map((line, i) => ({ line: line.replace(/^\ufeff+|\ufeff+$/g, ""), number: i + 1 }))
    .filter(({ line }) => line.trim());
  const long = numbered.find(({ line }) => line.length > MAX_LINE_LENGTH);
  if (long) throw dataError(file, long.number, "", text("file.longLine", { length: long.line.length, limit: MAX_LINE_LENGTH }));
  const isComment = (/** @type {{line: string}} */ { line }) => line.trimStart().startsWith("#");
  let lines = numbered.filter((one) => !isComment(one));
  // A line for spreadsheets that names the delimiter
  const [, separator] = SEPARATOR_LINE.exec(lines[0]?.line ?? "") ?? [];
  if (separator) lines = lines.slice(1);
  if (!lines.length) throw dataError(file, null, "", text("file.noRows"));
  const { delimiter, decimalComma } = dialect(lines.map(({ line }) => line), DELIMITERS.includes(separator) ? [separator] : DELIMITERS);
  const row = (/** @type {{line: string, number: number}} */ { line, number }) => ({ line: number, cells: cellsOf(line, delimiter) });
  const comments = numbered.filter(isComment).map(({ line, number }) => row({ line: line.trimStart().replace(/^#+/, ""), number }));
  /** @param {number | null} line @param {string} column @param {string} message */
  const error = (line, column, message) => dataError(file, line, column, message);

  /** Value of a cell; not a number if it is empty or says that there is none.
   * @param {Row} row @param {number} index @param {string} column its name, for messages */
  function number({ line, cells }, index, column) {
    const cell = cells[index] ?? "";
    if (MISSING.has(cell.toLowerCase())) return NaN;
    // The point could as well separate thousands
    const isMixed = decimalComma && cell.includes(".") && (DECIMAL_POINT.test(cell) || cell.includes(","));
    const isLarge = Math.abs(numberIn(cell)) > LARGEST_NUMBER;
    const key = isMixed ? "file.mixedDecimals" : !isNumber(cell, decimalComma) ? "file.number" : isLarge ? "file.finite" : null;
    if (key) throw error(line, column, text(key, { cell: quote(cell) }));
    return Math.abs(numberIn(cell)) * LARGEST_NUMBER < 1 ? 0 : numberIn(cell);
  }

  return { file, delimiter, decimalComma, comments, lines: lines.map(row), error, number };
}

/** @param {string} file @param {Uint8Array} bytes */
function decoded(file, bytes) {
  if (bytes.length > LARGEST_FILE) throw dataError(file, null, "", text("file.large"));
  const afterMark = bytes.slice(begins(bytes, UTF_8_MARK) ? UTF_8_MARK.length : 0);
  const other = OTHER_FORMATS.find(([start]) => begins(afterMark, start));
  if (other) throw dataError(file, null, "", text("file.notText", { what: text(other[1]) }));
  const whole = textOf(bytes);
  if (whole.includes("\0")) throw dataError(file, null, "", text("file.notText", { what: text("file.binary") }));
  return whole;
}

/**
 * Cells of a line, at least one, without the spaces around them; quotation marks as spreadsheets write them.
 * @param {string} line
 * @param {string} delimiter " " means any white space
 */
function cellsOf(line, delimiter) {
  if (delimiter === " ") return Array.from(line.match(WORDS) ? line.matchAll(WORDS) : [[""]], ([, quoted, bare]) => quoted || bare || "");
  const cells = Array.from(line.matchAll(CELLS[delimiter]));
  const last = cells.findIndex(([, , , end]) => !end);
  return cells.slice(0, last + 1).map(([, quoted = "", bare]) => (quoted.replaceAll('""', '"') + bare).trim());
}

/** The delimiter and the decimal sign with which rows have most numbers or empty cells. @param {string[]} lines @param {string[]} delimiters */
function dialect(lines, delimiters) {
  const sample = lines.length <= 2 * SAMPLE_LINES ? lines : [...lines.slice(0, SAMPLE_LINES), ...lines.slice(-SAMPLE_LINES)];
  let [best, most] = [{ delimiter: delimiters[0], decimalComma: false }, -1];
  for (const delimiter of delimiters) {
    const rows = sample.map((line) => cellsOf(line, delimiter)).filter((row) => row.length > 1);
    for (const decimalComma of [false, true]) {
      const counts = rows.map((row) => row.filter((cell) => !cell || isNumber(cell, decimalComma)).length);
      // Of names such as "X 2" between tabs, white space would make more numbers
      const count = counts.reduce((sum, numbers, i) => (2 * numbers > rows[i].length ? sum + numbers : sum), 0);
      if (count > most) [best, most] = [{ delimiter, decimalComma }, count];
    }
  }
  return best;
}

/**
 * What one unit of the last digit that tells anything is worth, of each number of a column. Zeros at the end do not count, as
 * some programs add them, and the number with the most digits tells for all.
 * @param {string[]} cells
 */
export function lastDigits(cells) {
  const parts = cells.map((cell) => {
    const [, whole = "", printed = "", power = "0"] = DIGITS.exec(cell) ?? [];
    const decimals = printed.replace(/(?<!0)0+$/, "");
    const count = (whole + decimals).replace(/^0+/, "").length;
    // 12.50e-3: three digits, the first at 10^-2, the last at 10^-4, and printed to 10^-5
    const last = Number(power) - decimals.length;
    return { count, last, first: last + count - 1, printed: Number(power) - printed.length };
  });
  const told = parts.filter(({ count }) => count);
  const most = largest(told.map(({ count }) => count));
  const lowest = told.length ? -largest(told.map(({ last }) => -last)) : 0;
  return parts.map(({ count, first, printed }) => {
    return Number(`1e${count ? Math.max(lowest, Math.min(first + 1 - most, printed)) : lowest}`);
  });
}
