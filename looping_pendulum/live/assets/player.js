/** The time that is shown: playing, slow motion, steps, and the slider of the time. */

import { fixed, text } from "./texts.js";

const STEP = 2e-3;
const LARGE_STEP = 2e-2;
/** Longest time between two frames that counts [ms]: after a pause of the browser the motion goes on where it was. */
const MAX_FRAME = 100;

/** Time of the run that is shown, and the buttons that change it. */
export class Player {
  /**
   * @param {(id: string) => HTMLElement} element
   * @param {() => number} end end of the run [s]
   * @param {() => void} onChange to be called when the time, or what the buttons say, has changed
   */
  constructor(element, end, onChange) {
    this.end = end;
    this.onChange = onChange;
    this.time = 0;
    this.playing = false;
    this.slow = 4;
    /** @type {number | null} */
    this.previous = null;
    this.slider = /** @type {HTMLInputElement} */ (element("time"));
    this.button = element("play");
    this.clock = element("clock");
    this.button.addEventListener("click", () => this.toggle());
    element("start").addEventListener("click", () => this.stopAt(0));
    element("end").addEventListener("click", () => this.stopAt(this.end()));
    element("back").addEventListener("click", () => this.stopAt(this.time - STEP));
    element("forward").addEventListener("click", () => this.stopAt(this.time + STEP));
    this.slider.addEventListener("input", () => this.stopAt(Number(this.slider.value)));
    for (const button of this.speeds()) button.addEventListener("click", () => this.setSlow(Number(button.dataset.slow)));
    this.setSlow(this.slow);
  }

  /** @returns {HTMLElement[]} */
  speeds() {
    return [...document.querySelectorAll("[data-slow]")].map((button) => /** @type {HTMLElement} */ (button));
  }

  /** @param {number} times */
  setSlow(times) {
    this.slow = times;
    for (const button of this.speeds()) button.setAttribute("aria-pressed", String(Number(button.dataset.slow) === times));
  }

  toggle() {
    if (this.playing) this.pause();
    else this.play();
  }

  play() {
    if (this.time >= this.end()) this.time = 0;
    this.playing = true;
    this.previous = null;
    this.onChange();
  }

  pause() {
    this.playing = false;
    this.onChange();
  }

  /** @param {number} time */
  stopAt(time) {
    this.time = Math.min(Math.max(time, 0), this.end());
    this.pause();
  }

  /** Go on by the time since the last frame. @param {number} now [ms] */
  advance(now) {
    if (!this.playing) return;
    if (this.previous !== null) this.time += Math.min(now - this.previous, MAX_FRAME) / 1000 / this.slow;
    this.previous = now;
    if (this.time < this.end()) return;
    this.time = this.end();
    this.playing = false;
  }

  /** Whether a key was for the player. @param {KeyboardEvent} event */
  onKey(event) {
    const step = event.shiftKey ? LARGE_STEP : STEP;
    /** @type {Record<string, () => void>} */
    const keys = {
      " ": () => this.toggle(),
      ArrowRight: () => this.stopAt(this.time + step),
      ArrowLeft: () => this.stopAt(this.time - step),
      Home: () => this.stopAt(0),
      End: () => this.stopAt(this.end()),
    };
    if (!Object.hasOwn(keys, event.key)) return false;
    keys[event.key]();
    return true;
  }

  /** @param {string} words what is to be seen at the time */
  draw(words) {
    this.slider.max = String(this.end());
    this.slider.value = String(this.time);
    this.slider.setAttribute("aria-valuetext", text("spokenTime", { time: fixed(this.time, 3), words }));
    this.clock.textContent = `${fixed(this.time, 3)} s`;
    const action = text(this.playing ? "pause" : "play");
    if (this.button.textContent !== action) this.button.textContent = action;
  }
}
