/**
 * Rows of a film that are displaced in time, by the points themselves, as `identify` tells them
 * (`discrepancy/data/displaced_rows.py`): repeated, lost and uneven pictures.
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

/** @typedef {import("./clock.js").Channel & {timeError?: number}} Channel standard error of each time by rounding [s] */
/** @typedef {import("./clock.js").Notes} Notes */
/**
 * All channels at the times of all rows [s], in standard deviations of their noise (not a number: missing), for each the first one with
 * the same missing rows, and the time from row to row [s].
 * @typedef {{t: number[], values: number[][], same: number[], step: number}} Film
 */
/**
 * By how much a row is displaced [steps] (positive: filmed later than its time says), the standard error of that, the mean square
 * of the residuals in variances of the noise, and the displacement otherwise than along the velocities [standard errors], with so
 * many rows on each side.
 * @typedef {{half: number, value: number, error: number, misfit: number, across: number}} Displacement
 */
/**
 * Normal equations of displacements in each window, one after the other. `places`: which of the `size` displacements each row has
 * (`size`: none), by the row of the film or of the window; `squares`: of what no polynomial describes; `freedom`: number of values
 * beyond all that is fitted to them; `misfit`: mean square of the residuals.
 * @typedef {{places: number[], ofFilm: boolean, size: number, squares: Float64Array, freedom: Float64Array, value: Float64Array,
 *   right: Float64Array, normal: Float64Array, misfit: Float64Array}} Equations
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
const SIZE = DEGREE + 1;
/** Largest mean square of a longer window's residuals, in that of a shorter one or in the noise's, with which it is taken. */
const MAX_MISFIT_RATIO = 1.25;
/** The same with which a displacement is told at all: beyond it the motion is no polynomial, as where a string jerks. */
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
/** The same of all rows after lost pictures. */
const MIN_LOST = 0.6;
/** Longest pattern of repeated or uneven frames [frames]. */
const MAX_PERIOD = 6;
/** Standard errors by which durations at the places of a pattern must differ. */
const MIN_PATTERN_SIGMAS = 5;
/** Smallest number of rows from which anything is told. */
const MIN_ROWS = 12;
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
/** Scatter of points at even times, in that at the file's, below which the pictures were taken at even ones. */
const MIN_EVEN_RATIO = 0.8;
/** Last digit, in standard deviations of the noise, up to which equal points are no chance but copies. */
const MAX_CHANCE_DIGIT = 0.2;
/** Smallest number of points that are equal to the one before of which any is taken for a copy. */
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
  const total = (/** @type {Channel[]} */ those) => sumOf(those.map(scatter));
  const chosen = total(even) < MIN_EVEN_RATIO * total(byFile) ? even : byFile;
  const [kept, all] = [chosen, channels].map((those) => largest(those.map(({ t }) => t.length)));
  notes.assumptions.push(text(pictures === 1 ? "assumed.copies" : "assumed.pattern", { period, pictures, kept, all }));
  return chosen;
}

/** The channels with an error of each time, if points lie farther from a smooth motion along their ways than across, as where
 * pictures are taken unevenly, but their times are even. @param {Channel[]} channels @param {Notes} notes @returns {Channel[]} */
export function withTimeErrors(channels, notes) {
  const film = filmOf(channels);
  if (!film) return channels;
  const rows = bestDisplacements(film, false).filter((one) => one && one.misfit < MAX_MISFIT && one.error < MAX_ROW_ERROR);
  const others = film.values.length - 1;
  if (rows.length < MIN_ROWS || !others) return channels;
  // By the noise alone; a point that is far out in either direction is an outlier
  const told = rows.filter((one) => one !== null).map(({ value, error, misfit, across }) => {
    const widening = Math.sqrt(Math.max(misfit, 1));
    const byNoise = error / widening;
    const [along, beside] = [Math.abs(value) / byNoise, across * widening].map((one) => Math.min(one, MAX_SIGMAS) ** 2);
    return { error: byNoise, along, beside };
  });
  const noise = Math.max(mean(told.map(({ beside }) => beside)) / others, 1);
  const ratio = mean(told.map(({ along }) => along)) / noise;
  if (ratio < Math.max(MIN_UNEVEN_RATIO, 1 + MIN_SIGMAS * Math.sqrt(2 / told.length))) return channels;
  const weights = told.map(({ error }) => 1 / (error ** 2 + MIN_UNEVEN ** 2) ** 2);
  const variance = dot(weights, told.map(({ along, error }) => (along - noise) * error ** 2)) / sumOf(weights);
  const timeError = film.step * Math.sqrt(Math.max(variance, 0));
  if (timeError < 2 * largest(channels.map((channel) => channel.timeError ?? 0))) return channels; // what rounding explains
  notes.assumptions.push(text("assumed.unevenPictures", { error: inSentence(1e3 * timeError, 2) }));
  return channels.map((channel) => ({ ...channel, timeError }));
}

