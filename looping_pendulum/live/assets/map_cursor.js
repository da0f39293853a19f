/** The map by keyboard: a cursor over angle and mass ratio that says where the heavy mass halts. */

import { settingsOf, snapped, controlOf, withValue } from "./controls.js";
import { dropAtHalt } from "./map_worker.js";
import { fixed, text } from "./texts.js";

/** @import { State } from "./controls.js" */
/** @typedef {{release_angle: number, mass_ratio: number}} Place */

const CENTIMETRES = 100;
const LARGE_STEP = 10;
/** Key -> the setting that it changes, and by how many of its steps. @type {Record<string, [keyof Place, number]>} */
const KEYS = {
  ArrowRight: ["release_angle", 1], ArrowLeft: ["release_angle", -1], ArrowUp: ["mass_ratio", 1], ArrowDown: ["mass_ratio", -1],
};

/** Moves by the arrows, and sets what it stands on by Enter. */
export class MapCursor {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {HTMLElement} reading where it says what is at the cursor
   * @param {() => State} current
   * @param {(place: Place) => void} onPick
   * @param {() => void} onChange to be called when it must be drawn anew
   */
  constructor(canvas, reading, current, onPick, onChange) {
    this.reading = reading;
    this.current = current;
    this.onPick = onPick;
    this.onChange = onChange;
    /** Where it stands; null while nobody moves it. @type {Place | null} */
    this.place = null;
    canvas.addEventListener("keydown", (event) => this.onKey(event));
    canvas.addEventListener("blur", () => this.moveTo(null));
  }

  /** @param {KeyboardEvent} event */
  onKey(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (Object.hasOwn(KEYS, event.key)) {
      const [name, count] = KEYS[event.key];
      const state = this.stateAt(this.place);
      const { step } = controlOf(name);
      const wanted = snapped(state.values[name], step) + count * step * (event.shiftKey ? LARGE_STEP : 1);
      const { release_angle, mass_ratio } = withValue(state, name, wanted).values;
      this.moveTo({ release_angle, mass_ratio });
    } else if (event.key === "Enter" && this.place) {
      this.onPick(this.place);
      this.moveTo(null);
    } else if (event.key === "Escape" && this.place) this.moveTo(null);
    else return;
    event.preventDefault();
    event.stopPropagation(); // on the rest of the page the arrows step through the time
  }

  /** @param {Place | null} place */
  moveTo(place) {
    this.place = place;
    this.reading.textContent = place ? this.wordsAt(place) : "";
    this.onChange();
  }

  /** The settings, with those of a place. @param {Place | null} place @returns {State} */
  stateAt(place) {
    const state = this.current();
    return { ...state, values: { ...state.values, ...place } };
  }

  /** @param {Place} place */
  wordsAt(place) {
    const drop = dropAtHalt(settingsOf({ ...this.stateAt(place), release: "looping" }));
    const values = { angle: place.release_angle, ratio: place.mass_ratio, drop: fixed(CENTIMETRES * drop, 1) };
    return text(Number.isNaN(drop) ? "mapReadNever" : "mapReadHalts", values);
  }
}
