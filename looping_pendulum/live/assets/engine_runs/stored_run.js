/** The reference's stored run in place of a live one, for a scenario with effects that the page's model does not have. */

import { END_EVENTS } from "../../model.js";
import { restsOf } from "../shown_run.js";
import { modeAt, placeOf } from "./motion.js";

/** @import { RunsData } from "./motion.js" */
/** @import { Sample, ShownEvent } from "../shown_run.js" */

/** Kind of a moment -> the event that the page names, where both have a name for it. @type {Record<string, string>} */
const NAMES = { stop: "stops", stick: "sticks", slip: "slips", slack: "slack", taut: "taut", halt: "halts", rod: "light_reaches_rod" };

/** Has what a `ShownRun` has, as far as a stored run knows it: no energies, and no force of the air. */
export class StoredRun {
  /** @param {RunsData} data @param {Record<string, any>} settings */
  constructor(data, settings) {
    this.data = data;
    this.settings = settings;
    this.release = data.release;
    const { events, end, count } = data.runs[0];
    this.end = this.endOfRun = Math.min(end ?? data.duration, data.duration);
    this.halt = events.find(({ kind }) => kind === "halt")?.t ?? null;
    this.samples = Array.from({ length: count }, (_, i) => this.at(i / data.rate));
    /** @type {ShownEvent[]} */
    this.events = events.flatMap(({ kind, name, t }) => {
      const known = NAMES[kind] ?? (name !== undefined && END_EVENTS.has(name) ? name : null);
      return known === null ? [] : [{ kind: known, time: t }];
    });
    const last = this.events[this.events.length - 1]?.kind;
    this.ending = ["light_reaches_rod", "heavy_reaches_rod", "unwrapped"].includes(last) ? last : "time_up";
    this.rests = restsOf(this.events, modeAt(data, 0), (time) => {
      const { drop, turns } = this.at(time);
      return { drop, turns };
    });
    this.dropAtHalt = this.halt === null ? null : this.at(this.halt).drop;
  }

  /** What is to be seen at t [s]; after the end, the end. @param {number} t @returns {Sample} */
  at(t) {
    const place = placeOf(this.data, this.data.runs[0], Math.min(t, this.end));
    const known = {
      t: Math.min(Math.max(t, 0), this.end),
      drop: place?.drop,
      turns: place?.turns ?? 0,
      mode: modeAt(this.data, t),
      light: [place?.x ?? NaN, place?.y ?? NaN],
      heavy: [place?.heavyX, place?.heavyY],
      wrapAngle: place?.angle ?? 0,
      freeLength: place?.length ?? 0,
      lightTension: place?.lightTension ?? NaN,
      heavyTension: place?.heavyTension ?? NaN,
      energies: { kinetic: NaN, potential: NaN, lost: NaN },
      dragForce: [NaN, NaN],
      holding: null,
    };
    return /** @type {Sample} */ (/** @type {unknown} */ (known));
  }

  /** Smallest and largest value of a quantity. @param {(s: Sample) => number} value @returns {[number, number]} */
  range(value) {
    const values = this.samples.map(value).filter(Number.isFinite);
    return [Math.min(...values), Math.max(...values)];
  }
}