/** What the points say against the times, which cannot be put right. @param {Channel[]} channels @returns {string[]} */
export function clockFaults(channels) {
  const film = filmOf(channels);
  if (!film) return [];
  const faults = [];
  const displaced = singleDisplacements(film);
  for (const [key, isLost] of /** @type {const} */ ([["fault.lost", true], ["fault.repeated", false]])) {
    const named = displaced.filter(({ value }) => value > 0 === isLost);
    if (!named.length) continue;
    const shown = named.slice(0, MAX_SHOWN).map(({ t }) => `${inSentence(t, 4)} s`).join(", ");
    const times = named.length > MAX_SHOWN ? text("fault.more", { shown, count: named.length - MAX_SHOWN }) : shown;
    faults.push(text(key, { times, steps: inSentence(named[0].value, 2) }));
  }
  const uneven = unevenPattern(film);
  if (uneven) faults.push(text("fault.uneven", { means: uneven.map((m) => inSentence(m, 2)).join(` ${text("fault.and")} `) }));
  return faults.map((fault) => `${fault}; ${text("fault.wayOut")}`);
}

/** The film of some channels; null: there are too few rows. @param {Channel[]} channels @returns {Film | null} */
function filmOf(channels) {
  const moving = channels.filter((channel) => channel.name !== "angle_rate" && channel.t.length >= 2 * MIN_ROWS);
  if (!moving.length) return null;
  const t = [...new Set(moving.flatMap((channel) => channel.t))].sort((a, b) => a - b);
  const values = moving.map((channel) => {
    const noise = Math.max(scatter(channel), channel.lastDigit);
    const known = new Map(channel.t.map((time, i) => [time, channel.value[i] / noise]));
    return t.map((time) => known.get(time) ?? NaN);
  });
  const same = values.map((own) => values.findIndex((other) => other.every((value, i) => Number.isNaN(value) === Number.isNaN(own[i]))));
  return { t, values, same, step: median(steps(t)) };
}

/** Numbers of the frames at some times, from the first row. @param {Film} film @param {number[]} times */
const numbersOf = ({ t, step }, times) => times.map((time) => rounded((time - t[0]) / step));

/** Place of a frame in a pattern, also of one before the first row. @param {number} number @param {number} period */
const placeOf = (number, period) => ((number % period) + period) % period;

/** Displacements of each row, or of all from it on, by the longest window of those in which the motion is a polynomial; null: no
 * window fits. @param {Film} film @param {boolean} onward @returns {(Displacement | null)[]} */
function bestDisplacements(film, onward) {
  /** @type {(Displacement | null)[]} */
  const best = film.t.map(() => null);
  const halves = HALF_WINDOWS.map(([rows, duration]) => Math.max(rows, rounded(duration / film.step)));
  for (const half of [...new Set(halves)].sort((a, b) => a - b)) {
    displacements(film, half, onward).forEach((here, n) => {
      if (here.misfit < MAX_MISFIT_RATIO * Math.max(best[half + n]?.misfit ?? Infinity, 1)) best[half + n] = here;
    });
  }
  return best;
}

