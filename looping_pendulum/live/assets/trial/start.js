/** Tells where a record begins, as `identify` does (`measured/readers.py`, `measured/noise.py`). */

import { median, range, robustDeviation } from "./statistics.js";

/** @import { Channel } from "./reader.js" */

/** Twice the largest acceleration of a mass after its release [m/s^2], and of an angle [rad/s^2]: a record that is faster begins later. */
const [MAX_START_ACCELERATION, MAX_ANGULAR_ACCELERATION] = [9.81, 98.1];
/** The same by noise, in its standard deviations. */
const MAX_START_SIGMAS = 4;
/** Order of the differences in which a smooth motion leaves nothing, so that they show its noise. */
const ORDER = 4;
/** Windows of points that are longer than this many median windows have gaps. */
const MAX_WINDOW_RATIO = 1.6;

/** Time at which a clock begins elsewhere while the masses are at rest [s]; 0: it does not. @param {Channel[]} channels */
export function startOf(channels) {
  const start = Math.min(...channels.map(({ t }) => t[0]));
  const stepsOf = (/** @type {number[]} */ t) => t.slice(1).map((later, i) => later - t[i]);
  const step = Math.min(...channels.filter(({ t }) => t.length > 1).map(({ t }) => median(stepsOf(t))));
  if (Math.abs(start) <= 3 * step) return 0; // without a step, too
  const isMoving = channels.some(({ name, t, value }) => {
    const acceleration = name === "angle" ? MAX_ANGULAR_ACCELERATION : MAX_START_ACCELERATION;
    const most = acceleration * (t[2] - t[0]) ** 2 + MAX_START_SIGMAS * scatter(t, value);
    return t.length <= ORDER || Math.abs(value[2] - value[0]) > most;
  });
  return isMoving ? 0 : start;
}

/** Typical size of differences of fourth order: the noise of points on a smooth motion. @param {number[]} t @param {number[]} value */
export function scatter(t, value) {
  if (t.length <= ORDER) return 0;
  const windows = range(0, t.length - ORDER);
  const longest = MAX_WINDOW_RATIO * median(windows.map((i) => t[i + ORDER] - t[i]));
  const whole = windows.filter((i) => t[i + ORDER] - t[i] < longest);
  return robustDeviation(whole.map((i) => difference(t.slice(i, i + ORDER + 1), value.slice(i, i + ORDER + 1))));
}

/** Divided difference of some points, scaled so that white noise of variance 1 gives variance 1.
 * @param {number[]} t @param {number[]} value */
function difference(t, value) {
  const length = t[t.length - 1] - t[0];
  const weights = t.map((one, i) => 1 / t.reduce((product, other, j) => (j === i ? product : (product * (one - other)) / length), 1));
  const size = Math.hypot(...weights);
  return weights.reduce((sum, weight, i) => sum + (weight / size) * value[i], 0);
}
