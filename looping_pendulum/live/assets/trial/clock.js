/**
 * One account of time, as `identify` gives it (`measured/clock.py`): a film's frames follow each other at equal steps, so
 * that its times are whole numbers of frames, perhaps rounded by the program that wrote them.
 */

import { text } from "../texts.js";
import { at, largest, percentile, rounded, scatter, smallest, steps, where } from "./arrays.js";
import { dataError, inSentence } from "./messages.js";
import { dot, mean, median, range, sumOfSquares } from "./statistics.js";

/**
 * Values of one channel [SI], one for each row, and what the last digit of each is worth; not a number: none.
 * @typedef {{name: string, column: string, value: number[], digit: number[]}} Series
 */
/**
 * SI, without missing samples; `timeError`: standard error of each time [s].
 * @typedef {{name: string, column: string, t: number[], value: number[], lastDigit: number, timeError: number}} Channel
 */
/** @typedef {{channel: string, reason: string, count: number}} Unused values of a channel, or of a column that is none */
/** @typedef {{unused: Unused[], assumptions: string[]}} Notes */
/**
 * Rows with one column of times, its name, the lines of the rows, their times [s] (null: the file has frames only), the largest
 * error of each by rounding, and the numbers of the frames (null: the file does not say).
 * @typedef {{clock: string, lines: number[], time: number[] | null, rounding: number[], frame: number[] | null, channels: Series[]}} Sheet
 */
/** @typedef {Sheet & {time: number[]}} TimedSheet */
/**
 * Number of steps of each time; `cut`: what is added to times whose last digits were cut off so that they are as good as rounded ones [s].
 * @typedef {{start: number, rate: number, number: number[], largestError: number, cut: number}} Grid
 */
/** @typedef {{file: string, frameRate: number | null, clipRate: number | null, notes: Notes}} How */

/** Relative difference of two frame rates that are the same. */
const RATE_TOLERANCE = 0.01;
/** Frame rates of cameras [Hz]. */
const USUAL_RATES = [
  15, 20, 24, 25, 30, 48, 50, 60, 90, 100, 120, 200, 240, 250, 300, 400, 480, 500, 600, 960, 1000,
];
/** Rounding of times, in steps from row to row, that needs no account. */
const EXACT = 1e-3;
/** Largest plausible time between rows [s]. */
const MAX_TIME_STEP = 0.5;
/** Smallest number of rows whose times are looked at for rounding. */
const MIN_ROUNDED = 10;
/** Share of the scatter that is left with equal steps, below which the frames were even and the file's times are not theirs. */
const MIN_EVEN_GAIN = 0.8;
/** Standard errors of an uneven clock's mean step within which a usual rate is taken. */
const USUAL_SIGMAS = 3;
/** Smallest number of rows by which the points tell even frames from uneven ones. */
const MIN_ROWS = 24;
/** Longest step, in mean steps, that may be the unrest of a recorder and not a missing row. */
const MAX_UNEVEN = 2.5;
/** Largest relative difference of a usual rate's step from the median one at which rows may be counted by that rate. */
const NEAR_STEP = 0.25;
/** Twice the largest acceleration of a mass after its release [m/s^2], and of an angle [rad/s^2]: a record that is faster begins later. */
const [MAX_START_ACCELERATION, MAX_ANGULAR_ACCELERATION] = [9.81, 98.1];
/** The same by noise, in its standard deviations. */
const MAX_START_SIGMAS = 4;
/** Keeps comparisons of decimal times from their last bit [s]. */
const TINY = 1e-9;

/** @param {Notes} notes @param {string} channel @param {string} reason @param {number} more */
export function count(notes, channel, reason, more) {
  const known = notes.unused.find((one) => one.channel === channel && one.reason === reason);
  if (known) known.count += more;
  else if (more) notes.unused.push({ channel, reason, count: more });
}