/** Rows before which pictures are lost, and those that show the picture before. @param {Film} film */
function singleDisplacements(film) {
  const found = [true, false].flatMap((onward) => bestDisplacements(film, onward).flatMap((best, row) => {
    if (!best) return [];
    const { half, value, error, misfit, across } = best;
    const sigmas = Math.abs(value) / error;
    const isUsual = (value > COPIED[0] && value < COPIED[1]) || (onward && value > MIN_LOST);
    const isAlong = across < Math.max(MAX_ACROSS, MAX_SLOPE * sigmas);
    return isUsual && isAlong && sigmas > MIN_SIGMAS && misfit < MAX_MISFIT ? [{ row, t: film.t[row], half, value, sigmas }] : [];
  }));
  // A single row that is displaced displaces those around it a little, and the other way round: the clearest one counts
  /** @type {typeof found} */
  const chosen = [];
  for (const here of found.sort((a, b) => b.sigmas - a.sigmas)) {
    if (chosen.every(({ row }) => Math.abs(here.row - row) > here.half)) chosen.push(here);
  }
  return chosen.sort((a, b) => a.row - b.row);
}

/** All windows of so many rows, in each of which a channel is a polynomial of the time, beside which some rows lie along the velocity. */
class Curves {
  /** @param {Film} film @param {number} channel @param {number} half rows before the one for which the polynomials' variable is 0
   * @param {number} length @param {Curves[]} others of the channels before */
  constructor({ t, values, same, step }, channel, half, length, others) {
    this.half = half;
    this.length = length;
    /** Number of windows. */
    this.count = Math.max(t.length - length + 1, 0);
    /** Which rows are known. */
    this.known = Uint8Array.from(values[channel], (value) => Number(Number.isFinite(value)));
    /** Polynomials that are orthonormal over the known rows, and their derivatives: window by window, degree by degree, row by row. */
    this.basis = others[same[channel]]?.basis ?? new Float64Array(this.count * SIZE * length);
    this.slopes = others[same[channel]]?.slopes ?? new Float64Array(this.count * SIZE * length);
    if (same[channel] === channel) this.#orthonormalise(t, half * step);
    /** What no polynomial describes, the coefficients of the nearest one, and the velocity by it [1 / row]. */
    this.rest = new Float64Array(this.count * length);
    this.coefficients = new Float64Array(this.count * SIZE);
    this.velocity = new Float64Array(this.count * length);
    /** What a polynomial describes of rows that move with the velocity: its coefficients for each displacement of a window. */
    this.described = new Float64Array(this.count * (MAX_PERIOD - 1) * SIZE);
    this.#fitPolynomials(values[channel]);
  }

