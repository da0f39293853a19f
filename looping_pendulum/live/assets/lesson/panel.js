/** The lesson on the page: asks for a prediction, sets what a step says, and tells what the run says. */

import { parsed, same, settingsOf } from "../controls.js";
import { html } from "../elements.js";
import { remainderInWords } from "../fit_panel.js";
import { ShownRun } from "../shown_run.js";
import { fixed, shown, text, withUnit } from "../texts.js";
import { resultOf } from "../outcome.js";
import { Classroom } from "./classroom.js";
import { TYPICAL_SCATTER, filmedPoints, madeUpTrial } from "./made_up.js";
import { STEPS, distanceOf, filmedState, isOfRatioStep, judgeRatio, judgeTrial, lowestRatio, placeOfRatio, trialState } from "./steps.js";
import { workOf } from "./work.js";

/** @import { State } from "../controls.js" */
/** @import { DrawnRun } from "../shown_run.js" */
/** @import { Judgement, Step } from "./steps.js" */
/**
 * @typedef {{state: State, run: DrawnRun, set: (state: State) => void, change: () => void, play: () => boolean,
 *   stopAt: (time: number) => void, trial: import("../trial_panel.js").TrialPanel, history: import("../history.js").History,
 *   fit: import("../fit_panel.js").FitPanel}} LessonPage what the lesson needs of the page; `play`: false if nothing is to move
 */

const MILLIMETRES = 1000;
/** Task -> control to which the student goes. */
const CONTROL_OF_TASK = { ratio: "range-mass_ratio", drag: "range-light_drag", trial: "trial-file" };
const MADE_UP_FILE = "made-up.csv";
/** Time after which a search is named: a shorter one would only flicker [ms]. */
const LONG_SEARCH = 300;

/** The steps, one of which is open, and what was predicted and answered in each. */
export class LessonPanel {
  /** @param {(id: string) => HTMLElement} element @param {LessonPage} page */
  constructor(element, page) {
    this.element = element;
    this.page = page;
    this.place = 0;
    this.works = STEPS.map((step) => workOf(step));
    /** What is said of each step in place of its judgement, until that. @type {((() => string) | null)[]} */
    this.hints = STEPS.map(() => null);
    this.classroom = new Classroom(element, () => this.results, () => page.history.saveSoon());
    /** What a step set, and beside which state its run is shown. @type {{name: string, state: State, beside: State | null} | null} */
    this.given = null;
    /** Step whose run is being watched. @type {Step | null} */
    this.watched = null;
    /** Whether the run is to be shown as it is when it was seen, since nothing is to move. */
    this.jumps = false;
    /** Film of the step of a wrong drag. @type {{hidden: number, run: DrawnRun, points: [number, number, number][]} | null} */
    this.film = null;
    /** Seeds of the next film and of the next trial that is made up. */
    this.seeds = { film: 1, trial: 1 };
    /** The lowest ratio of its step, once it was asked for. @type {Promise<number> | null} */
    this.lowest = null;
    /** Wind in the trial that was made up last [m/s]. */
    this.wind = 0;
    element("lesson-steps").append(...STEPS.map((_, place) => {
      const button = html("button", { type: "button" }, String(place + 1));
      button.addEventListener("click", () => this.open(place));
      return html("li", {}, button);
    }));
    element("lesson-change").addEventListener("click", () => this.change());
    element("lesson-check").addEventListener("click", () => this.check());
    element("lesson-next").addEventListener("click", () => this.open((this.place + 1) % STEPS.length));
    element("lesson-go").addEventListener("click", () => this.go());
    element("lesson-anew").addEventListener("click", () => this.beginAnew([this.place]));
    element("class-anew").addEventListener("click", () => {
      this.classroom.name.value = "";
      this.beginAnew([...STEPS.keys()]);
    });
    element("lesson").addEventListener("toggle", () => page.history.saveSoon());
  }

  /** What is to be there again when the page is opened anew. */
  get record() {
    const { place, works, seeds, given, isOpen: open, classroom } = this;
    const set = STEPS.findIndex((step) => step.name === given?.name);
    return { place, open, works, seeds, set, name: classroom.name.value };
  }

  /** Whether there is nothing that could be lost. */
  get isEmpty() {
    return !this.results.size && !this.classroom.record;
  }

  get isOpen() {
    return /** @type {HTMLDetailsElement} */ (this.element("lesson")).open;
  }