/** The channels with the times of their points. @param {Sheet[]} sheets @param {How} how @returns {Channel[]} */
export function timedChannels(sheets, how) {
  const { file, frameRate } = how;
  if (frameRate !== null && sheets.every(({ frame }) => frame)) return channelsOf(sheets, timesOfFrames(sheets, frameRate, file), 0, file);
  if (sheets.some(({ time }) => !time)) throw dataError(file, null, "", text("file.needsRate"));
  const timed = sheets.map((sheet) => growing(/** @type {TimedSheet} */ (sheet), file));
  const { times, error } = timesOfClock(timed, how);
  return channelsOf(timed, times, error, file);
}

/** @param {Sheet[]} sheets @param {number[][]} times of the rows of each @param {number} timeError @param {string} file @returns {Channel[]} */
function channelsOf(sheets, times, timeError, file) {
  return sheets.flatMap(({ channels }, i) => channels.map(({ name, column, value, digit }) => {
    const kept = where(value, (one, k) => Number.isFinite(one + times[i][k]));
    if (!kept.length) throw dataError(file, null, column, text("file.noValues", { name: `${name}(t)` }));
    return { name, column, t: at(times[i], kept), value: at(value, kept), lastDigit: largest(at(digit, kept)), timeError };
  }));
}

/** Whether any channel has a value in each row. @param {Sheet} sheet */
const withPoint = ({ lines, channels }) => lines.map((_, i) => channels.some(({ value }) => Number.isFinite(value[i])));

/** Times by frame numbers; all tracks count from the first frame in which any of them has a point.
 * @param {Sheet[]} sheets @param {number} rate @param {string} file */
function timesOfFrames(sheets, rate, file) {
  const numbers = sheets.map((sheet) => {
    const hasPoint = withPoint(sheet);
    const frame = (sheet.frame ?? []).map((number, i) => (hasPoint[i] ? number : NaN));
    let before = -Infinity;
    for (const i of where(hasPoint, Boolean)) {
      const found = { frame: inSentence(frame[i]), before: inSentence(before) };
      if (!(frame[i] > before)) throw dataError(file, sheet.lines[i], "frame", text(Number.isNaN(frame[i]) ? "file.noFrame" : "file.framesGrow", found));
      before = frame[i];
    }
    return frame;
  });
  const first = smallest(numbers.flat().filter(Number.isFinite));
  return numbers.map((frame) => frame.map((number) => (number - first) / rate));
}

/** The rows that have a time and a point. @param {TimedSheet} sheet @param {string} file @returns {TimedSheet} */
function growing(sheet, file) {
  const hasPoint = withPoint(sheet);
  const kept = where(hasPoint, (has, i) => has && Number.isFinite(sheet.time[i]));
  const [time, lines] = [at(sheet.time, kept), at(sheet.lines, kept)];
  const back = steps(time).findIndex((step) => step < 0);
  if (back >= 0) {
    const found = { time: inSentence(time[back + 1]), before: inSentence(time[back]), line: lines[back] };
    throw dataError(file, lines[back + 1], sheet.clock, text("file.timesGrow", found));
  }
  return {
    ...sheet,
    lines,
    time,
    rounding: at(sheet.rounding, kept),
    channels: sheet.channels.map((one) => ({ ...one, value: at(one.value, kept), digit: at(one.digit, kept) })),
  };
}

/** The times of the rows of each sheet [s] (not a number: none), and how far rounding may have changed them, as a standard error [s].
 * @param {TimedSheet[]} sheets @param {How} how */
