/**
 * How long each step from row to row lasted, by how far the masses moved in it, as `identify` tells it
 * (`discrepancy/data/step_durations.py`): repeated, lost and uneven pictures.
 */

import { text } from "../texts.js";
import { at, largest, percentile, rounded, scatter, spanOf, steps, where } from "./arrays.js";
import { count } from "./clock.js";
import { inSentence } from "./messages.js";
import { dot, mean, median, range, robustDeviation } from "./statistics.js";

/** @typedef {import("./clock.js").Channel} Channel */
/** @typedef {import("./clock.js").Notes} Notes */
/**
 * Times of the rows, the time from row to row, and of each step its duration in what it should be by the times (not a number where
 * the motion does not show it), the standard error of that, and the cosine of the angle between its way and the mean of those around.
 * @typedef {{t: number[], step: number, ratio: number[], error: number[], along: number[]}} Durations
 */

/** Numbers of steps before and after a step with which it is compared. */
const WINDOWS = [3, 6];
/** Largest error of a step's duration with which it counts for a pattern. */
const MAX_ERROR = 0.2;
/** Smallest number of such steps from which a pattern is told. */
const MIN_STEPS = 12;
/** Standard errors by which a duration must differ from the mean. */
const MIN_SIGMAS = 5;
/** Durations below which a picture is stored again, and above which pictures are lost before it. */
const [COPY, LOST] = [0.35, 1.7];
/** Duration of a step below which both masses rest, whatever the steps around are, and twice its largest error. */
const REST = 0.15;
/** Smallest cosine of the angle between a long way and those around it: a tracker that slips goes another way than the mass. */
const MIN_ALONG = 0.95;
/** Largest distance from 1 of the durations of the steps beside such a one: where masses turn fast, all are uneven. */
const MAX_USUAL = 0.2;
/** Longest pattern of repeated or uneven frames. */
const MAX_PERIOD = 6;
/** Smallest difference of the durations of frames in turn that is named. */
const MIN_UNEVEN = 0.08;
/** Smallest number of points that are equal to the one before of which any is taken for a copy. */
const MIN_COPIES = 3;
/** Smallest noise, as a part of the range of the values, in which a copy tells anything: made-up data have none. */
const MIN_NOISE = 5e-5;
/** Last digit, in standard deviations of the noise, up to which equal points are no chance but copies. */
const MAX_CHANCE_DIGIT = 0.2;
/** Largest number of times that a sentence names. */
const MAX_SHOWN = 3;
const BODIES = [["light_x", "light_y"], ["heavy_x", "heavy_y"]];

/** The channels without pictures that are stored again. @param {Channel[]} channels @param {Notes} notes @returns {Channel[]} */
export function withoutCopies(channels, notes) {
  for (const window of WINDOWS) {
    const durations = durationsOf(channels, window);
    const pattern = durations && patternOfCopies(durations);
    if (durations && pattern) return withoutPattern(channels, durations, pattern, notes);
  }
  return byBody(channels).flatMap((body) => withoutEqualPoints(body, notes));
}

/** @param {Channel[]} channels @param {Durations} durations @param {boolean[]} pattern which rows are new @param {Notes} notes */
function withoutPattern(channels, durations, pattern, notes) {
  const period = pattern.length;
  const newBefore = pattern.map((_, i) => pattern.slice(0, i).filter(Boolean).length);
  const pictures = pattern.filter(Boolean).length;
  const first = pattern.indexOf(true);
  const both = channels.map((channel) => {
    const numbers = numbersOf(durations, channel.t);
    const kept = where(numbers, (number) => pattern[number % period]);
    const byFile = { ...channel, t: at(channel.t, kept), value: at(channel.value, kept) };
    const rank = at(numbers, kept).map((number) => newBefore[number % period] + pictures * Math.floor(number / period));
    // A camera's pictures are even in time, which a film shows twice and three times in turn
    return { byFile, even: { ...byFile, t: rank.map((k) => durations.t[0] + (first + (k * period) / pictures) * durations.step) } };
  });
  const [byFile, even] = [both.map((one) => one.byFile), both.map((one) => one.even)];
  const total = (/** @type {Channel[]} */ those) => those.reduce((sum, channel) => sum + scatter(channel), 0);
  const chosen = total(even) < total(byFile) ? even : byFile;
  const [kept, all] = [chosen, channels].map((those) => largest(those.map(({ t }) => t.length)));
  notes.assumptions.push(text(pictures === 1 ? "assumed.copies" : "assumed.pattern", { period, pictures, kept, all }));
  return chosen;
}

