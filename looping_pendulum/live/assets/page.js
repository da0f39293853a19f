/** The page: settings lead to a run, the run and the time to all that is drawn. */

import { keyOf } from "./arrows.js";
import { forgetColours, whenResized } from "./canvas.js";
import { CONTROLS, admit, linkOf, settingsOf, stateOf, withValue } from "./controls.js";
import { listenToStage, releasedAt } from "./dragging.js";
import { html } from "./elements.js";
import { EngineRuns } from "./engine_runs/engine_runs.js";
import { EventLog } from "./event_log.js";
import { FilmPanel } from "./film/panel.js";
import { FitPanel } from "./fit_panel.js";
import { Handout } from "./handout.js";
import { History } from "./history.js";
import { Speech } from "./language.js";
import { Keeping } from "./keeping.js";
import { listenToKeys } from "./keys.js";
import { LessonPanel } from "./lesson/panel.js";
import { HaltMap } from "./map.js";
import { MapCursor } from "./map_cursor.js";
import { changeOf, fillTable, resultOf, showEvents } from "./outcome.js";
import { OwnCurve } from "./own_curve.js";
import { Player } from "./player.js";
import { Plot, kindsOf } from "./plots.js";
import { ShownRun, durationOf } from "./shown_run.js";
import { Sliders } from "./sliders.js";
import { Stage } from "./stage.js";
import { Stopwatch } from "./stopwatch.js";
import { LANGUAGES, fixed, shown, text, textsOf } from "./texts.js";
import { Bench } from "./tools.js";
import { TrialPanel, nearest } from "./trial_panel.js";

/** @import { Preset, State } from "./controls.js" */
/** @import { DrawnRun } from "./shown_run.js" */
/** @typedef {{presets: Preset[], start: string, keys: Record<string, string>}} PageData */

const CENTIMETRES = 100;
/** Time without a further key after which a setting is one of its own [ms]. */
const PATIENCE = 1000;

/** @param {string} id */
function element(id) {
  const found = document.getElementById(id);
  if (!found) throw new Error(`the page has no element ${id}`);
  return found;
}

/** Everything on the page. */
class Page {
  /** @param {PageData} data @param {import("./engine_runs/motion.js").RunsData | null} runs stored runs of the first scenario
   * @param {string} source this script, which the worker runs, too */
  constructor(data, runs, source) {
    this.data = data;
    this.speech = new Speech(element, () => this.relabel());
    admit(data.presets);
    const first = data.presets.find(({ name }) => name === data.start) ?? data.presets[0];
    /** Link of each scenario's settings -> the scenario, the first of several that have the same ones. */
    this.presetOfLink = new Map(data.presets.toReversed().map((preset) => [linkOf(stateOf(preset)), preset]));
    this.history = new History(stateOf(first), this);
    this.engines = runs && new EngineRuns(runs, first, element, {
      onTime: (time) => this.player.stopAt(time),
      onSwitch: () => this.change(),
      onBack: () => this.set(stateOf(first)),
    });
    /** Duration of the scenario that was chosen last [s]. */
    this.longest = first.duration;
    this.run = this.runOf(this.state);
    /** @type {DrawnRun | null} */
    this.ghost = null;
    this.player = new Player(element, () => this.activeRuns?.duration ?? this.run.end, () => this.wake());
    this.stage = new Stage(/** @type {HTMLCanvasElement} */ (element("stage")));
    const stopwatch = new Stopwatch(element, () => this.player.time, (id, words) => this.say(id, words));
    this.bench = new Bench(element, this.stage, stopwatch, () => this.wake());
    /** Time at which the values of all plots are read; null while nobody reads them [s]. @type {number | null} */
    this.probe = null;
    /** @type {import("./plots.js").Times} */
    this.times = {
      onTime: (time) => this.player.stopAt(time),
      onProbe: (time) => {
        this.probe = time;
        this.wake();
      },
      time: () => this.player.time,
    };
    this.plots = kindsOf(runs !== null).map((kind) => this.plot(kind));
    const startWorker = () => new Worker(URL.createObjectURL(new Blob([source], { type: "text/javascript" })));
    const map = /** @type {HTMLCanvasElement} */ (element("map"));
    /** @type {(place: import("./map_cursor.js").Place) => void} */
    const pick = (place) => this.pick(place);
    const cursor = new MapCursor(map, element("map-reading"), () => this.state, pick, () => this.wake());
    this.map = new HaltMap(map, cursor, startWorker, pick, () => this.wake());
    this.log = new EventLog(element("event-log"));
    this.trial = new TrialPanel(element, () => this.change(), (file) => this.film.open(file));
    this.film = new FilmPanel(element, this);
    this.fit = new FitPanel(element, this.trial, startWorker, () => this.state, (values) => this.takeFit(values));
    this.ownCurve = new OwnCurve(element, this, this.times);
    this.keeping = new Keeping(element, this);
    this.handout = new Handout(element, this);
    this.lesson = new LessonPanel(element, this);
    this.sliders = new Sliders(element("settings"), element("more-settings"), this.select("release"), {
      current: () => this.state.values,
      onMove: (name, value) => this.move(withValue(this.state, name, value)),
      onSettle: (later) => (later ? this.settleSoon() : this.settle()),
      onRelease: (release) => this.set({ release, values: this.state.values }),
      onFault: (message, row) => this.fail(message, row),
    });
    /** Whether the settings have changed since the last frame. */
    this.changed = true;
    this.pending = false;
    /** Times that a change and its drawing took [ms], the newest last; for the benchmark. @type {number[]} */
    this.costs = [];
    this.frames = 0;
    this.listen();
    this.relabel();
    this.history.begin();
    this.change();
    if (this.engines?.belongTo(this.state)) this.play();
  }

