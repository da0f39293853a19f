/** A stopwatch that runs with the time of the motion, in slow motion as slowly as that. */

import { makeMovable } from "./dragging.js";
import { fixed, text } from "./texts.js";

/** What an arrow key moves it by [px]. */
const STEP = 4;

/** Started at one time that is shown and stopped at another, it reads what lies between. */
export class Stopwatch {
  /** @param {(id: string) => HTMLElement} element @param {() => number} time that is shown [s]
   * @param {(id: string, words: string | (() => string)) => void} say */
  constructor(element, time, say) {
    this.element = element;
    this.time = time;
    this.say = say;
    /** Reading when it was stopped last [s]. */
    this.kept = 0;
    /** Time at which it was started; null while it is stopped [s]. @type {number | null} */
    this.since = null;
    this.box = element("stopwatch");
    this.place = [8, 8];
    element("stopwatch-run").addEventListener("click", () => this.toggle());
    element("stopwatch-reset").addEventListener("click", () => {
      this.kept = 0;
      if (this.since !== null) this.since = this.time();
      this.tell();
    });
    makeMovable(element("stopwatch-grip"), STEP, (right, down) => this.move(right, down));
  }

  /** What it reads [s]; less than nothing where the motion was taken back to before the start. */
  get reading() {
    return this.kept + (this.since === null ? 0 : this.time() - this.since);
  }

  toggle() {
    [this.kept, this.since] = [this.reading, this.since === null ? this.time() : null];
    this.tell();
  }

  /** Say its reading where screen readers announce it: not while it runs. */
  tell() {
    this.say("stopwatch-said", this.since === null ? () => text("stopwatchReads", { time: fixed(this.kept, 3) }) : "");
    this.relabel();
    this.show(true);
  }

  relabel() {
    this.element("stopwatch-run").textContent = text(this.since === null ? "stopwatchStart" : "stopwatchStop");
  }

  /** @param {number} x @param {number} y [px] */
  move(x, y) {
    const { offsetWidth, offsetHeight, parentElement } = this.box;
    const room = [(parentElement?.clientWidth ?? 0) - offsetWidth, (parentElement?.clientHeight ?? 0) - offsetHeight];
    this.place = [x, y].map((by, i) => Math.max(0, Math.min(this.place[i] + by, room[i])));
    [this.box.style.left, this.box.style.top] = this.place.map((length) => `${length}px`);
  }

  /** @param {boolean} isOn */
  show(isOn) {
    if (this.box.hidden === isOn) {
      this.box.hidden = !isOn;
      if (isOn) this.move(0, 0); // the stage may have less room than before
    }
    if (!isOn) return;
    const words = `${fixed(this.reading, 3)} s`;
    if (this.element("stopwatch-time").textContent !== words) this.element("stopwatch-time").textContent = words;
  }
}