/** What the points say against the times, which cannot be put right. @param {Channel[]} channels @returns {string[]} */
export function clockFaults(channels) {
  const [durations, usual] = [mean, median].map((typical) => durationsOf(channels, WINDOWS[0], typical));
  if (!durations || !usual) return [];
  const { t, ratio, error, along } = usual;
  const distance = ratio.map((one) => Math.abs(one - 1));
  // Points of fast masses scatter more than others
  const scores = where(error, (one) => one < MAX_ERROR).map((i) => distance[i] / error[i]);
  const least = MIN_SIGMAS * Math.max(1, scores.length ? robustDeviation(scores) : 1);
  // Two masses do not rest at once for a single step, while a pendulum's points may lie on both sides of its turning point
  const hasBoth = ["light", "heavy"].every((mass) => channels.some(({ name }) => name.startsWith(mass)));
  const isMoving = (/** @type {number} */ i) => i < 0 || i >= ratio.length || ratio[i] > 0.5;
  const alone = standsAlone(usual).map((one, i) => {
    return one || (hasBoth && ratio[i] < REST && error[i] < REST / 2 && isMoving(i - 1) && isMoving(i + 1));
  });
  const faults = [];
  for (const [key, isJump] of /** @type {const} */ ([
    ["fault.lost", (/** @type {number} */ i) => ratio[i] > LOST && along[i] > MIN_ALONG],
    ["fault.repeated", (/** @type {number} */ i) => ratio[i] < COPY],
  ])) {
    const jumps = where(ratio, (_, i) => isJump(i) && distance[i] > least * error[i] && alone[i]);
    if (!jumps.length) continue;
    const shown = at(t, jumps.slice(0, MAX_SHOWN)).map((time) => `${inSentence(time, 4)} s`).join(", ");
    const times = jumps.length > MAX_SHOWN ? text("fault.more", { shown, count: jumps.length - MAX_SHOWN }) : shown;
    faults.push(text(key, { times, steps: inSentence(ratio[jumps[0]], 2) }));
  }
  const uneven = unevenPattern(durations);
  if (uneven) faults.push(text("fault.uneven", { means: uneven.map((m) => inSentence(m, 2)).join(` ${text("fault.and")} `) }));
  return faults.map((fault) => `${fault}; ${text("fault.wayOut")}`);
}

/** Numbers of the frames at some times, from the first row. @param {Durations} durations @param {number[]} times */
const numbersOf = ({ t, step }, times) => times.map((time) => rounded((time - t[0]) / step));

/** Which steps have two usual ones on each side: in a jolt, or at an outlier, several in a row are unusual. @param {Durations} durations */
function standsAlone({ ratio, error }) {
  const usual = ratio.map((r, i) => Math.abs(r - 1) < Math.max(MAX_USUAL, 3 * error[i]));
  return usual.map((_, i) => [i - 2, i - 1, i + 1, i + 2].every((k) => usual[k]));
}

/**
 * Mean duration of the steps at each place of a pattern, and its standard error; null: some place has too few steps.
 * @param {Durations} durations
 * @param {number} period
 * @param {number} end 1: the places are those of the rows that the steps lead to; 0: those that they leave
 */
function meansByPlace(durations, period, end) {
  const { t, ratio, error } = durations;
  const counted = where(error, (one) => one < MAX_ERROR);
  const places = numbersOf(durations, counted.map((i) => t[i + end])).map((number) => number % period);
  const ofPlace = range(0, period).map((place) => counted.filter((_, k) => places[k] === place));
  if (ofPlace.some((those) => those.length < MIN_STEPS / period)) return null;
  const means = [];
  const errors = [];
  for (const those of ofPlace) {
    const weights = those.map((i) => 1 / Math.max(error[i], 0.02) ** 2);
    const total = weights.reduce((sum, w) => sum + w, 0);
    const mean = weights.reduce((sum, w, k) => sum + w * ratio[those[k]], 0) / total;
    const spread = weights.reduce((sum, w, k) => sum + w * (ratio[those[k]] - mean) ** 2, 0) / total;
    const number = total ** 2 / weights.reduce((sum, w) => sum + w ** 2, 0);
    means.push(mean);
    errors.push(Math.sqrt(Math.max(spread / Math.max(number - 1, 1), 1 / total)));
  }
  return { means, errors };
}

/** @param {Channel[]} channels @returns {Channel[][]} */
function byBody(channels) {
  /** @type {Map<string, Channel[]>} */
  const bodies = new Map();
  for (const channel of channels) {
    const body = BODIES.find((names) => names.includes(channel.name))?.[0] ?? channel.name;
    bodies.set(body, [...(bodies.get(body) ?? []), channel]);
  }
  return [...bodies.values()];
}

/** A body's channels without points that repeat the one before in every digit.
 * @param {Channel[]} body @param {Notes} notes */