  /** The stored runs while they belong to the settings. */
  get activeRuns() {
    return this.engines?.active ? this.engines : null;
  }

  get state() {
    return this.history.present;
  }

  /** @param {string} id */
  select(id) {
    return /** @type {HTMLSelectElement} */ (element(id));
  }

  /** @param {string} id */
  checked(id) {
    return /** @type {HTMLInputElement} */ (element(id)).checked;
  }

  /** @param {string} id @param {string | (() => string)} words a function if they shall stay in another language, too */
  say(id, words) {
    this.speech.say(id, words);
  }

  /** Say what is wrong, beside what it is about; if that is all settings, above them.
   * @param {string | (() => string)} words @param {HTMLElement} place */
  fail(words, place = element("story")) {
    place.after(element("fault"));
    this.say("fault", words);
  }

  /** Write all words of the page in its language. */
  relabel() {
    this.speech.fill();
    this.sliders.relabel();
    this.engines?.relabel();
    if (this.engines) document.title = text("pageTitleOf", { title: this.engines.title });
    for (const { kind, box } of this.plots) box.setAttribute("aria-label", text("plotLabel", { title: text(kind.title) }));
    const options = new Map([...this.select("preset").options].map((option) => [option.value, option]));
    for (const preset of this.data.presets) {
      /** @type {HTMLOptionElement} */ (options.get(preset.name)).text = textsOf(preset).title;
    }
    this.bench.relabel();
    this.ownCurve.relabel();
    this.trial.relabel();
    this.fit.relabel();
    this.lesson.relabel();
    this.change();
  }

  /** @param {import("./plots.js").Kind} kind */
  plot(kind) {
    const box = html("div", { className: "plot" });
    box.dataset.plot = kind.id;
    element("plots").append(box);
    return new Plot(box, kind, this.times);
  }

  listen() {
    window.addEventListener("error", ({ error }) => error && this.fail(() => text("pageFault")));
    window.addEventListener("unhandledrejection", () => this.fail(() => text("pageFault")));
    for (const { name, shipped } of this.data.presets) {
      const option = new Option("", name);
      option.toggleAttribute("lang", !shipped); // the language of a reader's own title is not known
      this.select("preset").append(option);
    }
    this.select("language").addEventListener("change", () => {
      this.speech.speak(this.select("language").value);
      this.history.save();
    });
    this.select("preset").addEventListener("change", () => {
      const preset = this.data.presets.find(({ name }) => name === this.select("preset").value);
      if (preset) this.set(stateOf(preset));
    });
    element("undo").addEventListener("click", () => this.go("undo"));
    element("redo").addEventListener("click", () => this.go("redo"));
    for (const id of ["ghost", "forces", "velocity", "acceleration"]) element(id).addEventListener("change", () => this.change());
    element("table-of-run").addEventListener("toggle", () => this.table());
    const left = element("left");
    element("full").hidden = !document.fullscreenEnabled; // telephones of some makers
    element("full").addEventListener("click", () => {
      if (document.fullscreenElement) document.exitFullscreen();
      else left.requestFullscreen();
    });
    // What a finger reads in a plot ends where it touches something else
    document.addEventListener("pointerdown", ({ target }) => {
      if (this.probe !== null && target instanceof Element && !target.closest(".plot")) this.times.onProbe(null);
    });
    listenToKeys(this);
    whenResized(() => this.change());
    Theme.onChange(() => {
      forgetColours();
      this.speech.nameTheme();
      this.change();
    });
    listenToStage(this.stage, {
      lightMass: () => this.run.at(this.player.time).light,
      onTake: () => this.player.stopAt(0),
      onMove: (place) => this.move(releasedAt(this.state, place)),
      onLetGo: () => {
        this.settle();
        this.play();
      },
    });
  }

