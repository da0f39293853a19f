/** Motions that the page makes up as if they had been filmed: runs with hidden settings, and scatter from a seed. */

import { CONTROLS, settingsOf, tidy, withValue } from "../controls.js";
import { seeded } from "../random.js";
import { ShownRun } from "../shown_run.js";

/** @import { State } from "../controls.js" */

/** Standard deviation of a made-up coordinate [m]. */
export const SCATTER = 2e-3;
/** Typical distance of made-up points from their true places [m]: half of them are nearer. */
export const TYPICAL_SCATTER = SCATTER * Math.sqrt(2 * Math.LN2);
/** Typical distance of a film's points from its run, by chance at most [m]: that of a hundred points scatters by 7 %. */
export const LARGEST_TYPICAL = 1.35 * TYPICAL_SCATTER;
const FILMED_TIME = 0.8;
const FRAMES_PER_SECOND = 120;
/** Drags of films, as far from the set one as to be seen, at steps of the slider [g/m]. */
const DRAGS = [1, 3];
/** Speed of the wind in every other made-up trial, which a fit does not know [m/s]. */
export const WIND = 3;
/** Setting -> how far a made-up trial may be from what the page sets, in the units that are shown. */
const SPREADS = { release_angle: 2, free_length: 1, kinetic_friction: 0.03, light_drag: 0.1 };

/** Normally distributed number of standard deviation 1 (Box and Muller). @param {() => number} random */
function normal(random) {
  return Math.sqrt(-2 * Math.log(1 - random())) * Math.cos(2 * Math.PI * random());
}

/** State of a film: another drag than that which is set. @param {State} state @param {number} seed @returns {State} */
export function filmOf(state, seed) {
  const { step } = /** @type {import("../controls.js").Control} */ (CONTROLS.find(({ name }) => name === "light_drag"));
  const [low, high] = DRAGS;
  const count = Math.round((high - low) / step);
  return withValue(state, "light_drag", tidy(low + step * Math.floor((count + 1) * seeded(seed)())));
}

/** Points of the light mass in a film, at equal times: time [s], x and y [m]. @param {ShownRun} run @param {number} seed
 * @returns {[number, number, number][]} */
export function filmedPoints(run, seed) {
  const random = seeded(seed);
  return timesOf(run).map((t) => {
    const [x, y] = run.at(t).light;
    return [t, x + SCATTER * normal(random), y + SCATTER * normal(random)];
  });
}

/** @param {ShownRun} run */
function timesOf({ end }) {
  const count = Math.floor(Math.min(end, FILMED_TIME) * FRAMES_PER_SECOND);
  return Array.from({ length: count + 1 }, (_, i) => i / FRAMES_PER_SECOND);
}

/**
 * Make up a trial near a state; with an odd seed a wind blows in it.
 * @param {State} state
 * @param {number} seed
 * @returns {{state: State, csv: string, wind: number}} what it was made with, and its file
 */
export function madeUpTrial(state, seed) {
  const random = seeded(seed);
  let hidden = state;
  for (const [name, spread] of Object.entries(SPREADS)) hidden = withValue(hidden, name, state.values[name] + spread * (2 * random() - 1));
  const wind = seed % 2 ? WIND : 0;
  hidden = withValue(hidden, "wind_speed", wind);
  const run = new ShownRun(settingsOf(hidden));
  const rows = timesOf(run).map((t) => {
    const { light, heavy } = run.at(t);
    return [t, ...[...light, ...heavy].map((x) => x + SCATTER * normal(random))].map((x) => x.toFixed(5)).join(",");
  });
  return { state: hidden, csv: `t,light_x,light_y,heavy_x,heavy_y\n${rows.join("\n")}\n`, wind };
}
