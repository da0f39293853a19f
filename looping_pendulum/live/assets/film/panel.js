/** A film under the model: on one clock and one scale with it, and points that are set by hand or found in it. */

import { colours, write } from "../canvas.js";
import { parsed } from "../controls.js";
import { fixed, shown, text } from "../texts.js";
import { Film } from "./film.js";
import { evenTimes } from "./frame_times.js";
import { expectedAt, findNear, templateOf } from "./search.js";

/** @import { View } from "../stage.js" */
/** @import { Mark } from "./search.js" */
/** @typedef {"light" | "heavy"} Mass */
/**
 * @typedef {{stage: import("../stage.js").Stage, player: import("../player.js").Player, change: () => void, wake: () => void,
 *   trial: import("../trial_panel.js").TrialPanel, fit: import("../fit_panel.js").FitPanel}} FilmPage what the film needs of the page
 */

/** Radius of the enlarged place [px of the film], and how large it is drawn [px]. */
const [LOUPE, LOUPE_SIZE] = [12, 150];
/** Relative difference of two frame rates that are the same. */
const RATE_TOLERANCE = 0.01;
/** By how much an arrow key moves a mark [px of the film]. */
const FINE = 0.1;
/** How near to a point it is taken [px of the stage]. */
const REACH = 14;
/** Share of the stage that a film fills before its scale is known. */
const FILLED = 0.9;
const NAMES = { light: "M1", heavy: "M2" };
const STEPS = { PageUp: -1, PageDown: 1 };
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

export class FilmPanel {
  /** @param {(id: string) => HTMLElement} element @param {FilmPage} page */
  constructor(element, page) {
    this.element = element;
    this.page = page;
    /** @type {Film | null} */
    this.film = null;
    /** Place of the rod's axis in the picture [px], and metres in a pixel; null: not said yet. */
    this.axis = { x: 0, y: 0 };
    /** @type {number | null} */
    this.scale = null;
    /** Time of the release by the film [s]. */
    this.release = 0;
    /** @type {Record<Mass, Mark[]>} in order of time */
    this.marks = { light: [], heavy: [] };
    /** What a click on the stage says. @type {"" | "axis" | "length" | "correct" | Mass} */
    this.task = "";
    /** Name of the trial that the points were handed over as: it follows when one is corrected. */
    this.used = "";
    /** Mass whose mark was set last. @type {Mass} */
    this.last = "light";
    /** First end of the length that is being said [px of the film]. @type {{x: number, y: number} | null} */
    this.end = null;
    this.searching = false;
    const file = this.input("film-file");
    file.addEventListener("change", () => {
      if (file.files?.length) this.open(file.files[0]);
      file.value = "";
    });
    /** @type {Record<string, () => unknown>} */
    const actions = {
      "film-axis": () => this.begin("axis"),
      "film-scale": () => this.begin("length"),
      "film-light": () => this.begin("light"),
      "film-heavy": () => this.begin("heavy"),
      "film-release": () => this.releaseHere(),
      "film-back": () => this.go(-1),
      "film-on": () => this.go(1),
      "film-find": () => this.find(),
      "film-correct": () => this.begin("correct"),
      "film-undo": () => this.undo(),
      "film-use": () => this.use(),
      "film-remove": () => this.remove(),
    };
    for (const [id, action] of Object.entries(actions)) element(id).addEventListener("click", action);
    this.input("film-time").addEventListener("input", () => this.showAt(Number(this.input("film-time").value)));
    for (const id of ["film-rate", "film-length"]) element(id).addEventListener("change", () => this.tell());
    // Before the stage takes the light mass
    page.stage.canvas.addEventListener("pointerdown", (event) => this.click(event), { capture: true });
    page.stage.canvas.addEventListener("keydown", (event) => this.press(event));
  }

  /** @param {string} id */
  input(id) {
    return /** @type {HTMLInputElement} */ (this.element(id));
  }

