/**
 * Rows of a film that are displaced in time, by the points themselves, as `identify` tells them
 * (`measured/displaced_rows.py`): repeated, lost and uneven pictures.
 *
 * Over a short while the masses' motion is a polynomial of the time. Points whose pictures were taken earlier or later than their
 * times say lie beside it along the velocity, those of all masses by one and the same time. That time is fitted; no model of the
 * motion is needed.
 */

import { text } from "../texts.js";
import { at, largest, rounded, scatter, spanOf, steps, where } from "./arrays.js";
import { count } from "./clock.js";
import { inSentence } from "./messages.js";
import { dot, inverse, mean, median, range } from "./statistics.js";

/** @typedef {import("./clock.js").Channel} Channel */
/** @typedef {import("./clock.js").Notes} Notes */
/**
 * All channels at the times of all rows [s], in standard deviations of their noise (not a number: missing), for each the first one with
 * the same missing rows, and the time from row to row [s]. `patterns` and `displacements`: what was found of it, by `half` and `onward`.
 * @typedef {{t: number[], values: number[][], same: number[], step: number, patterns: Map<number, Pattern[]>,
 *   displacements: Map<boolean, (Displacement | null)[]>}} Film
 */
/**
 * By how much a row is displaced [steps] (positive: filmed later than its time says), the standard error of that, the mean square
 * of the residuals in variances of the noise, and the displacement otherwise than along the velocities [standard errors], with so
 * many rows on each side.
 * @typedef {{half: number, value: number, error: number, misfit: number, across: () => number}} Displacement
 */
/**
 * Runs of `length` rows that begin at some rows, with the sum of squares of what no polynomial describes in each, and the number of its
 * values beyond the coefficients.
 * @typedef {{starts: number[], length: number, curves: Curves[], squares: Float64Array, freedom: Float64Array}} Windows
 */
/**
 * Displacements in windows. `places`: which of the `size` ones of its window a row of the film, or of the window, has (`size`: none);
 * `value`: all of them [steps], window by window; `squares`, `right`: for each, the sums over its rows of the squared velocity, and of
 * the velocity times what no polynomial describes; `misfit`: mean square of each window's residuals.
 * @typedef {{places: number[], ofFilm: boolean, size: number, value: Float64Array, squares: Float64Array, right: Float64Array,
 *   misfit: Float64Array}} Shifts
 */
/**
 * Time from the picture at each place of a pattern to the next one [steps], its standard errors, and the median over windows of the
 * residuals' mean square.
 * @typedef {{durations: number[], error: number[], misfit: number}} Pattern
 */

/** Rows, and time [s], on each side over which the motion is taken for a polynomial, whichever is longer. */
const HALF_WINDOWS = [[3, 0.0125], [6, 0.025], [6, 0.05]];
/** The same for patterns; the longer one holds all of them whole, but with few frames a second the masses turn in it. */
const PATTERN_HALF_WINDOWS = [6, 3];
/** Degree of the polynomial. */
const DEGREE = 3;
/** The same by which lost pictures must show, too, in the longest window: in 20 rows a second a swing is no cubic at its turning points. */
const FINER_DEGREE = 5;
/** Part of the normal equations' trace that keeps displacements finite that nothing determines. */
const RIDGE = 1e-9;
/** Largest mean square of a longer window's residuals, in that of a shorter one or in the noise's, with which it is taken. */
const MAX_MISFIT_RATIO = 1.25;
/** The same with which a displacement is named at all: beyond it the motion is no polynomial, as where a string jerks. */
const MAX_MISFIT = 2.5;
/** Number of fits, each with the velocity of the one before: rows that are displaced change it. */
const REFITS = 3;
/** Largest displacement that is fitted [steps]. */
const MAX_DISPLACEMENT = 6;
/** Standard errors by which a row must be displaced. */
const MIN_SIGMAS = 6;
/** Largest displacement otherwise than along the velocities, in standard errors and in the one along them. */
const [MAX_ACROSS, MAX_SLOPE] = [4, 0.1];
/** Displacement of a row, or of all from it on, in which the picture before is stored again [steps]. */
const COPIED = [-1.5, -0.6];
/** The same by three steps in a row: largest way of the middle one in those of the others, smallest way of these [standard deviations
 * of the noise], and smallest cosine of the angle between them. */
