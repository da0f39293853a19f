/** What is printed in place of the page: a worksheet on the setting and moment that are shown, and its answers. */

import { keyOf } from "./arrows.js";
import { setSize } from "./canvas.js";
import { CONTROLS, codeOf, controlOf, isMeaningful, settingsOf, withValue } from "./controls.js";
import { html } from "./elements.js";
import { STEPS } from "./lesson/steps.js";
import { resultOf, whyNotForGood, wordsOf } from "./outcome.js";
import { ShownRun } from "./shown_run.js";
import { Stage } from "./stage.js";
import { fixed, namesOf, shown, text, withUnit } from "./texts.js";

/** @import { State } from "./controls.js" */
/** @import { DrawnRun, Sample } from "./shown_run.js" */
/**
 * @typedef {{state: State, run: DrawnRun, player: {time: number}, arrows: import("./arrows.js").ShownArrows,
 *   lesson: import("./lesson/panel.js").LessonPanel, engines: import("./engine_runs/engine_runs.js").EngineRuns | null}} PrintedPage what the sheets need of the page
 * @typedef {{question: string, answer: string}} Asked
 */

/** Size of the picture in CSS pixels, as wide as A4 without its margins, and its pixels in one of them. */
const [WIDTH, HEIGHT, SHARPNESS] = [680, 290, 3];
/** Lines to write on: for the prediction, and for an answer. */
const [LINES_TO_PREDICT, LINES_TO_ANSWER] = [3, 2];
const MOST_EVENTS = 12;
const CENTIMETRES = 100;
/** Friction that is asked about where there is none. */
const SOME_FRICTION = 0.3;
/** Release -> setting that the last question changes. @type {Record<string, string>} */
const CHANGED = { looping: "kinetic_friction", vertical: "kinetic_friction", held: "free_length", drop: "light_mass" };

/** All settings that mean something, in words; those that are seldom needed only if they are not zero.
 * @param {State} state @returns {[string, string][]} name, and value with its unit */
export function settingsInWords(state) {
  const controls = CONTROLS.filter(({ name, more }) => isMeaningful(name, state) && (!more || state.values[name]));
  return controls.map(({ name, unit }) => [text(`setting.${name}`), withUnit(shown(state.values[name]), unit)]);
}

/** Fills the sheets when the page is printed, and empties them then. */
export class Handout {
  /** @param {(id: string) => HTMLElement} element @param {PrintedPage} page */
  constructor(element, page) {
    this.page = page;
    const sheets = element("handout");
    /** Whether the sheets of all steps of the lesson are printed, and nothing else. */
    let isForTeacher = false;
    window.addEventListener("beforeprint", () => {
      const { lesson } = page;
      const ofPupils = [this.worksheet(), this.answers(), ...(lesson.isOpen ? [forTeacher([lesson.step])] : [])];
      sheets.replaceChildren(...(isForTeacher ? [forTeacher(STEPS)] : ofPupils));
    });
    window.addEventListener("afterprint", () => {
      isForTeacher = false;
      sheets.replaceChildren();
    });
    element("worksheet").addEventListener("click", () => window.print());
    element("teacher-sheets").addEventListener("click", () => {
      isForTeacher = true;
      window.print();
    });
  }

  /** The run that is shown; of a stored one the page's own, which knows all that is asked. */
  get run() {
    const { state, run } = this.page;
    return state.stored === undefined ? run : new ShownRun(settingsOf(state), run.end);
  }

  /** What the run lacks of that which is stored. */
  get note() {
    const { state, engines } = this.page;
    return state.stored !== undefined && engines ? [html("p", {}, text("without", { effects: namesOf(engines.preset.lacks) }))] : [];
  }

  worksheet() {
    const { state, player } = this.page;
    const cells = settingsInWords(state).map(([name, value]) => html("tr", {}, html("th", { scope: "row" }, name), html("td", {}, value)));
    const half = Math.ceil(cells.length / 2);
    return html("article", {},
      html("h1", {}, text("sheetTitle")),
      html("p", { className: "blank" }, html("span", {}, text("sheetName")), html("span", {}, text("sheetDate"))),
      this.picture(player.time, true),
      html("div", { className: "settings-table" },
        ...[cells.slice(0, half), cells.slice(half)].map((rows) => html("table", {}, html("tbody", {}, ...rows)))),
      ...this.note,
      html("p", {}, text("sheetPredict")),
      ...lines(LINES_TO_PREDICT),
      html("ol", {}, ...this.asked().map(({ question }) => html("li", {}, question, ...lines(LINES_TO_ANSWER)))));
  }

  answers() {
    const { run } = this;
    const listed = run.events.slice(0, MOST_EVENTS).map((event) => html("li", {}, wordsOf(event)));
    return html("article", {},
      html("h1", {}, text("sheetAnswers")),
      this.picture(run.halt === null ? run.end : Math.min(run.halt, run.end), false),
      html("ol", {}, ...this.asked().map(({ question, answer }) => html("li", {}, question, html("p", {}, html("strong", {}, answer))))),
      html("h2", {}, text("events")),
      html("ul", {}, ...listed),
      ...this.note,
      html("p", { className: "soft" }, text("sheetCode", { code: codeOf(this.page.state) })));
  }

  /** The stage at a time, with what it shows. @param {number} time @param {boolean} untilNow */
  picture(time, untilNow) {
    const { run } = this;
    const canvas = html("canvas");
    setSize(canvas, WIDTH, HEIGHT, SHARPNESS);
    const none = { light: [], heavy: [] };
    const { arrows } = this.page;
    new Stage(canvas).draw({
      run, time, untilNow, arrows, ghost: null, runs: null, film: null, points: none, now: { light: null, heavy: null },
    });
    const key = html("ul", { className: "key" }, ...keyOf(run, arrows, HEIGHT));
    return html("figure", {}, canvas, html("figcaption", {}, text("sheetPicture", { time: fixed(time, 3) })), key);
  }