  /** @param {number[]} t @param {number} unit of the polynomials' variable [s] */
  #orthonormalise(t, unit) {
    const { length, known, basis, slopes } = this;
    for (let n = 0; n < this.count; n++) {
      const first = n * SIZE * length;
      for (let j = 0; j < SIZE; j++) {
        const at = first + j * length;
        for (let k = 0; k < length; k++) {
          const x = (t[n + k] - t[n + this.half]) / unit;
          basis[at + k] = known[n + k] * x ** j;
          slopes[at + k] = j ? j * x ** (j - 1) : 0;
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

  /** @param {number[]} values */
  #fitPolynomials(values) {
    const { length, known, basis, rest, coefficients } = this;
    for (let n = 0; n < this.count; n++) {
      const here = n * length;
      for (let k = 0; k < length; k++) rest[here + k] = known[n + k] ? values[n + k] : 0;
      for (let j = 0; j < SIZE; j++) {
        const at = (n * SIZE + j) * length;
        let part = 0;
        for (let k = 0; k < length; k++) part += basis[at + k] * rest[here + k];
        for (let k = 0; k < length; k++) rest[here + k] -= part * basis[at + k];
        coefficients[n * SIZE + j] = part;
      }
    }
  }

  /** Add the normal equations of displacements along the velocity, which the fit before has changed. @param {Equations} equations */
  addEquations({ places, ofFilm, size, value, normal, right }) {
    const { length, half, known, basis, slopes, rest, velocity, described } = this;
    const moved = new Float64Array(SIZE);
    for (let n = 0; n < this.count; n++) {
      const first = n * size;
      const mine = first * SIZE;
      for (let j = 0; j < SIZE; j++) {
        moved[j] = this.coefficients[n * SIZE + j];
        for (let p = 0; p < size; p++) moved[j] -= value[first + p] * described[mine + p * SIZE + j];
      }
      described.fill(0, mine, mine + size * SIZE);
      for (let k = 0; k < length; k++) {
        const place = places[ofFilm ? n + k : k];
        if (place === size || !known[n + k]) continue;
        let v = 0;
        for (let j = 1; j < SIZE; j++) v += moved[j] * slopes[(n * SIZE + j) * length + k];
        v /= half;
        velocity[n * length + k] = v;
        for (let j = 0; j < SIZE; j++) described[mine + place * SIZE + j] += v * basis[(n * SIZE + j) * length + k];
        normal[(first + place) * size + place] += v * v;
        right[first + place] += v * rest[n * length + k];
      }
      for (let p = 0; p < size; p++) {
        for (let q = 0; q < size; q++) {
          let shared = 0;
          for (let j = 0; j < SIZE; j++) shared += described[mine + p * SIZE + j] * described[mine + q * SIZE + j];
          normal[(first + p) * size + q] -= shared;
        }
      }
    }
  }

  /** Square of what the rows of place 0 of a window are displaced by otherwise than along the velocity, in residuals.
   * @param {number} n number of the window @param {Equations} equations of one displacement */
  across(n, { places, value }) {
    const { length, known, basis, rest, velocity, described } = this;
    const parts = new Array(SIZE).fill(0);
    let [left, squares] = [0, 0];
    for (let k = 0; k < length; k++) {
      if (places[k] || !known[n + k]) continue;
      left += rest[n * length + k] - value[n] * velocity[n * length + k];
      squares += 1;
      for (let j = 0; j < SIZE; j++) parts[j] += basis[(n * SIZE + j) * length + k];
    }
    for (let j = 0; j < SIZE; j++) {
      left += value[n] * parts[j] * described[n * SIZE + j];
      squares -= parts[j] * parts[j];
    }
    return (left * left) / Math.max(squares, TINY);
  }
}

/** @param {Film} film @param {number} half @param {number} length @returns {Curves[]} */
function curvesOf(film, half, length) {
  /** @type {Curves[]} */
  const curves = [];
  film.values.forEach((_, channel) => curves.push(new Curves(film, channel, half, length, curves)));
  return curves;
}

/** The equations of all windows, with the displacements and the misfit of the fit before.
 * @param {Curves[]} curves @param {number[]} places @param {boolean} ofFilm @param {number} size @returns {Equations} */
function equationsOf(curves, places, ofFilm, size) {
  const [{ count, length }] = curves;
  const [squares, freedom, misfit] = [0, 0, 1].map((start) => new Float64Array(count).fill(start));
  for (let n = 0; n < count; n++) {
    freedom[n] = -size;
    for (const { rest, known } of curves) {
      let rows = -SIZE;
      for (let k = 0; k < length; k++) {
        squares[n] += rest[n * length + k] ** 2;
        rows += known[n + k];
      }
      freedom[n] += Math.max(rows, 0);
    }
  }
  const [value, right, normal] = [count * size, count * size, count * size * size].map((all) => new Float64Array(all));
  return { places, ofFilm, size, squares, freedom, value, right, normal, misfit };
}

/** The equations by the velocities of the fit before. @param {Curves[]} curves @param {Equations} equations */
function renew(curves, equations) {
  equations.normal.fill(0);
  equations.right.fill(0);
  for (const curve of curves) curve.addEquations(equations);
}

/** Take the misfit that is left by the displacements. @param {Equations} equations */
function takeMisfit({ size, squares, freedom, value, right, normal, misfit }) {
  for (let n = 0; n < misfit.length; n++) {
    let left = squares[n];
    for (let p = n * size; p < (n + 1) * size; p++) {
      left -= 2 * value[p] * right[p];
      for (let q = 0; q < size; q++) left += value[p] * normal[p * size + q] * value[n * size + q];
    }
    misfit[n] = left / Math.max(freedom[n], 1);
  }
}

/** @param {number} value */
const clipped = (value) => Math.max(-MAX_DISPLACEMENT, Math.min(MAX_DISPLACEMENT, value));

/** Displacement of the row after so many, or of all from it on, in each window.
 * @param {Film} film @param {number} half @param {boolean} onward @returns {Displacement[]} */
function displacements(film, half, onward) {
  const places = range(0, 2 * half + (onward ? 0 : 1)).map((k) => Number(onward ? k < half : k !== half));
  const curves = curvesOf(film, half, places.length);
  const equations = equationsOf(curves, places, false, 1);
  const { value, right, normal, misfit } = equations;
  for (let refit = 0; refit < REFITS; refit++) {
    renew(curves, equations);
    for (let n = 0; n < value.length; n++) value[n] = clipped(right[n] / (Math.max(normal[n], 0) + TINY));
  }
  takeMisfit(equations);
  return Array.from(value, (here, n) => {
    const scale = Math.max(misfit[n], 1);
    const across = Math.sqrt(sumOf(curves.map((curve) => curve.across(n, equations))) / scale);
    return { half, value: here, error: Math.sqrt(scale / (Math.max(normal[n], 0) + TINY)), misfit: misfit[n], across };
  });
}

/** How long pictures in turn last by the points, by the length of the pattern; empty: there are too few rows.
 * @param {Film} film @param {number} half @returns {Pattern[]} */
function patterns(film, half) {
  if (film.t.length < Math.max(2 * half + MIN_ROWS, 4 * MAX_PERIOD)) return [];
  const curves = curvesOf(film, half, 2 * half + 1);
  const numbers = numbersOf(film, film.t);
  return range(2, MAX_PERIOD + 1).map((period) => patternOf(curves, numbers.map((number) => number % period), period));
}

/** How long pictures in turn last. @param {Curves[]} curves @param {number[]} places of the rows @param {number} period @returns {Pattern} */
function patternOf(curves, places, period) {
  // The others are displaced from the last place
  const size = period - 1;
  const equations = equationsOf(curves, places, true, size);
  const { value, right, normal, misfit } = equations;
  let covariance = [[0]];
  for (let refit = 0; refit < REFITS; refit++) {
    renew(curves, equations);
    const weight = misfit.map((one) => 1 / Math.max(one, 1));
    const total = range(0, size).map((p) => range(0, size).map((q) => {
      return weight.reduce((sum, w, n) => sum + w * normal[(n * size + p) * size + q], p === q ? TINY : 0);
    }));
    const sums = range(0, size).map((p) => weight.reduce((sum, w, n) => sum + w * right[n * size + p], 0));
    covariance = inverse(total);
    const shared = covariance.map((row) => clipped(dot(row, sums)));
    for (let i = 0; i < value.length; i++) value[i] = shared[i % size];
    takeMisfit(equations);
    // Windows overlap, so that each row counts in as many as they are long
    const scale = (curves[0].length * dot(weight, misfit)) / sumOf([...weight]);
    covariance = covariance.map((row) => row.map((one) => scale * one));
  }
  const next = (/** @type {number} */ p) => (p + 1) % period;
  const late = (/** @type {number} */ p) => (p < size ? value[p] : 0);
  const variance = (/** @type {number} */ p, /** @type {number} */ q) => covariance[p]?.[q] ?? 0;
  return {
    durations: range(0, period).map((p) => 1 + late(next(p)) - late(p)),
    error: range(0, period).map((p) => Math.sqrt(variance(p, p) + variance(next(p), next(p)) - 2 * variance(p, next(p)))),
    misfit: median(misfit),
  };
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
  if (!copies || fresh.length < MIN_ROWS) return body;
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
    for (const pattern of patterns(film, half)) {
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
    for (const { durations, error } of patterns(film, half)) {
      if (spanOf(durations) > Math.max(MIN_UNEVEN, MIN_PATTERN_SIGMAS * Math.SQRT2 * largest(error))) return durations;
    }
  }
  return null;
}
