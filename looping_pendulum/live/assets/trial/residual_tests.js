/**
 * Whether what a fit leaves is noise, by the tests of `identify` (`discrepancy/fit/residual.py`): its size, and in each group of
 * residuals whether neighbours err alike. The limits are those; noise alone is above one of them in some 3 % of the trials.
 */

import { dot, range, sumOfSquares } from "./statistics.js";

/**
 * @typedef {{name: string, t: number[], z: number[], mode: string[], wrapAngle: number[]}} StandardisedChannel of each point that
 *   is fitted its residual in units of its noise, and the mode and wrap angle of the run by the model
 * @typedef {{ratio: number, larger: boolean, pattern: boolean}} ResidualTests root mean square in units of the noise; whether that is
 *   more than noise has; whether neighbours err alike
 */

/** Largest mean square that passes, with many values; excess of fewer ones, in units of 1/sqrt(n). */
const [MAX_CHI2_PER_DOF, CHI2_SCATTER_SIGMAS] = [1.07, 3.5];
/** Largest z of the correlation of neighbours; smallest z of the number of runs of one sign. */
const [MAX_LAG1_Z, MIN_RUNS_Z] = [3.2, -3.4];
/** Lags of the Ljung-Box statistic, and its largest value: white noise of many values is above it in 0.05 %. */
const [LAGS, MAX_LJUNG_BOX] = [10, 31.42];
const MIN_GROUP_SIZE = 20;
const SLIDING = ["sliding_up", "sliding_down"];

/**
 * @param {StandardisedChannel[]} channels @param {number} parameters how many were fitted
 * @returns {ResidualTests}
 */
export function testResiduals(channels, parameters) {
  const count = channels.reduce((sum, { z }) => sum + z.length, 0);
  const square = channels.reduce((sum, { z }) => sum + sumOfSquares(z), 0) / Math.max(count - parameters, 1);
  const limit = Math.max(MAX_CHI2_PER_DOF, 1 + CHI2_SCATTER_SIGMAS / Math.sqrt(count));
  const groups = groupsOf(channels).filter((z) => z.length >= MIN_GROUP_SIZE);
  return { ratio: Math.sqrt(square), larger: square > limit, pattern: groups.some(hasPattern) };
}

/** Residuals by mode and direction: those of the light mass along and across its string. @param {StandardisedChannel[]} channels */
function groupsOf(channels) {
  const [x, y] = ["light_x", "light_y"].map((wanted) => channels.find(({ name }) => name === wanted));
  const directions = channels.filter((one) => !(x && y && (one === x || one === y)));
  if (x && y) {
    const places = new Map(y.t.map((t, i) => [t, i]));
    const both = range(0, x.t.length).filter((i) => places.has(x.t[i]));
    const turned = (/** @type {(zx: number, zy: number, angle: number) => number} */ turn) => ({
      ...x,
      z: both.map((i) => turn(x.z[i], y.z[places.get(x.t[i]) ?? 0], x.wrapAngle[i])),
      mode: both.map((i) => x.mode[i]),
    });
    directions.push(turned((zx, zy, angle) => zx * Math.sin(angle) - zy * Math.cos(angle)));
    directions.push(turned((zx, zy, angle) => -zx * Math.cos(angle) - zy * Math.sin(angle)));
  }
  return directions.flatMap(({ z, mode }) => [true, false].map((sliding) => z.filter((_, i) => SLIDING.includes(mode[i]) === sliding)));
}

/** @param {number[]} z */
function hasPattern(z) {
  const n = z.length;
  const square = sumOfSquares(z);
  const correlations = range(1, LAGS + 1).map((lag) => dot(z.slice(lag), z) / square);
  const ljungBox = correlations.reduce((sum, r, i) => sum + (n * (n + 2) * r * r) / (n - i - 1), 0);
  return correlations[0] * Math.sqrt(n) > MAX_LAG1_Z || runsZ(z) < MIN_RUNS_Z || ljungBox > MAX_LJUNG_BOX;
}

/** Standard score of the number of runs of one sign (Wald and Wolfowitz). @param {number[]} z */
function runsZ(z) {
  const n = z.length;
  const up = z.filter((value) => value > 0).length;
  if (up === 0 || up === n) return -Math.sqrt(n);
  const runs = 1 + z.slice(1).filter((value, i) => value > 0 !== z[i] > 0).length;
  const mean = (2 * up * (n - up)) / n + 1;
  return (runs - mean) / Math.sqrt(Math.max(((mean - 1) * (mean - 2)) / (n - 1), 1e-9));
}