const [MAX_STOP, MIN_WAY, MIN_COSINE] = [0.2, 20, 0.5];
/** The same of all rows after lost pictures. */
const MIN_LOST = 0.6;
/** Longest pattern of repeated or uneven frames [frames]. */
const MAX_PERIOD = 6;
/** Standard errors by which durations at the places of a pattern must differ. */
const MIN_PATTERN_SIGMAS = 6;
/** Smallest number of rows that show anything. */
const MIN_ROWS = 12;
/** Smallest number of points that are left without copies. */
const MIN_FRESH = 6;
/** Largest number of rows on each side, at many frames a second. */
const MAX_HALF = 24;
/** Largest number of rows that are looked at, the first ones: a minute at 60 frames a second. */
const MAX_ROWS = 4000;
/** Misfit of a longer pattern, in that of a shorter one, below which it is the longer one. */
const MIN_MISFIT_RATIO = 0.8;
/** Duration of a step below which a picture is stored again [steps]. */
const COPY = 0.35;
/** Smallest difference of the durations of frames in turn that is named. */
const MIN_UNEVEN = 0.08;
/** Largest error of a row's displacement by the noise with which it tells of uneven times [steps]. */
const MAX_ROW_ERROR = 0.3;
/** Largest displacement of a row that counts [standard errors]. */
const MAX_SIGMAS = 8;
/** Smallest ratio of the points' mean squares along and across their ways at which times are uneven. */
const MIN_UNEVEN_RATIO = 2.2;
/** Factors by which the duration of a row may change in a film: those of a phone's slow motion. */
const RATE_FACTORS = [2, 4, 8, 1 / 2, 1 / 4, 1 / 8];
/** Rows on each side of one from which on they last longer or shorter. */
const RATE_HALF_WINDOWS = [3, 4, 6, 10];
/** Smallest fall of the residuals' sum of squares [variances of the noise] by a change of the clock, and without a model. */
const [MIN_GAIN, MIN_OWN_GAIN] = [30, 40];
/** Smallest part of the noise's sum of squares that remains, so that windows with less to lose need not be tried. */
const MIN_NOISE_LEFT = 0.3;
/** The same in that by leaving out one row, and smallest factor by which the misfit falls. */
const [MIN_GAIN_RATIO, MIN_MISFIT_FALL] = [1.5, 3];
/** Smallest number of rows on each side, as in short windows few numbers describe any motion. */
const MIN_OWN_HALF = 6;
/** Largest number of changes of the clock, the clearest ones. */
const MAX_CHANGES = 4;
/** Last digit, in standard deviations of the noise, up to which equal points are no chance but copies. */
const MAX_CHANCE_DIGIT = 0.2;
/** Smallest number of points that are equal to the one before, or where the masses were then, of which any is a copy. */
const MIN_COPIES = 3;
/** Smallest noise, as a part of the range of the values, in which a copy tells anything: made-up data have none. */
const MIN_NOISE = 5e-5;
/** Largest number of rows that a sentence names. */
const MAX_SHOWN = 3;
/** Keeps divisions finite where the rows determine nothing. */
const TINY = 1e-12;
const BODIES = [["light_x", "light_y"], ["heavy_x", "heavy_y"]];

/** The channels without pictures that are stored again. @param {Channel[]} channels @param {Notes} notes @returns {Channel[]} */
export function withoutCopies(channels, notes) {
  const film = filmOf(channels);
  const pattern = film && patternOfCopies(film);
  return film && pattern ? withoutPattern(channels, film, pattern, notes) : byBody(channels).flatMap((body) => withoutEqualPoints(body, notes));
}

/** @param {Channel[]} channels @param {Film} film @param {boolean[]} pattern which rows are new @param {Notes} notes */
function withoutPattern(channels, film, pattern, notes) {
  const period = pattern.length;
  const newBefore = pattern.map((_, i) => pattern.slice(0, i).filter(Boolean).length);
  const pictures = pattern.filter(Boolean).length;
  const first = pattern.indexOf(true);
  const both = channels.map((channel) => {
    const numbers = numbersOf(film, channel.t);
    const kept = where(numbers, (number) => pattern[placeOf(number, period)]);
    const byFile = { ...channel, t: at(channel.t, kept), value: at(channel.value, kept) };
    const rank = at(numbers, kept).map((number) => newBefore[placeOf(number, period)] + pictures * Math.floor(number / period));
    // A camera's pictures are even in time, which a film shows twice and three times in turn
    return { byFile, even: { ...byFile, t: rank.map((k) => film.t[0] + (first + (k * period) / pictures) * film.step) } };
  });
  const [byFile, even] = [both.map((one) => one.byFile), both.map((one) => one.even)];
  const noise = byFile.map(scatter);
  const chosen = roughness(even, noise) < roughness(byFile, noise) ? even : byFile;
  const [kept, all] = [chosen, channels].map((those) => largest(those.map(({ t }) => t.length)));
  notes.assumptions.push(text(pictures === 1 ? "assumed.copies" : "assumed.pattern", { period, pictures, kept, all }));
  return chosen;
}

