/** Tells those who do not see the motion what happens in it. */

import { html } from "./elements.js";
import { wordsOf } from "./outcome.js";

/** @import { DrawnRun, ShownEvent } from "./shown_run.js" */

/** A log that screen readers read as it grows. Each event enters it once, when the motion that plays passes it. */
export class EventLog {
  /** @param {HTMLElement} log */
  constructor(log) {
    this.log = log;
    /** @type {DrawnRun | null} */
    this.run = null;
    /** @type {Set<ShownEvent>} */
    this.announced = new Set();
  }

  /** The motion has played from a time to a later one. @param {DrawnRun} run @param {number} from @param {number} to [s] */
  played(run, from, to) {
    if (!(to > from)) return;
    if (run !== this.run || from === 0) this.clear(run);
    for (const event of run.events) {
      const passed = event.time <= to && (event.time > from || from === 0);
      if (!passed || this.announced.has(event)) continue;
      this.announced.add(event);
      this.log.append(html("p", {}, wordsOf(event)));
    }
  }

  /** @param {DrawnRun} run */
  clear(run) {
    this.run = run;
    this.announced.clear();
    this.log.replaceChildren();
  }
}