function timesOfClock(sheets, { file, frameRate, clipRate, notes }) {
  const longest = sheets.reduce((most, sheet) => (sheet.lines.length > most.lines.length ? sheet : most));
  const rounding = longest.time.length >= MIN_ROUNDED ? largest(longest.rounding) : 0;
  const stated = [clipRate, frameRate].filter((rate) => rate !== null);
  const grid = rounding ? frameGrid(longest.time, longest.rounding, stated) : null;
  const grown = steps(longest.time).filter((one) => one > 0);
  const step = grid ? 1 / grid.rate : grown.length ? meanNear(grown, 50) : 0;
  if (frameRate === null && step > MAX_TIME_STEP) {
    const slow = { step: inSentence(step), unit: step > 1000 ? "us" : "ms" };
    throw dataError(file, longest.lines[0], longest.clock, text(Math.abs(step - 1) < TINY ? "file.slowFrames" : "file.slow", slow));
  }
  let fileRate = step ? 1 / step : frameRate;
  /** @type {number[][] | null} */
  let times = null;
  let error = 0;
  if (grid && grid.largestError > EXACT * step) {
    // On the declared rate, if the rounded times do not tell the difference
    const wanted = stated.filter((rate) => Math.abs(rate * step - 1) < RATE_TOLERANCE);
    const usual = atUsualRate(grid, longest.time, longest.rounding, wanted) ?? grid;
    const onGrid = sheets.map((sheet) => timesOnGrid(usual, sheet));
    if (onGrid.every((t) => t.length)) {
      times = onGrid;
      fileRate = usual.rate;
      const printed = { digit: inSentence(2 * rounding, 2), rate: inSentence(usual.rate, 4) };
      notes.assumptions.push(text(rounding > 0.1 * step ? "assumed.coarseGrid" : "assumed.grid", printed));
    }
  }
  if (!times) {
    const unique = sheets.map((sheet) => withoutRepeatedRows(sheet, file, notes));
    times = grid ? unique : evenTimes(sheets, unique, stated, notes);
    if (!grid && rounding > EXACT * step) {
      error = rounding / Math.sqrt(3);
      notes.assumptions.push(text("assumed.timeErrors", { digit: inSentence(2 * rounding, 2) }));
    }
  }
  const madeFor = clipRate ?? fileRate;
  if (frameRate === null || madeFor === null || !(Math.abs(madeFor / frameRate - 1) >= RATE_TOLERANCE)) return { times, error };
  const rates = { from: inSentence(madeFor, 4), to: inSentence(frameRate, 4) };
  notes.assumptions.push(text(clipRate ? "assumed.rate" : "assumed.rateByRows", rates));
  const factor = madeFor / frameRate;
  return { times: times.map((t) => t.map((one) => one * factor)), error: error * factor };
}

/** Mean of the steps that are about as long as the one that a percentage of all do not exceed. @param {number[]} all @param {number} percent */
function meanNear(all, percent) {
  const usual = percentile(all, percent, false);
  return mean(all.filter((step) => step > 0.5 * usual && step < 1.5 * usual));
}

/** The times of a sheet's rows on a grid [s]; none: they are not on it. @param {Grid} grid @param {TimedSheet} sheet */
function timesOnGrid({ start, rate, cut }, { time, rounding }) {
  const own = frameGrid(time, rounding, [rate]);
  if (!own) return [];
  const first = rounded((own.start + cut - start) * rate);
  const t = own.number.map((number) => start + (first + number * rounded(rate / own.rate)) / rate);
  return t.every((one, i) => Math.abs(one - cut - time[i]) <= 2 * rounding[i] + TINY) ? t : [];
}

/** The first of the rates with the smallest distance; nothing if there are none. @param {number[]} rates
 * @param {(rate: number) => number} distance @returns {number | undefined} */
const nearest = (rates, distance) => [...rates].sort((a, b) => distance(a) - distance(b))[0];

/** The grid with one of the wanted rates, or the nearest usual one; null: the rounded times do not allow it.
 * @param {Grid} grid @param {number[]} time @param {number[]} rounding @param {number[]} wanted @returns {Grid | null} */
