/** The lesson on the page: asks for a prediction, sets what a step says, and tells what the run says. */

import { parsed, same, settingsOf } from "../controls.js";
import { ShownRun } from "../shown_run.js";
import { fixed, shown, text, withUnit } from "../texts.js";
import { resultOf } from "../outcome.js";
import { Classroom } from "./classroom.js";
import { TYPICAL_SCATTER, filmedPoints, madeUpTrial } from "./made_up.js";
import { STEPS, distanceOf, filmedState, isOfRatioStep, judgeRatio, judgeTrial, lowestRatio, placeOfRatio, trialState } from "./steps.js";

/** @typedef {import("../controls.js").State} State */
/** @typedef {import("../shown_run.js").DrawnRun} DrawnRun */
/** @typedef {import("./steps.js").Judgement} Judgement */
/** @typedef {import("./steps.js").Step} Step */
/**
 * @typedef {{state: State, run: DrawnRun, set: (state: State) => void, change: () => void, play: () => boolean,
 *   stopAt: (time: number) => void, trial: import("../trial_panel.js").TrialPanel,
 *   fit: import("../fit_panel.js").FitPanel}} LessonPage what the lesson needs of the page; `play`: false if nothing is to move
 * @typedef {{words: () => string, tone: Verdict, verdict: Verdict}} Answer `tone`: of the words; `verdict`: of the step
 * @typedef {"" | "right" | "wrong"} Verdict
 */

const MILLIMETRES = 1000;
/** Task -> control to which the student goes. */
const CONTROL_OF_TASK = { ratio: "range-mass_ratio", drag: "range-light_drag", trial: "trial-file" };
const MADE_UP_FILE = "made-up.csv";

/** The steps, one of which is open, and what was predicted and answered in each. */
export class LessonPanel {
  /** @param {(id: string) => HTMLElement} element @param {LessonPage} page */
  constructor(element, page) {
    this.element = element;
    this.page = page;
    this.place = 0;
    /** What is chosen or typed in each step. */
    this.predictions = STEPS.map(() => "");
    /** What was predicted when the button was pressed. */
    this.kept = STEPS.map(() => "");
    /** What a run said then, and what the student measured. */
    this.found = STEPS.map(() => "");
    this.measured = STEPS.map(() => "");
    this.classroom = new Classroom(element, () => this.results);
    /** @type {Answer[]} */
    this.answers = STEPS.map(() => ({ words: () => "", tone: "", verdict: "" }));
    /** What a step set, and beside which state its run is shown. @type {{state: State, beside: State | null} | null} */
    this.given = null;
    /** Step whose run is being watched. @type {Step | null} */
    this.watched = null;
    /** Whether the run is to be shown as it is when it was seen, since nothing is to move. */
    this.jumps = false;
    /** Film of the step of a wrong drag. @type {{hidden: number, run: DrawnRun, points: [number, number, number][]} | null} */
    this.film = null;
    /** Seeds of the next film and of the next trial that is made up. */
    this.seeds = { film: 1, trial: 1 };
    /** Wind in the trial that was made up last [m/s]. */
    this.wind = 0;
    element("lesson-steps").append(...STEPS.map((_, place) => {
      const button = Object.assign(document.createElement("button"), { type: "button", textContent: String(place + 1) });
      button.addEventListener("click", () => this.open(place));
      const item = document.createElement("li");
      item.append(button);
      return item;
    }));
    element("lesson-change").addEventListener("click", () => this.change());
    element("lesson-check").addEventListener("click", () => this.check());
    element("lesson-next").addEventListener("click", () => this.open((this.place + 1) % STEPS.length));
    element("lesson-go").addEventListener("click", () => this.go());
  }

  get step() {
    return STEPS[this.place];
  }

  get isOpen() {
    return /** @type {HTMLDetailsElement} */ (this.element("lesson")).open;
  }

