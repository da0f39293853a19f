/** A trial of one's own: its file, its points over the motion, and what is left between them and the run. */

import { colours, fitted, polyline, ticks, write } from "./canvas.js";
import { parsed } from "./controls.js";
import { save } from "./export.js";
import { FilmPanel } from "./film/panel.js";
import { fixed, shown, text, written } from "./texts.js";
import { Chooser } from "./trial/chooser.js";
import { tableOf } from "./trial/columns.js";
import { otherFrameRate, typicalDistance } from "./trial/distance.js";
import { DataError, readTrial, tracksOf } from "./trial/reader.js";
import { range } from "./trial/statistics.js";

/** @import { DrawnRun } from "./shown_run.js" */
/** @import { Trial } from "./trial/reader.js" */
/** @typedef {{name: string, colour: "blue" | "orange" | "sky" | "pink", t: number[], value: number[]}} Residual [cm] or [deg] */

/** Above are the title and, below it, what each colour is. */
const EDGE = { left: 44, right: 10, top: 40, bottom: 22 };
const LEGEND = 29;
/** Points at the start that show on which side the light mass is let go. */
const FIRST_POINTS = 5;
/** Colours of each mass that all see differ; the masses differ by their shapes. @type {Record<string, Residual["colour"]>} */
export const COLOURS = { light_x: "orange", light_y: "pink", heavy_x: "sky", heavy_y: "blue", angle: "orange", height: "blue" };

/** What is taken of a file of which nothing is said yet: id of a field -> its value. */
const DEFAULTS = {
  "trial-length": "m", "trial-clock": "s", "trial-rate": "", "trial-release": "0",
  "trial-origin-x": "0", "trial-origin-y": "0", "trial-mass-error": "0.5", "trial-radius-error": "1", "trial-scale-error": "0.5",
};
/** Drags that nobody measures, and what a ball of 3 cm, or a string of 1.5 mm, has in air: their error [kg/m, kg/m²]. */
export const DRAGS = { heavy_drag: 1e-3, string_drag: 1e-3 };
/** Standard error of the picture's vertical in a careful set-up, as `identify` has it (`measured/camera.py`) [rad]. */
const LEVEL = (0.5 * Math.PI) / 180;
/** What is measured before the trial -> the field that has its relative standard error. */
export const MEASURED = { light_mass: "trial-mass-error", heavy_mass: "trial-mass-error", rod_radius: "trial-radius-error" };

/** Reads the file again whenever what is said about it changes. */
export class TrialPanel {
  /** @param {(id: string) => HTMLElement} element @param {() => void} onChange @param {(file: File) => void} onFilm */
  constructor(element, onChange, onFilm) {
    this.element = element;
    this.onChange = onChange;
    /** @type {{name: string, bytes: Uint8Array} | null} */
    this.file = null;
    /** Why the file that was chosen last is not taken, in the language of the page. @type {(() => string) | null} */
    this.refusal = null;
    /** @type {Trial | null} */
    this.trial = null;
    /** Length in the file per true length, as a fit found it. */
    this.scale = 1;
    /** Angle by which the picture is turned, as a fit found it [rad]. */
    this.tilt = 0;
    element("trial-plain").addEventListener("click", () => {
      if (this.trial) save("plain.csv", new Blob([tableOf(this.trial.channels)], { type: "text/csv" }));
    });
    this.chooser = new Chooser(element, (chosen) => this.take(chosen, true));
    const file = /** @type {HTMLInputElement} */ (element("trial-file"));
    file.addEventListener("change", () => {
      if (file.files?.length) this.open(file.files[0]);
      file.value = "";
    });
    element("trial-remove").addEventListener("click", () => this.remove());
    for (const id of ["trial-light", "trial-heavy", "trial-length", "trial-clock", "trial-rate"]) {
      element(id).addEventListener("change", () => {
        this.refusal = null;
        this.read();
      });
    }
    for (const id of ["trial-release", "trial-mirror", "trial-origin-x", "trial-origin-y"]) {
      element(id).addEventListener("change", () => onChange());
    }
    document.addEventListener("dragover", (event) => event.preventDefault());
    document.addEventListener("drop", (event) => {
      event.preventDefault();
      const dropped = event.dataTransfer?.files;
      if (!dropped?.length) return;
      if (FilmPanel.isFilm(dropped[0])) onFilm(dropped[0]);
      else this.open(dropped[0]);
    });
  }

