/** A run of the looping pendulum from its release to its end: the model of `reference_ode`, carried out in the browser. */

import { Core } from "./core.js";
import {
  DEFAULTS,
  DEMANDED_ANGLES,
  DRIVER,
  DURATION,
  EVENTS,
  EVENT_COLUMNS,
  FAILURES,
  HOLDING_MODES,
  LEAST_TOLERANCE,
  LIGHT_REACHES_ROD,
  MODELS,
  MODE_NAMES,
  PHASE_EVENTS,
  RELEASES,
  REQUIRED,
  REQUIREMENTS,
  SIGNS_SIZE,
  STATE_SIZE,
  STEP_COLUMNS,
  STICKING,
  STOP,
  TOLERANCE,
} from "./model.js";

/** @typedef {{time: number, event: string | null, modeBefore: string, modeAfter: string}} RunEvent */
/** @typedef {{release: string, p: Record<string, number>}} Settings with all that was left open */

/** Code of the row of the release; all others are places in `EVENTS`. */
const RELEASED = -1;
/** Numbers of a step's row before its polynomial, and terms of that. */
const [STEP_HEAD, TERMS] = [3, 8];
/** Rows for which there is room at first. */
const [EVENT_ROOM, STEP_ROOM] = [128, 1024];
/** Numbers that `quantities` of models.py gives. */
const QUANTITIES = 21;

/** @typedef {{core: Core, models: import("./core.js").LoadedModel[], requirements: number}} Machine */
/** @type {Machine | null} */
let machine = null;

/** Resolves when `simulate` can be called; rejected where the browser does not allow WebAssembly. */
export const ready = start();

async function start() {
  const core = await Core.start(DRIVER);
  machine = { core, models: await Promise.all(MODELS.map((model) => core.load(model))), requirements: await core.place(REQUIREMENTS) };
}

/** @returns {Machine} */
function running() {
  if (!machine) throw new Error("simulate: found WebAssembly not yet started, needed to wait for `ready`");
  return machine;
}

/**
 * Return the run of an apparatus; to be called when `ready` has resolved.
 * @param {Record<string, any>} settings values by the names of `Parameters` and of its coefficients, SI and radians; `release`:
 *   "looping" (the default), "vertical", "held" or "drop"
 * @param {{duration?: number, tolerance?: number}} [options] limit on the simulated time [s]; relative tolerance of a step
 * @throws {RangeError} if a setting is missing, unknown or impossible
 * @throws {Error} if the integration breaks down
 */
export function simulate(settings, { duration = DURATION, tolerance = TOLERANCE } = {}) {
  const given = complete(settings);
  if (!(duration > 0)) throw new RangeError(`duration: found ${duration}, needed a number above 0`);
  return new Run(given, carriedOut(given, duration, Math.max(tolerance, LEAST_TOLERANCE), EVENT_ROOM, STEP_ROOM));
}

/**
 * Return the settings with all that they leave open.
 * @param {Record<string, any>} settings
 * @returns {Settings}
 */
function complete(settings) {
  const { release = "looping", ...given } = settings;
  if (!Object.hasOwn(RELEASES, release)) {
    throw new RangeError(`release: found ${release}, needed one of ${Object.keys(RELEASES).join(", ")}`);
  }
  for (const [name, value] of Object.entries(given)) {
    if (!REQUIRED.includes(name) && !Object.hasOwn(DEFAULTS, name)) throw new RangeError(`${name}: no such setting`);
    if (typeof value !== "number") throw new RangeError(`${name}: found ${value}, needed a number`);
  }
  /** @type {Record<string, number>} */
  const p = { ...DEFAULTS, ...given };
  if (release in DEMANDED_ANGLES) p.release_angle = DEMANDED_ANGLES[release];
  if (!("static_friction" in given)) p.static_friction = p.kinetic_friction;
  for (const name of REQUIRED) {
    if (!(name in p)) throw new RangeError(`${name}: not given`);
  }
  const fault = faultOf(p);
  if (fault) throw new RangeError(fault);
  return { release, p };
}

/** What is impossible in an apparatus; "" if nothing is. @param {Record<string, number>} p */
function faultOf(p) {
  const { core, requirements } = running();
  const { names, messages, outputs } = REQUIREMENTS;
  const values = core.evaluate(requirements, 0, [], [], names.map((name) => p[name]), outputs);
  const shown = values.slice(messages.length);
  const fault = messages.find((_, i) => !values[i]) ?? "";
  return fault.replace(/\{(\d+)\}/g, (_, place) => String(Number(shown[place].toPrecision(6))));
}

/**
 * Have the driver carry out a run; return its rows of events and of steps, end to end.
 * @param {Settings} settings @param {number} duration @param {number} tolerance
 * @param {number} max_events rows for which there is room @param {number} max_dense
 * @returns {{events: Float64Array, steps: Float64Array}}
 */
function carriedOut({ release, p }, duration, tolerance, max_events, max_dense) {
  const { core, models } = running();
  const place = RELEASES[release];
  const [failure, events, dense, rows] = core.withRoom(() => {
    const status = core.put(Int32Array, [0, 0, 0, 0]);
    const [eventRows, denseRows] = [core.room(8 * EVENT_COLUMNS * max_events), core.room(8 * STEP_COLUMNS * max_dense)];
    core.carryOut(tolerance, {
      model: models[place].address,
      runs: 1,
      p: core.put(Float64Array, MODELS[place].names.map((name) => p[name])),
      durations: core.put(Float64Array, [duration]),
      starts: core.put(Int32Array, [0, 0]),
      status,
      events: eventRows,
      max_events,
      dense: denseRows,
      max_dense,
    });
    const [failed, eventCount, , stepCount] = core.integers(status, 4);
    const copied = {
      events: core.doubles(eventRows, EVENT_COLUMNS * Math.min(eventCount, max_events)).slice(),
      steps: core.doubles(denseRows, STEP_COLUMNS * Math.min(stepCount, max_dense)).slice(),
    };
    return [failed, eventCount, stepCount, copied];
  });
  if (failure) throw new Error(`${FAILURES[failure]}, after t = ${rows.events[rows.events.length - EVENT_COLUMNS + 2]} s`);
  if (events > max_events || dense > max_dense) return carriedOut({ release, p }, duration, tolerance, events, dense);
  return rows;
}

