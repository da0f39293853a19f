/** Fits settings of the model to tracked points: Levenberg and Marquardt's method, with standard errors. */

import { simulate } from "../../run.js";

/**
 * @typedef {{settings: Record<string, any>, light: [number, number, number][], heavy: [number, number, number][],
 *   duration: number}} FitTask points: time from the release [s], x and y [m]
 * @typedef {{name: string, value: number, error: number}} FittedParameter SI
 * @typedef {{parameters: FittedParameter[], before: number, after: number, alike: number, count: number, converged: boolean}} FitResult
 *   root mean square of a coordinate's residual before and after [m]; correlation of neighbouring residuals; number of coordinates
 */

/** Relative tolerance of a step: far finer than the changes by which slopes are computed. */
const TOLERANCE = 1e-9;
/** Parameter -> the change by which its slope is computed, and the least and greatest value [SI]. */
const PARAMETERS = /** @type {Record<string, [number, number, number]>} */ ({
  kinetic_friction: [1e-5, 0, 2],
  light_drag: [1e-7, 0, 0.01],
  release_angle: [1e-5, 0.02, Math.PI],
  free_length: [1e-6, 0.02, 5],
  hanging_length: [1e-6, 1e-3, 2],
  origin_x: [1e-6, -1, 1],
  origin_y: [1e-6, -1, 1],
});
/** Shares of the points' time up to which they are fitted, one after the other: late points alone lead astray. */
const STAGES = [0.4, 0.7, 1];
const MAX_ITERATIONS = 30;
const CONVERGED = 1e-7;
const MAX_DAMPING = 1e12;

/**
 * Return the parameters with which the model's run is nearest to the points.
 * @param {FitTask} task
 * @returns {FitResult}
 */
export function fit(task) {
  const names = Object.keys(PARAMETERS).filter((name) => task.heavy.length > 0 || name !== "hanging_length");
  const start = names.map((name) => Number(task.settings[name] ?? 0));
  const last = Math.max(...[...task.light, ...task.heavy].map(([t]) => t));
  let values = start;
  let converged = false;
  for (const share of STAGES) {
    const until = (/** @type {[number, number, number][]} */ points) => points.filter(([t]) => t <= share * last);
    const part = { ...task, light: until(task.light), heavy: until(task.heavy) };
    if (2 * (part.light.length + part.heavy.length) <= names.length) continue;
    ({ values, converged } = descend(part, names, values));
  }
  const residuals = residualsOf(task, names, values);
  const slopes = slopesOf(task, names, values, residuals);
  const [count, free] = [residuals.length, residuals.length - names.length];
  const variance = sumOfSquares(residuals) / Math.max(free, 1);
  const covariance = inverse(normalMatrix(slopes));
  return {
    parameters: names.map((name, i) => ({ name, value: values[i], error: Math.sqrt(variance * covariance[i][i]) })),
    before: Math.sqrt(sumOfSquares(residualsOf(task, names, start)) / count),
    after: Math.sqrt(sumOfSquares(residuals) / count),
    alike: correlationOfNeighbours(residuals),
    count,
    converged,
  };
}

/**
 * @param {FitTask} task
 * @param {string[]} names
 * @param {number[]} start
 */
function descend(task, names, start) {
  let values = start;
  let residuals = residualsOf(task, names, values);
  let damping = 1e-3;
  for (let iteration = 0; iteration < MAX_ITERATIONS; iteration++) {
    const slopes = slopesOf(task, names, values, residuals);
    const matrix = normalMatrix(slopes);
    const gradient = slopes.map((slope) => dot(slope, residuals));
    const sum = sumOfSquares(residuals);
    for (;;) {
      const damped = matrix.map((row, i) => row.map((x, j) => (i === j ? x * (1 + damping) : x)));
      const step = inverse(damped).map((row) => -dot(row, gradient));
      const tried = values.map((value, i) => within(names[i], value + step[i]));
      const next = residualsOf(task, names, tried);
      const better = sumOfSquares(next);
      if (better < sum) {
        [values, residuals] = [tried, next];
        damping /= 10;
        if (sum - better < CONVERGED * sum) return { values, converged: true };
        break;
      }
      damping *= 10;
      // No step, however short, leads nearer
      if (!(damping < MAX_DAMPING)) return { values, converged: true };
    }
  }
  return { values, converged: false };
}

/** @param {string} name @param {number} value */
function within(name, value) {
  const [, low, high] = PARAMETERS[name];
  return Math.min(high, Math.max(low, value));
}

