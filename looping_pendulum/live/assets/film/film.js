/** A film in the page: its frames, one at a time, with their own times. */

import { frameTimes } from "./frame_times.js";

/** Frames at least, and time of the film [s], that are looked at to know how long a frame lasts: WebM has times in whole
 * milliseconds. How fast they are played for it. */
const [COUNTED, COUNTED_TIME, SLOWLY] = [8, 0.25, 0.25];
/** Steps of more than so many usual ones have a frame between that the browser left out. */
const MAX_STEP_RATIO = 1.5;
/** A time after the end of every film [s]. */
const AFTER_ALL = 1e6;
/** Time after which a frame that was found counts as shown, and one that is played as the last [ms]. */
const PATIENCE = 1500;
/** Frames of each half of a film of which the background is made; an odd number. */
const OF_BACKGROUND = 7;
/** Part of its duration at which a frame is asked for, as its times are rounded. */
const WITHIN = 0.5;

/** A film that is loaded; its frames are shown on a canvas, so that drawings need not wait for the decoder. */
export class Film {
  /** @param {string} name @param {HTMLVideoElement} video */
  constructor(name, video) {
    this.name = name;
    this.video = video;
    this.width = video.videoWidth;
    this.height = video.videoHeight;
    this.duration = video.duration;
    /** The frame that is shown. */
    this.picture = Object.assign(document.createElement("canvas"), { width: this.width, height: this.height });
    this.context = /** @type {CanvasRenderingContext2D} */ (this.picture.getContext("2d", { willReadFrequently: true }));
    /** Time of the frame that is shown, by the film [s]. */
    this.time = 0;
    /** How long a frame lasts [s]. */
    this.step = 1 / 30;
    /** When its frames are shown, by the tables of its file [s]; null: they were not read. @type {number[] | null} */
    this.times = null;
    /** Frames per second of the camera, 0 if the file does not say it [Hz]. */
    this.cameraRate = 0;
    /** Whether the browser says the time of each frame; else it is taken from that which was asked for. */
    this.reportsFrames = "requestVideoFrameCallback" in video;
    this.busy = false;
  }

  /**
   * Load a film; it is not sent anywhere.
   * @param {File} file
   * @returns {Promise<Film>}
   * @throws {Error} if the browser cannot show it
   */
  static async load(file) {
    const video = Object.assign(document.createElement("video"), { muted: true, playsInline: true, preload: "auto" });
    video.className = "film-source"; // in the page, but not seen: browsers do not decode what stands in none
    document.querySelector("main")?.append(video); // outside of it a screen reader would meet it in no landmark
    try {
      await new Promise((loaded, failed) => {
        video.addEventListener("loadeddata", loaded, { once: true });
        video.addEventListener("error", () => failed(new Error(video.error?.message)), { once: true });
        video.src = URL.createObjectURL(file);
      });
      if (video.duration === Infinity) await lookForEnd(video);
      if (!video.videoWidth || !Number.isFinite(video.duration)) throw new Error("no pictures");
    } catch (error) {
      remove(video);
      throw error;
    }
    const film = new Film(file.name, video);
    const table = await frameTimes(file);
    if (!table) await film.measureStep();
    await film.show(0);
    if (table) film.take(table);
    return film;
  }

  /** Take the times of the file's tables, which may begin at another one than the browser's clock. @param {import("./frame_times.js").FrameTimes} table */
  take({ times, rate }) {
    const late = this.reportsFrames ? this.time - times[0] : 0;
    this.times = times.map((time) => time + late);
    this.time = this.times[0];
    this.step = median(times.slice(1).map((time, i) => time - times[i]));
    this.cameraRate = rate;
  }

  remove() {
    remove(this.video);
  }

  /** Show the frame at a time by the film; return its own time [s]. @param {number} time */
  async show(time) {
    this.busy = true;
    const { video } = this;
    const shown = new Promise((done) => {
      let later = 0;
      const seen = (/** @type {number | null} */ ownTime) => {
        clearTimeout(later);
        done(ownTime);
      };
      if (this.reportsFrames) video.requestVideoFrameCallback((_, { mediaTime }) => seen(mediaTime));
      // A frame that is shown already is not reported again; a slow machine takes its time up to here
      const found = () => {
        if (this.reportsFrames) later = window.setTimeout(() => seen(null), PATIENCE);
        else seen(null);
      };
      video.addEventListener("seeked", found, { once: true });
    });
    video.currentTime = Math.min(Math.max(time, 0), this.duration);
    const ownTime = await shown;
    const now = video.currentTime + 1e-6;
    this.time = ownTime ?? this.times?.findLast((begin) => begin <= now) ?? this.step * Math.floor(now / this.step);
    this.context.drawImage(video, 0, 0, this.width, this.height);
    this.busy = false;
    return this.time;
  }

  /** Show a frame some frames on, or before; return whether there is one. @param {number} count */
  async go(count) {
    const { time, times, step } = this;
    const shown = times?.findLastIndex((begin) => begin <= time + step / 4) ?? 0;
    await this.show((times?.[shown + count] ?? time + count * step) + WITHIN * step);
    return this.time !== time;
  }