  /** Three questions on the setting, answered by its run and by that of another one. @returns {Asked[]} */
  asked() {
    const { state } = this.page;
    const { run } = this;
    const [first, second] = QUESTIONS[state.release];
    const { name, max } = controlOf(CHANGED[state.release]);
    const before = state.values[name];
    const other = withValue(state, name, before === 0 ? SOME_FRICTION : 2 * before <= max ? 2 * before : before / 2);
    const changed = new ShownRun(settingsOf(other), run.end);
    const why = name === "kinetic_friction" && other.values[name] > before ? whyNotForGood(changed, run) : "";
    return [
      first(run),
      second(run),
      {
        question: text("askChange", { changes: changesInWords(state, other) }),
        answer: [first(changed).answer, why].filter(Boolean).join(" "),
      },
    ];
  }
}

/** What a teacher needs of steps of the lesson: what each is for, what pupils say, and what to ask.
 * @param {import("./lesson/steps.js").Step[]} steps */
function forTeacher(steps) {
  const parts = /** @type {const} */ ({ aim: "teacherAim", say: "teacherSay", ask: "teacherAsk" });
  return html("article", {}, html("h1", {}, text("teacherTitle")), ...steps.map(({ name, options }) => html("section", {},
    html("h2", {}, text("lessonStep", { number: STEPS.findIndex((step) => step.name === name) + 1, name: text(`lesson.${name}.title`) })),
    html("p", {}, text(`lesson.${name}.text`)),
    html("p", {}, html("strong", {}, text(`lesson.${name}.question`)), " ", options.map((one) => text(`lesson.${name}.${one}`)).join(" / ")),
    ...Object.entries(parts).map(([part, title]) => html("p", {}, html("strong", {}, text(title)), " ", text(`teacher.${name}.${part}`))))));
}

/** All settings in which two states differ: friction at rest may go with that of sliding. @param {State} state @param {State} other */
function changesInWords(state, other) {
  const changed = CONTROLS.filter(({ name }) => state.values[name] !== other.values[name] && isMeaningful(name, state));
  return changed.map(({ name, unit }) => {
    const [before, value] = [state, other].map(({ values }) => withUnit(shown(values[name]), unit));
    return text("oneChange", { setting: text(`setting.${name}`), value, before });
  }).join("; ");
}

/** Release -> the first two questions of its runs. @type {Record<string, [(run: DrawnRun) => Asked, (run: DrawnRun) => Asked]>} */
const QUESTIONS = {
  looping: [ofHalt, ofTurns],
  vertical: [ofHalt, ofPulls],
  held: [ofSpeed, ofPullThen],
  drop: [ofFall, ofSpeeds],
};

/** @param {DrawnRun} run */
function ofHalt(run) {
  return { question: text("askHalt"), answer: resultOf(run) };
}

/** @param {DrawnRun} run */
function ofTurns(run) {
  const [first, halt, last] = [0, run.halt ?? run.end, run.end].map((t) => fixed(run.at(t).turns, 2));
  const time = fixed(run.end, 3);
  return { question: text("askTurns"), answer: text(run.halt === null ? "tellTurnsAtEnd" : "tellTurns", { first, halt, last, time }) };
}

/** @param {DrawnRun} run */
function ofPulls(run) {
  const [light, heavy] = [run.at(0).lightTension, run.at(0).heavyTension].map((pull) => fixed(pull, 3));
  return { question: text("askPulls"), answer: text("tellPulls", { light, heavy }) };
}

/** @param {Sample} sample */
const speedOf = ({ lightVelocity }) => Math.hypot(...lightVelocity);

/** When the light mass is fastest. @param {DrawnRun} run */
const fastest = (run) => run.samples.reduce((best, sample) => (speedOf(sample) > speedOf(best) ? sample : best));

/** @param {DrawnRun} run */
function ofSpeed(run) {
  const sample = fastest(run);
  return { question: text("askSpeed"), answer: text("tellSpeed", { time: fixed(sample.t, 2), speed: fixed(speedOf(sample), 2) }) };
}

/** @param {DrawnRun} run */
function ofPullThen(run) {
  const { lightTension } = fastest(run);
  const { light_mass: mass, gravity } = run.settings;
  const values = { pull: fixed(lightTension, 3), times: fixed(lightTension / (mass * gravity), 1) };
  return { question: text("askPullThen"), answer: text("tellPullThen", values) };
}

/** @param {DrawnRun} run */
function ofFall(run) {
  const [start, end] = [run.at(0), run.at(run.end)];
  const [light, heavy] = [start.light[1] - end.light[1], end.drop].map((fall) => fixed(CENTIMETRES * fall, 1));
  return { question: text("askFall", { time: fixed(run.end, 2) }), answer: text("tellFall", { light, heavy }) };
}

/** @param {DrawnRun} run */
function ofSpeeds(run) {
  const end = run.at(run.end);
  const [light, heavy] = [end.lightVelocity, end.heavyVelocity].map((velocity) => fixed(Math.hypot(...velocity), 2));
  return { question: text("askSpeeds"), answer: text("tellSpeeds", { light, heavy }) };
}

/** Lines to write on. @param {number} count */
const lines = (count) => Array.from({ length: count }, () => html("p", { className: "line-to-write" }));
