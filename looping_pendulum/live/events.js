/** Finds the first event within a step: where an event function falls through zero. */

import { BETWEEN, CHECKS, DIP_THRESHOLD, MIN_DIP_DEPTH } from "./model.js";

/** Values at `CHECKS` -> values of the polynomial through them at `BETWEEN`: Lagrange's polynomials. */
const WEIGHTS = BETWEEN.map((x) =>
  Float64Array.from(CHECKS, (node, i) =>
    CHECKS.reduce((product, other, j) => (j === i ? product : (product * (x - other)) / (node - other)), 1),
  ),
);
/** Largest value between `CHECKS` of such a polynomial whose values at `CHECKS` are at most 1 (Lebesgue's constant). */
const MAX_GROWTH = Math.max(...WEIGHTS.map((weights) => weights.reduce((sum, weight) => sum + Math.abs(weight), 0)));
const GOLDEN = (3 - Math.sqrt(5)) / 2;
const MAX_ITERATIONS = 200;

/**
 * Return the place of the first event function that falls through zero within a step, and the fraction of the step at which it
 * does; null without one.
 * @param {number} count number of event functions
 * @param {(x: number, out: Float64Array) => void} evaluate writes the event functions at the fraction x
 * @param {boolean} dips whether to look for dips between `CHECKS`; not in a mode's first step, where a function that starts at
 *   zero is all rounding
 * @returns {{place: number, fraction: number} | null}
 */
export function firstEvent(count, evaluate, dips) {
  const scratch = new Float64Array(count);
  const table = new Float64Array(count * CHECKS.length);
  for (let i = 0; i < CHECKS.length; i++) {
    evaluate(CHECKS[i], scratch);
    for (let place = 0; place < count; place++) table[place * CHECKS.length + i] = scratch[place];
  }
  let first = null;
  for (let place = 0; place < count; place++) {
    const values = table.subarray(place * CHECKS.length, (place + 1) * CHECKS.length);
    const value = (/** @type {number} */ x) => {
      evaluate(x, scratch);
      return scratch[place];
    };
    const bracket = crossing(values, value, dips);
    if (!bracket) continue;
    const fraction = root(value, ...bracket);
    if (first === null || fraction < first.fraction) first = { place, fraction };
  }
  return first;
}

/**
 * Return fractions between which a function falls through zero for the first time; null if it does not.
 * @param {Float64Array} values its values at `CHECKS`
 * @param {(x: number) => number} value
 * @param {boolean} dips
 * @returns {[number, number] | null}
 */
function crossing(values, value, dips) {
  let fall = 1;
  while (fall < values.length && !(values[fall - 1] > 0 && values[fall] <= 0)) fall++;
  const falls = fall < values.length;
  const before = falls ? CHECKS[fall - 1] : 1;
  // A function that only just falls through zero may be back above it at the next of the checks
  const dip = dips && values[0] > 0 ? bottomOfDip(values, value, before) : null;
  if (dip !== null) return [Math.max(...CHECKS.filter((x) => x < dip)), dip];
  return falls ? [before, CHECKS[fall]] : null;
}

/**
 * Return the fraction up to `before` at which a function that is positive at `CHECKS` has a minimum below zero; null without one.
 * @param {Float64Array} values its values at `CHECKS`
 * @param {(x: number) => number} value
 * @param {number} before
 */
function bottomOfDip(values, value, before) {
  let largest = 0;
  for (let i = 0; i < values.length; i++) largest = Math.max(largest, Math.abs(values[i]));
  const [start, end] = [values[0], values[values.length - 1]];
  let bend = 0;
  for (let i = 0; i < values.length; i++) {
    bend = Math.max(bend, Math.abs(values[i] - start - CHECKS[i] * (end - start)));
  }
  // In most steps a function is so nearly linear that the polynomial cannot be so low
  if (Math.min(start, end) - MAX_GROWTH * bend > DIP_THRESHOLD * largest) return null;
  let lowest = 0;
  let least = start;
  // Most of a run's time would pass here with the methods of arrays
  for (let i = 1; i < BETWEEN.length && BETWEEN[i] <= before; i++) {
    const weights = WEIGHTS[i];
    let between = 0;
    for (let j = 0; j < weights.length; j++) between += weights[j] * values[j];
    if (between < least) {
      least = between;
      lowest = i;
    }
  }
  if (!(least < DIP_THRESHOLD * largest && lowest > 0 && lowest < BETWEEN.length - 1)) return null;
  const bottom = minimize(value, BETWEEN[lowest - 1], Math.min(BETWEEN[lowest + 1], before));
  return value(bottom) <= -MIN_DIP_DEPTH * largest ? bottom : null;
}

/**
 * Return where a function that has opposite signs at a and b is zero, to rounding (Chandrupatla 1997).
 * @param {(x: number) => number} f
 * @param {number} a
 * @param {number} b
 */
export function root(f, a, b) {
  // The root is between the newest point and the opposite one
  let [newest, opposite] = [b, a];
  let [atNewest, atOpposite] = [f(b), f(a)];
  let share = 0.5;
  for (let i = 0; i < MAX_ITERATIONS; i++) {
    const x = newest + share * (opposite - newest);
    const fx = f(x);
    const sameSide = Math.sign(fx) === Math.sign(atNewest);
    // The point that is given up helps to interpolate
    const [previous, atPrevious] = sameSide ? [newest, atNewest] : [opposite, atOpposite];
    if (!sameSide) [opposite, atOpposite] = [newest, atNewest];
    [newest, atNewest] = [x, fx];
    const [best, least] = Math.abs(atNewest) < Math.abs(atOpposite) ? [newest, atNewest] : [opposite, atOpposite];
    const smallest = (2 * Number.EPSILON * Math.abs(best)) / Math.abs(opposite - newest);
    if (least === 0 || smallest > 0.5) return best;
    const place = (newest - opposite) / (previous - opposite);
    const height = (atNewest - atOpposite) / (atPrevious - atOpposite);
    share = 0.5;
    if (height ** 2 < place && (1 - height) ** 2 < 1 - place) {
      // Inverse quadratic interpolation, where it is monotonic
      share =
        (atNewest / (atOpposite - atNewest)) * (atPrevious / (atOpposite - atPrevious)) +
        ((previous - newest) / (opposite - newest)) *
          (atNewest / (atPrevious - atNewest)) *
          (atOpposite / (atPrevious - atOpposite));
    }
    share = Math.min(1 - smallest, Math.max(smallest, share));
  }
  return newest;
}

/**
 * Return where a function has its least value between a and b, to 1e-9 (golden section).
 * @param {(x: number) => number} f
 * @param {number} a
 * @param {number} b
 */
export function minimize(f, a, b) {
  let [c, d] = [a + GOLDEN * (b - a), b - GOLDEN * (b - a)];
  let [fc, fd] = [f(c), f(d)];
  while (b - a > 1e-9) {
    if (fc < fd) {
      [b, d, fd] = [d, c, fc];
      c = a + GOLDEN * (b - a);
      fc = f(c);
    } else {
      [a, c, fc] = [c, d, fd];
      d = b - GOLDEN * (b - a);
      fd = f(d);
    }
  }
  return 0.5 * (a + b);
}
