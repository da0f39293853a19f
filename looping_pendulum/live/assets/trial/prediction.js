/** What the camera measures of the model's run, as `identify` has it (`measured/measurement.py`). */

import { simulate } from "../../run.js";

/**
 * @typedef {{name: string, t: number[], value: number[], error?: number[]}} Channel a coordinate of a mass by the file's clock
 *   [s, m or rad]; `error`: standard error that the file states of each value
 * @typedef {{times: number[], places: number[][]}} Times all times of the channels, ascending; of each channel, the place of
 *   its values' times among them
 * @typedef {{origin_x: number, origin_y: number, clock_offset: number, scale: number, tilt: number}} Camera place of the rod's
 *   axis in the file [m]; time since the release at which the file's clock is 0 [s]; length in the file per true length; angle
 *   by which the picture is turned, counterclockwise [rad]
 * @typedef {ReturnType<import("../../run.js").Run["sample"]>} Sample
 */

/** Channel -> what it shows of a sample; along and across: what a true length gives in its own direction and a quarter turn on.
 * @type {Record<string, (sample: Sample, camera: Camera, along: number, across: number) => number>} */
const MEASURED = {
  light_x: ({ light: [x, y] }, { origin_x }, along, across) => along * x - across * y + origin_x,
  light_y: ({ light: [x, y] }, { origin_y }, along, across) => across * x + along * y + origin_y,
  heavy_x: ({ heavy: [x, y] }, { origin_x }, along, across) => along * x - across * y + origin_x,
  heavy_y: ({ heavy: [x, y] }, { origin_y }, along, across) => across * x + along * y + origin_y,
  angle: ({ wrapAngle }, { tilt }) => wrapAngle - Math.PI + tilt,
};
export const FITTED_CHANNELS = Object.keys(MEASURED);

/** Relative tolerance of a step: far finer than the changes by which slopes are computed. */
const TOLERANCE = 1e-9;
/** Time by which a run is longer than the points, so that it does not end just before the last one [s]. */
const LONGER = 1e-3;

/** @param {Channel[]} channels @returns {Times} */
export function timesOf(channels) {
  const times = [...new Set(channels.flatMap(({ t }) => t))].sort((a, b) => a - b);
  const place = new Map(times.map((t, i) => [t, i]));
  return { times, places: channels.map(({ t }) => t.map((one) => place.get(one) ?? 0)) };
}

/**
 * The run of an apparatus until after the last point.
 * @param {Record<string, any>} settings @param {Times} times @param {number} clockOffset
 */
export function runFor(settings, { times }, clockOffset) {
  const duration = Math.max(times[times.length - 1] + clockOffset, 0) + LONGER;
  return simulate(settings, { duration, tolerance: TOLERANCE });
}

/**
 * Samples of a run at the times of the points: at rest before the release, and after its end where it ended.
 * @param {import("../../run.js").Run} run @param {Times} times @param {number} clockOffset
 */
export function samplesOf(run, { times }, clockOffset) {
  return times.map((t) => run.sample(Math.min(Math.max(t + clockOffset, 0), run.endTime)));
}

/**
 * What the camera measures, all channels end to end [m or rad].
 * @param {Channel[]} channels @param {Times} times @param {Sample[]} samples @param {Camera} camera
 */
export function measured(channels, { places }, samples, camera) {
  const values = new Float64Array(channels.reduce((sum, { t }) => sum + t.length, 0));
  const { scale, tilt } = camera;
  const [along, across] = [scale * Math.cos(tilt), scale * Math.sin(tilt)];
  let i = 0;
  channels.forEach(({ name }, k) => {
    const show = MEASURED[name];
    for (const place of places[k]) values[i++] = show(samples[place], camera, along, across);
  });
  return values;
}