/** How far points are from polynomials of their times [variances of the noise]. @param {Channel[]} channels @param {number[]} noise */
function roughness(channels, noise) {
  const film = newFilm(channels, noise);
  const half = PATTERN_HALF_WINDOWS[1];
  return film ? sumOf([...windowsOf(film, half, 2 * half + 1).squares]) : 0;
}

/** The channels with an error of each time, if points lie farther from a smooth motion along their ways than across, as where
 * pictures are taken unevenly, but their times are even. @param {Channel[]} channels @param {Notes} notes @returns {Channel[]} */
export function withTimeErrors(channels, notes) {
  const film = filmOf(channels);
  if (!film) return channels;
  const precise = bestDisplacements(film, false).flatMap((row) => {
    if (!row || !(row.misfit < MAX_MISFIT && row.error < MAX_ROW_ERROR)) return [];
    // By the noise alone; a point that is far out in either direction is an outlier
    const widening = Math.sqrt(Math.max(row.misfit, 1));
    const error = row.error / widening;
    const [along, beside] = [Math.abs(row.value) / error, row.across() * widening].map((one) => Math.min(one, MAX_SIGMAS) ** 2);
    return [{ error, along, beside }];
  });
  const others = film.values.length - 1;
  if (precise.length < MIN_ROWS || !others) return channels;
  const noise = Math.max(mean(precise.map(({ beside }) => beside)) / others, 1);
  const ratio = mean(precise.map(({ along }) => along)) / noise;
  if (ratio < Math.max(MIN_UNEVEN_RATIO, 1 + MIN_SIGMAS * Math.sqrt(2 / precise.length))) return channels;
  const weights = precise.map(({ error }) => 1 / (error ** 2 + MIN_UNEVEN ** 2) ** 2);
  const variance = dot(weights, precise.map(({ along, error }) => (along - noise) * error ** 2)) / sumOf(weights);
  const timeError = film.step * Math.sqrt(Math.max(variance, 0));
  if (timeError < 2 * largest(channels.map((channel) => channel.timeError))) return channels; // what rounding explains
  notes.assumptions.push(text("assumed.unevenPictures", { error: inSentence(1e3 * timeError, 2) }));
  return channels.map((channel) => ({ ...channel, timeError }));
}

/** What the points say against the times, which cannot be put right. @param {Channel[]} channels @returns {string[]} */
export function clockFaults(channels) {
  const film = filmOf(channels);
  if (!film) return [];
  const changes = rateChanges(film).map(({ t, factor }) => {
    const found = { time: inSentence(t, 3), factor: inSentence(factor > 1 ? factor : 1 / factor, 3) };
    return text(factor > 1 ? "fault.longer" : "fault.shorter", found);
  });
  if (changes.length) return [text("fault.changes", { changes: changes.join(` ${text("fault.and")} `) })];
  const uneven = unevenPattern(film);
  if (uneven) {
    const means = uneven.map((m) => inSentence(m, 2)).join(` ${text("fault.and")} `);
    return [`${text("fault.uneven", { means })}; ${text("fault.wayOut")}`];
  }
  const faults = [];
  const displaced = singleDisplacements(film, unrestOf(channels, film));
  for (const [key, isLost] of /** @type {const} */ ([["fault.lost", true], ["fault.repeated", false]])) {
    const named = displaced.filter(({ value }) => value > 0 === isLost);
    if (!named.length) continue;
    const shown = named.slice(0, MAX_SHOWN).map(({ row }) => `${inSentence(film.t[row], 4)} s`).join(", ");
    const times = named.length > MAX_SHOWN ? text("fault.more", { shown, count: named.length - MAX_SHOWN }) : shown;
    faults.push(text(key, { times, steps: inSentence(rounded(named[0].value), 2) }));
  }
  return faults.map((fault) => `${fault}; ${text("fault.wayOut")}`);
}

/** The channels without single rows in which the masses are where they were a row before: there the picture before is stored
 * again, or a tracker slipped; such a row tells nothing in either case. @param {Channel[]} channels @param {Notes} notes */
export function withoutRepeatedRows(channels, notes) {
  const film = filmOf(channels);
  const rows = film ? singleDisplacements(film, unrestOf(channels, film)).filter(({ onward }) => !onward).map(({ row }) => film.t[row]) : [];
  if (!rows.length || rows.length >= MIN_COPIES) return channels;
  notes.assumptions.push(text("assumed.repeated", { times: rows.map((t) => `${inSentence(t, 4)} s`).join(` ${text("fault.and")} `) }));
  return channels.map((channel) => {
    const kept = where(channel.t, (t) => !rows.includes(t));
    return { ...channel, t: at(channel.t, kept), value: at(channel.value, kept) };
  });
}