  /** @param {File} file @param {boolean} scrolls whether the page goes to the trial */
  async open(file, scrolls = true) {
    const { name } = file;
    /** @type {Uint8Array} */
    let bytes;
    try {
      bytes = new Uint8Array(await file.arrayBuffer());
    } catch {
      this.refuse(() => text("cannotBeRead", { file: name }));
      return;
    }
    this.chooser.close();
    const problem = problemOf({ name, bytes });
    if (problem?.isForm && this.chooser.offer({ name, bytes })) {
      this.refusal = null;
      this.tell();
      this.element("trial").scrollIntoView({ block: "nearest" });
      return;
    }
    this.take({ name, bytes }, scrolls);
  }

  /** @param {{name: string, bytes: Uint8Array}} next @param {boolean} scrolls whether the page goes to the trial */
  take(next, scrolls) {
    const problem = problemOf(next);
    // With a field that can help, a file may still be read
    if (this.trial && problem && !problem.field) {
      this.refuse(() => problemOf(next)?.message ?? "");
      return;
    }
    this.refusal = null;
    this.file = next;
    this.reset();
    for (const id of ["trial-light", "trial-heavy"]) this.element(id).replaceChildren();
    this.offerTracks(this.file);
    this.read();
    if (this.trial) /** @type {HTMLInputElement} */ (this.element("trial-mirror")).checked = startsOnTheRight(this.trial);
    this.onChange();
    if (scrolls) this.element("trial").scrollIntoView({ block: "nearest" });
  }

  /** Read other points of the file that is there; what is said about it stays. @param {string} content */
  replace(content) {
    if (!this.file) return;
    this.file = { ...this.file, bytes: new TextEncoder().encode(content) };
    this.read();
  }

  /** Leave a file; what was read before stays. @param {() => string} words */
  refuse(words) {
    if (!this.trial) this.remove();
    this.refusal = words;
    this.tell();
    this.element("trial").scrollIntoView({ block: "nearest" });
  }

  /** Say why a file was refused, and what is shown in its place. */
  tell() {
    const stays = this.trial && this.file ? text("trialStays", { file: this.file.name }) : "";
    this.fault(this.refusal ? [this.refusal(), ...(stays ? [stays] : [])].join(". ") : "");
  }

  /** Say what is wrong with a file, beside the field that could help. @param {string} words @param {string} [field] */
  fault(words, field) {
    const error = this.element("trial-error");
    const place = field ? this.element(field) : this.element("trial-file");
    place.parentElement?.after(error);
    for (const one of this.element("trial-options").querySelectorAll("[aria-invalid]")) one.removeAttribute("aria-invalid");
    if (field) place.setAttribute("aria-invalid", "true");
    error.textContent = words;
  }

  /** Forget what was said about another file. */
  reset() {
    for (const [id, value] of Object.entries(DEFAULTS)) {
      /** @type {HTMLInputElement | HTMLSelectElement} */ (this.element(id)).value = value;
    }
    /** @type {HTMLInputElement} */ (this.element("trial-mirror")).checked = false;
    this.scale = 1;
    this.tilt = 0;
    this.element("fit-message").textContent = "";
    this.element("fit-table").replaceChildren();
  }

  /** @param {{name: string, bytes: Uint8Array}} file */
  offerTracks({ name, bytes }) {
    /** @type {string[]} */
    let tracks = [];
    try {
      tracks = tracksOf(name, bytes);
    } catch (error) {
      if (!(error instanceof DataError)) throw error; // its message comes when the whole file is read
    }
    for (const id of ["trial-light", "trial-heavy"]) {
      const select = /** @type {HTMLSelectElement} */ (this.element(id));
      const { value } = select;
      const options = tracks.map((track) => new Option(track || text("onlyTrack"), `=${track}`));
      select.replaceChildren(new Option(text("trackByName"), "-"), ...options);
      if (options.some((option) => option.value === value)) select.value = value;
    }
  }