  /** Play, unless the reader wants nothing to move; return whether it plays. */
  play() {
    const moves = !window.matchMedia("(prefers-reduced-motion: reduce)").matches;
    if (moves) this.player.play();
    return moves;
  }

  /** @param {number} time */
  stopAt(time) {
    this.player.stopAt(time);
  }

  /** Go to the next moment of the stored runs, or with -1 to the one before; return whether there are any.
   * @param {number} direction */
  goToMoment(direction) {
    const runs = this.activeRuns;
    if (runs) this.player.stopAt(runs.moment(direction, this.player.time));
    return runs !== null;
  }

  /** Show a state that is on its way. @param {State} state */
  move(state) {
    this.history.present = state;
    this.say("fault", "");
    this.change();
  }

  /** Keep what is shown as a setting of its own when no further key follows. */
  settleSoon() {
    clearTimeout(this.settling);
    this.settling = window.setTimeout(() => this.settle(), PATIENCE);
  }

  settling = 0;

  /** Keep what is shown as a setting of its own. */
  settle() {
    clearTimeout(this.settling);
    this.history.settle();
    this.change();
  }

  /** @param {State} state */
  set(state) {
    this.history.settle();
    this.move(state);
    this.settle();
    this.player.stopAt(0);
  }

  /** Set what a fit found. @param {Record<string, number>} values */
  takeFit(values) {
    let { state } = this;
    const { time } = this.player;
    for (const { name } of CONTROLS) if (name in values) state = withValue(state, name, values[name]);
    this.set(state);
    // Whoever corrects the points of a film goes on at the frame that is shown
    this.player.stopAt(time);
  }

  /** @param {import("./map_cursor.js").Place} place */
  pick({ release_angle, mass_ratio }) {
    this.set(withValue(withValue(this.state, "release_angle", release_angle), "mass_ratio", mass_ratio));
  }

  /** @param {"undo" | "redo"} where in the history */
  go(where) {
    this.say("fault", "");
    this.history[where]();
  }

  /** The settings or what is shown of the run have changed. */
  change() {
    this.changed = true;
    this.wake();
  }

  wake() {
    if (this.pending) return;
    this.pending = true;
    requestAnimationFrame((now) => this.frame(now));
  }

  /** @param {number} now */
  frame(now) {
    this.pending = false;
    const started = performance.now();
    const { time, playing } = this.player;
    this.player.advance(now);
    const { changed } = this;
    this.changed = false;
    if (changed) this.compute();
    if (playing) this.log.played(this.run, time, this.player.time);
    this.draw();
    if (changed) this.showKey();
    this.frames += 1;
    if (changed) this.costs.push(performance.now() - started);
    if (this.player.playing) this.wake();
    else this.keeping.endFilm();
  }

  /** Run the model, and show all that does not move with the time. */
  compute() {
    const { state } = this;
    this.sliders.show(state);
    this.engines?.show(state);
    const runs = this.activeRuns;
    const link = linkOf(state);
    if (link !== this.computed) {
      // A scenario may last longer than runs are watched else; a change of its settings leaves that as it is
      this.longest = this.presetOfLink.get(link)?.duration ?? this.longest;
      try {
        this.run = this.runOf(state);
      } catch (error) {
        const isTooShort = error instanceof RangeError && error.message.startsWith("free_length");
        this.fail(() => text(isTooShort ? "tooShort" : "cannotRun"));
      }
      this.computed = link;
    }
    this.ghost = this.ghostOf(this.lesson.beside(state, this.history.before));
    this.player.time = Math.min(this.player.time, this.player.end());
    for (const plot of this.plots) {
      plot.box.hidden = this.engines?.hides(plot.kind.id) ?? false;
      if (!plot.box.hidden) plot.show(this.run, this.ghost, runs);
    }
    const preset = this.presetOfLink.get(link);
    this.select("preset").value = preset?.name ?? "";
    element("story").toggleAttribute("lang", preset?.shipped === false);
    this.say("story", preset ? textsOf(preset).description : "");
    this.button("undo").disabled = !this.history.canUndo;
    this.button("redo").disabled = !this.history.canRedo;
    this.say("heavy-mass", `M2 = ${shown(Number((state.values.light_mass * state.values.mass_ratio).toPrecision(4)))} g`);
    this.say("result", resultOf(this.run));
    this.say("compared", changeOf(this.run, this.ghost));
    this.say("map-state", state.release === "looping" ? (this.engines?.noteOnMap ?? "") : text("mapNoLoop"));
    this.trial.show(this.run);
    this.ownCurve.show(this.run);
    this.map.show(state);
    showEvents(element("events"), this.run, (time) => this.player.stopAt(time));
    this.table();
  }

