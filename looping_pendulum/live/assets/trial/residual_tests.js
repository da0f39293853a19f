/**
 * Whether what a fit leaves is noise, by the tests of `identify` (`discrepancy/fit/residual.py`): its size, and in each group
 * of residuals whether neighbours err alike. The limits are those: of 24 blind trials without a missing effect none is above
 * one of them.
 */

import { seeded } from "../random.js";
import { range, sumOfSquares } from "./statistics.js";

/**
 * @typedef {{name: string, t: number[], z: number[], mode: string[], wrapAngle: number[]}} StandardisedChannel of each point
 *   that is fitted its residual in units of its noise, and the mode and wrap angle of the run by the model
 * @typedef {{ratio: number, larger: boolean, pattern: boolean}} ResidualTests root mean square in units of the noise; whether
 *   that is more than noise has; whether neighbours err alike
 */

/** Largest mean square that passes, with many values; excess of fewer ones, in units of 1/sqrt(n). */
const [MAX_CHI2_PER_DOF, CHI2_SCATTER_SIGMAS] = [1.07, 3.5];
/** Largest z of the correlation of neighbours; smallest z of the number of runs of one sign. */
const [MAX_LAG1_Z, MIN_RUNS_Z] = [3.2, -3.4];
/** Lags of the Ljung-Box statistic, and the smallest share of noise that has a larger one. */
const [LAGS, MIN_LJUNG_BOX_P] = [10, 5e-4];
/** Statistic that many values of noise exceed in that share, by the chi-square distribution. */
const MAX_LJUNG_BOX = 31.42;
/**
 * Statistics between which (1 % and 1e-12 by that distribution) shuffled residuals tell of at most so many values, which
 * exceed it more often.
 */
const [SHUFFLED_FROM, SHUFFLED_TO, SHUFFLES, MAX_SHUFFLED] = [23.21, 77.8, 10000, 500];
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

/**
 * Residuals by mode and direction: those of the light mass along and across its string.
 * @param {StandardisedChannel[]} channels
 */
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
  return directions.flatMap(({ z, mode }) =>
    [true, false].map((sliding) => z.filter((_, i) => SLIDING.includes(mode[i]) === sliding)),
  );
}

/** @param {number[]} z */
function hasPattern(z) {
  const lag1 = correlation(z, 1, sumOfSquares(z));
  return lag1 * Math.sqrt(z.length) > MAX_LAG1_Z || runsZ(z) < MIN_RUNS_Z || hasSlowPattern(z);
}

/** @param {number[]} z @param {number} lag @param {number} square */
function correlation(z, lag, square) {
  let sum = 0;
  for (let i = lag; i < z.length; i++) sum += z[i] * z[i - lag];
  return sum / square;
}

/** @param {number[]} z @param {number} square */
function ljungBox(z, square) {
  const n = z.length;
  let sum = 0;
  for (let lag = 1; lag <= LAGS; lag++) sum += (n * (n + 2) * correlation(z, lag, square) ** 2) / (n - lag);
  return sum;
}

/** Whether residuals over some frames err alike. @param {number[]} z */
function hasSlowPattern(z) {
  const square = sumOfSquares(z);
  const statistic = ljungBox(z, square);
  if (z.length > MAX_SHUFFLED || statistic < SHUFFLED_FROM || statistic > SHUFFLED_TO) return statistic > MAX_LJUNG_BOX;
  const random = seeded(0); // the same residuals have the same result
  const shuffled = [...z];
  let larger = 1;
  for (let shuffle = 0; shuffle < SHUFFLES && larger < MIN_LJUNG_BOX_P * (SHUFFLES + 1); shuffle++) {
    for (let i = shuffled.length - 1; i > 0; i--) {
      const j = Math.floor(random() * (i + 1));
      [shuffled[i], shuffled[j]] = [shuffled[j], shuffled[i]];
    }
    if (ljungBox(shuffled, square) >= statistic) larger += 1;
  }
  return larger < MIN_LJUNG_BOX_P * (SHUFFLES + 1);
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
