/**
 * Splits a table of any program into columns, of which a person then says what each is, and makes a plain table of it for `readTrial`.
 * Which mass is which, and what has no name, is asked and not guessed.
 */

import { LARGEST_FILE, cellsOf, linesOf } from "./table.js";
import { factorTo } from "./units.js";

/** What a column can be, beside nothing: its name in a plain table -> the SI unit. @type {Record<string, string>} */
export const ROLES = { t: "s", light_x: "m", light_y: "m", heavy_x: "m", heavy_y: "m", angle: "rad", height: "m" };
/** @typedef {{head: string[], rows: string[][], decimalComma: boolean, others: number}} Columns names and cells as the file has them;
 * `others`: lines below the first row that hold no row */

const DELIMITERS = [/\t/, /;/, /,/, /\s+/];
const LEAST_ROWS = 3;
const [WITH_POINT, WITH_COMMA] = [/^[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?$/i, /^[+-]?(\d+,?\d*|,\d+)(e[+-]?\d+)?$/i];
/** The unit at the end of a heading: "x (cm)", "x in cm", "x_cm". */
const UNIT = /(?:[[(]\s*([a-z°]+)\s*[\])]|(?:\bin|[_,/])\s*([a-z°]+))\s*$/i;
const [TIME, ANGLE, HEIGHT] = [/^(t|time|times|zeit|zeitpunkt|seconds?|sekunden?)(?![a-z])/i, /^(angle|winkel|theta)(?![a-z])/i, /^(height|h\u00f6he)(?![a-z])/i];
const AXIS = /(?:^|[^a-z])([xy])(?![a-z])/i;
const [OF_LIGHT, OF_HEAVY] = [/light|leicht|m1(?!\d)/i, /heavy|schwer|m2(?!\d)/i];

/** The columns of a table; null: it is none. @param {Uint8Array} bytes @returns {Columns | null} */
export function columnsOf(bytes) {
  if (bytes.length > LARGEST_FILE) return null;
  const lines = linesOf(bytes).map(({ line }) => line.trim());
  const found = DELIMITERS.map((delimiter) => splitBy(lines, delimiter)).reduce((best, one) => (one.rows.length > best.rows.length ? one : best));
  return found.rows.length < LEAST_ROWS ? null : found;
}

/** The rows of numbers that a delimiter makes, all as wide as most are, and what stands above them. @param {string[]} lines @param {RegExp} delimiter
 * @returns {Columns} */
function splitBy(lines, delimiter) {
  const cells = lines.map((line) => cellsOf(line, delimiter));
  const isNumber = (/** @type {string} */ cell) => WITH_POINT.test(cell) || (delimiter.source !== "," && WITH_COMMA.test(cell));
  const isRow = (/** @type {string[]} */ row) => row.length > 1 && row.filter(isNumber).length > row.length / 2;
  /** @type {Map<number, number>} */
  const counts = new Map();
  for (const row of cells) if (isRow(row)) counts.set(row.length, (counts.get(row.length) ?? 0) + 1);
  const [width] = [...counts].reduce((most, one) => (one[1] > most[1] ? one : most), [0, 0]);
  const rows = cells.filter((row) => row.length === width && isRow(row));
  const first = Math.max(cells.findIndex((row) => row.length === width && isRow(row)), 0);
  const head = cells.slice(0, first).findLast((row) => row.length === width);
  const others = cells.length - first - rows.length;
  const decimalComma = rows.some((row) => row.some((cell) => cell.includes(",")));
  return { head: head ?? Array.from({ length: width }, (_, i) => `${i + 1}`), rows, decimalComma, others };
}

/** What each column seems to be by its heading; "": that must be said. @param {string[]} head */
export function guessed(head) {
  const axes = head.map((name) => AXIS.exec(name)?.[1].toLowerCase() ?? "");
  const isAlone = ["x", "y"].every((axis) => axes.filter((one) => one === axis).length === 1);
  const roles = head.map((name, i) => {
    if (TIME.test(name)) return "t";
    if (ANGLE.test(name)) return "angle";
    if (HEIGHT.test(name)) return "height";
    const mass = OF_LIGHT.test(name) || (axes[i] && isAlone) ? "light" : OF_HEAVY.test(name) ? "heavy" : "";
    return axes[i] && mass ? `${mass}_${axes[i]}` : "";
  });
  return roles.map((role, i) => (roles.indexOf(role) === i ? role : ""));
}

/** A plain table of the columns that have a role, with the units of their headings. @param {Columns} columns @param {string[]} roles */
export function plainTable({ head, rows, decimalComma }, roles) {
  const used = roles.flatMap((role, i) => (role ? [i] : []));
  const names = used.map((i) => [roles[i], ...(unitOf(head[i], ROLES[roles[i]]) ?? [])].join(" "));
  const plain = (/** @type {string} */ cell) => (decimalComma ? cell.replace(",", ".") : cell);
  return [names, ...rows.map((row) => used.map((i) => plain(row[i])))].map((cells) => cells.join(",")).join("\n").concat("\n");
}

/** A plain table of what was read: a row for each time, an empty cell where a channel has no value then.
 * @param {import("./reader.js").Channel[]} channels */
export function tableOf(channels) {
  const times = [...new Set(channels.flatMap(({ t }) => t))].sort((a, b) => a - b);
  const values = channels.map(({ t, value }) => new Map(t.map((time, i) => [time, value[i]])));
  const names = ["t [s]", ...channels.map(({ name }) => `${name} [${ROLES[name]}]`)];
  const rows = times.map((time) => [time, ...values.map((one) => one.get(time) ?? "")]);
  return [names, ...rows].map((cells) => cells.join(",")).join("\n").concat("\n");
}

/** The unit that a heading states in brackets, if it is one of the quantity. @param {string} name @param {string} si @returns {string[] | null} */
function unitOf(name, si) {
  const match = UNIT.exec(name);
  const unit = (match?.[1] ?? match?.[2] ?? "").toLowerCase();
  return unit && factorTo(si, unit) !== null ? [`[${unit}]`] : null;
}
