/**
 * Fits settings of the model to tracked points, as `identify` calibrates a study of one trial: the same model, the same noise
 * of the points, and the same ones left out. Levenberg and Marquardt's method in windows of time that grow to the whole
 * trial.
 */

import { BOUNDS } from "../../model.js";
import { noiseOf } from "./noise.js";
import { FITTED_CHANNELS, measured, runFor, samplesOf, timesOf } from "./prediction.js";
import { testResiduals } from "./residual_tests.js";
import { dot, inverse, normalMatrix, range, sumOfSquares } from "./statistics.js";

/** @import { Camera, Channel, Sample, Times } from "./prediction.js" */
/**
 * @typedef {{settings: Record<string, any>, channels: Channel[], camera: Camera, known: Record<string, number>}} FitTask
 *   settings and camera from which it starts; parameters that were measured -> standard error of what these say [SI]
 * @typedef {{name: string, value: number, error: number}} FittedParameter SI
 * @typedef {{parameters: FittedParameter[], before: number, after: number, count: number, outliers: number, converged:
 *   boolean, tests: import("./residual_tests.js").ResidualTests}} FitResult root mean square of the residuals before and
 *   after [m]; number of values that are fitted, and of those left out as they do not show the mass
 * @typedef {{task: FitTask, times: Times, names: string[], sigma: Float64Array}} Problem sigma: standard deviation of each
 *   value, infinite for one that is left out
 * @typedef {{samples: Sample[], predicted: Float64Array}} Prediction
 * @typedef {{values: number[], converged: boolean, cost: number}} Minimum
 */

/** Parameter that a fit may change -> the change by which its slope is computed [SI]. @type {Record<string, number>} */
export const CHANGES = {
  kinetic_friction: 1e-5,
  light_drag: 1e-7,
  heavy_drag: 1e-6,
  string_drag: 1e-7,
  release_angle: 1e-5,
  free_length: 1e-6,
  hanging_length: 1e-6,
  origin_x: 1e-6,
  origin_y: 1e-6,
  clock_offset: 1e-6,
  light_mass: 1e-7,
  heavy_mass: 1e-6,
  rod_radius: 1e-7,
  scale: 1e-6,
  tilt: 1e-6,
};
/** Those that are measured before a trial; without a standard error of what was measured they are not fitted. */
const MEASURED = ["light_mass", "heavy_mass", "rod_radius", "scale", "tilt", "heavy_drag", "string_drag"];
/** What moves no mass. */
const OF_THE_PICTURE = ["origin_x", "origin_y", "scale", "tilt"];
/** Shares of the time up to which points are fitted, one after the other: late points alone lead astray. */
const WINDOWS = [0.3, 0.5, 0.8];
/**
 * Accuracy of the fits of windows, and of the last one: the relative decrease of the cost that one which has converged could
 * still make; whether slopes are those of both sides. Those of one side are wrong by so little that it matters only where the
 * model misses much: masses and friction, which one trial hardly tells apart, were then off by 0.18 standard errors.
 */
const [OF_A_WINDOW, OF_THE_WHOLE] = [{ tolerance: 3e-4, central: false }, { tolerance: 1e-7, central: true }];
const MAX_ITERATIONS = 30;
const MAX_DAMPING = 1e9;

/**
 * Return the parameters with which the model's run is nearest to the points.
 * @param {FitTask} given
 * @returns {FitResult}
 */
export function fit(given) {
  const task = { ...given, channels: given.channels.filter(({ name }) => FITTED_CHANNELS.includes(name)) };
  const shown = new Set(task.channels.map(({ name }) => name));
  const names = Object.keys(CHANGES).filter((name) =>
    name === "hanging_length" ? shown.has("heavy_y") : !MEASURED.includes(name) || task.known[name] > 0,
  );
  /** @type {Record<string, number>} */
  const first = stated(task);
  const start = names.map((name) => within(name, first[name]));
  const equal = new Float64Array(task.channels.reduce((sum, { t }) => sum + t.length, 0)).fill(1);
  /** @type {Problem} */
  let problem = { task, times: timesOf(task.channels), names, sigma: equal };
  const before = predict(problem, start);
  let best = inWindows(problem, start);
  for (const round of [1, 2]) {
    problem = withNoiseOfResiduals(problem, best.values);
    best = descend(problem, best.values, OF_THE_WHOLE);
    if (round === 1 && problem.sigma.includes(Infinity)) {
      // The outliers may have led the fit astray, so that it begins anew without them
      const anew = descend(problem, inWindows(problem, start).values, OF_THE_WHOLE);
      if (anew.cost < best.cost) best = anew;
    }
  }
  const { predicted, samples } = predict(problem, best.values);
  const slopes = slopesOf(problem, best.values, { predicted, samples }, true);
  const covariance = inverse(normalMatrix(slopes));
  const used = range(0, equal.length).filter((i) => Number.isFinite(problem.sigma[i]));
  const measuredValues = task.channels.flatMap(({ value }) => value);
  const distance = (/** @type {Float64Array} */ from) =>
    Math.sqrt(sumOfSquares(used.map((i) => measuredValues[i] - from[i])) / used.length);
  return {
    parameters: names.map((name, i) => ({ name, value: best.values[i], error: Math.sqrt(covariance[i][i]) })),
    before: distance(before.predicted),
    after: distance(predicted),
    count: used.length,
    outliers: equal.length - used.length,
    converged: best.converged,
    tests: testResiduals(standardised(problem, { predicted, samples }, best.values), names.length, task.channels.some(({ error }) => error)),
  };
}

