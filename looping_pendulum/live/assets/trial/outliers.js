/**
 * Finds tracked points that do not show the mass, as `identify` does (`discrepancy/fit/residual_noise.py`, which says why): single
 * ones, and blocks in which the tracker followed something else. Distances are from where the neighbours lead one to expect a
 * residual.
 */

import { GAUSSIAN_MAD, inverse, median, normalMatrix, range } from "./statistics.js";

/** @typedef {number[]} Place residual of a point in each coordinate [m] */

/** Neighbours on each side whose median tells where a point is expected. */
const HALF_WINDOW = 6;
/** Points on each side among which a distance is typical or not. */
const TYPICAL_WINDOW = 15;
/** Longest block of points on another object, and the points beside it from which its expected place is interpolated. */
const [MAX_BLOCK, EDGE_POINTS] = [60, 5];
/** Share of the points of a block that must be off by more than noise. */
const MIN_BLOCK_SHARE = 0.8;
/** Share of outliers that is assumed at least and at most. */
const [MIN_SHARE, MAX_SHARE] = [1e-4, 0.2];
const MAX_ITERATIONS = 50;
/** The median that is subtracted scatters, too. */
const SPREAD = Math.sqrt(1 + Math.PI / 2 / (2 * HALF_WINDOW));

/**
 * Return which points of a body are outliers.
 * @param {Place[]} residual in the order of time
 * @param {number[]} sigma standard deviation of each coordinate of a point [m]
 * @param {number} area in which an outlier may lie
 * @returns {boolean[]}
 */
export function findOutliers(residual, sigma, area) {
  const none = residual.map(() => false);
  if (residual.length < 2 * HALF_WINDOW + 1) return none;
  const single = singleOnes(residual, sigma, area, none);
  const blocks = blocksOf(residual, sigma, single, area);
  if (!blocks.includes(true)) return single;
  // Beside a block the neighbours led astray
  const again = singleOnes(residual, sigma, area, blocks);
  return blocks.map((inBlock, i) => inBlock || again[i]);
}

/** @param {Place[]} residual @param {number[]} sigma @param {number} area @param {boolean[]} leftOut */
function singleOnes(residual, sigma, area, leftOut) {
  const gone = [...leftOut];
  for (;;) {
    const rest = range(0, gone.length).filter((i) => !gone[i]);
    if (rest.length <= 2 * HALF_WINDOW) break;
    const distances = distancesFromNeighbours(rest, rest.map((i) => residual[i]));
    const { square, improbable } = judged(distances, rest.map((i) => sigma[i]), area, true);
    // An outlier leads its neighbours astray, so that of those that are near each other only the worst goes at a time
    const size = square.map((s, i) => (improbable[i] ? s : 0));
    const near = (/** @type {number} */ i) => size.slice(Math.max(i - HALF_WINDOW, 0), i + HALF_WINDOW + 1);
    const worst = rest.filter((_, i) => improbable[i] && near(i).every((s) => s <= size[i]));
    if (!worst.length) break;
    for (const i of worst) gone[i] = true;
  }
  const single = gone.map((one, i) => one && !leftOut[i]);
  return single.filter(Boolean).length <= MAX_SHARE * single.length ? single : single.map(() => false);
}

/**
 * Squared distances in units of noise, and where a point is an outlier with a probability above a half.
 * @param {Place[]} distances @param {number[]} sigma @param {number} area
 * @param {boolean} rough whether distances that are typical of their surroundings count as noise, however large they are
 */
function judged(distances, sigma, area, rough) {
  const standardised = distances.map((place, i) => place.map((d) => d / (SPREAD * sigma[i])));
  const typical = rough ? typicalSizes(standardised) : sigma.map(() => 1);
  const square = standardised.map((place, i) => place.reduce((sum, d) => sum + (d / typical[i]) ** 2, 0));
  const logScale = sigma.map((s, i) => Math.log(Math.sqrt(2 * Math.PI) * SPREAD * typical[i] * s));
  const logNoise = square.map((s, i) => -0.5 * s - distances[i].length * logScale[i]);
  let share = MIN_SHARE;
  /** @type {number[]} */
  let probability = [];
  for (let iteration = 0; iteration < MAX_ITERATIONS; iteration++) {
    const [logOutlier, logOther] = [Math.log(share) - Math.log(area), Math.log1p(-share)];
    probability = logNoise.map((log) => 1 / (1 + Math.exp(log + logOther - logOutlier)));
    const found = Math.min(Math.max(probability.reduce((sum, p) => sum + p, 0) / probability.length, MIN_SHARE), MAX_SHARE);
    if (Math.abs(found - share) < 1e-3 * share) break;
    share = found;
  }
  return { square, improbable: probability.map((p) => p > 0.5) };
}