/** Standard error of each time [steps]. @param {Channel[]} channels @param {Film} film */
const unrestOf = (channels, film) => largest(channels.map(({ timeError }) => timeError)) / film.step;

/** The film that was asked for last: of one file's channels, all three exported functions ask for it.
 * @type {{channels: Channel[], film: Film | null}} */
let last = { channels: [], film: null };

/** The film of some channels; null: there are too few rows. @param {Channel[]} channels */
function filmOf(channels) {
  const isLast = channels.length === last.channels.length && channels.every((channel, i) => channel === last.channels[i]);
  if (!isLast) last = { channels: [...channels], film: newFilm(channels) };
  return last.film;
}

/** @param {Channel[]} channels @param {number[]} [noise] of each; by default, as its points show it @returns {Film | null} */
function newFilm(channels, noise = channels.map((channel) => Math.max(scatter(channel), channel.lastDigit))) {
  const moving = where(channels, ({ name, t }) => name !== "angle_rate" && t.length >= MIN_ROWS);
  if (!moving.length) return null;
  const t = [...new Set(moving.flatMap((c) => channels[c].t))].sort((a, b) => a - b).slice(0, MAX_ROWS);
  const values = moving.map((c) => {
    const known = new Map(channels[c].t.map((time, i) => [time, channels[c].value[i] / noise[c]]));
    return t.map((time) => known.get(time) ?? NaN);
  });
  const same = values.map((own) => values.findIndex((other) => other.every((value, i) => Number.isNaN(value) === Number.isNaN(own[i]))));
  return { t, values, same, step: median(steps(t)), patterns: new Map(), displacements: new Map() };
}

/** Numbers of the frames at some times, from the first row. @param {Film} film @param {number[]} times */
const numbersOf = ({ t, step }, times) => times.map((time) => rounded((time - t[0]) / step));

/** Place of a frame in a pattern, also of one before the first row. @param {number} number @param {number} period */
const placeOf = (number, period) => ((number % period) + period) % period;

/** Numbers of rows on each side by which displacements are looked for, the smallest first. @param {Film} film */
function halvesOf({ step }) {
  const halves = HALF_WINDOWS.map(([rows, duration]) => Math.min(Math.max(rows, rounded(duration / step)), MAX_HALF));
  return [...new Set(halves)].sort((a, b) => a - b);
}

/** Displacements of each row, or of all from it on, by the longest window of those in which the motion is a polynomial; null: no
 * window fits. @param {Film} film @param {boolean} onward @returns {(Displacement | null)[]} */
function bestDisplacements(film, onward) {
  const known = film.displacements.get(onward);
  if (known) return known;
  /** @type {(Displacement | null)[]} */
  const best = film.t.map(() => null);
  for (const half of halvesOf(film)) {
    displacements(film, half, onward).forEach((here, n) => {
      if (here.misfit < MAX_MISFIT_RATIO * Math.max(best[half + n]?.misfit ?? Infinity, 1)) best[half + n] = here;
    });
  }
  film.displacements.set(onward, best);
  return best;
}

/** Rows before which pictures are lost, and those that show the picture before. @param {Film} film
 * @param {number} unrest standard error of each time [steps] */
function singleDisplacements(film, unrest) {
  const longest = Math.max(...halvesOf(film));
  /** @type {Displacement[] | undefined} */
  let finer;
  const isClear = (/** @type {number} */ row, /** @type {number} */ sign) => {
    finer ??= displacements(film, longest, true, FINER_DEGREE);
    const { value, error, misfit } = finer[row - longest] ?? { value: 0, error: Infinity, misfit: Infinity };
    return misfit < MAX_MISFIT && sign * value > Math.max(MIN_LOST, MIN_SIGMAS * Math.hypot(error, unrest));
  };
  // A single row that is displaced displaces those around it a little, and the other way round
  const chosen = clearest([true, false].flatMap((onward) => bestDisplacements(film, onward).flatMap((best, row) => {
    if (!best) return [];
    const { half, value, error, misfit, across } = best;
    const sigmas = Math.abs(value) / Math.hypot(error, unrest);
    const isUsual = (value > COPIED[0] && value < COPIED[1]) || (onward && value > MIN_LOST);
    if (!isUsual || !(sigmas > MIN_SIGMAS && misfit < MAX_MISFIT)) return [];
    if (onward && !isClear(row, Math.sign(value))) return [];
    return across() < Math.max(MAX_ACROSS, MAX_SLOPE * sigmas) ? [{ row, half, strength: sigmas, value, onward }] : [];
  }))).map(({ row, value, onward }) => ({ row, value, onward }));
  for (const row of unrest < MAX_STOP ? stops(film) : []) {
    if (chosen.every((other) => Math.abs(row - other.row) > 1)) chosen.push({ row, value: -1, onward: false });
  }
  return chosen.sort((a, b) => a.row - b.row);
}

