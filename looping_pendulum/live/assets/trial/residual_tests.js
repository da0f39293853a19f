/**
 * Whether what a fit leaves is noise, by the tests of `identify` (`discrepancy/fit/residual.py`): its size, and in each group
 * of residuals whether neighbours err alike, and where. The limits are those: of 24 blind trials without a missing effect none
 * is above one of them.
 */

import { range, sumOfSquares } from "./statistics.js";

/**
 * @typedef {{name: string, t: number[], z: number[], mode: string[], wrapAngle: number[]}} StandardisedChannel of each point
 *   that is fitted its time since the release, its residual in units of its noise, and the mode and wrap angle of the run by the
 *   model
 * @typedef {{direction: string, sliding: boolean, t: number[], z: number[]}} Group `direction`: a channel, or "along" or
 *   "across" the light mass's string
 * @typedef {{direction: string, sliding: boolean, time: number}} Place where a misfit is largest, and when [s]
 * @typedef {{ratio: number, larger: boolean, pattern: boolean, place: Place | null}} ResidualTests root mean square in units of
 *   the noise; whether that is more than noise has; whether neighbours err alike; `place`: null if it is noise
 */

/** Largest mean square that passes, with many values; excess of fewer ones, in units of 1/sqrt(n). */
const [MAX_CHI2_PER_DOF, CHI2_SCATTER_SIGMAS] = [1.07, 3.5];
/** Largest z of the score of errors that last so many frames. */
const [MAX_LASTING_Z, FRAMES] = [3.4, [4, 10, 24]];
const MIN_GROUP_SIZE = 20;
const SLIDING = ["sliding_up", "sliding_down"];

/**
 * @param {StandardisedChannel[]} channels @param {number} parameters how many were fitted
 * @param {boolean} haveErrors whether the file states errors: neighbours share a part of a tracker's, so that the size alone tells
 * @returns {ResidualTests}
 */
export function testResiduals(channels, parameters, haveErrors) {
  const count = channels.reduce((sum, { z }) => sum + z.length, 0);
  const square = channels.reduce((sum, { z }) => sum + sumOfSquares(z), 0) / Math.max(count - parameters, 1);
  const limit = Math.max(MAX_CHI2_PER_DOF, 1 + CHI2_SCATTER_SIGMAS / Math.sqrt(count));
  const groups = groupsOf(channels).filter(({ z }) => z.length >= MIN_GROUP_SIZE);
  const largest = (/** @type {(group: Group) => number} */ of) => groups.reduce((one, other) => (of(other) > of(one) ? other : one));
  const [larger, pattern] = [square > limit, !haveErrors && groups.some((group) => lasting(group) > MAX_LASTING_Z)];
  const worst = pattern ? largest(lasting) : larger && groups.length ? largest(({ z }) => sumOfSquares(z) / z.length) : null;
  return { ratio: Math.sqrt(square), larger, pattern, place: worst && placeOf(worst) };
}

/** Where neighbours of a group are off together by most. @param {Group} group @returns {Place} */
function placeOf({ direction, sliding, t, z }) {
  const around = z.map((_, i) => Math.abs(z.slice(Math.max(i - FRAMES[0], 0), i + FRAMES[0] + 1).reduce((sum, one) => sum + one, 0)));
  return { direction, sliding, time: t[around.indexOf(Math.max(...around))] };
}

/**
 * Residuals by mode and direction: those of the light mass along and across its string.
 * @param {StandardisedChannel[]} channels @returns {Group[]}
 */
function groupsOf(channels) {
  const [x, y] = ["light_x", "light_y"].map((wanted) => channels.find(({ name }) => name === wanted));
  const directions = channels.filter((one) => !(x && y && (one === x || one === y)));
  if (x && y) {
    const places = new Map(y.t.map((t, i) => [t, i]));
    const both = range(0, x.t.length).filter((i) => places.has(x.t[i]));
    const turned = (/** @type {string} */ name, /** @type {(zx: number, zy: number, angle: number) => number} */ turn) => ({
      ...x,
      name,
      t: both.map((i) => x.t[i]),
      z: both.map((i) => turn(x.z[i], y.z[places.get(x.t[i]) ?? 0], x.wrapAngle[i])),
      mode: both.map((i) => x.mode[i]),
    });
    directions.push(turned("along", (zx, zy, angle) => zx * Math.sin(angle) - zy * Math.cos(angle)));
    directions.push(turned("across", (zx, zy, angle) => -zx * Math.cos(angle) - zy * Math.sin(angle)));
  }
  return directions.flatMap(({ name: direction, t, z, mode }) =>
    [true, false].map((sliding) => {
      const here = range(0, z.length).filter((i) => SLIDING.includes(mode[i]) === sliding);
      return { direction, sliding, t: here.map((i) => t[i]), z: here.map((i) => z[i]) };
    }),
  );
}

/** Largest score of errors that last some frames. @param {Group} group */
const lasting = ({ z }) => Math.max(...FRAMES.map((frames) => lastingZ(z, frames)));

/**
 * Standard score of errors whose correlation falls as exp(-k / frames), against white noise: the sum of the products of all
 * pairs of residuals, so weighted, by its exact variance and skewness, and Wilson's and Hilferty's cube root.
 * @param {number[]} z @param {number} frames
 */
function lastingZ(z, frames) {
  const n = z.length;
  const decay = Math.exp(-1 / frames);
  let [earlier, score, square, cube] = [0, 0, 0, 0];
  for (let i = 1; i < n; i++) {
    earlier = decay * (earlier + z[i - 1]);
    score += z[i] * earlier;
    const pairs = (n - i) * decay ** (2 * i); // of values that are i apart
    square += pairs;
    cube += 6 * (i - 1) * pairs;
  }
  const variance = square / (n * (n + 2));
  const skewness = cube / (n * (n + 2) * (n + 4)) / variance ** 1.5;
  const root = Math.cbrt(Math.max(1 + (score / sumOfSquares(z) / Math.sqrt(variance)) * (skewness / 2), 0));
  return ((root - 1 + skewness ** 2 / 36) * 6) / skewness;
}