  /** Time of the motion in one second of the film's own clock [s]: less than 1 in slow motion. */
  get factor() {
    const rate = parsed(this.input("film-rate").value);
    const factor = this.film && rate > 0 ? 1 / (this.film.step * rate) : 1;
    return Math.abs(factor - 1) < RATE_TOLERANCE ? 1 : factor;
  }

  /** Time since the release at a time by the film [s]. @param {number} time */
  since(time) {
    return (time - this.release) * this.factor;
  }

  /** Whether a file is a film by its name or kind. @param {File} file */
  static isFilm(file) {
    return file.type.startsWith("video/") || /\.(mp4|mov|m4v|webm|mkv|avi)$/i.test(file.name);
  }

  /** @param {File} file */
  async open(file) {
    this.remove();
    /** @type {HTMLDetailsElement} */ (this.element("film")).open = true;
    this.say(() => text("filmLoads", { file: file.name }));
    try {
      this.film = await Film.load(file);
    } catch {
      this.say(() => text("filmFails", { file: file.name }));
      return;
    }
    const { film, page } = this;
    const { box } = page.stage;
    this.axis = { x: film.width / 2, y: film.height / 3 };
    this.input("film-rate").value = shown(Number((film.cameraRate || 1 / film.step).toPrecision(4)));
    this.input("film-time").max = String(film.duration);
    this.element("film-tools").hidden = false;
    // Until its scale is said it fills the stage
    this.guess = box ? (box.high - box.low) / (FILLED * film.height) : 1 / film.height;
    this.say(() => text(film.times || film.reportsFrames ? "filmOwnTimes" : "filmAskedTimes", {
      file: film.name, width: film.width, height: film.height, rate: fixed(1 / film.step, 2),
      clock: text(film.times ? "filmFileClock" : "filmBrowserClock", { count: film.times?.length ?? 0 }),
    }));
    page.change();
  }

  guess = 1;

  remove() {
    this.film?.remove();
    this.film = null;
    this.scale = null;
    this.release = 0;
    this.marks = { light: [], heavy: [] };
    this.used = "";
    this.begin("");
    this.element("film-tools").hidden = true;
    this.say("");
    this.page.change();
  }

  /** @param {string | (() => string)} words */
  say(words) {
    this.words = typeof words === "string" ? () => words : words;
    this.tell();
  }

  words = () => "";

  /** Write what is said, and how far the points are, in the language of the page. */
  tell() {
    const { film, marks } = this;
    this.element("film-message").textContent = this.words();
    if (!film) return;
    const since = this.since(film.time);
    const places = { time: fixed(film.time, 4), since: fixed(since, 4), light: marks.light.length, heavy: marks.heavy.length };
    this.element("film-state").textContent = text("filmState", places);
    this.input("film-time").value = String(film.time);
    for (const id of ["axis", "scale", "correct", "light", "heavy"]) {
      this.element(`film-${id}`).setAttribute("aria-pressed", String(this.task === (id === "scale" ? "length" : id)));
    }
    /** @type {HTMLButtonElement} */ (this.element("film-use")).disabled = this.scale === null || !marks.light.length;
    /** @type {HTMLButtonElement} */ (this.element("film-find")).disabled = marks[this.last].length < 2;
  }

  /** @param {FilmPanel["task"]} task what the next clicks say */
  begin(task) {
    this.task = this.task === task ? "" : task;
    this.end = null;
    if (task === "light" || task === "heavy") this.last = task;
    const hints = {
      "": "", axis: "filmClickAxis", length: "filmClickLength", correct: "filmClickPoint", light: "filmClickMass", heavy: "filmClickMass",
    };
    const hint = hints[this.task];
    this.page.stage.canvas.style.cursor = this.task ? "crosshair" : "";
    this.page.stage.canvas.tabIndex = this.task ? 0 : -1;
    const mass = NAMES[this.last];
    this.say(hint ? () => text(/** @type {import("../texts.js").TextKey} */ (hint), { mass }) : "");
  }