function atUsualRate(grid, time, rounding, wanted, tolerance = TINY) {
  const usual = nearest(USUAL_RATES, (rate) => Math.abs(rate - grid.rate)) ?? grid.rate;
  for (const rate of [...wanted, usual]) {
    const low = largest(time.map((t, i) => t - rounding[i] - grid.number[i] / rate));
    const high = smallest(time.map((t, i) => t + rounding[i] - grid.number[i] / rate));
    // A film's times count its frames, from one of them on; programs round them, or cut their last digits off
    for (const [cut, above] of [[0, TINY], [largest(rounding), -TINY]]) {
      const from = Math.max(low + cut, Math.min(0, time[0])) - TINY;
      const likely = [0, rounded((0.5 * (low + high) + cut) * rate + TINY) / rate];
      const start = likely.find((one) => from <= one && one <= high + cut + above);
      if (start !== undefined) return { ...grid, rate, start, cut };
    }
    if (low <= high + tolerance) return { ...grid, rate, start: 0.5 * (low + high) };
  }
  return null;
}

/**
 * The equal steps of which rounded times are whole numbers; null: they are not, or are too coarse to tell.
 * @param {number[]} time that does not fall [s]
 * @param {number[]} rounding
 * @param {number[]} rates that are likely [Hz]
 * @returns {Grid | null}
 */
function frameGrid(time, rounding, rates) {
  const last = time[time.length - 1];
  if (time.length < 3 || last <= time[0]) return null;
  const all = steps(time);
  const most = largest(rounding);
  const lastBit = TINY * (1 + Math.abs(last));
  // A quarter of a step where a row has more digits than others, as what is fitted has the others' error
  const least = median(all) / 6;
  const byDigits = rounding.map((digit) => 1.5 * Math.min(Math.max(digit, least), most) + lastBit);
  // The equal steps nearest to times with some numbers; null: one is farther from its step than is allowed
  const fitted = (/** @type {number[]} */ number, allowed = byDigits) => {
    const { middle, row, slope, rest } = line(number, time);
    const largestError = largest(rest.map(Math.abs));
    if (steps(number).some((step) => step <= 0) || slope <= 0 || !rest.every((one, i) => Math.abs(one) <= allowed[i])) return null;
    return { start: middle + slope * (row[0] - number[0]), rate: 1 / slope, number, largestError, cut: 0 };
  };
  const rows = fitted(range(0, time.length));
  const usual = percentile(all, 50, false);
  if ([...rates, ...USUAL_RATES].some((rate) => Math.abs(rate * usual - 1) < TINY)) {
    // Times that are whole numbers of a usual step are exact, unless no row is missing at another usual rate
    const exact = fitted(time.map((t) => rounded((t - time[0]) / usual)), time.map(() => lastBit));
    if (exact && !(rows && atUsualRate(rows, time, rounding, rates, -TINY))) return exact;
  }
  if (rows) return rows;
  // Where rows may be missing, steps rounded to whole numbers of the smaller ones
  const numbers = rates.map((rate) => time.map((t) => rounded((t - time[0]) * rate)));
  if (percentile(all, 10, false) > 4 * most) {
    const one = meanNear(all, 10);
    let sum = 0;
    numbers.unshift([0, ...all.map((step) => (sum += rounded(step / one)))]);
  }
  return numbers.map((number) => fitted(number)).find(Boolean) ?? null;
}

/** The straight line of least squares through times, by their numbers from the middle one on, and what is left of the times.
 * @param {number[]} number @param {number[]} time */
function line(number, time) {
  const [middle, middleNumber] = [mean(time), mean(number)];
  const row = number.map((one) => one - middleNumber);
  const slope = dot(row, time.map((t) => t - middle)) / sumOfSquares(row);
  return { middle, row, slope, rest: time.map((t, i) => t - middle - slope * row[i]) };
}

/** The times of a sheet's rows [s], not a number for a row that repeats the one before whole.
 * @param {TimedSheet} sheet @param {string} file @param {Notes} notes */
function withoutRepeatedRows({ time, lines, clock, channels }, file, notes) {
  return time.map((t, i) => {
    if (i === 0 || t !== time[i - 1]) return t;
    for (const { name, value } of channels) {
      count(notes, name, text("unused.repeated"), Number(Number.isFinite(value[i])));
      if (Math.abs(value[i] - value[i - 1]) > 0) {
        const found = { time: inSentence(t), before: inSentence(t), line: lines[i - 1] };
        throw dataError(file, lines[i], clock, text("file.sameTime", found));
      }
    }
    return NaN;
  });
}

