/** The settings that can be changed, by the table of quantities, and the state of them all. */

import { RELEASES, SLIDERS } from "../model.js";

/**
 * @typedef {{name: string, key: string, unit: string, factor: number, min: number, max: number, step: number,
 *   more: boolean}} Control `key`: its name in a link; `factor`: SI units in one shown unit; `more`: seldom needed
 * @typedef {{release: string, values: Record<string, number>, stored?: string}} State values in the units that are shown;
 *   `stored`: name of the scenario whose stored run is shown, since the model lacks effects of it
 * @typedef {{name: string, title: string, description: string, shipped: boolean, release: string, settings: Record<string, number>,
 *   lacks: string[], duration: number}} Preset `lacks`: effects of the scenario that the model does not have; `duration`: its own [s]
 */

/** Settings that can be changed, in the order of the page; those that are seldom needed. */
const MAIN = [
  "release_angle", "free_length", "light_mass", "mass_ratio", "rod_radius", "kinetic_friction", "static_friction", "light_drag",
];
const MORE = [
  "heavy_drag", "string_drag", "light_linear_drag", "heavy_linear_drag", "wind_speed", "side_force", "push_across", "push_along",
  "gravity", "hanging_length", "light_radius",
];

/** @type {Control[]} */
export const CONTROLS = [...MAIN, ...MORE].map((name) => {
  const { unitInLink, ...slider } = SLIDERS[name];
  return { name, key: unitInLink ? `${name}_${unitInLink}` : name, ...slider, more: MORE.includes(name) };
});
const BY_NAME = new Map(CONTROLS.map((one) => [one.name, one]));

/** Control that a name stands for. @param {string} name @returns {Control} */
export function controlOf(name) {
  const found = BY_NAME.get(name);
  if (!found) throw new RangeError(`${name}: no such control`);
  return found;
}

/** Number without the noise of its last digits. @param {number} x */
export const tidy = (x) => Number(x.toPrecision(10));

/** Whole number of steps that is nearest to a value. @param {number} value @param {number} step */
export function snapped(value, step) {
  return tidy(Math.round(value / step) * step);
}

/** State of a scenario. @param {Preset} preset @returns {State} */
export function stateOf({ name: scenario, release, settings, lacks }) {
  /** @type {Record<string, number>} */
  const values = {};
  for (const { name, factor } of CONTROLS) {
    const si = name === "mass_ratio" ? settings.heavy_mass / settings.light_mass : settings[name];
    values[name] = tidy(si / factor);
  }
  return lacks.length ? { release, values, stored: scenario } : { release, values };
}

/** Settings that mean nothing at a release. @type {Record<string, string[]>} */
const WITHOUT_MEANING = {
  vertical: ["release_angle"],
  drop: ["kinetic_friction", "static_friction", "string_drag"],
  held: ["mass_ratio", "kinetic_friction", "static_friction", "heavy_drag", "heavy_linear_drag"],
};

/** Whether a setting means something at a release. @param {string} name @param {State} state */
export const isMeaningful = (name, { release }) => !WITHOUT_MEANING[release]?.includes(name);

/** Widen the ranges so that every scenario is within them. @param {Preset[]} presets */
export function admit(presets) {
  for (const preset of presets) {
    const { values } = stateOf(preset);
    for (const one of CONTROLS) {
      one.min = Math.min(one.min, values[one.name]);
      one.max = Math.max(one.max, values[one.name]);
    }
  }
}

/** Settings of the model [SI]. @param {State} state @returns {Record<string, any>} */
export function settingsOf({ release, values }) {
  /** @type {Record<string, any>} */
  const settings = { release };
  for (const { name, factor } of CONTROLS) settings[name] = values[name] * factor;
  settings.heavy_mass = settings.light_mass * settings.mass_ratio;
  delete settings.mass_ratio;
  return settings;
}

/**
 * Return the state with one value changed; a string at rest holds at least as well as one that slides.
 * @param {State} state
 * @param {string} name
 * @param {number} value
 * @returns {State}
 */
export function withValue(state, name, value) {
  const { min, max } = controlOf(name);
  const values = { ...state.values, [name]: tidy(Math.min(max, Math.max(min, value))) };
  const equal = state.values.static_friction === state.values.kinetic_friction;
  if (name === "kinetic_friction") {
    values.static_friction = equal ? values.kinetic_friction : Math.max(values.static_friction, values.kinetic_friction);
  }
  if (name === "static_friction") values.kinetic_friction = Math.min(values.static_friction, values.kinetic_friction);
  return { release: state.release, values };
}

/** @param {State} one @param {State} other */
export function same(one, other) {
  return one.release === other.release && one.stored === other.stored && CONTROLS.every(({ name }) => one.values[name] === other.values[name]);
}

/**
 * Number that somebody typed, with a point or a comma; NaN if it is none.
 * @param {string} typed
 */
export function parsed(typed) {
  const plain = typed.trim().replace(",", ".");
  return /^[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?$/i.test(plain) ? Number(plain) : NaN;
}

/** The state as the part of an address after "#". @param {State} state */
export function linkOf({ release, values, stored }) {
  const parts = CONTROLS.map(({ name, key }) => `${key}=${values[name]}`);
  const run = stored === undefined ? [] : [`stored=${encodeURIComponent(stored)}`];
  return [`release=${release}`, ...parts, ...run].join("&");
}

/** What begins a code: with other controls than before, or in another order, it needs another number. */
export const CODE = "LP1:";

/** The state as a short code: the release, and the values in the order of the controls, empty for zero. @param {State} state */
export function codeOf({ release, values }) {
  return CODE + [release, ...CONTROLS.map(({ name }) => values[name] || "")].join(";").replace(/;+$/, "");
}

/** The link that says the same as a code; "" if it is none. @param {string} code */
export function linkOfCode(code) {
  if (!code.toUpperCase().startsWith(CODE)) return "";
  const [release, ...values] = code.slice(CODE.length).split(";");
  return [`release=${release}`, ...CONTROLS.map(({ key }, i) => `${key}=${values[i] || 0}`)].join("&");
}

/**
 * Read a link; what it does not name stays as in `state`.
 * @param {string} link
 * @param {State} state
 * @returns {{state: State, faults: {key: string, text: string, min?: number, max?: number}[]}}
 */
export function readLink(link, state) {
  const faults = [];
  const known = new Map(CONTROLS.map((one) => [one.key, one]));
  /** @type {State} */
  let read = { release: state.release, values: state.values };
  for (const [key, value] of new URLSearchParams(link)) {
    if (key === "release") {
      if (Object.hasOwn(RELEASES, value)) read = { ...read, release: value };
      else faults.push({ key, text: value });
      continue;
    }
    if (key === "stored") read = { ...read, stored: value };
    const one = known.get(key);
    if (!one) continue; // of a later version of this page, or of somebody's own
    const number = parsed(value);
    if (number >= one.min && number <= one.max) {
      read = { ...read, values: { ...read.values, [one.name]: number } };
    } else faults.push({ key, text: value, min: one.min, max: one.max });
  }
  // As typed, a link may hold a friction at rest below that of sliding
  const { kinetic_friction: sliding, static_friction: resting } = read.values;
  return { state: { ...read, values: { ...read.values, static_friction: Math.max(sliding, resting) } }, faults };
}
