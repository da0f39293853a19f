/** Tells which quantity each column holds, as `identify` does (`discrepancy/data/columns.py`). */

import { text } from "../texts.js";
import { quote } from "./table.js";

/** @typedef {import("./table.js").Table} Table */
/** @typedef {import("./table.js").TableLine} TableLine */
/** @typedef {{index: number, label: string, role: string, track: string, unit: string}} Column */
/** @typedef {Record<string, string>} Tracks mass -> name of its track */

/** @type {Record<string, string>} */
const ROLES = {
  t: "t", time: "t", zeit: "t", temps: "t", tiempo: "t", frame: "frame", x: "x", y: "y", drop: "drop", height: "height", h: "height",
  angle: "angle", theta: "angle", rate: "angle_rate", omega: "angle_rate", angle_rate: "angle_rate", angular_velocity: "angle_rate",
  angular_rate: "angle_rate",
};
const TIDY_NAME = /^(?:(light|heavy|m1|m2)[_ ]?([xy])|([xy])[_ ]?([12]))$/;
const SUFFIX = /^(.*?)_(s|ms|m|cm|mm|rad|deg|m_per_s|rad_per_s)$/;
/** @type {Record<string, string>} */
const MASS_OF_NAME = { m1: "light", 1: "light", m2: "heavy", 2: "heavy" };
const KNOWN_NAMES = ["x", "y", "light_x", "heavy_y", "angle", "height"];
const CLOSE = 0.6;

/**
 * @param {Table} table
 * @param {Tracks} tracks
 * @param {string[]} assumptions
 * @returns {Column[]}
 */
export function readColumns(table, tracks, assumptions) {
  const header = [...table.head].reverse().find(({ cells }) => ["t", "frame", "drop"].includes(parseName(cells[0]).role));
  const titleLines = table.head.filter((row) => row !== header);
  if (!header) return byPosition(table, tracks, titleLines, assumptions);
  // Tracker writes a name above the first column of its track; all columns up to the next name are that track's
  let starts = new Map(titleLines.flatMap(({ cells }) => cells.flatMap((cell, i) => (cell ? [/** @type {[number, string]} */ ([i, cell])] : []))));
  if (starts.size === 1) starts = new Map([[0, [...starts.values()][0]]]);
  /** @type {Column[]} */
  const columns = [];
  let track = "";
  header.cells.forEach((cell, index) => {
    track = starts.get(index) ?? track;
    const { role, mass, unit } = parseName(cell);
    if (!cell) return;
    const owner = mass || track;
    columns.push({ index, label: owner && !mass ? `${cell} (${owner})` : cell, role, track: owner, unit });
  });
  if (!columns.some(({ role }) => role === "t" || role === "frame")) {
    const names = quote(header.cells.filter(Boolean).join(", "));
    throw table.error(header.line, "", text("file.noTimes", { names }));
  }
  refuseHeaderWithoutCoordinates(table, header, columns);
  return columns;
}

/** @param {Table} table @param {TableLine} header @param {Column[]} columns */
function refuseHeaderWithoutCoordinates(table, header, columns) {
  if (columns.some(({ role }) => ["x", "y", "height", "angle"].includes(role))) return;
  const found = columns.map((column) => ({ column, match: closest(column.label.toLowerCase()) })).find(({ match }) => match);
  const names = quote(columns.map(({ label }) => label).join(", "));
  const message = found ? text("file.didYouMean", { names, known: found.match, name: found.column.label }) : text("file.noCoordinates", { names });
  throw table.error(header.line, "", message);
}

/** The known name that is most like a word; "" if none is. @param {string} word */
function closest(word) {
  const rated = KNOWN_NAMES.map((name) => ({ name, likeness: likeness(word, name) })).filter(({ likeness: l }) => l >= CLOSE);
  rated.sort((a, b) => b.likeness - a.likeness || (a.name < b.name ? 1 : -1));
  return rated[0]?.name ?? "";
}

/** Twice the letters in common, in order, by all letters (Ratcliff and Obershelp). @param {string} a @param {string} b */
function likeness(a, b) {
  return (2 * common(a, b)) / (a.length + b.length);
}