/** Size that is typical around each point, in units of noise, at least 1. @param {Place[]} standardised */
function typicalSizes(standardised) {
  const n = standardised.length;
  const width = Math.min(TYPICAL_WINDOW, (n - 1) >> 1);
  const mirrored = (/** @type {number} */ i) => (i < 0 ? -i : i >= n ? 2 * (n - 1) - i : i);
  return standardised.map((place, i) => {
    const around = range(i - width, i + width + 1).map(mirrored);
    return Math.max(1, ...place.map((_, c) => GAUSSIAN_MAD * median(around.map((k) => Math.abs(standardised[k][c])))));
  });
}

/**
 * How far each point is from where its neighbours lead one to expect it. Of several expectations the nearest counts: medians of
 * the neighbours on both sides, before and after, and a parabola; at the ends a line stands for the first.
 * @param {number[]} place @param {Place[]} residual
 * @returns {Place[]}
 */
function distancesFromNeighbours(place, residual) {
  const n = residual.length;
  const width = HALF_WINDOW;
  return residual.map((here, i) => {
    const first = Math.min(Math.max(i - width, 0), n - 2 * width - 1);
    const others = range(first, first + 2 * width + 1).filter((k) => k !== i);
    const steps = others.map((k) => place[k] - place[i]);
    const parabola = weightsOfParabola(steps);
    const sides = [range(i - width, i), range(i + 1, i + width + 1)].filter(([k]) => k >= 0 && k + width <= n);
    const columns = here.map((_, c) => others.map((k) => residual[k][c]));
    const expected = [
      columns.map((column) => (sides.length === 2 ? median(column) : atZeroOfLine(steps, column))),
      ...sides.map((side) => here.map((_, c) => median(side.map((k) => residual[k][c])))),
      columns.map((column) => column.reduce((sum, value, k) => sum + parabola[k] * value, 0)),
    ];
    const distances = expected.map((there) => here.map((value, c) => value - there[c]));
    return distances.reduce((nearest, one) => (Math.hypot(...one) < Math.hypot(...nearest) ? one : nearest));
  });
}

/** Weights of values at `steps` in the value at 0 of the parabola by least squares. @param {number[]} steps */
function weightsOfParabola(steps) {
  const powers = [0, 1, 2].map((power) => steps.map((x) => x ** power));
  const [row] = inverse(normalMatrix(powers));
  return steps.map((_, k) => row[0] * powers[0][k] + row[1] * powers[1][k] + row[2] * powers[2][k]);
}

/** Value at 0 of a line by the medians of slopes and remainders (Theil and Sen). @param {number[]} x @param {number[]} y */
function atZeroOfLine(x, y) {
  const slope = median(x.flatMap((a, i) => x.slice(i + 1).map((b, k) => (y[i + 1 + k] - y[i]) / (b - a))));
  return median(y.map((value, i) => value - slope * x[i]));
}

/** Which points belong to blocks that leave the expected place in one jump and come back in another.
 * @param {Place[]} residual @param {number[]} sigma @param {boolean[]} single @param {number} area */
function blocksOf(residual, sigma, single, area) {
  const mask = residual.map(() => false);
  const kept = range(0, residual.length).filter((i) => !single[i]);
  const steps = kept.slice(1).map((k, i) => residual[k].map((value, c) => value - residual[kept[i]][c]));
  if (!steps.length) return mask;
  const scatter = kept.slice(1).map((k, i) => Math.SQRT2 * Math.max(sigma[k], sigma[kept[i]]));
  // A jump counts as an outlier counts, so that both have one threshold
  const { improbable } = judged(steps, scatter, area, true);
  const jumps = range(1, kept.length).filter((k) => improbable[k - 1]);
  const medianOf = (/** @type {number} */ from, /** @type {number} */ to) =>
    residual[0].map((_, c) => median(kept.slice(from, to).map((k) => residual[k][c])));
  jumps.forEach((start, k) => {
    for (const end of jumps.slice(k + 1)) {
      if (end - start > MAX_BLOCK) break;
      if (start < EDGE_POINTS || end + EDGE_POINTS > kept.length) continue;
      const [before, after] = [medianOf(start - EDGE_POINTS, start), medianOf(end, end + EDGE_POINTS)];
      const inside = kept.slice(start, end);
      const distance = inside.map((place, i) => {
        const way = (i + 1) / (inside.length + 1);
        return residual[place].map((value, c) => value - before[c] - way * (after[c] - before[c]));
      });
      const off = judged(distance, inside.map((i) => sigma[i]), area, false).improbable.filter(Boolean).length;
      const there = median(distance.map((one) => Math.hypot(...one)));
      if (Math.hypot(...after.map((value, c) => value - before[c])) < 0.5 * there && off >= MIN_BLOCK_SHARE * inside.length) {
        mask.fill(true, kept[start], kept[end - 1] + 1);
        break;
      }
    }
  });
  return mask;
}