  /** Take up what was kept; of anything else nothing is taken. @param {any} kept a `record` @param {unknown} lines of the class */
  restore(kept, lines) {
    const { place, open, works, seeds, set, name } = kept ?? {};
    this.works = STEPS.map((step, i) => workOf(step, Array.isArray(works) ? works[i] : null));
    for (const what of /** @type {("film" | "trial")[]} */ (["film", "trial"])) {
      if (Number.isInteger(seeds?.[what])) this.seeds[what] = Math.max(1, seeds[what]);
    }
    /** @type {HTMLDetailsElement} */ (this.element("lesson")).open = open === true;
    this.classroom.restore(name, lines);
    if (this.works.some((work, i) => STEPS[i].task === "drag" && work.counted) && this.seeds.film > 1) {
      this.seeds.film -= 1;
      this.makeFilm();
    }
    this.take(Number.isInteger(set) ? STEPS[set] : undefined);
    this.show(Number.isInteger(place) && STEPS[place] ? place : 0);
  }

  /** Go on with the step that was set last. @param {Step | undefined} step */
  take(step) {
    const work = step && this.works[STEPS.indexOf(step)];
    const state = step?.state();
    if (!step || !work?.counted || !state) return;
    this.given = { name: step.name, state, beside: step.beside?.() ?? null };
    if (work.judgement) return;
    if (step.judge) this.watched = step;
    this.tell(() => text(step.judge ? "lessonWatch" : `lesson.${step.name}.task`), STEPS.indexOf(step));
  }

  /** Forget what was predicted and found in steps. @param {number[]} places */
  beginAnew(places) {
    for (const place of places) {
      const step = STEPS[place];
      this.works[place] = workOf(step);
      this.hints[place] = null;
      if (this.watched === step) this.watched = null;
      if (this.given?.name === step.name) this.given = null;
      if (step.task === "drag") this.film = null;
    }
    this.relabel();
    this.page.change();
    this.page.history.save();
    this.element("lesson-name").focus();
  }

  get step() {
    return STEPS[this.place];
  }

  get work() {
    return this.works[this.place];
  }

  /** Open a step, to which the browser's Back leads back. @param {number} place */
  open(place) {
    if (place !== this.place) {
      this.page.history.settle();
      this.show(place);
      this.page.history.add();
    }
    this.element("lesson-name").focus();
  }

  /** @param {number} place */
  show(place) {
    this.place = place;
    this.relabel();
    this.page.change();
  }

  go() {
    const { task } = this.step;
    if (task) this.element(task === "trial" && this.page.trial.trial ? "trial-fit" : CONTROL_OF_TASK[task]).focus();
  }

  /** Write the open step in the language of the page. */
  relabel() {
    const { step } = this;
    const say = (/** @type {string} */ id, /** @type {string} */ words) => (this.element(id).textContent = words);
    say("lesson-name", text("lessonStep", { number: this.place + 1, name: text(`lesson.${step.name}.title`) }));
    for (const part of ["text", "question"]) say(`lesson-${part}`, text(`lesson.${step.name}.${part}`));
    const isTrial = step.task === "trial";
    say("lesson-change", text(isTrial ? "lessonMakeTrial" : "lessonChange"));
    say("lesson-go", text(isTrial ? "lessonGoToTrial" : "lessonGo"));
    for (const id of ["lesson-check", "lesson-go"]) this.element(id).hidden = !step.task;
    this.element("lesson-options").replaceChildren(...(step.options.length ? this.choices(step) : this.numberFields(step)));
    this.showAnswer();
    this.classroom.show();
  }

  /** @param {Step} step */
  choices({ name, options }) {
    return options.map((option) => {
      const radio = html("input", { type: "radio", name: "lesson-option", value: option, checked: this.work.prediction === option });
      radio.addEventListener("change", () => this.predict(option));
      return html("label", {}, radio, text(`lesson.${name}.${option}`));
    });
  }

  /** @param {Step} step */
  numberFields({ unit }) {
    const words = unit ? text("lessonNumber", { unit }) : text("lessonPlainNumber");
    return [
      numberField("lesson-number", words, this.work.prediction, (typed) => this.predict(typed)),
      numberField("lesson-measured", text("lessonMeasured"), this.work.measured, (typed) => {
        const number = parsed(typed);
        this.work.measured = number > 0 ? String(number) : "";
        this.classroom.show();
        this.page.history.saveSoon();
      }),
    ];
  }

  /** @param {string} said an option, or a number as it was typed */
  predict(said) {
    this.work.prediction = said;
    this.page.history.saveSoon();
  }

  /** Count a prediction, from the press of the button on: nobody need wait for the end of the run. @param {string} said */
  count(said) {
    if (said !== this.work.counted) this.work.judgement = null;
    this.work.counted = said;
    this.classroom.show();
    this.page.history.saveSoon();
  }

  /** Name of each step of which something was predicted or measured -> what was said of it. */
  get results() {
    const known = this.works.map(({ counted, measured, judgement }, i) => {
      return { name: STEPS[i].name, said: counted, found: String(judgement?.found ?? ""), measured };
    });
    return new Map(known.filter(({ said, measured }) => said || measured).map(({ name, ...result }) => [name, result]));
  }