  /** Say all that is said about the file in the language of the page. */
  relabel() {
    this.chooser.show();
    if (this.file) {
      this.offerTracks(this.file);
      this.read();
    } else this.tell();
  }

  remove() {
    this.refusal = null;
    this.file = null;
    this.fail("");
    this.reset();
    this.element("trial-options").hidden = true;
    this.onChange();
  }

  /** @param {string} id */
  chosen(id) {
    return /** @type {HTMLInputElement | HTMLSelectElement} */ (this.element(id)).value;
  }

  /** What is said about the file. */
  get options() {
    /** @type {Record<string, string>} */
    const tracks = {};
    for (const mass of ["light", "heavy"]) {
      const value = this.chosen(`trial-${mass}`);
      if (value.startsWith("=")) tracks[mass] = value.slice(1);
    }
    const rate = this.chosen("trial-rate").trim();
    const { checked: mirrored } = /** @type {HTMLInputElement} */ (this.element("trial-mirror"));
    return {
      tracks,
      length: this.chosen("trial-length"),
      time: this.chosen("trial-clock"),
      rate: rate ? parsed(rate) : null,
      mirrored,
    };
  }

  read() {
    if (!this.file) return;
    const { tracks, length, time, rate } = this.options;
    this.element("trial-options").hidden = false;
    try {
      this.trial = readTrial(this.file.name, this.file.bytes, { tracks, units: { length, time }, frame_rate: rate });
      this.tell();
    } catch (error) {
      if (!(error instanceof DataError)) throw error;
      this.fail(error.message, error.field);
    }
    this.onChange();
  }

  /** @param {string} message @param {string} [field] */
  fail(message, field) {
    this.trial = null;
    for (const id of ["trial-message", "trial-faults"]) this.element(id).textContent = "";
    this.fault(message, field);
  }

  /** Time of the release by the file's clock [s]. */
  get releaseTime() {
    return parsed(this.chosen("trial-release")) || 0;
  }

  /** Place of the rod's axis in the file, as the sides are shown [m]. @param {string} name of a channel */
  originOf(name) {
    const axis = name.endsWith("_x") ? "x" : name.endsWith("_y") ? "y" : "";
    return axis ? 1e-2 * (parsed(this.chosen(`trial-origin-${axis}`)) || 0) : 0;
  }

  /** What was tracked by the file's clock and from its origin, with the light mass let go on the left.
   * @returns {import("./trial/prediction.js").Channel[]} */
  get channels() {
    const { mirrored } = this.options;
    return (this.trial?.channels ?? []).map((channel) => {
      const flipped = mirrored && ["light_x", "heavy_x", "angle"].includes(channel.name);
      return flipped ? { ...channel, value: channel.value.map((x) => -x) } : channel;
    });
  }

  /** What is known of the camera; lengths and the vertical are right as the file has them, within their errors.
   * @returns {import("./trial/prediction.js").Camera} */
  get camera() {
    const [origin_x, origin_y] = [this.originOf("light_x"), this.originOf("light_y")];
    return { origin_x, origin_y, clock_offset: 0 - this.releaseTime, scale: 1, tilt: 0 };
  }

  /** Standard errors of what was measured before the trial [SI]; 0: exact. @param {Record<string, any>} settings */
  errorsOf(settings) {
    const relative = (/** @type {string} */ field) => 0.01 * Math.max(parsed(this.chosen(field)) || 0, 0);
    const measured = Object.entries(MEASURED).map(([name, field]) => [name, relative(field) * settings[name]]);
    const hasLengths = this.trial?.channels.some(({ name }) => name !== "angle");
    const camera = hasLengths ? { scale: relative("trial-scale-error"), tilt: LEVEL } : { scale: 0, tilt: 0 };
    return { ...Object.fromEntries(measured), ...DRAGS, ...camera };
  }

