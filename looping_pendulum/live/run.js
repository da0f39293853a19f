/** A run of the looping pendulum from its release to its end: the model of `reference_ode`, integrated in the browser. */

import { firstEvent } from "./events.js";
import { Integrator } from "./integrator.js";
import {
  DEFAULTS,
  DEMANDED_ANGLES,
  DURATION,
  ENDED,
  FIRST_STEP,
  LIGHT_REACHES_ROD,
  MAX_EVENTS,
  MAX_STEPS,
  MODES,
  MODE_NAMES,
  PHASE_EVENTS,
  RELEASES,
  REQUIRED,
  REST_SERIES_DURATION,
  STICKING,
  STOP,
  TIME_UP,
  TOLERANCE,
  faultOf,
  withDerived,
} from "./model.js";

/** @typedef {import("./model.js").Motion} Motion */
/** @typedef {import("./model.js").Numbers} Numbers */
/** @typedef {import("./integrator.js").DenseStep} DenseStep */

/**
 * A run between two events: the steps' dense output, or the series by which it leaves rest.
 * @typedef {{mode: number, signs: import("./model.js").Signs, start: number, end: number, steps: DenseStep[],
 *   series: number[][] | null}} Segment
 */
/** @typedef {{time: number, event: string | null, modeBefore: string, modeAfter: string}} RunEvent */

/**
 * Return the run of an apparatus.
 * @param {Record<string, any>} settings values by the names of `Parameters` and of its coefficients, SI and radians; `release`:
 *   "looping" (the default), "vertical", "held" or "drop"
 * @param {{duration?: number, tolerance?: number}} [options] limit on the simulated time [s]; relative tolerance of a step
 * @throws {RangeError} if a setting is missing, unknown or impossible
 * @throws {Error} if the integration breaks down
 */
export function simulate(settings, { duration = DURATION, tolerance = TOLERANCE } = {}) {
  const { release, p } = complete(settings);
  if (!(duration > 0)) throw new RangeError(`duration: found ${duration}, needed a number above 0`);
  const { released, after, bySeries, series } = RELEASES[release](p);
  /** @type {RunEvent[]} */
  const events = [{ time: 0, event: null, modeBefore: MODE_NAMES[released.mode], modeAfter: MODE_NAMES[released.mode] }];
  /** @type {Segment[]} */
  const segments = [];
  let motion = after;
  if (bySeries) {
    segments.push({ mode: motion.mode, signs: motion.signs, start: 0, end: REST_SERIES_DURATION, steps: [], series });
  }
  while (motion.mode !== ENDED) {
    if (events.length > MAX_EVENTS) throw new Error(`more than ${MAX_EVENTS} events at t = ${motion.t} s`);
    const before = motion.mode;
    const { event, segment } = advance(p, motion, duration, tolerance);
    segments.push(segment);
    motion = MODES[before].apply[event](p, segment.end, stateAt(segment, segment.end), motion.signs);
    events.push({ time: segment.end, event, modeBefore: MODE_NAMES[before], modeAfter: MODE_NAMES[motion.mode] });
  }
  return new Run(p, events, segments);
}

/**
 * Return the settings with all that they leave open.
 * @param {Record<string, any>} settings
 * @returns {{release: string, p: Numbers}}
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
  const whole = withDerived(p);
  const fault = faultOf(whole);
  if (fault) throw new RangeError(fault);
  return { release, p: whole };
}

/**
 * Integrate a mode until one of its events, or to the limit on the time.
 * @param {Numbers} p
 * @param {Motion} motion
 * @param {number} duration
 * @param {number} tolerance
 * @returns {{event: string, segment: Segment}}
 */
function advance(p, { mode, t, y, signs }, duration, tolerance) {
  const equations = MODES[mode];
  const { rates, eventValues, integrated, events } = equations;
  const integrator = new Integrator(
    (now, z, out) => rates(p, now, z, signs, out),
    t,
    integrated.map((place) => y[place]),
    { tolerance, firstStep: FIRST_STEP },
  );
  const z = new Float64Array(integrated.length);
  /** @type {Segment} */
  const segment = { mode, signs, start: t, end: t, steps: [], series: null };
  while (segment.steps.length < MAX_STEPS) {
    const dense = integrator.step();
    const found = firstEvent(
      events.length,
      (x, out) => eventValues(p, dense.start + x * dense.size, dense.at(x, z), signs, out),
      segment.steps.length > 0,
    );
    segment.steps.push(dense);
    segment.end = found ? dense.start + found.fraction * dense.size : integrator.t;
    // The last step may go beyond the limit
    if (segment.end >= duration) {
      segment.end = duration;
      return { event: TIME_UP, segment };
    }
    if (found) return { event: events[found.place][signs.phase], segment };
  }
  throw new Error(`${MODE_NAMES[mode]}: no event within ${MAX_STEPS} steps`);
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

/**
 * Return the whole state of a segment at t [s].
 * @param {Segment} segment
 * @param {number} t
 */
function stateAt({ mode, steps, series }, t) {
  if (series) {
    const x = t / REST_SERIES_DURATION;
    return series[0].map((constant, i) => constant + x * (series[1][i] + x * series[2][i]));
  }
  const step = steps[lastStarted(steps.length, (i) => steps[i].start, t)];
  const z = step.at((t - step.start) / step.size, new Float64Array(step.z.length));
  return MODES[mode].fullState(z);
}

/** A run from release to end. */
export class Run {
  /**
   * @param {Numbers} p
   * @param {RunEvent[]} events
   * @param {Segment[]} segments
   */
  constructor(p, events, segments) {
    this.settings = p;
    /** All events in order, the release (`event` null) first and the end last. */
    this.events = events;
    this.segments = segments;
    const { kineticEnergy, potentialEnergy } = this.quantities(0);
    this.energyAtRelease = kineticEnergy + potentialEnergy;
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
   * Return what is to be seen at t [s], from 0 to the end (`(i / n) * endTime` never passes it): positions and velocities (x to
   * the right, y up, from the rod's centre) [m, m/s], angle [rad], lengths [m], tensions [N], energies [J] (`lost`: since the
   * release, negative where wind or a side force gave more), the force of the air on the light mass [N], and of a taut string
   * that no clamp holds |ln(T2/T1)|, which the rod's friction keeps up (`needed`), beside the most that it can hold (`bound`);
   * else `holding` is null.
   * @param {number} t
   */
  sample(t) {
    if (!(t >= 0 && t <= this.endTime)) throw new RangeError(`t: found ${t}, needed from 0 to ${this.endTime} s`);
    const { mode, kineticEnergy, potentialEnergy, ...seen } = this.quantities(t);
    return {
      mode,
      ...seen,
      energies: {
        kinetic: kineticEnergy,
        potential: potentialEnergy,
        lost: this.energyAtRelease - kineticEnergy - potentialEnergy,
      },
    };
  }

  /** @param {number} t */
  quantities(t) {
    const segment = this.segments[lastStarted(this.segments.length, (i) => this.segments[i].start, t)];
    const { mode, signs } = segment;
    return { mode: MODE_NAMES[mode], ...MODES[mode].quantities(this.settings, t, stateAt(segment, t), signs) };
  }
}