  /** The prediction of the open step; where there is none, that is said, and it is "". */
  get said() {
    const said = this.work.prediction;
    if (this.step.options.length) {
      if (!said) this.tell(() => text("lessonNoPrediction"));
      return said;
    }
    const number = parsed(said);
    if (number > 0) return String(number);
    this.tell(() => text("lessonNoNumber"));
    return "";
  }

  /** @param {() => string} words @param {number} place of the step that they are about */
  tell(words, place = this.place) {
    this.hints[place] = words;
    this.showAnswer();
  }

  showAnswer() {
    const { hints, works, place: open } = this;
    const { judgement } = this.work;
    const hint = hints[open];
    // A hint that comes later is neither right nor wrong, and does not take back what a step has shown
    const tone = hint || !judgement ? "" : toneOf(judgement);
    const now = hint ? hint() : judgement ? answerInWords(this.step, this.work.counted, judgement) : "";
    this.element("lesson-answer").className = tone;
    if (this.element("lesson-answer").textContent !== now) this.element("lesson-answer").textContent = now;
    [...this.element("lesson-steps").querySelectorAll("button")].forEach((button, place) => {
      const verdict = works[place].judgement ? toneOf(works[place].judgement) : "";
      const key = { "": "lessonStep", right: "lessonStepRight", wrong: "lessonStepWrong" }[verdict];
      const name = text(`lesson.${STEPS[place].name}.title`);
      button.setAttribute("aria-label", text(/** @type {import("../texts.js").TextKey} */ (key), { number: place + 1, name }));
      button.textContent = `${place + 1}${{ "": "", right: "\u00a0✓", wrong: "\u00a0·" }[verdict]}`;
      if (place === open) button.setAttribute("aria-current", "step");
      else button.removeAttribute("aria-current");
    });
  }

  /** Set what the step says, and have its run played. */
  change() {
    const { step, said } = this;
    if (!said) return;
    this.count(said);
    const state = step.state();
    if (!state) {
      this.makeTrial();
      return;
    }
    if (step.task === "drag") this.makeFilm();
    this.given = { name: step.name, state, beside: step.beside?.() ?? null };
    this.watched = step;
    this.page.set(state);
    if (step.forces) this.tick("forces");
    if (step.beside) this.tick("ghost");
    this.tell(() => text("lessonWatch"));
    this.jumps = !this.page.play();
  }

  /** Have shown what a step speaks of. @param {string} id of a checkbox */
  tick(id) {
    /** @type {HTMLInputElement} */ (this.element(id)).checked = true;
  }

  /** State whose run is the ghost beside that of a state; null: a step set it, and wants none. @param {State} state
   * @param {State | null} before whose ghost a state has that no step set */
  beside(state, before) {
    return this.given && same(state, this.given.state) ? this.given.beside : before;
  }

  /** Points of the film while its step is open. */
  get points() {
    return this.isOpen && this.step.task === "drag" && this.film ? this.film.points : null;
  }

  /** Look at the run that is shown: once it has been seen for long enough, tell what it says.
   * @param {DrawnRun} run @param {number} time */
  watch(run, time) {
    const step = this.watched;
    if (!step || !this.given) return;
    const place = STEPS.indexOf(step);
    if (!same(this.page.state, this.given.state)) {
      this.watched = null;
      this.tell(() => text("lessonLeft"), place);
      return;
    }
    if (this.jumps) {
      this.jumps = false;
      this.page.stopAt(step.seenAt(run));
      return;
    }
    if (time < step.seenAt(run)) return;
    this.watched = null;
    const { beside } = this.given;
    const other = step.task === "drag" ? (this.film?.run ?? null) : beside && new ShownRun(settingsOf(beside));
    if (step.judge) this.judge(step, step.judge(this.works[place].counted, run, other));
    else this.tell(() => text(`lesson.${step.name}.task`), place);
  }

  /** Keep and tell what a run or a fit says of a prediction. @param {Step} step @param {Judgement} judgement */
  judge(step, judgement) {
    const place = STEPS.indexOf(step);
    this.works[place].judgement = judgement;
    this.hints[place] = null;
    this.showAnswer();
    this.classroom.show();
    this.page.history.saveSoon();
  }

  check() {
    const { step, said, work } = this;
    if (!said) return;
    this.count(work.counted || said);
    if (step.task === "ratio") this.checkRatio(step);
    else if (step.task === "drag") this.checkDrag();
    else this.checkTrial(step);
  }