  /** A channel as the run shows it: from the release on, with the light mass let go on the left.
   * @param {string} name */
  channel(name) {
    const found = this.channels.find((one) => one.name === name);
    if (!found) return null;
    const { releaseTime, tilt } = this;
    const placed = (/** @type {import("./trial/prediction.js").Channel} */ { name, value }) => {
      const [origin, scale] = [this.originOf(name), name === "angle" ? 1 : this.scale];
      return value.map((one) => (one - origin) / scale);
    };
    const [own, t] = [placed(found), found.t.map((time) => time - releaseTime)];
    const across = { x: "y", y: "x" }[name.at(-1) ?? ""];
    const beside = across && this.channels.find((one) => one.name === name.slice(0, -1) + across);
    // Without its other coordinate, a turned picture cannot be undone
    if (!beside || !tilt) return { t, value: own };
    const other = new Map(placed(beside).map((value, i) => [beside.t[i], value]));
    const both = range(0, own.length).filter((i) => other.has(found.t[i]));
    const turn = across === "y" ? Math.sin(tilt) : -Math.sin(tilt);
    return {
      t: both.map((i) => t[i]),
      value: both.map((i) => Math.cos(tilt) * own[i] + turn * /** @type {number} */ (other.get(found.t[i]))),
    };
  }

  /** Tracked points of a mass: time [s] and place [m].
   * @param {"light" | "heavy"} mass @returns {[number, number, number][]} */
  points(mass) {
    const [x, y] = [this.channel(`${mass}_x`), this.channel(`${mass}_y`)];
    if (!x || !y) return [];
    const heights = new Map(y.t.map((t, i) => [t, y.value[i]]));
    return x.t.flatMap((t, i) => {
      const height = heights.get(t);
      return height === undefined ? [] : [/** @type {[number, number, number]} */ ([t, x.value[i], height])];
    });
  }

  /** What is left between the trial and a run, at the times of the run. @param {DrawnRun} run @returns {Residual[]} */
  residuals(run) {
    return Object.entries(COLOURS).flatMap(([name, colour]) => {
      const channel = this.channel(name);
      if (!channel) return [];
      const inside = channel.t.flatMap((t, i) => (t >= 0 && t <= run.end ? [i] : []));
      const t = inside.map((i) => channel.t[i]);
      const first = inside.length ? channel.value[inside[0]] - predicted(run, name, t[0]) : 0;
      // Of a height only changes are known: where it is zero, the file does not say
      const offset = name === "height" ? first : 0;
      const factor = name === "angle" ? 180 / Math.PI : 100;
      return [{ name, colour, t, value: inside.map((i, k) => factor * (channel.value[i] - offset - predicted(run, name, t[k]))) }];
    });
  }

  /** Say what was read and how far it is from a run, and draw what is left. @param {DrawnRun} run */
  show(run) {
    const { trial, file } = this;
    if (!trial || !file) {
      this.draw([], run.end);
      return;
    }
    const residuals = this.residuals(run);
    const used = trial.channels.map(({ name, t }) => `${name} ${t.length}`).join(", ");
    const empty = trial.empty ? [text("emptyCells", { count: trial.empty })] : [];
    const any = residuals.some(({ t }) => t.length > 0);
    const light = this.points("light");
    const distance = typicalDistance(light, run);
    const typical = !any ? text("trialNone") : distance >= 0 ? text("trialDistance", { distance: inMillimetres(distance) }) : "";
    const other = otherFrameRate(light, run);
    const factor = other && (other.factor < 1 ? `1/${written(1 / other.factor, 2)}` : written(other.factor, 2));
    const rate = other && factor ? text("trialOtherRate", { factor, rate: written(other.rate, 3) }) : "";
    this.element("trial-faults").textContent = rate;
    const parts = [used, ...empty, ...trial.assumptions].join("; ");
    this.element("trial-message").textContent = text("trialUsed", { file: file.name, used: parts, typical });
    this.draw(residuals, run.end);
  }

