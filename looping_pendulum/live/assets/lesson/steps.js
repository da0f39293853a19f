/** The steps of the lesson: what each sets, what it asks, and what a run answers. Nothing here is known but what runs say. */

import { simulate } from "../../run.js";
import { CONTROLS, same, settingsOf, withValue } from "../controls.js";
import { durationOf } from "../shown_run.js";
import { typicalDistance } from "../trial/distance.js";
import { LARGEST_TYPICAL, filmOf } from "./made_up.js";

/** @import { State } from "../controls.js" */
/** @import { DrawnRun } from "../shown_run.js" */
/** @typedef {{found: string | number, right: boolean, values: Record<string, number>, ratio?: number,
 *   tests?: import("../trial/fit.js").FitResult["tests"], wind?: number}} Judgement
 *   `found`: the option, or the number, that the run says; `values`: those of the explanation; `ratio`: at which somebody found the lowest;
 *   `tests` and `wind`: of a fit, and of the trial if it was made up [m/s] */
/**
 * @typedef {{name: string, options: string[], unit: string, seenAt: (run: DrawnRun) => number, forces?: boolean,
 *   state: () => State | null, beside?: () => State | null, judge?: (said: string, run: DrawnRun, other: DrawnRun | null) => Judgement,
 *   task?: "ratio" | "drag" | "trial"}} Step
 *   `options`: of a question with a choice; none: a number is asked for. `seenAt`: time at which the run has shown its answer [s].
 *   `beside`: whose run is the ghost, and the other one of `judge`. `task`: what is left to be done after the run was seen.
 */

/** What the steps set where they say nothing else, in the units that are shown; all that is not named is zero. @type {Record<string, number>} */
const APPARATUS = {
  release_angle: 90, free_length: 58, light_mass: 10, mass_ratio: 10, rod_radius: 6.25, gravity: 9.81, hanging_length: 3,
};
/** How near a predicted number must come, as a share of what the run says. */
const CLOSE = 0.05;
/** A drop that is nearer to another than this counts as the same [m]. */
const SAME_DROP = 1e-3;
/** Times of halting that are nearer than this count as the same [s]. */
const SAME_TIME = 1e-3;
/** A factor, or a gain, that changes less than this from one half turn to the next is the same one. */
const SAME_SHARE = 1e-3;
const HALF_TURN = 0.5;
const WATCHED_AFTER_HALT = 0.2;
export const RATIO_STEP = 0.1;
const [COARSE, FINE] = [0.25, 0.005];
const RATIOS = [1, 10];
const TOLERANCE = 1e-9;

/** @param {Record<string, number>} values @param {string} [release] @returns {State} */
export function lessonState(values, release = "looping") {
  return { release, values: Object.fromEntries(CONTROLS.map(({ name }) => [name, values[name] ?? APPARATUS[name] ?? 0])) };
}

/** @param {number} x @param {number} digits */
const rounded = (x, digits) => Number(x.toFixed(digits));

/** @param {DrawnRun} run */
const afterHalt = (run) => Math.min(run.end, (run.halt ?? run.end) + WATCHED_AFTER_HALT);

const friction = (/** @type {number} */ sliding, resting = sliding) => ({ kinetic_friction: sliding, static_friction: resting });

const OF_STATIC = { mass_ratio: 3, release_angle: 75, light_drag: 0.272, heavy_drag: 1.11 };
const OF_DRAG = { ...friction(0.34), light_drag: 0.25 };

/** @type {Step[]} */
export const STEPS = [
  {
    name: "atwood",
    options: [],
    unit: "m/s²",
    state: () => lessonState({ mass_ratio: 3 }, "vertical"),
    seenAt: (run) => run.end,
    judge(said, run) {
      const found = 2 * run.at(run.end).drop / run.end ** 2;
      const { heavy_mass: heavy, light_mass: light, gravity } = run.settings;
      return number(said, found, 2, { expected: rounded(gravity * (heavy - light) / (heavy + light), 2) });
    },
  },
  {
    name: "frictionless",
    options: ["falls", "halts", "turns"],
    unit: "",
    state: () => lessonState({}),
    seenAt: (run) => Math.min(run.end, run.events.filter(({ kind }) => kind === "stops")[1]?.time ?? run.end),
    judge(said, run) {
      const stops = run.events.filter(({ kind }) => kind === "stops");
      const found = run.halt !== null ? "halts" : stops.length ? "turns" : "falls";
      const time = run.halt ?? stops[0]?.time ?? run.end;
      return choice(said, found, { count: stops.length, time: rounded(time, 2), drop: rounded(100 * run.at(time).drop, 0) });
    },
  },
  {
    name: "friction",
    options: ["same", "more", "times"],
    unit: "",
    forces: true,
    state: () => lessonState(friction(0.34)),
    beside: () => lessonState({}),
    seenAt: afterHalt,
    judge(said, run) {
      const turns = run.at(0).turns;
      const [first, second, third] = [0, 1, 2].map((i) => ratioHeldAt(run, turns + i * HALF_TURN));
      const grows = second / first - 1 > SAME_SHARE;
      const isFactor = Math.abs(third * first / second ** 2 - 1) < SAME_SHARE;
      const { holding } = run.at(run.halt ?? run.end);
      return choice(said, !grows ? "same" : isFactor ? "times" : "more", {
        factor: rounded(second / first, 2),
        time: rounded(run.halt ?? run.end, 2),
        bound: rounded(Math.exp(holding?.bound ?? 0), 1),
        needed: rounded(Math.exp(holding?.needed ?? 0), 1),
      });
    },
  },
  {
    name: "lowest",
    options: [],
    unit: "",
    state: () => lessonState({ ...friction(0.3), light_drag: 0.272 }),
    seenAt: afterHalt,
    task: "ratio",
  },
  {
    name: "static",
    options: ["earlier", "same", "later"],
    unit: "",
    state: () => lessonState({ ...friction(0.2, 0.4), ...OF_STATIC }),
    beside: () => lessonState({ ...friction(0.2), ...OF_STATIC }),
    seenAt: (run) => Math.min(run.end, 0.7),
    judge(said, run, other) {
      const [time, before] = [run.halt ?? Infinity, other?.halt ?? Infinity];
      const found = time === before || Math.abs(time - before) < SAME_TIME ? "same" : time < before ? "earlier" : "later";
      return choice(said, found, { time: rounded(time, 3), before: rounded(before, 3) });
    },
  },
  {
    name: "drag",
    options: ["deeper", "same", "higher"],
    unit: "",
    state: () => lessonState(OF_DRAG),
    seenAt: afterHalt,
    task: "drag",
    judge(said, run, film) {
      const [drop, dropInFilm] = [run.dropAtHalt ?? Infinity, film?.dropAtHalt ?? Infinity];
      const found = Math.abs(dropInFilm - drop) < SAME_DROP ? "same" : dropInFilm > drop ? "deeper" : "higher";
      return choice(said, found, { film: rounded(100 * dropInFilm, 1), run: rounded(100 * drop, 1) });
    },
  },
  { name: "trial", options: ["noise", "more"], unit: "", state: () => null, seenAt: (run) => run.end, task: "trial" },
];

