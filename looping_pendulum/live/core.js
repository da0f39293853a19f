/** The driver and its models in WebAssembly: a twin of `reference_ode/core/host.py`, under which a run has the same bits. */

import { IMPORTED, JOB_FIELDS } from "./model.js";

/** Place of the number of doubles that a Jacobian needs in the table of a model. */
const VALUES = 4;
/** Most steps of a job: a page cannot be stopped while it computes; those of a swing of an hour are fewer. */
const MAX_STEPS = 200_000;
/** Numbers that fit where one function of a model reads and writes. */
const SCRATCH = 512;

/** @typedef {{functions: string, count: number}} Functions a module in base64, and how many functions it has */
/** @typedef {{first: number, address: number}} LoadedModel place of its first function; address of `Model` in driver.c */
/**
 * Functions of the driver.
 * @typedef {{memory: WebAssembly.Memory, __indirect_function_table: WebAssembly.Table, _initialize(): void,
 *   room(bytes: number): number, release_room(address: number): void, begin(job: number): void, advance(steps: number): number,
 *   [name: string]: any}} Driver
 */

/** @param {string} base64 */
const bytesOf = (base64) => Uint8Array.from(atob(base64), (character) => character.charCodeAt(0));

/** An instance of the driver, with all models that were loaded. */
export class Core {
  /** @param {string} driver the compiled driver in base64
   * @throws {Error} if WebAssembly is not there or not allowed */
  static async start(driver) {
    const { instance } = await WebAssembly.instantiate(bytesOf(driver));
    return new Core(/** @type {Driver} */ (/** @type {unknown} */ (instance.exports)));
  }

  /** @param {Driver} driver */
  constructor(driver) {
    this.driver = driver;
    this.table = driver.__indirect_function_table;
    driver._initialize();
    this.scratch = this.room(8 * SCRATCH);
  }

  /** Put functions into the table of functions; return the place of the first. @param {Functions} given */
  async place({ functions, count }) {
    const { memory } = this.driver;
    const first = this.table.grow(count);
    const imported = Object.fromEntries(IMPORTED.map((name) => [name, this.driver[`w_${name}`]]));
    await WebAssembly.instantiate(bytesOf(functions), { m: { ...imported, memory, table: this.table, first } });
    return first;
  }

  /** @param {Functions & {table: number[]}} model @returns {Promise<LoadedModel>} */
  async load(model) {
    const first = await this.place(model);
    const { table } = model;
    return { first, address: this.put(Int32Array, [first, this.put(Int32Array, table), this.room(8 * table[VALUES])]) };
  }

  /** Address of so many bytes. @param {number} bytes */
  room(bytes) {
    const address = bytes < 2 ** 32 ? this.driver.room(bytes) >>> 0 : 0; // a larger number would wrap around
    if (!address) throw new Error("memory: found too little for a run, needed more; close other pages");
    return address;
  }

  /** Address of numbers in memory. @param {Int32ArrayConstructor | Float64ArrayConstructor} Kind @param {ArrayLike<number>} values */
  put(Kind, values) {
    const address = this.room(Kind.BYTES_PER_ELEMENT * values.length);
    new Kind(this.driver.memory.buffer, address, values.length).set(values);
    return address;
  }

  /** Numbers in memory, until it grows. @param {number} address @param {number} count */
  doubles(address, count) {
    return new Float64Array(this.driver.memory.buffer, address, count);
  }

  /** Whole numbers in memory, until it grows. @param {number} address @param {number} count */
  integers(address, count) {
    return new Int32Array(this.driver.memory.buffer, address, count);
  }

  /** What a function writes, until the next call. @param {number} place @param {number} t @param {ArrayLike<number>} state
   * @param {ArrayLike<number>} signs @param {ArrayLike<number>} parameters @param {number} count of numbers that it writes */
  evaluate(place, t, state, signs, parameters, count) {
    const { scratch } = this;
    const memory = this.doubles(scratch, SCRATCH);
    const s = state.length, p = s + signs.length, out = p + parameters.length;
    memory.set(state);
    memory.set(signs, s);
    memory.set(parameters, p);
    this.table.get(place)(t, scratch, scratch + 8 * s, scratch + 8 * p, scratch + 8 * out);
    return memory.subarray(out, out + count);
  }

  /** Carry out a job. @param {number} rtol relative tolerance of a step @param {Record<string, number>} fields those of `JOB_FIELDS`
   *   that are not 0 @throws {Error} if it takes too many steps */
  carryOut(rtol, fields) {
    const job = this.put(Float64Array, [rtol, ...JOB_FIELDS.map(() => 0)]);
    new Int32Array(this.driver.memory.buffer, job + 8, JOB_FIELDS.length).set(JOB_FIELDS.map((name) => fields[name] ?? 0));
    this.driver.begin(job);
    if (!this.driver.advance(MAX_STEPS)) throw new Error(`duration: found more than ${MAX_STEPS} steps, needed a shorter run`);
  }

  /** What `work` returns; then all room that it took is free again. @template Result @param {() => Result} work */
  withRoom(work) {
    const mark = this.driver.room(0);
    try {
      return work();
    } finally {
      this.driver.release_room(mark);
    }
  }
}