/**
 * Equal steps in place of uneven ones where the points say that the frames were even: a program that records a screen writes
 * times that are not the camera's.
 * @param {TimedSheet[]} sheets @param {number[][]} times @param {number[]} stated likely frame rates [Hz] @param {Notes} notes
 */
function evenTimes(sheets, times, stated, notes) {
  const [t] = times;
  if (sheets.length > 1 || t.length < MIN_ROWS || !t.every(Number.isFinite)) return times;
  const all = steps(t);
  const rates = [...stated, ...USUAL_RATES];
  // Each row a frame, or, where rows are missing, whole numbers of a usual rate's frames
  const near = rates.filter((rate) => Math.abs(rate * median(all) - 1) < NEAR_STEP);
  const numbers = [range(0, t.length), ...near.map((rate) => frameNumbers(t, rate))];
  const fits = numbers.flatMap((number) => {
    const frames = steps(number);
    const fit = line(number, t);
    const shares = all.map((step, i) => step / (fit.slope * frames[i]));
    const isLikely = frames.every((one) => one > 0) && shares.every((share) => EXACT < share && share <= MAX_UNEVEN);
    return isLikely ? { ...fit, uneven: sumOfSquares(fit.rest) / fit.slope ** 2 } : [];
  });
  if (!fits.length) return times;
  const { middle, row, slope, rest } = fits.reduce((best, fit) => (fit.uneven < best.uneven ? fit : best));
  const unrest = Math.sqrt(sumOfSquares(rest) / t.length / sumOfSquares(row));
  const distance = (/** @type {number} */ rate) => Math.abs(1 / rate - slope);
  const likely = rates.filter((rate) => distance(rate) <= Math.max(USUAL_SIGMAS * unrest, EXACT * slope));
  const rate = nearest(likely, distance) ?? 1 / slope;
  const even = row.map((i) => middle + i / rate);
  const total = (/** @type {number[]} */ clock) => channelsOf(sheets, [clock], 0, "").reduce((sum, channel) => sum + scatter(channel), 0);
  const [low, high] = [5, 95].map((percent) => inSentence(1e3 * percentile(all, percent), 3));
  const isEven = !(total(even) > MIN_EVEN_GAIN * total(t));
  notes.assumptions.push(text(isEven ? "assumed.evenTimes" : "assumed.unevenTimes", { low, high, rate: inSentence(rate, 4) }));
  return isEven ? [even] : times;
}

/** Whole numbers of frames nearest to uneven times. @param {number[]} t @param {number} rate */
function frameNumbers(t, rate) {
  const turns = t.map((one) => 2 * Math.PI * rate * one);
  const phase = Math.atan2(mean(turns.map(Math.sin)), mean(turns.map(Math.cos)));
  return turns.map((turn) => rounded((turn - phase) / (2 * Math.PI)));
}

/** Time at which a clock begins elsewhere while the masses are at rest [s]; 0: it does not. @param {Channel[]} channels */
export function startOf(channels) {
  const start = smallest(channels.map(({ t }) => t[0]));
  const step = smallest(channels.filter(({ t }) => t.length > 1).map(({ t }) => median(steps(t))));
  if (Math.abs(start) <= 3 * step) return 0; // without a step, too
  const isMoving = channels.some(({ name, t, value }) => {
    const acceleration = name === "angle" ? MAX_ANGULAR_ACCELERATION : MAX_START_ACCELERATION;
    const most = acceleration * (t[2] - t[0]) ** 2 + MAX_START_SIGMAS * scatter({ t, value });
    return t.length < 5 || name === "angle_rate" || Math.abs(value[2] - value[0]) > most;
  });
  return isMoving ? 0 : start;
}
