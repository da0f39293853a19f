/** The string on the stage: from the heavy mass round the rod to the light one, and round the enlarged rod. */

import { colours, disc, polyline, write } from "./canvas.js";
import { fixed, text } from "./texts.js";

/** @import { Context } from "./canvas.js" */
/** @import { View } from "./stage.js" */
/** @typedef {{left: number, width: number, height: number}} Place on the canvas [px] */
/**
 * @typedef {{angle: number, length: number, radiusAt: (angle: number) => number, colour: string, width: number, dash?: number[],
 *   alpha?: number}} WoundString `length`: of what is free, `radiusAt`: where the string lies at an angle, both in rod radii
 */

/** Angle between two points of a wound string [rad]. */
const STEP = 0.05;

/** Draw a string from the heavy mass up to the rod, round it, and along the tangent to the light mass.
 * @param {Context} c @param {View} view @param {number} radius of the rod [m]
 * @param {{light: number[], heavy: number[], angle: number}} sample places [m]
 * @param {{colour: string, width: number, slack: boolean}} style */
export function drawString(c, view, radius, { light, heavy, angle }, { colour, width, slack }) {
  c.beginPath();
  c.moveTo(view.x(heavy[0]), view.y(heavy[1]));
  c.lineTo(view.x(radius), view.y(0));
  c.arc(view.x(0), view.y(0), radius * view.scale, 0, -Math.max(angle, 0), true);
  c.lineTo(view.x(light[0]), view.y(light[1]));
  c.strokeStyle = colour;
  c.lineWidth = width;
  c.setLineDash(slack ? [3, 5] : []); // only the ends of a slack string are known
  c.stroke();
  c.setLineDash([]);
}

/** Draw the rod enlarged, with the strings that are wound on it.
 * @param {Context} c @param {Place} place @param {number} scale the rod's radius [px] @param {WoundString[]} strings
 * @param {number | null} turns that are named */
export function drawRod(c, { left, width, height }, scale, strings, turns) {
  const { line, ink, soft } = colours();
  const [x, y] = [left + width / 2, height / 2 + 8];
  c.save();
  c.beginPath();
  c.rect(left, 0, width, height + 8);
  c.clip();
  disc(c, [x, y], scale, { fill: line });
  for (const { angle, length, radiusAt, ...style } of strings) {
    const on = (/** @type {number} */ a) => [x + scale * radiusAt(a) * Math.cos(a), y - scale * radiusAt(a) * Math.sin(a)];
    const points = [[on(0)[0], y + height], on(0)];
    for (let a = 0; a < angle; a += STEP) points.push(on(a));
    const [endX, endY] = on(angle);
    points.push([endX, endY], [endX - scale * length * Math.sin(angle), endY - scale * length * Math.cos(angle)]);
    polyline(c, points, style);
  }
  c.restore();
  if (turns !== null) {
    write(c, fixed(turns, 2), x, y - 7, { colour: ink, size: 13, align: "center", bold: true });
    write(c, text("turns"), x, y + 8, { colour: ink, size: 11, align: "center" });
  }
  write(c, text("rodEnlarged"), x, 12, { colour: soft, size: 11, align: "center", clear: true });
}
