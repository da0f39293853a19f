/** The grammar of the names that programs and people write above columns, as `identify` reads them (`measured/columns.py`). */

/**
 * `role`: "t", "frame", "object", "run", "setting", or a position, height, angle or rate; "" if it is none of these. `track`: the tracked
 * object. `axis`: that of an angular rate. `group`: what stands before a colon in its name, a program's name for its data, or an object.
 * `rows`: those that the column stands in.
 * @typedef {{index: number, label: string, role: string, track: string, axis: string, unit: string, run: string, group: string,
 *   rows: import("./table.js").Row[]}} Column
 */

const POSITION_ROLES = ["x", "y", "height", "angle", "angle_rate"];
/** @param {string} words */
const setOf = (words) => new Set(words.split(", "));
/** Quantity -> the words that say it, as a table by word. @param {Record<string, string>} table */
const byWord = (table) =>
  new Map(Object.entries(table).flatMap(([role, words]) => words.split(", ").map((word) => /** @type {const} */ ([word, role]))));
const ROLES = byWord({
  t: "t, time, times, timestamp, zeit, temps, tiempo, tempo",
  frame: "frame, frames, framenumber, bild, bildnummer, image",
  x: "horizontal",
  y: "vertical",
  height: "height, h, höhe, hauteur, altura",
  angle_rate: "omega, ω, gyroscope, gyroskop, gyro, winkelgeschwindigkeit",
  angle: "angle, theta, θ, winkel",
});
const WHOLE_NAMES = byWord({
  run: "drop, run",
  object: "particle, object, objekt, objet, track, track id, trackid, trajectory, point, marker",
  setting: "frame rate, framerate, fps, x origin, y origin, origin x, origin y, origin, scale",
});
const RATE_WORDS = setOf("rate, velocity, speed, vitesse, geschwindigkeit, velocidad");
/** Words of quantities that are computed from positions, or are none. */
const DERIVED_WORDS = new Set([...RATE_WORDS, ...setOf(
  "vx, vy, ax, ay, acceleration, beschleunigung, accélération, force, kraft, energy, momentum, pixelx, pixely, error, err, sigma, "
    + "uncertainty, std, origin, scale, absolute, step",
)]);
/** Words that say nothing more beside a quantity. */
const FILLING_WORDS = setOf("position, pos, coordinate, coord, center, centre, centroid, axis, video, elapsed");
/** Units that are told from names without brackets. */
export const UNITS = setOf(
  "m, cm, mm, dm, km, um, µm, in, inch, ft, px, pixel, pixels, s, sec, ms, us, µs, min, rad, deg, °, rad/s, deg/s, °/s, m/s, cm/s, "
    + "mm/s, px/s, m/s^2, m/s², px/m, hz, n, kg, g",
);
/** Longest text that is read as a name; the time that this takes grows with its square. */
const MAX_NAME = 200;
const RUN = /[,:]?\s*\b(?:run|lauf|essai|série)\s*#?\s*([0-9]+)\b\s*[,:]?/i;
const EVERY_RUN = new RegExp(RUN, "gi");
export const WHOLE_RUN = new RegExp(`^(?:${RUN.source})$`, "i");
const AXIS = /^(?:(.*?)[ _./-]+)?([xyz])(?:[ _]?([0-9]+)|[ _./-]+(.*))?$/i;
const BETWEEN_WORDS = /[\s_./-]+/;
const JOINED = /(light|heavy)([xy])/gi;
const CAMEL = /(?<=[a-z0-9])(?=[XYZ]$)/;
const UNIT_SUFFIX = /^(.*?)_(s|ms|m|cm|mm|rad|deg|m_per_s|rad_per_s)$/;

/** Names that a misspelt one is compared with. */
const KNOWN_NAMES = ["x", "y", "light_x", "heavy_y", "angle", "height"];
const CLOSE = 0.6;

/** @param {Partial<Column>} parts @returns {Column} */
export const columnOf = (parts) => ({
  index: 0, label: "", role: "", track: "", axis: "", unit: "", run: "", group: "", rows: [], ...parts,
});

/** The cells of a column. @param {Column} column */
export const cellsOf = ({ index, rows }) => rows.map(({ cells }) => cells[index] ?? "");

/** @param {{role: string}} column */
export const isPlace = ({ role }) => role === "x" || role === "y";

/** @param {{role: string}} column */
export const isPosition = ({ role }) => POSITION_ROLES.includes(role);

/**
 * Split the name of a column: "Latest: light x [cm], Run #2" -> x of light in cm, run 2; its label is what is left without unit, run and
 * program.
 * @param {string} cell
 */