/** Rows in which the masses are where they were before, though they move far, and on, before and after. With few rows a second no
 * polynomial describes the motion. @param {Film} film */
function stops({ t, values, step }) {
  const time = steps(t);
  const ways = values.map(steps);
  /** @param {number} i @param {number} k */
  const product = (i, k) => sumOf(ways.map((way) => way[i] * way[k])) / (time[i] * time[k]);
  return range(2, t.length - 1).filter((row) => {
    const [before, own, after] = [row - 2, row - 1, row].map((i) => Math.sqrt(product(i, i)));
    const slower = Math.min(before, after);
    const isMoving = slower * time[row - 1] > MIN_WAY && product(row - 2, row) > MIN_COSINE * before * after;
    // Where rows are missing the speed is a mean of too long a time
    return isMoving && own < MAX_STOP * slower && Math.max(...time.slice(row - 2, row + 1)) < 1.5 * step;
  });
}

/** Those rows of which none that is clearer is within half a window. @template {{row: number, half: number, strength: number}} T
 * @param {T[]} found @param {number} most largest number of them */
function clearest(found, most = Infinity) {
  /** @type {T[]} */
  const chosen = [];
  for (const here of [...found].sort((a, b) => b.strength - a.strength)) {
    if (chosen.length < most && chosen.every(({ row }) => Math.abs(here.row - row) > here.half)) chosen.push(here);
  }
  return chosen.sort((a, b) => a.row - b.row);
}

/** A channel in windows of rows, in each of which it is a polynomial of the time, beside which some rows lie along the velocity. */
class Curves {
  /** @param {number[]} values @param {number[]} starts of the windows @param {number} length @param {number} half rows before the one at
   * which the polynomials' variable is 0 @param {number} terms number of polynomials @param {Curves} [other] with the same ones */
  constructor(values, starts, length, half, terms, other) {
    this.starts = starts;
    this.terms = terms;
    this.length = length;
    this.half = half;
    /** Which rows are known. */
    this.known = Uint8Array.from(values, (value) => Number(Number.isFinite(value)));
    /** Polynomials that are orthonormal over the known rows, and their derivatives: window by window, degree by degree, row by row. */
    this.basis = other?.basis ?? new Float64Array(starts.length * terms * length);
    this.slopes = other?.slopes ?? new Float64Array(starts.length * terms * length);
    /** What no polynomial describes. */
    this.rest = new Float64Array(starts.length * length);
    this.velocity = new Float64Array(starts.length * length);
    /** Coefficients of the nearest polynomial, of that beneath displaced rows, and of that nearest to each displacement's velocities. */
    this.nearest = new Float64Array(starts.length * terms);
    this.beneath = new Float64Array(starts.length * terms);
    this.described = new Float64Array(starts.length * (MAX_PERIOD - 1) * terms);
  }

  /** Make the polynomials. @param {number[]} t @param {number} unit of their variable [s] @param {number} factor how long a row lasts from
   * 0 on, in what it lasted before */
  orthonormalise(t, unit, factor) {
    const { starts, length, half, known, basis, slopes, terms } = this;
    for (let n = 0; n < starts.length; n++) {
      const first = n * terms * length;
      for (let j = 0; j < terms; j++) {
        const at = first + j * length;
        for (let k = 0; k < length; k++) {
          const x = ((t[starts[n] + k] - t[starts[n] + half]) / unit) * (k > half ? factor : 1);
          let power = known[starts[n] + k];
          let slope = 0;
          for (let i = 0; i < j; i++) {
            slope = slope * x + power;
            power *= x;
          }
          basis[at + k] = power;
          slopes[at + k] = slope;
        }
        for (let before = first; before < at; before += length) {
          let shared = 0;
          for (let k = 0; k < length; k++) shared += basis[before + k] * basis[at + k];
          for (let k = 0; k < length; k++) {
            basis[at + k] -= shared * basis[before + k];
            slopes[at + k] -= shared * slopes[before + k];
          }
        }
        let squares = 0;
        for (let k = 0; k < length; k++) squares += basis[at + k] * basis[at + k];
        // A polynomial that the rows do not determine is zero
        const scale = squares > TINY ? 1 / Math.sqrt(squares) : 0;
        for (let k = 0; k < length; k++) {
          basis[at + k] *= scale;
          slopes[at + k] *= scale;
        }
      }
    }
  }

