/** The Runge-Kutta method DOP853 with step control and dense output, as in SciPy, whose coefficients `model.js` has. */

import { DOP853 } from "./model.js";

const STAGES = DOP853.B.length;
const ALL_STAGES = DOP853.C.length;
const TERMS = 3 + DOP853.D.length;
const SAFETY = 0.9;
const MIN_FACTOR = 0.2;
const MAX_FACTOR = 10;
const ERROR_EXPONENT = -1 / 8;

/** @typedef {(t: number, z: Float64Array, out: Float64Array) => void} Rates */

/**
 * Return the coefficients of a row that are not zero, with their places.
 * @param {number[]} row
 */
function sparse(row) {
  const places = row.flatMap((value, i) => (value === 0 ? [] : [i]));
  return { places: Int32Array.from(places), values: Float64Array.from(places, (i) => row[i]) };
}

const ROWS = DOP853.A.map(sparse);
const LAST = sparse(DOP853.B);
const ERROR_5 = sparse(DOP853.E5);
const ERROR_3 = sparse(DOP853.E3);
const DENSE = DOP853.D.map(sparse);

/** One step's dense output: z at t = start + x size, 0 <= x <= 1. */
export class DenseStep {
  /**
   * @param {number} start
   * @param {number} size
   * @param {Float64Array} z values at the start
   * @param {Float64Array} terms first that of each value, then the second of each, ...
   */
  constructor(start, size, z, terms) {
    this.start = start;
    this.size = size;
    this.z = z;
    this.terms = terms;
  }

  /**
   * Write the values at the fraction x of the step into `out`.
   * @param {number} x
   * @param {Float64Array} out
   */
  at(x, out) {
    const f = this.terms;
    const n = out.length;
    const rest = 1 - x;
    for (let i = 0; i < n; i++) {
      const inner = f[i + 3 * n] + x * (f[i + 4 * n] + rest * (f[i + 5 * n] + x * f[i + 6 * n]));
      out[i] = this.z[i] + x * (f[i] + rest * (f[i + n] + x * (f[i + 2 * n] + rest * inner)));
    }
    return out;
  }
}

/** Steps through the differential equations z' = rates(t, z). */
export class Integrator {
  /**
   * @param {Rates} rates
   * @param {number} t
   * @param {ArrayLike<number>} z
   * @param {{tolerance: number, firstStep: number}} options relative tolerance of a step; first step [s]
   */
  constructor(rates, t, z, { tolerance, firstStep }) {
    this.rates = rates;
    this.relative = tolerance;
    this.absolute = 0.1 * tolerance; // values near 0 count as 0.1 m, rad or m/s
    this.t = t;
    this.z = Float64Array.from(z);
    this.next = firstStep;
    const n = z.length;
    /** Slopes of the stages; that of stage `STAGES` is the slope at the end of the step. */
    this.slopes = Array.from({ length: ALL_STAGES }, () => new Float64Array(n));
    this.scratch = new Float64Array(n);
    this.end = new Float64Array(n);
    rates(t, this.z, this.slopes[0]);
  }

  /**
   * Advance by one step whose error is within the tolerance; return its dense output.
   * @returns {DenseStep}
   */
  step() {
    const smallest = 10 * Number.EPSILON * Math.max(Math.abs(this.t), Number.MIN_VALUE);
    let size = Math.max(this.next, smallest);
    let rejected = false;
    for (;;) {
      if (!(size >= smallest)) throw new Error("the steps of the integration became too small");
      this.attempt(size);
      const error = this.error(size);
      if (error < 1) {
        const factor = error === 0 ? MAX_FACTOR : Math.min(MAX_FACTOR, SAFETY * error ** ERROR_EXPONENT);
        this.next = size * (rejected ? Math.min(1, factor) : factor);
        return this.accept(size);
      }
      rejected = true;
      size *= Math.max(MIN_FACTOR, SAFETY * error ** ERROR_EXPONENT);
    }
  }

  /**
   * Compute the stages and the end of a step, and the slope there.
   * @param {number} size
   */
  attempt(size) {
    for (let stage = 1; stage < STAGES; stage++) {
      this.stage(stage, ROWS[stage], size);
    }
    this.combine(LAST, this.z, size, this.end);
    this.rates(this.t + size, this.end, this.slopes[STAGES]);
  }

  /**
   * @param {number} stage
   * @param {{places: Int32Array, values: Float64Array}} row
   * @param {number} size
   */
  stage(stage, row, size) {
    this.combine(row, this.z, size, this.scratch);
    this.rates(this.t + DOP853.C[stage] * size, this.scratch, this.slopes[stage]);
  }

  /**
   * Write z + size times the weighted sum of the slopes into `out`.
   * @param {{places: Int32Array, values: Float64Array}} row
   * @param {Float64Array} z
   * @param {number} size
   * @param {Float64Array} out
   */
  combine({ places, values }, z, size, out) {
    for (let i = 0; i < out.length; i++) {
      let sum = 0;
      for (let j = 0; j < places.length; j++) sum += values[j] * this.slopes[places[j]][i];
      out[i] = z[i] + size * sum;
    }
  }

  /**
   * Return the estimated error of the attempted step in units of the tolerance.
   * @param {number} size
   */
  error(size) {
    const n = this.z.length;
    let fifth = 0;
    let third = 0;
    for (let i = 0; i < n; i++) {
      const scale = this.absolute + Math.max(Math.abs(this.z[i]), Math.abs(this.end[i])) * this.relative;
      fifth += (this.weighted(ERROR_5, i) / scale) ** 2;
      third += (this.weighted(ERROR_3, i) / scale) ** 2;
    }
    if (fifth === 0 && third === 0) return 0;
    return (size * fifth) / Math.sqrt((fifth + 0.01 * third) * n);
  }

  /**
   * @param {{places: Int32Array, values: Float64Array}} row
   * @param {number} i
   */
  weighted({ places, values }, i) {
    let sum = 0;
    for (let j = 0; j < places.length; j++) sum += values[j] * this.slopes[places[j]][i];
    return sum;
  }

  /**
   * Make the attempted step the last one; return its dense output.
   * @param {number} size
   */
  accept(size) {
    for (let stage = STAGES + 1; stage < ALL_STAGES; stage++) this.stage(stage, ROWS[stage], size);
    const n = this.z.length;
    const terms = new Float64Array(TERMS * n);
    const [first, last] = [this.slopes[0], this.slopes[STAGES]];
    for (let i = 0; i < n; i++) {
      const change = this.end[i] - this.z[i];
      terms[i] = change;
      terms[i + n] = size * first[i] - change;
      terms[i + 2 * n] = 2 * change - size * (last[i] + first[i]);
      for (let k = 0; k < DENSE.length; k++) terms[i + (3 + k) * n] = size * this.weighted(DENSE[k], i);
    }
    const dense = new DenseStep(this.t, size, this.z, terms);
    this.t += size;
    this.z = this.end.slice();
    this.slopes[0].set(last);
    return dense;
  }
}