/**
 * Points less the run, x and y of each in turn [m]; without end where there is no run.
 * @param {FitTask} task
 * @param {string[]} names
 * @param {number[]} values
 */
function residualsOf({ settings, light, heavy, duration }, names, values) {
  const { origin_x = 0, origin_y = 0, ...changed } = Object.fromEntries(names.map((name, i) => [name, values[i]]));
  const complete = { ...settings, ...changed };
  // A trial does not tell the two frictions apart before it slides again: their ratio stays as it is set
  const ratio = settings.kinetic_friction > 0 ? settings.static_friction / settings.kinetic_friction : 1;
  complete.static_friction = Math.max(1, ratio) * complete.kinetic_friction;
  const residuals = new Float64Array(2 * (light.length + heavy.length));
  let run;
  try {
    run = simulate(complete, { duration, tolerance: TOLERANCE });
  } catch {
    return residuals.fill(Infinity); // an apparatus that cannot be built is not nearer
  }
  let i = 0;
  for (const [mass, points] of /** @type {["light" | "heavy", [number, number, number][]][]} */ ([["light", light], ["heavy", heavy]])) {
    for (const [t, x, y] of points) {
      const place = run.sample(Math.min(Math.max(t, 0), run.endTime))[mass];
      residuals[i++] = x - origin_x - place[0];
      residuals[i++] = y - origin_y - place[1];
    }
  }
  return residuals;
}

/**
 * Slopes of all residuals by each parameter, from central differences; one-sided at a bound.
 * @param {FitTask} task
 * @param {string[]} names
 * @param {number[]} values
 * @param {Float64Array} residuals
 */
function slopesOf(task, names, values, residuals) {
  return names.map((name, i) => {
    const change = PARAMETERS[name][0];
    const at = (/** @type {number} */ value) => residualsOf(task, names, values.map((one, k) => (k === i ? value : one)));
    const [low, high] = [within(name, values[i] - change), within(name, values[i] + change)];
    const below = low === values[i] ? residuals : at(low);
    return at(high).map((above, k) => (above - below[k]) / (high - low));
  });
}

/** @param {ArrayLike<number>} a @param {ArrayLike<number>} b */
function dot(a, b) {
  let sum = 0;
  for (let i = 0; i < a.length; i++) sum += a[i] * b[i];
  return sum;
}

/** @param {Float64Array} values */
const sumOfSquares = (values) => dot(values, values);

/** @param {Float64Array[]} slopes */
const normalMatrix = (slopes) => slopes.map((a) => slopes.map((b) => dot(a, b)));

/**
 * Inverse of a positive matrix by Gauss and Jordan's method with pivots, scaled to a diagonal of ones.
 * @param {number[][]} matrix
 */
function inverse(matrix) {
  const n = matrix.length;
  // A parameter that moves nothing has no slope: its error is infinite, and it stays where it is
  const scale = matrix.map((row, i) => (row[i] > 0 ? 1 / Math.sqrt(row[i]) : 0));
  const rows = matrix.map((row, i) => [
    ...row.map((x, j) => (scale[i] && scale[j] ? x * scale[i] * scale[j] : Number(i === j))),
    ...Array.from({ length: n }, (_, j) => Number(i === j)),
  ]);
  for (let i = 0; i < n; i++) {
    let pivot = i;
    for (let k = i + 1; k < n; k++) if (Math.abs(rows[k][i]) > Math.abs(rows[pivot][i])) pivot = k;
    [rows[i], rows[pivot]] = [rows[pivot], rows[i]];
    const divisor = rows[i][i];
    rows[i] = rows[i].map((x) => x / divisor);
    for (let k = 0; k < n; k++) {
      if (k === i) continue;
      const factor = rows[k][i];
      if (factor !== 0) rows[k] = rows[k].map((x, j) => x - factor * rows[i][j]);
    }
  }
  return rows.map((row, i) => row.slice(n).map((x, j) => (scale[i] && scale[j] ? x * scale[i] * scale[j] : i === j ? Infinity : 0)));
}

/** Correlation of each coordinate's residual with that of the point before, from 0 (noise) to 1. @param {Float64Array} residuals */
function correlationOfNeighbours(residuals) {
  let product = 0;
  for (let i = 2; i < residuals.length; i++) product += residuals[i] * residuals[i - 2];
  return product / sumOfSquares(residuals);
}