/** What the settings and the camera say, from which a fit starts. @param {FitTask} task @returns {Record<string, any>} */
const stated = ({ settings, camera }) => ({ ...settings, ...camera });

/** Fit roughly, in growing windows of time up to the whole. @param {Problem} problem @param {number[]} start */
function inWindows(problem, start) {
  const [first, last] = [problem.times.times[0], problem.times.times[problem.times.times.length - 1]];
  let values = start;
  for (const share of WINDOWS) {
    const part = until(problem, first + share * (last - first));
    if (part.sigma.length > 2 * problem.names.length) ({ values } = descend(part, values, OF_A_WINDOW));
  }
  return descend(problem, values, OF_A_WINDOW);
}

/** The problem with the points up to a time of the file's clock [s]. @param {Problem} problem @param {number} time */
function until({ task, names, sigma }, time) {
  const kept = task.channels.flatMap(({ t }) => t.map((one) => one <= time));
  const channels = task.channels.map(({ name, t, value, error }) => {
    const count = t.filter((one) => one <= time).length;
    return { name, t: t.slice(0, count), value: value.slice(0, count), error: error?.slice(0, count) };
  });
  return { task: { ...task, channels }, times: timesOf(channels), names, sigma: sigma.filter((_, i) => kept[i]) };
}

/**
 * Minimise the cost from `start`.
 * @param {Problem} problem @param {number[]} start @param {typeof OF_THE_WHOLE} accuracy
 * @returns {Minimum}
 */
function descend(problem, start, { tolerance, central }) {
  let values = start;
  let prediction = predict(problem, values);
  let residuals = residualsOf(problem, prediction, values);
  let cost = sumOfSquares(residuals);
  let damping = 1e-3;
  for (let iteration = 0; iteration < MAX_ITERATIONS; iteration++) {
    const slopes = slopesOf(problem, values, prediction, central);
    const matrix = normalMatrix(slopes);
    const gradient = slopes.map((slope) => dot(slope, residuals));
    // What presses against a bound stays there; it would bend the step of all others
    const free = problem.names.map((name, i) => within(name, values[i] + Math.sign(gradient[i]) * CHANGES[name]) !== values[i]);
    const stepFor = (/** @type {number} */ damped) =>
      inverse(matrix.map((row, i) => row.map((x, j) => (i === j ? x * (1 + damped) : free[i] && free[j] ? x : 0)))).map((row, i) =>
        free[i] && row[i] < Infinity ? dot(row, gradient) : 0,
      );
    // What the whole step promises, not what a damped one gained, which along a narrow valley is little far from its end
    if (dot(gradient, stepFor(0)) <= tolerance * cost) return { values, converged: true, cost };
    const before = cost;
    while (cost === before && damping < MAX_DAMPING) {
      const step = stepFor(damping);
      const tried = values.map((value, i) => within(problem.names[i], value + step[i]));
      const next = predictOrNull(problem, tried);
      const nextResiduals = next && residualsOf(problem, next, tried);
      if (next && nextResiduals && sumOfSquares(nextResiduals) < cost) {
        [values, prediction, residuals, cost] = [tried, next, nextResiduals, sumOfSquares(nextResiduals)];
        damping /= 10;
      } else damping *= 10;
    }
    if (cost === before) return { values, converged: true, cost }; // no step, however short, leads nearer
  }
  return { values, converged: false, cost };
}

/** @param {string} name @param {number} value */
function within(name, value) {
  const [low, high] = BOUNDS[name];
  return Math.min(high, Math.max(low, value));
}

/** @param {Problem} problem @param {number[]} values @returns {{settings: Record<string, any>, camera: Camera}} */
function split({ task, names }, values) {
  const changed = Object.fromEntries(names.map((name, i) => [name, values[i]]));
  /** @type {Record<string, any>} */
  const all = { ...stated(task), ...changed };
  const { origin_x, origin_y, clock_offset, scale, tilt, ...settings } = all;
  // One friction, unless that of the string at rest was set to a value of its own
  const { static_friction: resting, kinetic_friction: sliding } = task.settings;
  settings.static_friction = Math.max(resting > sliding ? resting : 0, settings.kinetic_friction);
  return { settings, camera: { origin_x, origin_y, clock_offset, scale, tilt } };
}