  /** Fit the polynomials alone, and add the squares of what they leave. @param {number[]} values @param {Float64Array} squares */
  fitPolynomials(values, squares) {
    const { starts, length, known, basis, rest, nearest, terms } = this;
    for (let n = 0; n < starts.length; n++) {
      const here = n * length;
      for (let k = 0; k < length; k++) rest[here + k] = known[starts[n] + k] ? values[starts[n] + k] : 0;
      for (let j = 0; j < terms; j++) {
        const at = (n * terms + j) * length;
        let part = 0;
        for (let k = 0; k < length; k++) part += basis[at + k] * rest[here + k];
        for (let k = 0; k < length; k++) rest[here + k] -= part * basis[at + k];
        nearest[n * terms + j] = part;
      }
      for (let k = 0; k < length; k++) squares[n] += rest[here + k] * rest[here + k];
    }
  }

  /** Take the velocities of the displaced rows by the polynomials beneath, and add them to the sums. @param {Shifts} shifts */
  addVelocities({ places, ofFilm, size, squares, right }) {
    const { starts, length, half, known, basis, slopes, rest, velocity, beneath, described, terms } = this;
    described.fill(0, 0, starts.length * size * terms);
    for (let n = 0; n < starts.length; n++) {
      for (let k = 0; k < length; k++) {
        const place = places[ofFilm ? starts[n] + k : k];
        if (place === size || !known[starts[n] + k]) continue;
        const own = n * size + place;
        let v = 0;
        for (let j = 1; j < terms; j++) v += beneath[n * terms + j] * slopes[(n * terms + j) * length + k];
        v /= half;
        velocity[n * length + k] = v;
        for (let j = 0; j < terms; j++) described[own * terms + j] += v * basis[(n * terms + j) * length + k];
        squares[own] += v * v;
        right[own] += v * rest[n * length + k];
      }
    }
  }

  /** Weighted sum over windows of the products of what polynomials describe of two displacements' velocities.
   * @param {Float64Array} weight @param {number} size @param {number} p @param {number} q */
  shared(weight, size, p, q) {
    const { described, terms } = this;
    let sum = 0;
    for (let n = 0; n < weight.length; n++) {
      const [one, other] = [(n * size + p) * terms, (n * size + q) * terms];
      for (let j = 0; j < terms; j++) sum += weight[n] * described[one + j] * described[other + j];
    }
    return sum;
  }

  /** Take the polynomials beneath the displaced rows, and subtract what they describe. @param {Shifts} shifts */
  displace({ size, value, misfit }) {
    const { nearest, beneath, described, terms } = this;
    for (let n = 0; n < misfit.length; n++) {
      for (let j = 0; j < terms; j++) {
        let part = 0;
        for (let p = n * size; p < (n + 1) * size; p++) part += value[p] * described[p * terms + j];
        beneath[n * terms + j] = nearest[n * terms + j] - part;
        misfit[n] -= part * part;
      }
    }
  }

  /** Square of what the rows of place 0 of a window are displaced by otherwise than along the velocity, in residuals.
   * @param {number} n @param {Shifts} shifts one of each window */
  across(n, { places, value }) {
    const { starts, length, known, basis, rest, velocity, described, terms } = this;
    const parts = new Array(terms).fill(0);
    let [left, squares] = [0, 0];
    for (let k = 0; k < length; k++) {
      if (places[k] || !known[starts[n] + k]) continue;
      left += rest[n * length + k] - value[n] * velocity[n * length + k];
      squares += 1;
      for (let j = 0; j < terms; j++) parts[j] += basis[(n * terms + j) * length + k];
    }
    for (let j = 0; j < terms; j++) {
      left += value[n] * parts[j] * described[n * terms + j];
      squares -= parts[j] * parts[j];
    }
    return (left * left) / Math.max(squares, TINY);
  }
}

/** @param {Film} film @param {number} half @param {number} length @param {number[]} [starts] by default, all @param {number} [factor] how
 * long a row lasts from the one after `half` others on, in what it lasted before @param {number} [degree] of the polynomials
 * @returns {Windows} */
function windowsOf({ t, values, same, step }, half, length, starts = range(0, t.length - length + 1), factor = 1, degree = DEGREE) {
  const terms = degree + 1;
  const squares = new Float64Array(starts.length);
  /** @type {Curves[]} */
  const curves = [];
  values.forEach((all, c) => {
    const own = new Curves(all, starts, length, half, terms, curves[same[c]]);
    if (same[c] === c) own.orthonormalise(t, half * step * Math.max(factor, 1), factor);
    own.fitPolynomials(all, squares);
    curves.push(own);
  });
  const freedom = Float64Array.from(starts, (start) => sumOf(curves.map(({ known }) => {
    return Math.max(known.subarray(start, start + length).reduce((sum, one) => sum + one, 0) - terms, 0);
  })));
  return { starts, length, curves, squares, freedom };
}

