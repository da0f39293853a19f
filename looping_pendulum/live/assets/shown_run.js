/** A run of the model as the page draws it: sampled once, with its events in words. */

import { END_EVENTS, PHASE_EVENTS } from "../model.js";
import { simulate } from "../run.js";

/** Relative tolerance of a step of a run that is only drawn: errors far below a micrometre. */
const DRAWN_TOLERANCE = 1e-9;
const TIME_BETWEEN_SAMPLES = 2.5e-3;
const [MIN_SAMPLES, MAX_SAMPLES] = [300, 1200];
/** Longest time that is watched [s]: masses without a string are soon out of sight. */
const DURATIONS = { looping: 5, vertical: 5, held: 5, drop: 0.6 };
/** Share of the samples that are not a short spike. */
const SHARE_WITHOUT_SPIKES = 0.99;

/** @typedef {{kind: string, time: number}} ShownEvent `kind`: of the texts `event.` which */
/** @typedef {{from: number, until: number | null, drop: number, turns: number}} Rest when the rod holds the string [s] (until null: to
 * the end of the run), how far the heavy mass is then below its start [m], and the turns on the rod as it catches the string */
/** @typedef {ReturnType<ShownRun["at"]>} Sample */
/**
 * What is drawn and said of a run, whether it is computed here or stored.
 * @typedef {Pick<ShownRun, "settings" | "release" | "end" | "endOfRun" | "halt" | "rests" | "samples" | "events" | "ending" |
 *   "dropAtHalt" | "at" | "range">} DrawnRun
 */

/** @param {string} release */
export function durationOf(release) {
  return DURATIONS[/** @type {keyof typeof DURATIONS} */ (release)];
}

/** A function of a run that is computed once for each. @template Value @param {(run: DrawnRun) => Value} compute */
export function oncePerRun(compute) {
  /** @type {WeakMap<DrawnRun, Value>} */
  const known = new WeakMap();
  return (/** @type {DrawnRun} */ run) => {
    if (!known.has(run)) known.set(run, compute(run));
    return /** @type {Value} */ (known.get(run));
  };
}

/** When the rod holds the string. @param {ShownEvent[]} events all of a run @param {string} modeAtStart
 * @param {(time: number) => {drop: number, turns: number}} placeAt */
export function restsOf(events, modeAtStart, placeAt) {
  /** @type {Rest[]} */
  const rests = [];
  const begin = (/** @type {number} */ time) => rests.push({ from: time, until: null, ...placeAt(time) });
  if (modeAtStart === "sticking") begin(0);
  for (const { kind, time } of events) {
    const last = rests[rests.length - 1];
    const isHeld = last !== undefined && last.until === null;
    if ((kind === "sticks" || kind === "halts") && !isHeld) begin(time);
    if ((kind === "slips" || kind === "slack") && isHeld) last.until = time;
  }
  return rests;
}

/** The exact run of settings, sampled for drawing. */
export class ShownRun {
  /** @param {Record<string, any>} settings @param {number} shown limit on the time that is shown [s]
   * @throws {RangeError} if the apparatus is impossible */
  constructor(settings, shown = durationOf(settings.release)) {
    this.settings = settings;
    this.release = settings.release;
    // Whether it halts shows only at its end, which may come after what is shown
    const duration = Math.max(durationOf(settings.release), shown);
    this.run = simulate(settings, { duration, tolerance: DRAWN_TOLERANCE });
    this.endOfRun = this.run.endTime;
    this.end = Math.min(this.endOfRun, shown);
    this.halt = this.run.haltingTime;
    this.startHeight = this.run.sample(0).heavy[1];
    const count = Math.round(Math.min(MAX_SAMPLES, Math.max(MIN_SAMPLES, this.end / TIME_BETWEEN_SAMPLES)));
    this.samples = Array.from({ length: count + 1 }, (_, i) => this.at((i / count) * this.end));
    const events = this.eventsInWords();
    /** Last event of the run. */
    this.ending = events[events.length - 1].kind;
    this.events = events.filter(({ time }) => time <= this.end);
    this.rests = restsOf(events, this.run.sample(0).mode, (time) => this.placeAt(time));
    this.dropAtHalt = this.halt === null ? null : this.placeAt(this.halt).drop;
  }

  /** How far the heavy mass is below its start [m], and the turns on the rod; also after what is shown. @param {number} t */
  placeAt(t) {
    const { heavy, wrapAngle } = this.run.sample(t);
    return { drop: this.startHeight - heavy[1], turns: wrapAngle / (2 * Math.PI) };
  }

  /** What is to be seen at t [s]; after the end, the end. @param {number} t */
  at(t) {
    const sample = this.run.sample(Math.min(Math.max(t, 0), this.end));
    return { t: Math.min(t, this.end), drop: this.startHeight - sample.heavy[1], turns: sample.wrapAngle / (2 * Math.PI), ...sample };
  }

  /** @returns {ShownEvent[]} */
  eventsInWords() {
    /** @type {ShownEvent[]} */
    const shown = [];
    for (const { time, event, modeAfter } of this.run.events) {
      if (event === null || PHASE_EVENTS.has(event)) continue;
      if (event.startsWith("slip_onset")) shown.push({ kind: "slips", time });
      else if (event === "stop") {
        shown.push({ kind: modeAfter !== "sticking" ? "stops" : time === this.halt ? "halts" : "sticks", time });
      } else if (event === "taut" && modeAfter === "sticking") {
        shown.push({ kind: time === this.halt ? "halts" : "sticks", time });
      } else if (event === "slack" || event === "taut" || END_EVENTS.has(event)) {
        shown.push({ kind: event, time });
      }
    }
    return shown;
  }

  /**
   * Smallest and largest value of a quantity, without the short spike of a light mass that comes to the rod.
   * @param {(s: Sample) => number} value
   * @returns {[number, number]}
   */
  range(value) {
    const values = this.samples.map(value).sort((a, b) => a - b);
    return [values[0], values[Math.floor(SHARE_WITHOUT_SPIKES * (values.length - 1))]];
  }
}