  /** A click while something is to be said of the picture. @param {PointerEvent} event */
  click(event) {
    const { film, task } = this;
    if (!film || !task || film.busy) return;
    event.stopImmediatePropagation();
    const { canvas } = this.page.stage;
    const [px, py] = this.page.stage.placeOf(event);
    const place = this.toFilm(px, py);
    if (task === "axis") {
      this.axis = place;
      this.begin("");
    } else if (task === "length") this.measure(place);
    else if (task === "correct") this.grab(event, place);
    else this.mark(task, { time: film.time, ...place });
    canvas.focus({ preventScroll: true });
    this.page.change();
  }

  /** Place on the stage -> in the picture [px]. @param {number} px @param {number} py */
  toFilm(px, py) {
    const [x, y] = this.page.stage.toPlane(px, py);
    const scale = this.scale ?? this.guess;
    return { x: this.axis.x + x / scale, y: this.axis.y - y / scale };
  }

  /** Drag the nearest point, whose frame is shown. @param {PointerEvent} event @param {{x: number, y: number}} place */
  grab(event, place) {
    const { canvas, view } = this.page.stage;
    const reach = REACH / ((this.scale ?? this.guess) * view.scale);
    const far = (/** @type {Mark} */ { x, y }) => Math.hypot(x - place.x, y - place.y);
    const all = /** @type {Mass[]} */ (["light", "heavy"]).flatMap((mass) => this.marks[mass].map((mark) => ({ mass, mark })));
    const near = all.filter(({ mark }) => far(mark) < reach).sort((a, b) => far(a.mark) - far(b.mark))[0];
    if (!near) return;
    const { mark } = near;
    this.select(near.mass, mark);
    const [dx, dy] = [mark.x - place.x, mark.y - place.y];
    const box = canvas.getBoundingClientRect();
    const drag = (/** @type {PointerEvent} */ { clientX, clientY }) => {
      const { x, y } = this.toFilm(clientX - box.left, clientY - box.top);
      Object.assign(mark, { x: x + dx, y: y + dy });
      this.page.change();
    };
    canvas.setPointerCapture(event.pointerId);
    canvas.addEventListener("pointermove", drag);
    canvas.addEventListener("lostpointercapture", () => {
      canvas.removeEventListener("pointermove", drag);
      this.corrected();
    }, { once: true });
  }

  /** Take a point to correct it, and show its frame. @param {Mass} mass @param {Mark} mark */
  select(mass, mark) {
    this.last = mass;
    this.newest = mark;
    this.showAt(mark.time + /** @type {Film} */ (this.film).step / 2);
  }

  /** The trial follows, and a fit that was made of it. */
  corrected() {
    this.page.change();
    const { fit, trial } = this.page;
    if (!this.used || trial.file?.name !== this.used) return;
    const isFitted = fit.fitted !== null && fit.fitted.file === trial.file;
    trial.replace(this.table());
    if (isFitted) fit.start();
  }

  /** Take two clicks for a known length. @param {{x: number, y: number}} place */
  measure(place) {
    const length = parsed(this.input("film-length").value) / 100;
    if (!(length > 0)) {
      this.say(() => text("filmNoLength"));
      this.input("film-length").focus();
      return;
    }
    if (!this.end) {
      this.end = place;
      return;
    }
    this.scale = length / Math.hypot(place.x - this.end.x, place.y - this.end.y);
    this.begin("");
  }

  /** @param {Mass} mass @param {Mark} mark */
  async mark(mass, mark) {
    this.put(mass, mark);
    this.corrected();
    await this.go(1);
  }

  /** @param {Mass} mass @param {Mark} mark one for each frame */
  put(mass, mark) {
    const { step } = /** @type {Film} */ (this.film);
    const others = this.marks[mass].filter(({ time }) => Math.abs(time - mark.time) > step / 2);
    this.marks[mass] = [...others, mark].sort((a, b) => a.time - b.time);
    this.newest = mark;
    this.last = mass;
  }

