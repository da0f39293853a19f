/** Arrows on both masses: forces, velocity and acceleration, and the key that says what they are and how long. */

import { arrow, colours, fitted, setSize } from "./canvas.js";
import { html } from "./elements.js";
import { oncePerRun } from "./shown_run.js";
import { text, withUnit, written } from "./texts.js";

/** @import { Context } from "./canvas.js" */
/** @import { DrawnRun, Sample } from "./shown_run.js" */
/** @typedef {"forces" | "velocity" | "acceleration"} Switch */
/** @typedef {{forces: boolean, velocity: boolean, acceleration: boolean}} ShownArrows what the page's switches show */
/** @typedef {Record<Switch, number>} Scales pixels for one newton, m/s and m/s² */
/**
 * @typedef {{of: Switch, unit: string, colour: keyof ReturnType<typeof colours>, dash?: number[], heads?: number}} Kind
 */

/** Text that names the arrows -> how they are drawn; dashes and heads differ, since not all see the colours differ.
 * @type {Record<"weight" | "stringPull" | "air" | "velocity" | "acceleration", Kind>} */
export const ARROWS = {
  weight: { of: "forces", unit: "N", colour: "blue" },
  stringPull: { of: "forces", unit: "N", colour: "pink", dash: [5, 7] },
  air: { of: "forces", unit: "N", colour: "green", dash: [0.1, 5.5] },
  velocity: { of: "velocity", unit: "m/s", colour: "yellow" },
  acceleration: { of: "acceleration", unit: "m/s²", colour: "sky", heads: 2 },
};
/** Length of the heavy mass's weight, where there is room, and the share of a lower stage's height that it has [px]. */
const [WEIGHT_LENGTH, WEIGHT_SHARE] = [70, 0.2];
/** Length of the largest velocity of a run, and of the acceleration of free fall [px]. */
const [VELOCITY_LENGTH, FREE_FALL_LENGTH] = [90, 24];
const MAX_LENGTH = 150;
/** Longest arrow of the key [px]. */
const KEY_LENGTH = 48;
const [KEY_HEIGHT, KEY_SHARPNESS] = [18, 2];

/** Length of the heavy mass's weight as an arrow on a stage of a height [px]. @param {number} height */
export const weightLength = (height) => Math.min(WEIGHT_LENGTH, WEIGHT_SHARE * height);

/** Largest speed of a mass in a run [m/s]. */
const fastest = oncePerRun((run) =>
  run.range(({ lightVelocity, heavyVelocity }) => Math.max(Math.hypot(...lightVelocity), Math.abs(heavyVelocity[1])))[1],
);

/** Scales of a run's arrows on a stage of a height. @param {DrawnRun} run @param {number} height [px] @returns {Scales} */
export function scalesOf(run, height) {
  const { heavy_mass: heavy, gravity } = run.settings;
  return {
    forces: weightLength(height) / (heavy * gravity),
    velocity: VELOCITY_LENGTH / Math.max(fastest(run), 1e-3),
    acceleration: FREE_FALL_LENGTH / gravity,
  };
}

/**
 * Draw the arrows of an instant at both masses.
 * @param {Context} c
 * @param {DrawnRun} run
 * @param {Sample} sample
 * @param {{light: number[], heavy: number[]}} places of the masses [px]
 * @param {ShownArrows} shown
 * @param {number} height of the stage [px]
 */
export function drawArrows(c, run, sample, { light, heavy }, shown, height) {
  if (!Object.values(shown).includes(true)) return;
  const scales = scalesOf(run, height);
  const draw = (/** @type {keyof typeof ARROWS} */ name, /** @type {number[]} */ from, /** @type {number[]} */ [x, y]) => {
    const { of, colour, dash, heads = 1 } = ARROWS[name];
    const length = Math.hypot(x, y) * scales[of];
    const scale = scales[of] * Math.min(1, MAX_LENGTH / length);
    arrow(c, from, [x * scale, -y * scale], { colour: colours()[colour], dash, heads: length > MAX_LENGTH ? 0 : heads });
  };
  if (shown.forces) {
    const { light_mass: m1, heavy_mass: m2, gravity, rod_radius: r } = run.settings;
    draw("weight", light, [0, -m1 * gravity]);
    draw("weight", heavy, [0, -m2 * gravity]);
    draw("air", light, sample.dragForce);
    if (run.release !== "drop") {
      // The string pulls the light mass towards the point where it leaves the rod
      const [dx, dy] = [r * Math.cos(sample.wrapAngle) - sample.light[0], r * Math.sin(sample.wrapAngle) - sample.light[1]];
      const share = sample.lightTension / Math.hypot(dx, dy);
      draw("stringPull", light, [dx * share, dy * share]);
      draw("stringPull", heavy, [0, sample.heavyTension]);
    }
  }
  if (shown.velocity) {
    draw("velocity", light, sample.lightVelocity);
    draw("velocity", heavy, sample.heavyVelocity);
  }
  if (shown.acceleration) {
    draw("acceleration", light, sample.lightAcceleration);
    draw("acceleration", heavy, sample.heavyAcceleration);
  }
}

/** The key of the arrows that are shown: each with its name, and a length with what it stands for.
 * @param {DrawnRun} run @param {ShownArrows} shown @param {number} height of the drawing [px] @param {number} enlarged pixels of CSS in one of it */
export function keyOf(run, shown, height, enlarged = 1) {
  if (!Object.values(shown).includes(true)) return [];
  const scales = scalesOf(run, height);
  const names = /** @type {(keyof typeof ARROWS)[]} */ (Object.keys(ARROWS));
  const items = names.filter((name) => shown[ARROWS[name].of]).map((name) => {
    const { of, unit, colour, dash, heads } = ARROWS[name];
    const value = roundBelow(KEY_LENGTH / scales[of]);
    const [length, canvas] = [value * scales[of], html("canvas")];
    setSize(canvas, length + 4, KEY_HEIGHT, KEY_SHARPNESS);
    canvas.style.width = `${(length + 4) * enlarged}px`;
    arrow(fitted(canvas).c, [2, KEY_HEIGHT / 2], [length, 0], { colour: colours()[colour], dash, heads });
    return html("li", {}, text(name), canvas, `= ${withUnit(written(value, 1), unit)}`);
  });
  return [...items, html("li", {}, text("arrowsCut"))];
}

/** Largest of 1, 2 and 5 times a power of ten that is at most a number. @param {number} most */
function roundBelow(most) {
  const power = 10 ** Math.floor(Math.log10(most));
  return ([5, 2].find((factor) => factor * power <= most) ?? 1) * power;
}