/**
 * Return the place of the last of the ascending numbers `starts` that is at most t.
 * @param {number} count
 * @param {(i: number) => number} start
 * @param {number} t
 */
function lastStarted(count, start, t) {
  let [low, high] = [0, count];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (start(middle) <= t) low = middle;
    else high = middle;
  }
  return low;
}

/** A run from release to end. */
export class Run {
  /**
   * @param {Settings} settings
   * @param {{events: Float64Array, steps: Float64Array}} rows
   */
  constructor({ release, p }, { events, steps }) {
    this.model = RELEASES[release];
    this.p = MODELS[this.model].names.map((name) => p[name]);
    this.steps = steps;
    // One array for all samples: to make one takes longer than all else of a sample
    this.state = new Float64Array(STATE_SIZE);
    const rows = Array.from({ length: events.length / EVENT_COLUMNS }, (_, i) => events.subarray(i * EVENT_COLUMNS, (i + 1) * EVENT_COLUMNS));
    this.signs = rows.map((row) => row.slice(-SIGNS_SIZE));
    /** All events in order, the release (`event` null) first and the end last. @type {RunEvent[]} */
    this.events = rows.map(([code, mode, time], i) => ({
      time,
      event: code === RELEASED ? null : EVENTS[code],
      modeBefore: MODE_NAMES[rows[Math.max(i - 1, 0)][1]],
      modeAfter: MODE_NAMES[mode],
    }));
    /** [J] @type {number} */
    this.energyAtRelease = 0;
    const { kinetic, potential } = this.sample(0).energies;
    this.energyAtRelease = kinetic + potential;
  }

  /** Time at which the run ended [s]. */
  get endTime() {
    return this.events[this.events.length - 1].time;
  }

  /** Times at which the heavy mass's speed becomes zero [s]. */
  get stops() {
    return this.events.filter(({ event }) => event === STOP).map(({ time }) => time);
  }

  /** Start of the sticking that lasts until the light mass reaches the rod [s]; null without one. */
  get haltingTime() {
    const changes = this.events.filter(({ event }) => event === null || !PHASE_EVENTS.has(event));
    const [last, end] = changes.slice(-2);
    return end.event === LIGHT_REACHES_ROD && end.modeBefore === MODE_NAMES[STICKING] ? last.time : null;
  }

  /**
   * Return what is to be seen at t [s], from 0 to the end (`(i / n) * endTime` never passes it): positions, velocities and
   * accelerations (x to the right, y up, from the rod's centre) [m, m/s, m/s^2], angle [rad], lengths [m], tensions [N], energies [J] (`lost`: since the
   * release, negative where wind or a side force gave more), the force of the air on the light mass [N], and of a taut string
   * that no clamp holds |ln(T2/T1)|, which the rod's friction keeps up (`needed`), beside the most that it can hold (`bound`);
   * else `holding` is null.
   * @param {number} t
   */
  sample(t) {
    if (!(t >= 0 && t <= this.endTime)) throw new RangeError(`t: found ${t}, needed from 0 to ${this.endTime} s`);
    const { core, models } = running();
    const { steps, events, model } = this;
    const step = STEP_COLUMNS * lastStarted(steps.length / STEP_COLUMNS, (i) => steps[i * STEP_COLUMNS], t);
    const mode = steps[step + 2];
    const event = lastStarted(events.length, (i) => events[i].time, steps[step]);
    const place = models[model].first + MODELS[model].quantities[mode];
    // In the order in which models.py gives them
    const q = core.evaluate(place, t, this.stateAt(step, t), this.signs[event], this.p, QUANTITIES);
    return {
      mode: MODE_NAMES[mode],
      light: [q[0], q[1]],
      heavy: [q[2], q[3]],
      lightVelocity: [q[4], q[5]],
      heavyVelocity: [0, q[6]],
      lightAcceleration: [q[18], q[19]],
      heavyAcceleration: [0, q[20]],
      wrapAngle: q[7],
      freeLength: q[8],
      slack: q[9],
      lightTension: q[10],
      heavyTension: q[11],
      energies: { kinetic: q[12], potential: q[13], lost: this.energyAtRelease - q[12] - q[13] },
      dragForce: [q[14], q[15]],
      holding: HOLDING_MODES.includes(mode) ? { needed: q[16], bound: q[17] } : null,
    };
  }

  /** Whole state at t [s] in the step whose row begins at the place `step`. @param {number} step @param {number} t */
  stateAt(step, t) {
    const { steps, state } = this;
    const x = (t - steps[step]) / steps[step + 1];
    const first = step + STEP_HEAD;
    // The polynomial of DOP853: z + x (d1 + (1 - x) (d2 + x (d3 + (1 - x) (d4 + ...))))
    state.fill(0);
    for (let term = TERMS - 1; term >= 0; term--) {
      const factor = term % 2 ? 1 - x : x;
      for (let i = 0; i < STATE_SIZE; i++) state[i] = steps[first + term * STATE_SIZE + i] + factor * state[i];
    }
    return state;
  }
}