  /** @type {Mark | null} */
  newest = null;

  /** Move the newest mark by a tenth of a pixel; while points are corrected, go to another one, or delete it. @param {KeyboardEvent} event */
  press(event) {
    const { newest, last } = this;
    const along = ARROWS[/** @type {keyof typeof ARROWS} */ (event.key)];
    const isCorrected = this.task === "correct";
    if (!this.film || !newest || (this.task !== "light" && this.task !== "heavy" && !isCorrected)) return;
    const place = this.marks[last].indexOf(newest);
    if (along) {
      newest.x += FINE * along[0];
      newest.y += FINE * along[1];
      this.page.change();
      if (isCorrected) this.corrected();
    } else if (isCorrected && event.key in STEPS) {
      const next = this.marks[last][place + STEPS[/** @type {keyof typeof STEPS} */ (event.key)]];
      if (next) this.select(last, next);
    } else if (isCorrected && event.key === "Delete") {
      this.marks[last].splice(place, 1);
      this.newest = this.marks[last][Math.min(place, this.marks[last].length - 1)] ?? null;
      this.tell();
      this.corrected();
    } else return;
    event.preventDefault();
    event.stopPropagation();
  }

  undo() {
    this.marks[this.last].pop();
    this.newest = this.marks[this.last].at(-1) ?? null;
    this.tell();
    this.corrected();
  }

  releaseHere() {
    if (!this.film) return;
    this.release = this.film.time;
    this.page.player.stopAt(0);
    this.tell();
    this.page.change();
  }

  /** @param {number} count of frames */
  async go(count) {
    const { film } = this;
    if (!film || film.busy) return;
    await film.go(count);
    this.lead();
  }

  /** @param {number} time by the film */
  async showAt(time) {
    const { film } = this;
    if (!film || film.busy) return;
    await film.show(time);
    this.lead();
  }

  /** Set the model to the time of the frame that is shown. */
  lead() {
    const since = this.film ? this.since(this.film.time) : 0;
    if (since >= 0) this.page.player.stopAt(since);
    this.tell();
    this.page.change();
  }

  /** Show the frame at a time of the model. @param {number} time since the release [s] */
  follow(time) {
    const { film } = this;
    if (!film || film.busy || this.searching || (!time && film.time < this.release)) return;
    const wanted = this.release + time / this.factor;
    if (film.isShown(wanted)) return;
    film.show(wanted).then(() => {
      this.tell();
      this.page.wake();
    });
  }

  /** Find the mass that was marked last in all further frames. */
  async find() {
    const { film, last: mass } = this;
    const clicked = this.marks[mass].at(-1);
    if (!film || !clicked || film.busy || this.searching) return;
    this.searching = true;
    await film.lookForBackground();
    await film.show(clicked.time + film.step / 2);
    film.setBackgroundOf(clicked.x, clicked.y);
    const template = templateOf(film, clicked);
    let count = 0;
    while (template && this.film === film && (await film.go(1))) {
      const found = findNear(film, template, expectedAt(this.marks[mass], film.time));
      if (!found) break;
      this.put(mass, found);
      count += 1;
      this.tell();
      this.page.wake();
    }
    this.searching = false;
    if (this.film !== film) return;
    this.lead();
    const ended = film.time > film.duration - 2 * film.step;
    const values = { mass: NAMES[mass], count };
    this.say(() => text(ended ? "filmFoundAll" : "filmLost", values));
  }

  /** Hand the points over as a trial. */
  use() {
    const { film, scale } = this;
    if (!film || scale === null) return;
    this.used = film.name.replace(/\.\w+$/, ".csv");
    this.page.trial.open(new File([this.table()], this.used));
  }

