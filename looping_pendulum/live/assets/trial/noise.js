/**
 * The noise of tracked points from the residuals of a fit, as `identify` estimates it (`discrepancy/fit/residual_noise.py`):
 * sigma = a + b |v| for each body, from differences of neighbouring residuals, which do not see slow misfits; at least what the file states.
 */

import { findOutliers } from "./outliers.js";
import { dot, median, range, robustDeviation } from "./statistics.js";

/**
 * @typedef {import("./prediction.js").Channel & {residual: number[], speed: number[], mode: string[], leftOut: boolean[]}} FittedChannel
 *   of each point its residual, the speed of the body and the mode of the run by the model, and whether the fit leaves it out
 */

/** Channels that show one body and share one law. */
const BODIES = [["light_x", "light_y"], ["heavy_x", "heavy_y"], ["angle"]];
/** Smallest number of differences from which a law is estimated. */
const MIN_DIFFERENCES = 20;
/** Smallest sigma of a point, as a part of the median sigma of its body's points. */
const MIN_SIGMA_RATIO = 0.2;
/** Time steps longer than this many median steps are gaps. */
const MAX_STEP_RATIO = 1.5;
/** Standardised size at which differences are clipped. */
const MAX_DIFFERENCE_SIGMAS = 4;
const ITERATIONS = 40;
/** Keeps divisions finite for data without noise [m]. */
const TINY = 1e-12;

/**
 * Return the standard deviation of each point, channel by channel; infinite: it does not show the mass.
 * @param {FittedChannel[]} channels
 * @returns {number[][]}
 */
export function noiseOf(channels) {
  /** @type {Map<string, number[]>} */
  const sigmas = new Map();
  for (const names of BODIES) {
    const body = channels.filter(({ name }) => names.includes(name));
    if (!body.length) continue;
    let law = lawOf(body, body.map(({ leftOut }) => leftOut));
    let outliers = outliersOf(body, law);
    if (outliers.some((one) => one.includes(true))) {
      law = lawOf(body, outliers); // they have widened it
      outliers = outliersOf(body, law);
    }
    body.forEach(({ name }, k) => sigmas.set(name, law[k].map((sigma, i) => (outliers[k][i] ? Infinity : sigma))));
  }
  return channels.map(({ name }) => sigmas.get(name) ?? []);
}

/**
 * Sigma of each point of a body by the law of its differences.
 * @param {FittedChannel[]} body @param {boolean[][]} leftOut
 */
function lawOf(body, leftOut) {
  /** @type {number[]} */
  const differences = [];
  /** @type {number[]} */
  const speeds = [];
  body.forEach(({ t, residual, speed, mode }, k) => {
    if (t.length < MIN_DIFFERENCES) return;
    const longest = MAX_STEP_RATIO * median(t.slice(1).map((later, i) => later - t[i]));
    for (let i = 1; i < t.length; i++) {
      // Only neighbours in one mode: the model's error may jump where the mode changes
      if (leftOut[k][i] || leftOut[k][i - 1] || mode[i] !== mode[i - 1] || !(t[i] - t[i - 1] < longest)) continue;
      differences.push((residual[i] - residual[i - 1]) / Math.SQRT2);
      speeds.push(0.5 * (speed[i] + speed[i - 1]));
    }
  });
  if (differences.length < MIN_DIFFERENCES) {
    const all = Math.max(robustDeviation(body.flatMap(({ residual }) => residual)), TINY);
    return body.map(({ t, error }) => t.map((_, i) => Math.max(all, error?.[i] ?? 0)));
  }
  const { a, b } = fitLaw(differences, speeds);
  return body.map(({ speed, error }) => {
    const least = MIN_SIGMA_RATIO * (a + b * median(speed));
    // What the tracker states is not smaller where neighbours err alike, as those of a mark do
    return speed.map((v, i) => Math.max(a + b * v, least, error?.[i] ?? 0));
  });
}

/**
 * Fit sigma = a + b v with a, b >= 0 to Gaussian differences by maximum likelihood; wild ones are clipped.
 * @param {number[]} differences @param {number[]} speeds
 */
function fitLaw(differences, speeds) {
  let a = robustDeviation(differences) + TINY;
  let b = 0;
  for (let iteration = 0; iteration < ITERATIONS; iteration++) {
    const sigma = speeds.map((v) => Math.max(a + b * v, 0.05 * a + TINY));
    // Linearised, the estimating equation is a weighted line through these values
    const target = sigma.map((s, i) => 0.5 * (s + Math.min(differences[i] ** 2, (MAX_DIFFERENCE_SIGMAS * s) ** 2) / s));
    const weight = sigma.map((s) => 1 / (s * s));
    const total = weight.reduce((sum, w) => sum + w, 0);
    const middle = dot(weight, speeds) / total;
    const centred = speeds.map((v) => v - middle);
    const weighted = centred.map((v, i) => weight[i] * v);
    const spread = dot(weighted, centred);
    b = spread > 1e-12 * total ? Math.max(dot(weighted, target) / spread, 0) : 0;
    a = dot(weight, target) / total - b * middle;
    if (a < 0) {
      const byWeight = speeds.map((v, i) => weight[i] * v);
      [a, b] = [TINY, dot(byWeight, target) / dot(byWeight, speeds)];
    }
  }
  return { a, b };
}

/**
 * Which points do not show the body; a point's coordinates are judged together.
 * @param {FittedChannel[]} body @param {number[][]} law
 */
function outliersOf(body, law) {
  const together = body.every(({ t }) => t.length === body[0].t.length && t.every((one, i) => one === body[0].t[i]));
  const groups = together ? [range(0, body.length)] : body.map((_, k) => [k]);
  /** @type {boolean[][]} */
  const outliers = [];
  for (const group of groups) {
    const sigma = law[group[0]];
    const columns = group.map((k) => body[k].residual);
    const widest = sigma.reduce((most, s) => Math.max(most, s), 0);
    // An outlier may lie anywhere between the extremes of all points, and of a body at rest within its noise
    const area = group.reduce((product, k) => product * Math.max(spanOf(body[k].value), widest), 1);
    const found = findOutliers(sigma.map((_, i) => columns.map((column) => column[i])), sigma, area);
    for (const k of group) outliers[k] = found;
  }
  return outliers;
}

/** @param {number[]} values */
function spanOf(values) {
  return values.reduce((most, v) => Math.max(most, v), -Infinity) - values.reduce((least, v) => Math.min(least, v), Infinity);
}
