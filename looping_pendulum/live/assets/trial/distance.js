/** How far tracked points are from a run, and whether another frame rate brings them to it (`discrepancy/first_look`). */

import { median } from "./statistics.js";

/** @import { DrawnRun } from "../shown_run.js" */
/** @typedef {[number, number, number]} Point time since the release [s] and place [m] */

/** Factors on the times that are tried: steps of a quarter of an octave, as the first look has them. */
const FACTORS = Array.from({ length: 57 }, (_, i) => 2 ** ((i - 28) / 4));
/** Factor within which times are right. */
const SMALLEST_FACTOR = 1.25;
/** Typical distance from which on another frame rate is looked for [m], and how near one must bring the points: as a share of it. */
const [FAR, NEAR] = [0.02, 0.25];
const [MIN_POINTS, MOST_POINTS] = [10, 200];
/** Frame rates of cameras [Hz], one of which is named if what is found is as near to it. */
const RATES = [24, 25, 30, 48, 50, 60, 90, 100, 120, 200, 240, 250, 300, 400, 480, 500, 600, 960, 1000];
const NEARNESS = 0.05;
const FINER = 40;

/** Typical distance of points from a run [m]: half of those within its time are nearer. NaN if there are none.
 * @param {Point[]} points @param {DrawnRun} run */
export function typicalDistance(points, run) {
  const inside = points.filter(([t]) => t >= 0 && t <= run.end);
  return median(inside.map(([t, x, y]) => Math.hypot(x - run.at(t).light[0], y - run.at(t).light[1])));
}

/**
 * Find the frame rate with which points come much nearer to a run.
 * @param {Point[]} points
 * @param {DrawnRun} run
 * @returns {{rate: number, factor: number} | null} rate [Hz], and how many times what the run allows the times are; null: there is none
 */
export function otherFrameRate(points, run) {
  const after = points.filter(([t]) => t >= 0);
  const now = typicalDistance(after, run);
  if (!(now > FAR) || after.length < MIN_POINTS) return null;
  const last = run.samples.length - 1;
  // A long film has more points than the search needs, which is made anew at each move of a slider
  const few = after.filter((_, i) => i % Math.ceil(after.length / MOST_POINTS) === 0);
  // The nearest sample will do: the points differ by centimetres
  const distance = (/** @type {number} */ factor) => {
    const inside = few.filter(([t]) => t * factor <= run.end);
    if (inside.length < few.length / 2) return Infinity;
    return median(inside.map(([t, x, y]) => {
      const { light } = run.samples[Math.round((t * factor * last) / run.end)];
      return Math.hypot(x - light[0], y - light[1]);
    }));
  };
  const best = (/** @type {number[]} */ factors) => factors.reduce((one, other) => (distance(other) < distance(one) ? other : one));
  const rough = best(FACTORS);
  const fine = best(Array.from({ length: 2 * FINER + 1 }, (_, i) => rough * 2 ** ((i - FINER) / (4 * FINER))));
  const isRight = Math.max(fine, 1 / fine) < SMALLEST_FACTOR;
  if (isRight || distance(fine) > NEAR * now) return null;
  const found = 1 / (fine * median(after.slice(1).map(([t], i) => t - after[i][0])));
  const usual = RATES.reduce((one, other) => (Math.abs(Math.log(other / found)) < Math.abs(Math.log(one / found)) ? other : one));
  return { rate: Math.abs(found / usual - 1) <= NEARNESS ? usual : found, factor: 1 / fine };
}
