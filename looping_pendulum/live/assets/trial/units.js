/** Units in which files have lengths, times and angles. */

const DEGREE = Math.PI / 180;
/** SI unit -> unit -> its factor. @type {Record<string, Record<string, number>>} */
const FACTORS = {
  m: {
    m: 1, dm: 0.1, cm: 1e-2, mm: 1e-3, km: 1e3, um: 1e-6, "µm": 1e-6, in: 0.0254, inch: 0.0254, ft: 0.3048, foot: 0.3048, feet: 0.3048,
    meter: 1, metre: 1, centimeter: 1e-2, centimetre: 1e-2, millimeter: 1e-3, millimetre: 1e-3,
  },
  s: { s: 1, sec: 1, second: 1, ms: 1e-3, millisecond: 1e-3, us: 1e-6, "µs": 1e-6, microsecond: 1e-6, min: 60, minute: 60 },
  rad: { rad: 1, radian: 1, mrad: 1e-3, deg: DEGREE, degree: DEGREE, "°": DEGREE, turn: 2 * Math.PI, revolution: 2 * Math.PI },
  "rad/s": { "rad/s": 1, "rad/sec": 1, "radian/s": 1, "deg/s": DEGREE, "degree/s": DEGREE, "°/s": DEGREE },
};
const PIXELS = ["px", "pixel", "pixels"];
/** A unit with a size of its own, "1.4 mm" for the pixels of a picture. */
const SIZED = /^([0-9]+(?:\.[0-9]*)?(?:[eE][+-]?[0-9]{1,3})?)? *(.*)$/;
/** Shortest word that has a plural; "ms" has none. */
const MIN_WORD = 4;

/** @param {string} unit */
export const isPixel = (unit) => PIXELS.includes(unit.toLowerCase());

/** The factor from a unit to the SI unit of its kind; null: it is none. @param {string} si @param {string} unit */
export function factorTo(si, unit) {
  const [, size = "1", name = ""] = SIZED.exec(unit.replace("μ", "µ")) ?? [];
  const singular = name.length >= MIN_WORD && name.endsWith("s") ? name.slice(0, -1) : name;
  const known = [name, singular].find((one) => Object.hasOwn(FACTORS[si], one));
  return known === undefined ? null : Number(size) * FACTORS[si][known];
}