  /** @param {Residual[]} residuals @param {number} end */
  draw(residuals, end) {
    const canvas = /** @type {HTMLCanvasElement} */ (this.element("residuals"));
    canvas.hidden = !residuals.length;
    if (!residuals.length) return;
    const { c, width, height } = fitted(canvas);
    const { grid, soft, ink } = colours();
    const most = Math.max(0.1, ...residuals.flatMap(({ value }) => value.map(Math.abs))) * 1.05;
    const tall = height - EDGE.top - EDGE.bottom;
    const x = (/** @type {number} */ t) => EDGE.left + (t / end) * (width - EDGE.left - EDGE.right);
    const y = (/** @type {number} */ v) => EDGE.top + (tall * (most - v)) / (2 * most);
    for (const v of ticks(-most, most)) {
      polyline(c, [[EDGE.left, y(v)], [width - EDGE.right, y(v)]], { colour: v === 0 ? soft : grid, width: 1 });
      write(c, shown(v), EDGE.left - 6, y(v), { colour: soft, size: 11, align: "right" });
    }
    for (const t of ticks(0, end)) write(c, `${shown(t)} s`, x(t), height - 9, { colour: soft, size: 11, align: "center" });
    const unit = residuals.every(({ name }) => name === "angle") ? "°" : "cm";
    write(c, text("residuals", { unit }), 6, 13, { colour: ink, size: 13, bold: true });
    let right = width - EDGE.right;
    for (const { name, colour, t, value } of [...residuals].reverse()) {
      c.fillStyle = colours()[colour];
      t.forEach((time, i) => mark(c, name, x(time), y(value[i]), 2));
      const words = name.replace("light", "M1").replace("heavy", "M2").replace("_", " ");
      write(c, words, right, LEGEND, { colour: soft, size: 11, align: "right" });
      right -= c.measureText(words).width + 12;
      c.fillStyle = colours()[colour];
      mark(c, name, right + 4, LEGEND, 4);
      right -= 7;
    }
  }
}

/** A distance in words. @param {number} metres */
export const inMillimetres = (metres) => fixed(1000 * metres, 1);

/** Why a file cannot be read as it stands; null if it can. @param {{name: string, bytes: Uint8Array}} file */
function problemOf({ name, bytes }) {
  try {
    readTrial(name, bytes);
  } catch (error) {
    if (error instanceof DataError) return error;
    throw error;
  }
  return null;
}

/** Shape of the points of a channel. @param {string} name */
export function shapeOf(name) {
  return name.startsWith("heavy") || name === "height" ? "square" : "disc";
}

/** @param {import("./canvas.js").Context} c @param {string} name of a channel @param {number} x @param {number} y
 * @param {number} size half of the point's [px] */
function mark(c, name, x, y, size) {
  c.beginPath();
  if (shapeOf(name) === "square") c.rect(x - size, y - size, 2 * size, 2 * size);
  else c.arc(x, y, size, 0, 2 * Math.PI);
  c.fill();
}

/** Tracked point that is nearest in time, if it is near. @param {[number, number, number][]} points @param {number} time */
export function nearest(points, time) {
  let best = null;
  for (const point of points) if (best === null || Math.abs(point[0] - time) < Math.abs(best[0] - time)) best = point;
  return best !== null && Math.abs(best[0] - time) < 0.02 ? [best[1], best[2]] : null;
}

/** What a run has where a file has a channel. @param {DrawnRun} run @param {string} name @param {number} t */
function predicted(run, name, t) {
  const { light, heavy, wrapAngle } = run.at(t);
  /** @type {Record<string, number>} */
  const values = {
    light_x: light[0], light_y: light[1], heavy_x: heavy[0], heavy_y: heavy[1], angle: wrapAngle - Math.PI, height: heavy[1],
  };
  return values[name];
}

/** Whether the light mass is let go on the right. @param {Trial} trial */
function startsOnTheRight(trial) {
  const x = trial.channels.find(({ name }) => name === "light_x");
  const first = x?.value.slice(0, FIRST_POINTS) ?? [];
  return first.reduce((sum, value) => sum + value, 0) > 0;
}