/** @param {string} a @param {string} b @returns {number} */
function common(a, b) {
  let [size, atA, atB] = [0, 0, 0];
  for (let i = 0; i < a.length; i++) {
    for (let j = 0; j < b.length; j++) {
      let k = 0;
      while (i + k < a.length && a[i + k] === b[j + k]) k += 1;
      if (k > size) [size, atA, atB] = [k, i, j];
    }
  }
  if (!size) return 0;
  return size + common(a.slice(0, atA), b.slice(0, atB)) + common(a.slice(atA + size), b.slice(atB + size));
}

/** "light_x [cm]" -> role "x", mass "light", unit "cm". @param {string} cell */
function parseName(cell) {
  let { words, unit } = splitUnit(cell.trim());
  words = words.toLowerCase();
  const suffix = SUFFIX.exec(words);
  if (suffix && !unit && !TIDY_NAME.test(words)) [words, unit] = [suffix[1], suffix[2].replace("_per_", "/")];
  const tidy = TIDY_NAME.exec(words);
  if (tidy) {
    const [mass, axis] = tidy[1] ? [tidy[1], tidy[2]] : [tidy[4], tidy[3]];
    return { role: axis, mass: MASS_OF_NAME[mass] ?? mass, unit };
  }
  return { role: Object.hasOwn(ROLES, words) ? ROLES[words] : "", mass: "", unit };
}

/** @param {string} words */
function splitUnit(words) {
  if (!words.endsWith("]") && !words.endsWith(")")) return { words, unit: "" };
  const inside = words.slice(0, -1);
  const last = Math.max(inside.lastIndexOf("]"), inside.lastIndexOf(")")) + 1; // an earlier pair of brackets is part of the name
  const openings = ["[", "("].map((sign) => inside.indexOf(sign, last)).filter((i) => i >= 0);
  if (!openings.length) return { words, unit: "" };
  const opening = Math.min(...openings);
  return { words: inside.slice(0, opening).trimEnd(), unit: inside.slice(opening + 1).trim() };
}

/**
 * @param {Table} table
 * @param {Tracks} tracks
 * @param {TableLine[]} titleLines
 * @param {string[]} assumptions
 * @returns {Column[]}
 */
function byPosition(table, tracks, titleLines, assumptions) {
  const width = Math.max(...table.rows.map(({ cells }) => cells.filter(Boolean).length));
  const titles = titleLines.flatMap(({ cells }) => cells.filter(Boolean));
  const given = Object.values(tracks);
  /** @type {[string, string][]} */
  let roles;
  if (!given.length && !titles.length && table.delimiter === " " && (width === 2 || width === 3)) {
    roles = /** @type {[string, string][]} */ ([["t", ""], ["angle", ""], ["angle_rate", ""]]).slice(0, width);
    assumptions.push(text(width > 2 ? "assumed.anglesAndRates" : "assumed.angles"));
  } else if (width === 3 || (width === 5 && (given.length === 2 || titles.length === 2))) {
    const fitting = (/** @type {string[]} */ names) => names.length === Math.floor(width / 2);
    const names = fitting(titles) ? titles : fitting(given) ? given : [stem(table.file)];
    roles = [["t", ""], ...names.flatMap((track) => /** @type {[string, string][]} */ ([["x", track], ["y", track]]))];
    assumptions.push(text(width === 5 ? "assumed.placesOfBoth" : "assumed.places"));
  } else {
    throw table.error(table.rows[0].line, "", text("file.needsNames", { width }));
  }
  return roles.map(([role, track], index) => ({
    index,
    label: track ? text("file.columnOf", { number: index + 1, role, track }) : `${index + 1} (${role})`,
    role,
    track,
    unit: "",
  }));
}

/** Name of a file without its ending. @param {string} file */
export function stem(file) {
  const name = file.slice(Math.max(file.lastIndexOf("/"), file.lastIndexOf("\\")) + 1);
  return name.lastIndexOf(".") > 0 ? name.slice(0, name.lastIndexOf(".")) : name;
}