/** Fit displacements along the velocity. @param {Windows} windows @param {number[]} places @param {boolean} ofFilm @param {number} size
 * @param {(shifts: Shifts) => void} solve takes the displacements that fit @returns {Shifts} */
function fitShifts({ starts, curves, squares, freedom }, places, ofFilm, size, solve) {
  const [value, squaredVelocities, right] = [0, 0, 0].map(() => new Float64Array(starts.length * size));
  const misfit = new Float64Array(starts.length).fill(1);
  const shifts = { places, ofFilm, size, value, squares: squaredVelocities, right, misfit };
  for (const { beneath, nearest } of curves) beneath.set(nearest);
  for (let refit = 0; refit < REFITS; refit++) {
    squaredVelocities.fill(0);
    right.fill(0);
    for (const curve of curves) curve.addVelocities(shifts);
    solve(shifts);
    misfit.set(squares);
    for (let n = 0; n < misfit.length; n++) {
      for (let p = n * size; p < (n + 1) * size; p++) misfit[n] += value[p] * (value[p] * squaredVelocities[p] - 2 * right[p]);
    }
    for (const curve of curves) curve.displace(shifts);
    for (let n = 0; n < misfit.length; n++) misfit[n] /= Math.max(freedom[n] - size, 1);
  }
  return shifts;
}

/** @param {number} value */
const clipped = (value) => Math.max(-MAX_DISPLACEMENT, Math.min(MAX_DISPLACEMENT, value));

/** Displacement of the row after `half` others, or of all from it on, in each window.
 * @param {Film} film @param {number} half @param {boolean} onward @param {number} [degree] of the polynomials @returns {Displacement[]} */
function displacements(film, half, onward, degree = DEGREE) {
  const places = range(0, 2 * half + (onward ? 0 : 1)).map((k) => Number(onward ? k < half : k !== half));
  const windows = windowsOf(film, half, places.length, undefined, 1, degree);
  const normal = new Float64Array(windows.starts.length);
  const shifts = fitShifts(windows, places, false, 1, ({ value, squares, right }) => {
    for (let n = 0; n < value.length; n++) {
      let own = squares[n];
      for (const { described, terms } of windows.curves) {
        for (let j = n * terms; j < (n + 1) * terms; j++) own -= described[j] * described[j];
      }
      normal[n] = (1 + RIDGE) * Math.max(own, 0) + TINY;
      value[n] = clipped(right[n] / normal[n]);
    }
  });
  return Array.from(shifts.value, (value, n) => {
    const misfit = shifts.misfit[n];
    const scale = Math.max(misfit, 1);
    const across = () => Math.sqrt(sumOf(windows.curves.map((curve) => curve.across(n, shifts))) / scale);
    return { half, value, error: Math.sqrt(scale / normal[n]), misfit, across };
  });
}

/** How long pictures in turn last by the points, by the length of the pattern; empty: there are too few rows.
 * @param {Film} film @param {number} half @returns {Pattern[]} */
function patternsOf(film, half) {
  const known = film.patterns.get(half);
  if (known || film.t.length < Math.max(2 * half + MIN_ROWS, 4 * MAX_PERIOD)) return known ?? [];
  const windows = windowsOf(film, half, 2 * half + 1);
  const numbers = numbersOf(film, film.t);
  const found = range(2, MAX_PERIOD + 1).map((period) => patternOf(windows, numbers.map((number) => number % period), period));
  film.patterns.set(half, found);
  return found;
}

/** How long pictures in turn last. @param {Windows} windows @param {number[]} places of the rows @param {number} period @returns {Pattern} */
function patternOf(windows, places, period) {
  // The others are displaced from the last place
  const size = period - 1;
  let weight = new Float64Array();
  let covariance = [[0]];
  const { value, misfit } = fitShifts(windows, places, true, size, (shifts) => {
    weight = shifts.misfit.map((one) => 1 / Math.max(one, 1));
    const normal = range(0, size).map(() => new Array(size).fill(0));
    const right = new Array(size).fill(0);
    for (let p = 0; p < size; p++) {
      for (let n = 0; n < weight.length; n++) {
        right[p] += weight[n] * shifts.right[n * size + p];
        normal[p][p] += weight[n] * shifts.squares[n * size + p];
      }
      for (let q = 0; q <= p; q++) {
        for (const curve of windows.curves) normal[p][q] -= curve.shared(weight, size, p, q);
        normal[q][p] = normal[p][q];
      }
    }
    const ridge = RIDGE * sumOf(normal.map((row, p) => row[p])) + TINY;
    normal.forEach((row, p) => { row[p] += ridge; });
    covariance = inverse(normal);
    const shared = covariance.map((row) => clipped(dot(row, right)));
    for (let p = 0; p < shifts.value.length; p++) shifts.value[p] = shared[p % size];
  });
  // Windows overlap, so that each row counts in as many as they are long
  const scale = (windows.length * dot(weight, misfit)) / sumOf([...weight]);
  const next = (/** @type {number} */ p) => (p + 1) % period;
  const late = (/** @type {number} */ p) => (p < size ? value[p] : 0);
  const variance = (/** @type {number} */ p, /** @type {number} */ q) => scale * (covariance[p]?.[q] ?? 0);
  return {
    durations: range(0, period).map((p) => 1 + late(next(p)) - late(p)),
    error: range(0, period).map((p) => Math.sqrt(variance(p, p) + variance(next(p), next(p)) - 2 * variance(p, next(p)))),
    misfit: median(misfit),
  };
}

