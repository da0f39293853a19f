/** Reads a text table as `identify` does (`discrepancy/data/delimited.py`): encoding, delimiter, decimal comma, header. */

import { text } from "../texts.js";

/** A file that cannot be used; the message is one line. */
export class DataError extends Error {}

/** @typedef {{line: number, cells: string[]}} TableLine */

const LARGEST_FILE = 20 * 1024 * 1024;
const MAX_LINE_LENGTH = 100_000;
const MISSING = new Set(["", "-", "--", "nan", "na", "n/a", "null", "none"]);
const DECIMAL_POINT = /^[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]{1,4})?$/;
const DECIMAL_COMMA = /^[+-]?[0-9]*,[0-9]+(?:[eE][+-]?[0-9]{1,4})?$/;
/** First bytes -> what the file is. @type {[number[], import("../texts.js").TextKey][]} */
const OTHER_FORMATS = [
  [[0x50, 0x4b, 3, 4], "file.zip"],
  [[0xd0, 0xcf, 0x11, 0xe0], "file.spreadsheet"],
  [[0x3c, 0x3f, 0x78, 0x6d, 0x6c], "file.xml"],
  [[0x25, 0x50, 0x44, 0x46], "file.pdf"],
];
const MAX_QUOTED = 60;

const UNPRINTABLE = /(?! )[\p{C}\p{Z}]/gu;

/** An unprintable character as Python escapes it. @param {string} character */
function escaped(character) {
  /** @type {Record<string, string>} */
  const short = { "\t": "\\t", "\n": "\\n", "\r": "\\r" };
  const code = character.codePointAt(0) ?? 0;
  const [letter, digits] = code < 0x100 ? ["x", 2] : code < 0x10000 ? ["u", 4] : ["U", 8];
  return short[character] ?? `\\${letter}${code.toString(16).padStart(digits, "0")}`;
}

/** A text in quotation marks, as Python writes it. @param {string} value */
export function inQuotes(value) {
  const mark = value.includes("'") && !value.includes('"') ? '"' : "'";
  const plain = value.replaceAll("\\", "\\\\").replace(UNPRINTABLE, escaped);
  return `${mark}${mark === "'" ? plain.replaceAll("'", "\\'") : plain}${mark}`;
}

/** A value of a file as messages name it. @param {string} value */
export function quote(value) {
  const characters = [...value];
  return `'${characters.length <= MAX_QUOTED ? value : `${characters.slice(0, MAX_QUOTED - 3).join("")}...`}'`;
}

/** A number with six digits, as Python's format "g" writes it. @param {number} x @param {number} digits */
export function general(x, digits = 6) {
  if (x === 0) return "0";
  const [mantissa, exponent] = x.toExponential(digits - 1).split("e");
  const power = Number(exponent);
  if (power >= -4 && power < digits) return String(Number(x.toPrecision(digits)));
  return `${Number(mantissa)}e${power < 0 ? "-" : "+"}${String(Math.abs(power)).padStart(2, "0")}`;
}

/**
 * @param {string} file
 * @param {number | null} line
 * @param {string} column
 * @param {string} message
 */
export function dataError(file, line, column, message) {
  const whole = `${line ? `${file}:${line}` : file}: ${column ? text("file.inColumn", { column, message }) : message}`;
  return new DataError(whole.replace(UNPRINTABLE, escaped));
}

/** A text table: lines of a header, then rows of numbers. */
export class Table {
  /**
   * @param {{file: string, delimiter: string, decimalComma: boolean, head: TableLine[], rows: TableLine[]}} parts
   */
  constructor({ file, delimiter, decimalComma, head, rows }) {
    this.file = file;
    this.delimiter = delimiter;
    this.decimalComma = decimalComma;
    this.head = head;
    this.rows = rows;
  }

  /** @param {number | null} line @param {string} column @param {string} message */
  error(line, column, message) {
    return dataError(this.file, line, column, message);
  }

  /**
   * Value of a cell; null if it is empty or says that there is none.
   * @param {TableLine} row
   * @param {number} index
   * @param {string} column
   */
  number(row, index, column) {
    const cell = row.cells[index] ?? "";
    if (MISSING.has(cell.toLowerCase())) return null;
    const withPoint = this.decimalComma && DECIMAL_COMMA.test(cell) ? cell.replace(",", ".") : cell;
    if (!DECIMAL_POINT.test(withPoint)) throw this.error(row.line, column, text("file.number", { cell: quote(cell) }));
    const value = Number(withPoint);
    if (!Number.isFinite(value)) throw this.error(row.line, column, text("file.finite", { cell: quote(cell) }));
    return value;
  }
}

/**
 * Read the bytes of a file.
 * @param {string} file its name
 * @param {Uint8Array} bytes
 * @returns {Table}
 */