/**
 * @param {Problem} problem @param {number[]} values @returns {Prediction}
 * @throws {Error} if the apparatus is impossible
 */
function predict(problem, values) {
  const { settings, camera } = split(problem, values);
  const samples = samplesOf(runFor(settings, problem.times, camera.clock_offset), problem.times, camera.clock_offset);
  return { samples, predicted: measured(problem.task.channels, problem.times, samples, camera) };
}

/** @param {Problem} problem @param {number[]} values @returns {Prediction | null} null: the apparatus is impossible */
function predictOrNull(problem, values) {
  try {
    return predict(problem, values);
  } catch {
    return null;
  }
}

/**
 * Measured less predicted values in units of their noise, then what was measured before the trial less what is fitted.
 * @param {Problem} problem @param {Prediction} prediction @param {number[]} values
 */
function residualsOf({ task, sigma, names }, { predicted }, values) {
  const first = stated(task);
  const before = names.flatMap((name, i) => (task.known[name] > 0 ? [(first[name] - values[i]) / task.known[name]] : []));
  const residuals = new Float64Array(sigma.length + before.length);
  let i = 0;
  for (const { value } of task.channels) {
    for (const one of value) {
      residuals[i] = (one - predicted[i]) / sigma[i];
      i += 1;
    }
  }
  residuals.set(before, sigma.length);
  return residuals;
}

/**
 * Slopes of the predicted values in units of their noise, by each parameter, from differences; then those of what is known.
 * @param {Problem} problem @param {number[]} values @param {Prediction} here
 * @param {boolean} central whether of both sides, where there is no bound
 */
function slopesOf(problem, values, here, central) {
  const { names, sigma, task, times } = problem;
  const known = names.filter((name) => task.known[name] > 0);
  return names.map((name, i) => {
    const change = CHANGES[name];
    const at = (/** @type {number} */ value) => {
      if (value === values[i]) return here.predicted;
      const moved = values.map((one, k) => (k === i ? value : one));
      if (OF_THE_PICTURE.includes(name)) return measured(task.channels, times, here.samples, split(problem, moved).camera);
      return predictOrNull(problem, moved)?.predicted;
    };
    const high = within(name, values[i] + change);
    const low = central || high === values[i] ? within(name, values[i] - change) : values[i];
    const [below, above] = [at(low), at(high)];
    const slopes = new Float64Array(sigma.length + known.length);
    if (below && above) for (let k = 0; k < sigma.length; k++) slopes[k] = (above[k] - below[k]) / (high - low) / sigma[k];
    if (known.includes(name)) slopes[sigma.length + known.indexOf(name)] = 1 / task.known[name];
    return slopes;
  });
}

/**
 * The problem with the noise that the residuals show, and without outliers.
 * @param {Problem} problem
 * @param {number[]} values
 */
function withNoiseOfResiduals(problem, values) {
  const { task, times, sigma } = problem;
  const { samples, predicted } = predict(problem, values);
  let i = 0;
  const channels = task.channels.map(({ name, t, value, error }, k) => {
    const first = i;
    i += t.length;
    const there = times.places[k].map((place) => samples[place]);
    return {
      name, t, value, error,
      residual: value.map((one, j) => one - predicted[first + j]),
      speed: there.map((sample) => speedOf(name, sample)),
      mode: there.map(({ mode }) => mode),
      leftOut: t.map((_, j) => sigma[first + j] === Infinity),
    };
  });
  return { ...problem, sigma: Float64Array.from(noiseOf(channels).flat()) };
}

/** Speed of what a channel shows [m/s or rad/s]. @param {string} name @param {Sample} sample */
function speedOf(name, { lightVelocity, heavyVelocity, wrapAngle, freeLength }) {
  if (name.startsWith("heavy")) return Math.hypot(...heavyVelocity);
  if (name.startsWith("light")) return Math.hypot(...lightVelocity);
  return Math.abs(lightVelocity[0] * Math.cos(wrapAngle) + lightVelocity[1] * Math.sin(wrapAngle)) / freeLength;
}

/** What is fitted of each channel, in units of its noise, by the time since the release.
 * @param {Problem} problem @param {Prediction} prediction @param {number[]} values */
function standardised(problem, prediction, values) {
  const residuals = residualsOf(problem, prediction, values);
  const { clock_offset: offset } = split(problem, values).camera;
  let i = 0;
  return problem.task.channels.map(({ name, t }, k) => {
    const first = i;
    i += t.length;
    const used = range(0, t.length).filter((j) => Number.isFinite(problem.sigma[first + j]));
    const there = used.map((j) => prediction.samples[problem.times.places[k][j]]);
    return {
      name,
      t: used.map((j) => t[j] + offset),
      z: used.map((j) => residuals[first + j]),
      mode: there.map(({ mode }) => mode),
      wrapAngle: there.map((sample) => sample.wrapAngle),
    };
  });
}