/** @param {string} said @param {string} found @param {Record<string, number>} values @returns {Judgement} */
function choice(said, found, values) {
  return { found, right: said === found, values };
}

/** @param {string} said @param {number} found @param {number} digits @param {Record<string, number>} values @returns {Judgement} */
function number(said, found, digits, values) {
  return { found: rounded(found, digits), right: Math.abs(Number(said) / found - 1) < CLOSE, values };
}

/** Ratio of pulls that the rod can hold when so much string lies on it. @param {DrawnRun} run @param {number} turns */
function ratioHeldAt({ samples }, turns) {
  const after = samples.findIndex((sample) => sample.turns >= turns);
  const [below, above] = [samples[Math.max(after - 1, 0)], samples[Math.max(after, 0)]];
  const share = above.turns > below.turns ? (turns - below.turns) / (above.turns - below.turns) : 0;
  const [low, high] = [below.holding?.bound ?? 0, above.holding?.bound ?? 0];
  return Math.exp(low + share * (high - low));
}

/** @param {State} state @param {number} ratio */
function haltsAt(state, ratio) {
  const settings = settingsOf(withValue(state, "mass_ratio", ratio));
  return simulate(settings, { duration: durationOf(state.release), tolerance: TOLERANCE }).haltingTime !== null;
}

/**
 * Find the lowest mass ratio down to which the heavy mass halts at each: steps down from the largest, then halves the last step.
 * It yields after each run, so that a page can do something else; its value is NaN if the heavy mass does not halt at the largest.
 * @param {State} state
 * @returns {Generator<void, number>}
 */
export function* lowestRatio(state) {
  let [low, high] = [...RATIOS];
  if (!haltsAt(state, high)) return NaN;
  for (let next = high - COARSE; next >= RATIOS[0]; next -= COARSE) {
    yield;
    if (!haltsAt(state, next)) {
      low = next;
      break;
    }
    high = next;
  }
  while (high - low > FINE) {
    yield;
    const middle = (low + high) / 2;
    if (haltsAt(state, middle)) high = middle;
    else low = middle;
  }
  return high;
}

/** Whether a state is one of the step of the lowest ratio: all but the ratio is as it set it. @param {State} state */
export function isOfRatioStep(state) {
  const step = /** @type {Step} */ (STEPS.find(({ task }) => task === "ratio"));
  const expected = /** @type {State} */ (step.state());
  return same({ ...state, values: { ...state.values, mass_ratio: expected.values.mass_ratio } }, expected);
}

/**
 * What is to be said of a ratio at which somebody stopped: that the heavy mass does not halt there, does so only in a gap below
 * ratios at which it does not, does so further down, too, or that this is the lowest.
 * @param {number} ratio
 * @param {boolean} halts
 * @param {number} lowest
 * @returns {"never" | "gap" | "high" | "lowest"}
 */
export function placeOfRatio(ratio, halts, lowest) {
  if (!halts) return "never";
  if (ratio < lowest - FINE) return "gap";
  return ratio > lowest + RATIO_STEP ? "high" : "lowest";
}

/** Judge the prediction of the lowest ratio. @param {string} said @param {number} ratio @param {number} lowest @returns {Judgement} */
export function judgeRatio(said, ratio, lowest) {
  return number(said, lowest, 2, { ratio });
}

/** What was filmed in the step of a wrong drag. @param {number} seed @returns {State} */
export const filmedState = (seed) => filmOf(lessonState(OF_DRAG), seed);

/**
 * Typical distance of a film's points from a run [m], and whether it is no more than their scatter.
 * @param {import("../trial/distance.js").Point[]} points
 * @param {DrawnRun} run
 */
export function distanceOf(points, run) {
  const distance = typicalDistance(points, run);
  return { distance, fits: distance < LARGEST_TYPICAL };
}

/** Setting from which a made-up trial is fitted. */
export const trialState = () => lessonState({ ...friction(0.3), release_angle: 100, free_length: 60, light_drag: 0.6 });

/** Judge what was predicted to be left after a fit. @param {string} said @param {boolean} isNoise
 * @param {number} after typical distance [m] @returns {Judgement} */
export function judgeTrial(said, isNoise, after) {
  return choice(said, isNoise ? "noise" : "more", { after: rounded(1000 * after, 1) });
}
