/** What the readers need of NumPy, with its rounding. */

import { median, range, robustDeviation } from "./statistics.js";

/** Order of the differences in which a smooth motion leaves nothing, so that they show its noise. */
const ORDER = 4;
/** Windows of points that are longer than this many median windows have gaps. */
const MAX_WINDOW_RATIO = 1.6;
/** Smallest standard deviation: keeps divisions finite for data without noise. */
const MIN_SCALE = 1e-12;

/** Not `Math.max(...values)`, which takes no hundred thousand. @param {number[]} values */
export const largest = (values) => values.reduce((most, value) => Math.max(most, value), -Infinity);

/** @param {number[]} values */
export const smallest = (values) => values.reduce((least, value) => Math.min(least, value), Infinity);

/** @param {number[]} values */
export const spanOf = (values) => largest(values) - smallest(values);

/** @param {number[]} values */
export const steps = (values) => values.slice(1).map((value, i) => value - values[i]);

/** Indices of the values that fulfil a condition. @template T @param {T[]} values @param {(value: T, i: number) => boolean} condition */
export const where = (values, condition) => range(0, values.length).filter((i) => condition(values[i], i));

/** Values at some indices. @template T @param {T[]} values @param {number[]} indices */
export const at = (values, indices) => indices.map((i) => values[i]);

/** Whole number nearest to x, of two the even one. @param {number} x */
export function rounded(x) {
  const below = Math.floor(x);
  const rest = x - below;
  return rest < 0.5 || (rest === 0.5 && below % 2 === 0) ? below : below + 1;
}

/** The value that a percentage of all do not exceed; `between`: or one between the nearest two. @param {number[]} values @param {number} percent */
export function percentile(values, percent, between = true) {
  const sorted = [...values].sort((a, b) => a - b);
  const place = (sorted.length - 1) * (percent / 100);
  const [low, high] = [sorted[Math.floor(place)], sorted[Math.ceil(place)]];
  const part = between ? place - Math.floor(place) : 0;
  return part < 0.5 ? low + (high - low) * part : high - (high - low) * (1 - part);
}

/** Typical size of a channel's differences of fourth order (`measured/noise.py`).
 * @param {{t: number[], value: number[]}} channel */
export function scatter({ t, value }) {
  if (t.length <= ORDER) return 0;
  const lengths = range(0, t.length - ORDER).map((i) => t[i + ORDER] - t[i]);
  const longest = MAX_WINDOW_RATIO * median(lengths);
  const whole = where(lengths, (length) => length < longest);
  const differences = whole.map((i) => difference(t.slice(i, i + ORDER + 1), value.slice(i, i + ORDER + 1)));
  // Times that are nearly one give no number
  return Math.max(robustDeviation(differences.filter(Number.isFinite)), MIN_SCALE);
}

/** Divided difference of some points, scaled so that white noise of variance 1 gives variance 1.
 * @param {number[]} t @param {number[]} value */
function difference(t, value) {
  const length = t[t.length - 1] - t[0];
  const weights = t.map((one, i) => 1 / t.reduce((product, other, j) => (j === i ? product : (product * (one - other)) / length), 1));
  const size = Math.hypot(...weights);
  return weights.reduce((sum, weight, i) => sum + (weight / size) * value[i], 0);
}
