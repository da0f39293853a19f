/** Runs of engines that `compare` stored, drawn beside the page's own while its settings are those of their scenario. */

import { linkOf, settingsOf, stateOf } from "../controls.js";
import { fixed, namesOf, text, textsOf } from "../texts.js";
import { drawCurves, drawDots, rangeOf, valuesAt } from "./curves.js";
import { nameOf } from "./shapes.js";
import { SAME_TIME, modeAt, placeOf } from "./motion.js";
import { MEASURED, NumbersNow, listOfRuns, momentsAndSources } from "./panel.js";
import { StageRuns } from "./stage_runs.js";
import { StoredRun } from "./stored_run.js";
import { Timeline, fillKey } from "./timeline.js";

/** @import { Preset, State } from "../controls.js" */
/** @import { Context } from "../canvas.js" */
/** @import { Plot } from "../plots.js" */
/** @import { RunsData } from "./motion.js" */

export class EngineRuns {
  /**
   * @param {RunsData} data
   * @param {Preset} preset scenario whose runs they are
   * @param {(id: string) => HTMLElement} element
   * @param {{onTime: (time: number) => void, onSwitch: () => void, onBack: () => void}} callbacks
   */
  constructor(data, preset, element, { onTime, onSwitch, onBack }) {
    this.data = data;
    this.preset = preset;
    this.element = element;
    this.duration = data.duration;
    this.link = linkOf(stateOf(preset));
    /** Whether the settings are those of the runs. */
    this.active = false;
    this.shown = new Set(data.runs.filter(({ count }) => count).map(({ id }) => id));
    if (data.trial) this.shown.add(MEASURED);
    /** @type {Map<string, string>} */
    this.colourOf = new Map();
    this.stage = new StageRuns(data);
    this.corners = this.stage.corners;
    this.timeline = new Timeline(data, element("timeline"), element("time"), onTime);
    this.onTime = onTime;
    this.onSwitch = onSwitch;
    this.back = element("engine-back");
    this.back.addEventListener("click", onBack);
    for (const id of ["engine-notices", "engine-runs"]) element(id).hidden = false;
    this.numbers = new NumbersNow(data);
    /** @type {StoredRun | null} */
    this.stored = null;
  }

  /** Write all words anew that do not change with the settings or the time; what was opened stays open. */
  relabel() {
    const { data, element, shown } = this;
    const folds = () => ["engine-runs", "engine-details"].flatMap((id) => [...element(id).querySelectorAll("details")]);
    const open = folds().map((fold) => fold.open);
    element("engine-runs").replaceChildren(listOfRuns(data, shown, (id, on) => {
      if (on) shown.add(id);
      else shown.delete(id);
      this.onSwitch();
    }));
    this.numbers = new NumbersNow(data);
    element("engine-details").replaceChildren(this.numbers.element, ...momentsAndSources(data, this.onTime));
    folds().forEach((fold, i) => { fold.open = open[i] ?? false; });
    fillKey(data, element("moment-key"));
    this.back.textContent = text("backTo", { title: this.title });
  }

  /** Title of the scenario whose runs they are. */
  get title() {
    return textsOf(this.preset).title;
  }

  /** Runs that are switched on, the reference first. */
  get runs() {
    return this.data.runs.filter(({ id }) => this.shown.has(id));
  }

  /** Whether the runs are of these settings. @param {State} state */
  belongTo(state) {
    return linkOf(state) === this.link;
  }

  /** The stored reference, where the page's model cannot move as the scenario does; null where it can. @param {State} state */
  standIn(state) {
    if (!this.preset.lacks.length || !this.belongTo(state)) return null;
    this.stored ??= new StoredRun(this.data, settingsOf(state));
    return this.stored;
  }