export function parseName(cell) {
  if (cell.length > MAX_NAME) return columnOf({ label: cell });
  const whole = cell.replace(EVERY_RUN, "");
  const colon = whole.lastIndexOf(":");
  const { words, unit } = splitUnit(whole.slice(colon + 1).trim());
  const group = whole.slice(0, Math.max(colon, 0)).trim();
  const name = columnOf({ label: words.toLowerCase(), unit, group, run: RUN.exec(cell)?.[1] ?? "" });
  const tokens = name.label.split(BETWEEN_WORDS).filter(Boolean);
  const any = (/** @type {Set<string>} */ set) => tokens.some((token) => set.has(token));
  const special = WHOLE_NAMES.get(tokens.join(" "));
  if (special) return { ...name, role: special };
  const [, before = "", axisName = "", number = "", after = ""] = AXIS.exec(words.replace(JOINED, "$1 $2").replace(CAMEL, " ")) ?? [];
  const axis = axisName.toLowerCase();
  const roles = tokens.flatMap((token) => ROLES.get(token) ?? []);
  const isAngular = tokens.includes("angular") || roles.includes("angle");
  if (roles.includes("angle_rate") || (isAngular && any(RATE_WORDS)) || (axis && ["rad/s", "deg/s", "°/s"].includes(unit.toLowerCase()))) {
    return { ...name, role: "angle_rate", axis };
  }
  // "v x" is a velocity, "A x" the object A
  const isDerived = any(DERIVED_WORDS) || (tokens.length <= 2 && words.split(BETWEEN_WORDS).some((word) => word === "v" || word === "a"));
  if (isDerived || (unit.includes("/") && UNITS.has(unit.toLowerCase()))) return name;
  if (axis && axis !== "z") {
    return { ...name, role: axis, track: [withoutFilling(before), withoutFilling(after), number].filter(Boolean).join(" ") };
  }
  return { ...name, role: tokens.length <= 3 ? (roles[0] ?? "") : "" };
}

/** An object's name without words such as "position"; nothing else of it is changed. @param {string} name */
function withoutFilling(name) {
  if (!name.toLowerCase().split(BETWEEN_WORDS).some((token) => FILLING_WORDS.has(token))) return name;
  return name.split(/[\s_]+/).filter((token) => !FILLING_WORDS.has(token.toLowerCase())).join(" ");
}

/** A unit without its brackets. @param {string} cell */
export const bare = (cell) => cell.replace(/^[[\]() ]+|[[\]() ]+$/g, "");

/** Split a unit off: "x [cm]", "x (cm)", "x/cm", "x in cm", "x, cm" or "x_cm". @param {string} words */
function splitUnit(words) {
  if (words.endsWith("]") || words.endsWith(")")) {
    const inside = words.slice(0, -1);
    const last = Math.max(inside.lastIndexOf("]"), inside.lastIndexOf(")")) + 1; // an earlier pair of brackets is part of the name
    const opening = inside.slice(last).search(/[[(]/);
    if (opening < 0) return { words, unit: "" };
    return { words: inside.slice(0, last + opening).replace(/[ /]+$/, ""), unit: inside.slice(last + opening + 1).trim() };
  }
  for (const sign of ["/", " in ", ","]) {
    // From the left, as a unit may have a slash of its own
    for (let place = words.indexOf(sign, 1); place > 0; place = words.indexOf(sign, place + 1)) {
      const unit = words.slice(place + sign.length).trim();
      if (UNITS.has(unit.toLowerCase())) return { words: words.slice(0, place).trim(), unit };
    }
  }
  const [, name = words, suffix = ""] = UNIT_SUFFIX.exec(words) ?? [];
  return { words: name, unit: suffix.replace("_per_", "/") };
}

/** The known name that is most like a word; "" if none is. @param {string} word */
export function closest(word) {
  const rated = KNOWN_NAMES.map((name) => ({ name, likeness: (2 * common(name, word)) / (name.length + word.length) }));
  const close = rated.filter(({ likeness }) => likeness >= CLOSE).sort((a, b) => b.likeness - a.likeness || (a.name < b.name ? 1 : -1));
  return close[0]?.name ?? "";
}

/** Number of letters in common, in order (Ratcliff and Obershelp). @param {string} a @param {string} b @returns {number} */
function common(a, b) {
  for (let size = a.length; size > 0; size--) {
    for (let i = 0; i + size <= a.length; i++) {
      const j = b.indexOf(a.slice(i, i + size));
      if (j >= 0) return size + common(a.slice(0, i), b.slice(0, j)) + common(a.slice(i + size), b.slice(j + size));
    }
  }
  return 0;
}