  computed = "";

  /** @param {string} id */
  button(id) {
    return /** @type {HTMLButtonElement} */ (element(id));
  }

  /** @param {State} state @returns {DrawnRun} @throws {RangeError} if the apparatus is impossible */
  runOf(state) {
    const shown = this.engines?.belongTo(state) ? this.engines.duration : Math.max(durationOf(state.release), this.longest);
    return this.engines?.standIn(state) ?? new ShownRun(settingsOf(state), shown);
  }

  ghostLink = "";

  /** @param {State | null} before @returns {DrawnRun | null} */
  ghostOf(before) {
    if (!before || !this.checked("ghost")) return null;
    const link = linkOf(before);
    if (this.ghost && link === this.ghostLink) return this.ghost;
    this.ghostLink = link;
    try {
      return this.runOf(before);
    } catch {
      return null; // what cannot be built leaves no ghost
    }
  }

  /** Which arrows are shown; of a stored run nobody knows them. @returns {import("./arrows.js").ShownArrows} */
  get arrows() {
    const isKnown = this.state.stored === undefined;
    const [forces, velocity, acceleration] = ["forces", "velocity", "acceleration"].map((id) => isKnown && this.checked(id));
    return { forces, velocity, acceleration };
  }

  /** Say what the arrows are, as long as the stage has them. */
  showKey() {
    const { size, enlarged } = this.stage;
    const items = keyOf(this.run, this.arrows, size.height, enlarged);
    element("key").hidden = !items.length;
    element("key").replaceChildren(...items);
  }

  /** The run as a table, when it is open. */
  table() {
    if (/** @type {HTMLDetailsElement} */ (element("table-of-run")).open) {
      fillTable(/** @type {HTMLTableElement} */ (element("table")), this.run);
    }
  }

  /** Draw all that moves with the time. */
  draw() {
    const { time } = this.player;
    const runs = this.activeRuns;
    this.film.follow(time);
    runs?.draw(time);
    const film = this.lesson.points;
    const points = film ? { light: film, heavy: [] } : { light: this.trial.points("light"), heavy: this.trial.points("heavy") };
    this.stage.draw({
      run: this.run,
      ghost: this.ghost,
      time,
      arrows: this.arrows,
      runs,
      film: this.film,
      points: { light: points.light.map(([, x, y]) => [x, y]), heavy: points.heavy.map(([, x, y]) => [x, y]) },
      now: { light: nearest(points.light, time), heavy: nearest(points.heavy, time) },
    });
    this.bench.draw();
    for (const plot of this.plots) if (!plot.box.hidden) plot.draw(time, this.probe);
    this.ownCurve.drawTime(time, this.probe);
    this.map.draw(this.state);
    const [least, most] = this.map.range.map((drop) => (Number.isFinite(drop) ? `${fixed(CENTIMETRES * drop, 0)} cm` : ""));
    this.say("map-least", least);
    this.say("map-most", most);
    const mode = text(`mode.${this.run.at(time).mode}`);
    this.player.draw(mode);
    this.lesson.watch(this.run, time);
    this.say("doing", time === 0 ? text("start") : (runs?.withLastMoment(mode, time) ?? mode));
  }
}

/** Show the page in place of the words that stand where no script runs. */
export function showPage() {
  element("no-start").remove();
  element("page").hidden = false;
}

/** Say in one sentence, in place of the page, why it does not run. @param {import("./texts.js").TextKey} key */
export function sayThatNothingRuns(key) {
  const speech = new Speech(element, () => speech.fill());
  element("main").replaceChildren(html("p", { id: "fault", role: "alert" }));
  speech.select.addEventListener("change", () => speech.speak(speech.select.value));
  speech.say("fault", () => text(key));
  speech.fill();
}

/** Start the page. @param {string} source text of the script that runs */
export function startPage(source) {
  const read = (/** @type {string} */ id) => JSON.parse(element(id).textContent ?? "");
  // For tests and benchmarks, which look at what the page draws
  const live = new Page(read("live-data"), read("engine-runs-data"), source);
  Object.assign(window, { live, liveControls: CONTROLS, liveLanguages: LANGUAGES });
}
