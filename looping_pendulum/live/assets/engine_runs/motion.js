/** Where everything of a stored run is at any time: its samples, joined smoothly. SI; x right and y up from the rod's centre. */

/**
 * @typedef {"stop" | "stick" | "slip" | "slack" | "taut" | "halt" | "rod" | "broke" | "other"} KindOfMoment
 * @typedef {{kind: KindOfMoment, t: number, words: string, name?: string}} Moment
 * @typedef {(number | null)[]} Values null where nothing is known
 * @typedef {{id: string, name: string, colour: string, dashes: number[], marker: string, events: Moment[], end: number | null,
 *   gap: string, caption: string, detail: string, story: string, count: number, heavy: number[], drop: Values, heavy_x?: Values, length?: Values,
 *   angle?: Values, x?: Values, y?: Values, light_tension?: Values, heavy_tension?: Values, distance?: Values}} EngineRun
 *   `count`: number of samples, 0 for a run that was not made; lists have `rate` values in a second
 * @typedef {{t: number[], x?: Values, y: Values}} TrackedMass
 * @typedef {{name: string, stage: Record<string, TrackedMass>, panels: Record<string, {t: number[], v: Values}>}} MeasuredTrial
 * @typedef {{scenario: string, release: string, duration: number, radius: number, string: boolean, rate: number,
 *   runs: EngineRun[], modes: {from: number, mode: string}[], versions: string[], tension_window: number,
 *   words: Record<string, string>, trial: MeasuredTrial | null}} RunsData `runs`: the reference, then the engines
 * @typedef {NonNullable<ReturnType<typeof placeOf>>} Place
 */

const TURN = 2 * Math.PI;
/** Times that differ by less are the same [s]. */
export const SAME_TIME = 1e-9;

/** Value at a place in a list, linear between its values; null where it is unknown. @param {Values | undefined} list
 * @param {number} place */
function between(list, place) {
  if (!list) return null;
  const i = Math.min(Math.floor(place), list.length - 1);
  const [a, b] = [list[i], list[Math.min(i + 1, list.length - 1)]];
  return a === null || b === null ? null : a + (b - a) * (place - i);
}

/** State of a run at t [s]; after its end it stays as it was there. null for a run without samples.
 * @param {RunsData} data @param {EngineRun} run @param {number} t */
export function placeOf(data, run, t) {
  if (!run.count) return null;
  const place = Math.min(Math.max(t * data.rate, 0), run.count - 1);
  const [length, angle, drop] = [between(run.length, place), between(run.angle, place), between(run.drop, place) ?? 0];
  let [x, y] = [between(run.x, place), between(run.y, place)];
  // The length and the angle turn smoothly, where x and y would cut corners
  if (x === null && length !== null && angle !== null) {
    x = data.radius * Math.cos(angle) - length * Math.sin(angle);
    y = data.radius * Math.sin(angle) + length * Math.cos(angle);
  }
  return {
    x, y, length, angle, drop,
    heavyX: between(run.heavy_x, place) ?? run.heavy[0],
    heavyY: run.heavy[1] - drop,
    turns: angle === null ? null : angle / TURN,
    lightTension: between(run.light_tension, place),
    heavyTension: between(run.heavy_tension, place),
    distance: between(run.distance, place),
    ended: hasEnded(run, t),
  };
}

/** @param {EngineRun} run @param {number} t */
export function hasEnded(run, t) {
  return run.end !== null && t > run.end + SAME_TIME;
}

/** Mode of the reference at t [s]. @param {RunsData} data @param {number} t */
export function modeAt(data, t) {
  return data.modes.findLast(({ from }) => from <= t + SAME_TIME)?.mode ?? "unknown";
}

/** Number of ascending times that are not after t. @param {number[]} times @param {number} t */
export function countUpTo(times, t) {
  const later = times.findIndex((time) => time > t + SAME_TIME);
  return later < 0 ? times.length : later;
}