  /** Show whether the runs belong to the settings, and lay out what does not move with the time. @param {State} state */
  show(state) {
    this.active = this.belongTo(state);
    this.colourOf = new Map(this.data.runs.map(({ id, colour }) => [id, Theme.colour(colour)]));
    for (const id of ["timeline", "moment-key", "engine-details"]) this.element(id).hidden = !this.active;
    document.body.classList.toggle("with-runs", this.active);
    /** @type {HTMLFieldSetElement} */ (this.element("engine-runs").firstElementChild).disabled = !this.active;
    this.back.hidden = this.active;
    for (const id of ["save-numbers", "save-scenario", "forces", "velocity", "acceleration"]) {
      const control = /** @type {HTMLButtonElement | HTMLInputElement} */ (this.element(id));
      control.disabled = this.standsIn;
      control.title = this.standsIn ? text("notKnown") : "";
    }
    const { lacks } = this.preset;
    const without = lacks.length ? text(this.active ? "standIn" : "without", { effects: namesOf(lacks) }) : "";
    const words = [this.active ? "" : text("otherSettings", { title: this.title }), without].join(" ").trim();
    const notice = this.element("engine-notice");
    if (notice.textContent !== words) notice.textContent = words;
    if (this.active) this.timeline.layout();
  }

  /** Whether the stored reference is shown in place of a live run. */
  get standsIn() {
    return this.active && this.preset.lacks.length > 0;
  }

  /** Whether nobody knows what a plot shows: energies of a stored run, distances from the reference with other settings.
   * @param {string} plot */
  hides(plot) {
    return plot === "energy" ? this.standsIn : plot === "distance" && !this.active;
  }

  /** What is to be said of the map, which the page's model computes. */
  get noteOnMap() {
    return this.standsIn ? text("mapWithout", { effects: namesOf(this.preset.lacks) }) : "";
  }

  /** What does not show on the canvases, at a time. @param {number} time */
  draw(time) {
    this.timeline.draw(time, this.shown);
    this.numbers.draw(time, this.shown);
  }

  /** @param {Context} c @param {import("../stage.js").View} view @param {number} time */
  drawStage(c, view, time) {
    this.stage.draw(c, view, this.stage.at(this.runs, this.colourOf, time), time, modeAt(this.data, time).endsWith("slack"));
    if (this.shown.has(MEASURED)) this.stage.points(c, view, time);
  }

  /** @param {Context} c @param {{left: number, width: number, height: number}} place @param {number} time */
  drawRod(c, place, time) {
    this.stage.rod(c, this.stage.at(this.runs, this.colourOf, time), place);
  }

  /** Lowest and highest value of a plot. @param {string} plot */
  range(plot) {
    return rangeOf(this.data, plot);
  }

  /** @param {Context} c @param {Plot} plot */
  drawCurves(c, plot) {
    drawCurves(c, plot, this.data, this.runs, this.colourOf, this.shown.has(MEASURED));
  }

  /** @param {Context} c @param {Plot} plot @param {number} time */
  drawDots(c, plot, time) {
    drawDots(c, plot, this.data, this.runs, this.colourOf, time);
  }

  /** What a plot shows of each run at a time. @param {string} plot @param {number} time */
  readings(plot, time) {
    return valuesAt(plot, this.data, this.runs, time).map(({ run, value }) => ({ name: nameOf(run), value }));
  }

  /** The next moment of a shown run, or with -1 the one before; the same time where there is none.
   * @param {number} direction @param {number} time */
  moment(direction, time) {
    const times = this.runs.flatMap(({ events }) => events.map(({ t }) => direction * t));
    const ahead = times.filter((t) => t - direction * time > SAME_TIME);
    return ahead.length ? direction * Math.min(...ahead) : time;
  }

  /** What is to be seen, and the last moment of the reference. @param {string} doing @param {number} time */
  withLastMoment(doing, time) {
    const last = this.data.runs[0].events.findLast(({ t }) => t <= time + SAME_TIME);
    return last ? text("lastMoment", { doing, moment: text(`moment.${last.kind}`), time: fixed(last.t, 4) }) : doing;
  }

  /** Where a run is, for tests. @param {string} id @param {number} time */
  place(id, time) {
    const run = this.data.runs.find((one) => one.id === id);
    return run ? placeOf(this.data, run, time) : null;
  }
}