  /** @param {Step} step */
  async checkRatio(step) {
    const { state, run } = this.page;
    const { place, work } = this;
    if (!isOfRatioStep(state)) {
      this.tell(() => text("lessonLeft"));
      return;
    }
    const isLong = window.setTimeout(() => this.tell(() => text("lessonSearching"), place), LONG_SEARCH);
    const ratio = state.values.mass_ratio;
    this.lowest ??= searched(lowestRatio(state));
    const lowest = await this.lowest;
    clearTimeout(isLong);
    if (this.works[place] !== work) return; // begun anew in the meantime
    const found = placeOfRatio(ratio, run.halt !== null, lowest);
    if (found === "lowest") this.judge(step, { ...judgeRatio(work.counted, ratio, lowest), ratio });
    else {
      const hints = { never: "lessonNever", gap: "lessonGap", high: "lessonHigh" };
      this.tell(() => text(/** @type {import("../texts.js").TextKey} */ (hints[found]), { ratio, result: resultOf(run) }), place);
    }
  }

  checkDrag() {
    const { film, page } = this;
    if (!film) {
      this.tell(() => text("lessonFirst", { command: text("lessonChange") }));
      return;
    }
    const { distance, fits } = distanceOf(film.points, page.run);
    const drag = page.state.values.light_drag;
    this.tell(() => text(fits ? "lessonNear" : "lessonFar", {
      distance: fixed(MILLIMETRES * distance, 1), scatter: fixed(MILLIMETRES * TYPICAL_SCATTER, 1), drag, hidden: film.hidden,
    }));
  }

  /** @param {Step} step */
  checkTrial(step) {
    const { trial, fit } = this.page;
    const { fitted } = fit;
    if (!trial.trial) this.tell(() => text("lessonNeedsTrial"));
    else if (!fitted || fitted.file !== trial.file) this.tell(() => text("lessonNeedsFit"));
    else {
      const wind = trial.file?.name === MADE_UP_FILE ? this.wind : undefined;
      this.judge(step, { ...judgeTrial(this.work.counted, fitted.isNoise, fitted.after), tests: fitted.tests, wind });
    }
  }

  makeFilm() {
    const state = filmedState(this.seeds.film);
    const run = new ShownRun(settingsOf(state));
    this.film = { hidden: state.values.light_drag, run, points: filmedPoints(run, this.seeds.film) };
    this.seeds.film += 1;
  }

  makeTrial() {
    const state = trialState();
    const { csv, wind } = madeUpTrial(state, this.seeds.trial);
    this.seeds.trial += 1;
    this.wind = wind;
    this.page.set(state);
    // Where to go on stands in the lesson, with a button that leads there
    this.page.trial.open(new File([csv], MADE_UP_FILE), false);
    this.tell(() => text("lessonTrialMade"));
  }
}

/** What a search finds in the end; between two of its runs the page goes on. @param {Generator<void, number>} search
 * @returns {Promise<number>} */
function searched(search) {
  return new Promise((find) => {
    const next = () => {
      const { done, value } = search.next();
      if (done) find(value);
      else setTimeout(next, 0);
    };
    next();
  });
}

/** @param {Judgement} judgement */
const toneOf = ({ right }) => (right ? "right" : "wrong");

/** What was said, what was found, and why. @param {Step} step @param {string} said @param {Judgement} judgement */
function answerInWords(step, said, judgement) {
  const { found, right, values } = judgement;
  const worded = (/** @type {string | number} */ answer) =>
    step.options.length ? text(`lesson.${step.name}.${answer}`) : withUnit(shown(answer), step.unit);
  return [
    text(step.task === "trial" ? "lessonSaidOfFit" : "lessonSaid", { said: worded(said), found: worded(found) }),
    text(right ? "lessonRight" : "lessonWrong"),
    text(`lesson.${step.name}.why`, values),
    moreInWords(step, judgement),
  ].join(" ").trim();
}

/** What is said beyond the explanation: what was left by a fit, which ratio was found, or what is to be done next.
 * @param {Step} step @param {Judgement} judgement */
function moreInWords({ name, task }, { tests, wind, ratio }) {
  if (ratio) return text("lessonRatioFound", { ratio });
  if (task === "drag") return text(`lesson.${name}.task`);
  if (!tests) return "";
  const origin = wind === undefined ? "" : wind ? text("lessonWind", { wind }) : text("lessonNoWind");
  return `${remainderInWords(tests)} ${origin}`;
}

/** @param {string} id @param {string} words @param {string} value @param {(typed: string) => void} onInput */
function numberField(id, words, value, onInput) {
  const field = html("input", { type: "text", id, inputMode: "decimal", autocomplete: "off", value: shown(value) });
  field.addEventListener("input", () => onInput(field.value));
  return html("label", {}, words, field);
}