  /** @param {number} place */
  open(place) {
    this.place = place;
    this.relabel();
    this.page.change();
    this.element("lesson-name").focus();
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
      const radio = Object.assign(document.createElement("input"), { type: "radio", name: "lesson-option", value: option });
      radio.checked = this.predictions[this.place] === option;
      radio.addEventListener("change", () => this.predict(option));
      const label = document.createElement("label");
      label.append(radio, text(`lesson.${name}.${option}`));
      return label;
    });
  }

  /** @param {Step} step */
  numberFields({ unit }) {
    const words = unit ? text("lessonNumber", { unit }) : text("lessonPlainNumber");
    return [
      numberField("lesson-number", words, this.predictions[this.place], (typed) => this.predict(typed)),
      numberField("lesson-measured", text("lessonMeasured"), this.measured[this.place], (typed) => {
        const number = parsed(typed);
        this.measured[this.place] = number > 0 ? String(number) : "";
        this.classroom.show();
      }),
    ];
  }

  /** @param {string} said an option, or a number as it was typed */
  predict(said) {
    this.predictions[this.place] = said;
  }

  /** Count a prediction, from the press of the button on: nobody need wait for the end of the run. @param {string} said */
  keep(said) {
    this.kept[this.place] = said;
    this.classroom.show();
  }

  /** Name of each step of which something was predicted or measured -> what was said of it. */
  get results() {
    const known = STEPS.map(({ name }, i) => ({ name, said: this.kept[i], found: this.found[i], measured: this.measured[i] }));
    return new Map(known.filter(({ said, measured }) => said || measured).map(({ name, ...result }) => [name, result]));
  }

  /** The prediction of the open step; where there is none, that is said, and it is "". */
  get said() {
    const said = this.predictions[this.place];
    if (this.step.options.length) {
      if (!said) this.tell(() => text("lessonNoPrediction"));
      return said;
    }
    const number = parsed(said);
    if (number > 0) return String(number);
    this.tell(() => text("lessonNoNumber"));
    return "";
  }

  /** @param {() => string} words @param {Verdict} tone @param {number} place of the step that it is about */
  tell(words, tone = "", place = this.place) {
    // A hint that comes later is neither right nor wrong, and does not take back what a step has shown
    this.answers[place] = { words, tone, verdict: tone || this.answers[place].verdict };
    this.showAnswer();
  }

  showAnswer() {
    const { words, tone } = this.answers[this.place];
    const now = words();
    this.element("lesson-answer").className = tone;
    if (this.element("lesson-answer").textContent !== now) this.element("lesson-answer").textContent = now;
    [...this.element("lesson-steps").querySelectorAll("button")].forEach((button, place) => {
      const key = { "": "lessonStep", right: "lessonStepRight", wrong: "lessonStepWrong" }[this.answers[place].verdict];
      const name = text(`lesson.${STEPS[place].name}.title`);
      button.setAttribute("aria-label", text(/** @type {import("../texts.js").TextKey} */ (key), { number: place + 1, name }));
      button.textContent = `${place + 1}${{ "": "", right: "\u00a0✓", wrong: "\u00a0·" }[this.answers[place].verdict]}`;
      if (place === this.place) button.setAttribute("aria-current", "step");
      else button.removeAttribute("aria-current");
    });
  }

  /** Set what the step says, and have its run played. */
  change() {
    const { step, said } = this;
    if (!said) return;
    this.keep(said);
    const state = step.state();
    if (!state) {
      this.makeTrial();
      return;
    }
    if (step.task === "drag") this.makeFilm();
    this.given = { state, beside: step.beside?.() ?? null };
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
      this.tell(() => text("lessonLeft"), "", place);
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
    const task = () => (step.task ? text(`lesson.${step.name}.task`) : "");
    if (step.judge) this.answer(step, step.judge(this.kept[place], run, other), task);
    else this.tell(task, "", place);
  }

  /** Tell what was said, what was found, and why. @param {Step} step @param {Judgement} judgement @param {() => string} more */
  answer(step, { found, right, values }, more = () => "") {
    const place = STEPS.indexOf(step);
    const said = this.kept[place];
    this.found[place] = String(found);
    const worded = (/** @type {string | number} */ answer) =>
      step.options.length ? text(`lesson.${step.name}.${answer}`) : withUnit(shown(answer), step.unit);
    this.tell(() => [
      text(step.task === "trial" ? "lessonSaidOfFit" : "lessonSaid", { said: worded(said), found: worded(found) }),
      text(right ? "lessonRight" : "lessonWrong"),
      text(`lesson.${step.name}.why`, values),
      more(),
    ].join(" ").trim(), right ? "right" : "wrong", place);
    this.classroom.show();
  }

  check() {
    const { step, said } = this;
    if (!said) return;
    this.keep(this.kept[this.place] || said);
    if (step.task === "ratio") this.checkRatio(step);
    else if (step.task === "drag") this.checkDrag();
    else this.checkTrial(step);
  }

  /** @param {Step} step */
  checkRatio(step) {
    const { state, run } = this.page;
    const place = STEPS.indexOf(step);
    if (!isOfRatioStep(state)) {
      this.tell(() => text("lessonLeft"));
      return;
    }
    this.tell(() => text("lessonSearching"));
    const ratio = state.values.mass_ratio;
    const search = lowestRatio(state);
    const next = () => {
      const { done, value } = search.next();
      if (!done) {
        // Between two runs the page goes on
        setTimeout(next, 0);
        return;
      }
      const found = placeOfRatio(ratio, run.halt !== null, value);
      const hints = { never: "lessonNever", gap: "lessonGap", high: "lessonHigh", lowest: "lessonRatioFound" };
      const hint = () => text(/** @type {import("../texts.js").TextKey} */ (hints[found]), { ratio, result: resultOf(run) });
      if (found === "lowest") this.answer(step, judgeRatio(this.kept[place], ratio, value), hint);
      else this.tell(hint, "", place);
    };
    next();
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
      const { wind } = this;
      const origin = () => (wind ? text("lessonWind", { wind }) : text("lessonNoWind"));
      const how = trial.file?.name === MADE_UP_FILE ? () => `${fitted.remainder()} ${origin()}` : fitted.remainder;
      this.answer(step, judgeTrial(this.kept[this.place], fitted.isNoise, fitted.after), how);
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

/** @param {string} id @param {string} words @param {string} value @param {(typed: string) => void} onInput */
function numberField(id, words, value, onInput) {
  const field = Object.assign(document.createElement("input"), { type: "text", id, inputMode: "decimal", autocomplete: "off" });
  field.value = shown(value);
  field.addEventListener("input", () => onInput(field.value));
  const label = document.createElement("label");
  label.append(words, field);
  return label;
}