  /** The points as a plain table. */
  table() {
    const { axis, marks } = this;
    const [film, scale] = [/** @type {Film} */ (this.film), /** @type {number} */ (this.scale)];
    const times = [...new Set([...marks.light, ...marks.heavy].map(({ time }) => time))].sort((a, b) => a - b);
    // The tables of an MP4 file need none of it
    const all = [...new Set([this.release, ...times])].sort((a, b) => a - b);
    const even = film.times ? null : evenTimes(all, film.step);
    if (even) film.step = even.step;
    const timeOf = new Map(all.map((time, i) => [time, even ? even.times[i] : time]));
    const since = (/** @type {number} */ time) =>
      (/** @type {number} */ (timeOf.get(time)) - /** @type {number} */ (timeOf.get(this.release))) * this.factor;
    const placeOf = (/** @type {Mass} */ mass, /** @type {number} */ time) => {
      const mark = marks[mass].find((one) => one.time === time);
      return mark ? [(mark.x - axis.x) * scale, (axis.y - mark.y) * scale].map((x) => x.toFixed(6)) : ["", ""];
    };
    const masses = /** @type {Mass[]} */ (["light", "heavy"]).filter((mass) => marks[mass].length);
    const rows = times.filter((time) => since(time) >= 0)
      .map((time) => [since(time).toFixed(6), ...masses.flatMap((mass) => placeOf(mass, time))].join(","));
    const names = masses.map((mass) => `${mass}_x,${mass}_y`);
    return `t,${names.join(",")}\n${rows.join("\n")}\n`;
  }

  /** Draw the frame under all else. @param {import("../canvas.js").Context} c @param {View} view */
  draw(c, view) {
    const { film, axis } = this;
    if (!film) return;
    const scale = (this.scale ?? this.guess) * view.scale;
    const at = (/** @type {{x: number, y: number}} */ { x, y }) => [view.x(0) + (x - axis.x) * scale, view.y(0) + (y - axis.y) * scale];
    const [left, top] = at({ x: 0, y: 0 });
    c.drawImage(film.picture, left, top, film.width * scale, film.height * scale);
    const { pink, orange, blue } = colours();
    for (const mass of /** @type {Mass[]} */ (["light", "heavy"])) {
      for (const mark of this.marks[mass]) cross(c, at(mark), mark === this.newest ? pink : mass === "light" ? orange : blue);
    }
    if (this.end) cross(c, at(this.end), pink);
    if (this.newest && ["light", "heavy", "correct"].includes(this.task)) this.loupe(c, this.newest);
  }

  /** The place of a mark, enlarged. @param {import("../canvas.js").Context} c @param {Mark} mark */
  loupe(c, { x, y, time }) {
    const film = /** @type {Film} */ (this.film);
    if (Math.abs(film.time - time) > 1.5 * film.step) return;
    const { panel, pink, ink } = colours();
    c.fillStyle = panel;
    c.fillRect(0, 0, LOUPE_SIZE, LOUPE_SIZE);
    c.imageSmoothingEnabled = false;
    c.drawImage(film.picture, x + 0.5 - LOUPE, y + 0.5 - LOUPE, 2 * LOUPE, 2 * LOUPE, 0, 0, LOUPE_SIZE, LOUPE_SIZE);
    c.imageSmoothingEnabled = true;
    cross(c, [LOUPE_SIZE / 2, LOUPE_SIZE / 2], pink);
    write(c, text("filmLoupe"), 4, LOUPE_SIZE + 10, { colour: ink, size: 11 });
  }
}

/** @param {import("../canvas.js").Context} c @param {number[]} place @param {string} colour */
function cross(c, [x, y], colour) {
  c.beginPath();
  c.moveTo(x - 5, y);
  c.lineTo(x + 5, y);
  c.moveTo(x, y - 5);
  c.lineTo(x, y + 5);
  c.strokeStyle = colour;
  c.lineWidth = 1.5;
  c.stroke();
}
