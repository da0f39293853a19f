/** Messages about a file and the numbers in them, as Python writes them. */

import { shown, text } from "../texts.js";

/** A file that cannot be used; the message is one line. */
export class DataError extends Error {}

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
  const quoted = characters.length <= MAX_QUOTED ? value : [...characters.slice(0, MAX_QUOTED - 3), "..."].join("");
  return `'${quoted}'`;
}

/** Largest number of names or lines that a sentence lists. */
const MAX_LISTED = 5;

/** Names for a message: the first few, and how many more there are. @param {(string | number)[]} names */
export function listed(names) {
  const shown = names.slice(0, MAX_LISTED).join(", ");
  return names.length > MAX_LISTED ? text("fault.more", { shown, count: names.length - MAX_LISTED }) : shown;
}

/** A number in Python's format "g". @param {number} x @param {number} digits */
export function general(x, digits = 6) {
  if (x === 0) return "0";
  if (!Number.isFinite(x)) return String(x).replace("Infinity", "inf").toLowerCase();
  const [mantissa, exponent] = rounded(x, digits).split("e");
  const power = Number(exponent);
  if (power >= -4 && power < digits) return String(Number(`${mantissa}e${power}`));
  return `${Number(mantissa)}e${power < 0 ? "-" : "+"}${String(Math.abs(power)).padStart(2, "0")}`;
}

/** A number with some digits, such as "1.02e+1"; of two that are as near, the even one, where JavaScript takes the larger one.
 * @param {number} x @param {number} digits */
function rounded(x, digits) {
  const [mantissa, exponent] = x.toExponential(digits - 1).split("e");
  const further = x.toExponential(digits + 20).split("e")[0].slice(-21);
  const last = Number(mantissa.at(-1));
  const toEven = /^50*$/.test(further) && last % 2 ? [mantissa.slice(0, -1), last - 1].join("") : mantissa;
  return `${toEven}e${exponent}`;
}

/** A number in a sentence. @param {number} x @param {number} [digits] */
export const inSentence = (x, digits) => shown(general(x, digits));

/**
 * @param {string} file
 * @param {number | null} line
 * @param {string} column
 * @param {string} message
 */
export function dataError(file, line, column, message) {
  const place = line ? `${file}:${line}` : file;
  const whole = `${place}: ${column ? text("file.inColumn", { column, message }) : message}`;
  return new DataError(whole.replace(UNPRINTABLE, escaped));
}