function withoutEqualPoints(body, notes) {
  const [{ t }] = body;
  if (t.length < MIN_STEPS || body.some((c) => c.t.length !== t.length || c.t.some((one, i) => one !== t[i]))) return body;
  const fresh = where(t, (_, i) => i === 0 || body.some(({ value }) => value[i] !== value[i - 1]));
  const copies = t.length - fresh.length;
  if (!copies || fresh.length < MIN_STEPS) return body;
  const left = body.map((channel) => ({ ...channel, t: at(t, fresh), value: at(channel.value, fresh) }));
  // Of rounded points, or of those on a raster such as a picture's pixels, many that are no neighbours are equal, too
  const byChance = largest(left.map(({ value }) => value.length - new Set(value).size));
  if (copies < Math.max(MIN_COPIES, byChance) || !left.every(hasFineDigits)) return body;
  for (const { name } of body) count(notes, name, text("unused.copy"), copies);
  return left;
}

/** Whether a channel has noise, and digits so far below it that no two points are equal by chance. @param {Channel} channel */
function hasFineDigits(channel) {
  return scatter(channel) > Math.max(MIN_NOISE * spanOf(channel.value), channel.lastDigit / MAX_CHANCE_DIGIT);
}

/**
 * Durations of the steps by the masses' ways; null: there are too few rows.
 * @param {Channel[]} channels
 * @param {number} window number of steps before and after a step with which it is compared
 * @param {(speeds: number[]) => number} typical what is taken of these: their mean, of which a pattern of copies leaves as much as of
 *   even steps, or their median, on which a single other step has no influence
 * @returns {Durations | null}
 */
function durationsOf(channels, window, typical = mean) {
  const moving = channels.filter((c) => c.name !== "angle_rate" && c.t.length > 2 * window + MIN_STEPS);
  if (!moving.length) return null;
  const t = [...new Set(moving.flatMap((channel) => channel.t))].sort((a, b) => a - b);
  const time = steps(t);
  const ways = moving.map((channel) => {
    const values = new Map(channel.t.map((one, i) => [one, channel.value[i]]));
    return steps(t.map((one) => values.get(one) ?? NaN));
  });
  // All channels, or one whose other points are missing, count in the same steps alone
  const speed = time.map((one, i) => Math.sqrt(ways.reduce((sum, way) => sum + way[i] ** 2, 0)) / one);
  const noise = noiseOf(moving, ways.flat());
  const step = median(time);
  const durations = { t, step, ratio: time.map(() => NaN), error: time.map(() => Infinity), along: time.map(() => NaN) };
  for (let i = window; i < time.length - window; i++) {
    const others = [...speed.slice(i - window, i), ...speed.slice(i + 1, i + window + 1)].filter(Number.isFinite);
    const own = others.length > window ? typical(others) : 0;
    if (!Number.isFinite(speed[i]) || !(own > 0)) continue;
    durations.ratio[i] = speed[i] / own;
    const around = ways.map((way) => mean([...way.slice(i - window, i), ...way.slice(i + 1, i + window + 1)].filter(Number.isFinite)));
    const here = ways.map((way) => way[i]);
    durations.along[i] = dot(here, around) / Math.max(Math.sqrt(dot(here, here)) * Math.sqrt(dot(around, around)), 1e-300);
    // By the usual step where a longer one is a gap, over which noise makes a way no longer
    durations.error[i] = (Math.SQRT2 * noise) / (own * Math.min(time[i], step));
  }
  return durations;
}

/** Noise of points that may be copies: a picture that is stored again scatters less than others.
 * @param {Channel[]} channels @param {number[]} ways */
function noiseOf(channels, ways) {
  const known = ways.filter((way) => Number.isFinite(way) && way !== 0).map(Math.abs);
  return Math.min(largest(channels.map(scatter)), known.length ? percentile(known, 10) * 5 : Infinity);
}

/** Which rows of a period show a new picture; null: there is no such pattern. @param {Durations} durations */
function patternOfCopies(durations) {
  for (let period = 2; period <= MAX_PERIOD; period++) {
    const found = meansByPlace(durations, period, 1);
    if (!found) return null;
    const isNew = found.means.map((mean) => !(mean < COPY));
    // Far from 1 where a picture is stored again, and far from that elsewhere
    const isClear = found.means.every((mean, i) => (isNew[i] ? mean - COPY : 1 - mean) / MIN_SIGMAS > found.errors[i]);
    if (isClear && isNew.includes(true) && isNew.includes(false)) return isNew;
  }
  return null;
}

/** Mean durations of frames in turn; null: they are even. @param {Durations} durations */
function unevenPattern(durations) {
  for (let period = 2; period <= MAX_PERIOD; period++) {
    const found = meansByPlace(durations, period, 0);
    if (!found) return null;
    const { means, errors } = found;
    if (spanOf(means) > Math.max(MIN_UNEVEN, MIN_SIGMAS * Math.SQRT2 * largest(errors))) return means;
  }
  return null;
}