export function readTable(file, bytes) {
  const numbered = decoded(file, bytes).split(/\r\n|\r|\n/).map((line, i) => ({ line, number: i + 1 }));
  const lines = numbered.filter(({ line }) => line.trim() && !line.trimStart().startsWith("#"));
  if (!lines.length) throw dataError(file, null, "", text("file.noRows"));
  for (const { line, number } of lines) {
    if (line.length > MAX_LINE_LENGTH) {
      throw dataError(file, number, "", text("file.longLine", { length: line.length, limit: MAX_LINE_LENGTH }));
    }
  }
  const { delimiter, decimalComma } = dialect(lines.map(({ line }) => line));
  const rows = lines.map(({ line, number }) => ({ line: number, cells: cellsOf(line, delimiter) }));
  const named = rows.findIndex(({ cells }) => cells[0].toLowerCase() === "quantity");
  const first = named >= 0 ? named + 1 : rows.findIndex(({ cells }) => isData(cells, decimalComma));
  if (first < 0 || first === rows.length) {
    const row = quote(lines[lines.length - 1].line.trim());
    throw dataError(file, rows[rows.length - 1].line, "", text("file.noNumbers", { row }));
  }
  const table = new Table({ file, delimiter, decimalComma, head: rows.slice(0, first), rows: rows.slice(first) });
  if (decimalComma) refuseMixedDecimals(table);
  return table;
}

/** @param {string} file @param {Uint8Array} bytes */
function decoded(file, bytes) {
  if (bytes.length > LARGEST_FILE) throw dataError(file, null, "", text("file.large"));
  const begins = (/** @type {number[]} */ start, from = 0) => start.every((byte, i) => bytes[from + i] === byte);
  const afterMark = begins([0xef, 0xbb, 0xbf]) ? 3 : 0;
  for (const [start, what] of OTHER_FORMATS) {
    if (begins(start, afterMark)) throw dataError(file, null, "", text("file.notText", { what: text(what) }));
  }
  const whole = textOf(bytes, begins);
  if (whole.includes("\0")) throw dataError(file, null, "", text("file.notText", { what: text("file.binary") }));
  return whole;
}

/** @param {Uint8Array} bytes @param {(start: number[]) => boolean} begins */
function textOf(bytes, begins) {
  try {
    if (begins([0xff, 0xfe])) return new TextDecoder("utf-16le", { fatal: true }).decode(bytes);
    if (begins([0xfe, 0xff])) return new TextDecoder("utf-16be", { fatal: true }).decode(bytes);
    return new TextDecoder("utf-8", { fatal: true }).decode(bytes);
  } catch {
    // Older programs on Windows write names in their own code page; the numbers are the same in all
    return Array.from(bytes, (byte) => String.fromCharCode(byte)).join("");
  }
}

/**
 * Cells of a line without the spaces around them; quotation marks as spreadsheets write them.
 * @param {string} line
 * @param {string} delimiter " " means any white space
 */
function cellsOf(line, delimiter) {
  if (delimiter === " ") return line.trim().split(/\s+/);
  if (!line.includes('"')) return line.split(delimiter).map((cell) => cell.trim());
  const cells = [];
  let [cell, quoted, start] = ["", false, true];
  for (let i = 0; i < line.length; i++) {
    const sign = line[i];
    if (quoted && sign === '"' && line[i + 1] === '"') {
      cell += sign;
      i += 1;
    } else if (quoted && sign === '"') quoted = false;
    else if (start && sign === '"') [quoted, start] = [true, false];
    else if (!quoted && sign === delimiter) {
      cells.push(cell.trim());
      [cell, start] = ["", true];
    } else {
      cell += sign;
      start = false;
    }
  }
  return [...cells, cell.trim()];
}

/** @param {string[]} lines @returns {{delimiter: string, decimalComma: boolean}} */
function dialect(lines) {
  for (const delimiter of ["\t", ";"]) {
    if (lines.filter((line) => line.includes(delimiter)).length * 2 > lines.length) {
      return { delimiter, decimalComma: lines.some((line) => cellsOf(line, delimiter).some((cell) => DECIMAL_COMMA.test(cell))) };
    }
  }
  // The last line holds numbers, whatever the lines of the header look like
  const last = cellsOf(lines[lines.length - 1], " ");
  if (last.length > 1 && last.every((cell) => DECIMAL_POINT.test(cell) || DECIMAL_COMMA.test(cell))) {
    return { delimiter: " ", decimalComma: lines.some((line) => cellsOf(line, " ").some((cell) => DECIMAL_COMMA.test(cell))) };
  }
  return { delimiter: lines.some((line) => line.includes(",")) ? "," : " ", decimalComma: false };
}

/** Whether a line is a row of numbers: its first cell is one, or most of its cells are. @param {string[]} cells @param {boolean} comma */
function isData(cells, comma) {
  const filled = cells.filter((cell) => cell);
  const numbers = filled.map((cell) => DECIMAL_POINT.test(cell) || (comma && DECIMAL_COMMA.test(cell)));
  return Boolean(cells[0]) && (numbers[0] || 2 * numbers.filter(Boolean).length > filled.length);
}

/** A point among decimal commas could as well separate thousands. @param {Table} table */
function refuseMixedDecimals(table) {
  for (const row of table.rows) {
    row.cells.forEach((cell, i) => {
      if (cell.includes(".") && (DECIMAL_POINT.test(cell) || cell.includes(","))) {
        throw table.error(row.line, String(i + 1), text("file.mixedDecimals", { cell: quote(cell) }));
      }
    });
  }
}