/** Rows from which on they last longer or shorter, if the motion is clearly a polynomial of other times only. @param {Film} film */
function rateChanges(film) {
  /** @type {Map<number, {row: number, half: number, strength: number, factor: number}>} */
  const best = new Map();
  for (const half of RATE_HALF_WINDOWS) {
    if (film.t.length < 2 * half + 1 || half < MIN_OWN_HALF) continue;
    const even = windowsOf(film, half, 2 * half + 1);
    // The others' sums are too small to fall that far
    const starts = even.starts.filter((start) => even.squares[start] > MIN_GAIN + MIN_NOISE_LEFT * even.freedom[start]);
    for (const factor of RATE_FACTORS) {
      const changed = windowsOf(film, half, 2 * half + 1, starts, factor);
      starts.forEach((start, n) => {
        const [before, after] = [even.squares[start], changed.squares[n]];
        const row = start + half;
        const gain = before - after;
        if (!(gain > Math.max(MIN_OWN_GAIN, best.get(row)?.strength ?? 0) && after < MAX_MISFIT * changed.freedom[n])) return;
        if (before > MIN_MISFIT_FALL * after && gain > MIN_GAIN_RATIO * largestByOneRow(even, start)) {
          best.set(row, { row, half, strength: gain, factor });
        }
      });
    }
  }
  return clearest([...best.values()], MAX_CHANGES).map(({ row, factor }) => ({ t: film.t[row], factor }));
}

/** By how much a window's sum of squares falls without the row that fits worst. @param {Windows} windows @param {number} n */
function largestByOneRow({ curves, length }, n) {
  return largest(range(0, length).map((k) => sumOf(curves.map(({ basis, rest, terms }) => {
    const described = sumOf(range(0, terms).map((j) => basis[(n * terms + j) * length + k] ** 2));
    return rest[n * length + k] ** 2 / Math.max(1 - described, 0.05);
  }))));
}

/** @param {number[]} values */
const sumOf = (values) => values.reduce((sum, value) => sum + value, 0);

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
  if (t.length < MIN_ROWS || body.some((c) => c.t.length !== t.length || c.t.some((one, i) => one !== t[i]))) return body;
  const fresh = where(t, (_, i) => i === 0 || body.some(({ value }) => value[i] !== value[i - 1]));
  const copies = t.length - fresh.length;
  if (!copies || fresh.length < MIN_FRESH) return body;
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

/** Which rows of a period show a new picture; null: none is clearly stored again, or some are neither. @param {Pattern} pattern */
function newRows({ durations, error }) {
  // A row shows the picture before again if that one lasts no time
  const isNew = durations.map((_, i) => !((durations.at(i - 1) ?? 0) < COPY));
  const isClear = durations.every((_, i) => {
    const last = durations.at(i - 1) ?? 0;
    return (isNew[i] ? last - COPY : 1 - last) > MIN_PATTERN_SIGMAS * (error.at(i - 1) ?? 0);
  });
  return isClear && isNew.includes(false) ? isNew : null;
}

/** Which rows of a period show a new picture; null: there is no such pattern. @param {Film} film */
function patternOfCopies(film) {
  for (const half of PATTERN_HALF_WINDOWS) {
    let best = null;
    for (const pattern of patternsOf(film, half)) {
      const isNew = newRows(pattern);
      // Of pictures stored four times, every second one is stored twice, too
      if (isNew && (!best || pattern.misfit < MIN_MISFIT_RATIO * best.misfit)) best = { isNew, misfit: pattern.misfit };
    }
    if (best) return best.isNew;
  }
  return null;
}

/** Mean durations of frames in turn; null: they are even. @param {Film} film */
function unevenPattern(film) {
  for (const half of PATTERN_HALF_WINDOWS) {
    for (const { durations, error } of patternsOf(film, half)) {
      if (spanOf(durations) > Math.max(MIN_UNEVEN, MIN_PATTERN_SIGMAS * Math.SQRT2 * largest(error))) return durations;
    }
  }
  return null;
}