  /** Whether a time belongs to the frame that is shown. @param {number} time [s] */
  isShown(time) {
    return Math.abs(Math.min(Math.max(time, 0), this.duration) - this.time - WITHIN * this.step) <= 0.75 * this.step;
  }

  /** Play some frames slowly, and see how long one lasts. */
  async measureStep() {
    if (!this.reportsFrames) return;
    const { video } = this;
    /** @type {number[]} */
    const times = [];
    video.playbackRate = SLOWLY;
    await new Promise((done) => {
      let last = window.setTimeout(done, PATIENCE);
      const look = (/** @type {number} */ _, /** @type {{mediaTime: number}} */ { mediaTime }) => {
        times.push(mediaTime);
        clearTimeout(last);
        last = window.setTimeout(done, PATIENCE);
        if (times.length > COUNTED && mediaTime - times[0] > COUNTED_TIME) done(null);
        else video.requestVideoFrameCallback(look);
      };
      video.requestVideoFrameCallback(look);
      video.play().catch(done);
    });
    video.pause();
    const steps = times.slice(1).map((time, i) => time - times[i]).filter((step) => step > 0).sort((a, b) => a - b);
    const whole = steps.filter((step) => step < MAX_STEP_RATIO * steps[Math.floor(steps.length / 4)]);
    if (whole.length) this.step = whole.reduce((sum, step) => sum + step) / whole.length;
  }

  /** Look at frames of the first and of the last half, in which something may come to rest: their medians, four values a pixel. */
  async lookForBackground() {
    if (this.halves.length) return;
    const before = this.time;
    const middle = (OF_BACKGROUND - 1) / 2;
    const values = new Uint8ClampedArray(OF_BACKGROUND);
    for (const first of [0, 1]) {
      /** @type {Uint8ClampedArray[]} */
      const frames = [];
      for (let i = 0; i < OF_BACKGROUND; i++) {
        await this.show((this.duration * (first + (i + WITHIN) / OF_BACKGROUND)) / 2);
        frames.push(this.context.getImageData(0, 0, this.width, this.height).data);
      }
      this.halves.push(frames[0].map((_, i) => {
        frames.forEach((frame, k) => (values[k] = frame[i]));
        return values.sort()[middle];
      }));
    }
    await this.show(before + WITHIN * this.step);
  }

  /** @type {Uint8ClampedArray[]} */
  halves = [];
  /** What is behind the thing that is looked for. @type {Uint8ClampedArray | null} */
  background = null;

  /** Take for background, at each pixel, that half of the film in which it is less like a thing. @param {number} x @param {number} y of the thing */
  setBackgroundOf(x, y) {
    const [early, late] = this.halves;
    const thing = this.context.getImageData(Math.round(x) - 1, Math.round(y) - 1, 3, 3).data;
    const colour = [0, 1, 2].map((channel) => median([...thing].filter((_, i) => i % 4 === channel)));
    const unlike = (/** @type {Uint8ClampedArray} */ half, /** @type {number} */ at) =>
      Math.abs(half[at] - colour[0]) + Math.abs(half[at + 1] - colour[1]) + Math.abs(half[at + 2] - colour[2]);
    this.background = early.slice();
    for (let at = 0; at < early.length; at += 4) {
      if (unlike(late, at) > unlike(early, at)) this.background.set(late.subarray(at, at + 4), at);
    }
  }

  /** How much a square of the frame that is shown differs from the background, row by row; null: it is not whole.
   * @param {number} x @param {number} y @param {number} reach whole pixels on each side @returns {Float32Array | null} */
  square(x, y, reach) {
    const { background, width } = this;
    const size = 2 * reach + 1;
    const [left, top] = [Math.round(x) - reach, Math.round(y) - reach];
    if (!background || left < 0 || top < 0 || left + size > width || top + size > this.height) return null;
    const { data } = this.context.getImageData(left, top, size, size);
    return Float32Array.from({ length: size * size }, (_, i) => {
      const at = 4 * (width * (top + Math.floor(i / size)) + left + (i % size));
      return [0, 1, 2].reduce((sum, channel) => sum + Math.abs(data[4 * i + channel] - background[at + channel]), 0);
    });
  }
}

/** @param {number[]} values */
const median = (values) => values.sort((a, b) => a - b)[Math.floor(values.length / 2)];

/** Have a browser find the duration that a film does not state: programs that record a screen write none. @param {HTMLVideoElement} video */
async function lookForEnd(video) {
  for (const time of [AFTER_ALL, 0]) {
    const there = new Promise((done, failed) => {
      video.addEventListener("seeked", done, { once: true });
      video.addEventListener("error", failed, { once: true });
    });
    video.currentTime = time;
    await there;
  }
}

/** @param {HTMLVideoElement} video */
function remove(video) {
  URL.revokeObjectURL(video.src);
  video.remove();
}
