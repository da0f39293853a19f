/** Units in which tables have lengths, times and angles. */

const DEGREE = Math.PI / 180;
/** SI unit -> unit -> its factor. @type {Record<string, Record<string, number>>} */
const FACTORS = {
  m: { m: 1, cm: 1e-2, mm: 1e-3 },
  s: { s: 1, ms: 1e-3 },
  rad: { rad: 1, deg: DEGREE, "°": DEGREE },
};

/** The factor from a unit to the SI unit of its kind; null: it is none. @param {string} si @param {string} unit */
export const factorTo = (si, unit) => (Object.hasOwn(FACTORS[si], unit) ? FACTORS[si][unit] : null);
