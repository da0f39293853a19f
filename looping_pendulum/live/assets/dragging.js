/** What is moved with mouse, finger or arrow keys: the light mass, which is let go elsewhere, and the tools over the stage. */

import { settingsOf, withValue } from "./controls.js";

/** @import { State } from "./controls.js" */
/** @import { Stage } from "./stage.js" */
/**
 * @typedef {{lightMass: () => number[], onTake: () => void, onMove: (place: number[]) => void, onLetGo: () => void}} Callbacks
 *   places in the plane [m]
 */

const CENTIMETRES = 100;
/** How near to the light mass a finger must be to take it [px]. */
const REACH = 44;

/** @param {Stage} stage @param {Callbacks} callbacks */
export function listenToStage(stage, { lightMass, onTake, onMove, onLetGo }) {
  const { canvas } = stage;
  let dragged = false;
  const isNear = (/** @type {PointerEvent} */ event) => {
    const [px, py] = stage.placeOf(event);
    const [x, y] = lightMass();
    return Math.hypot(stage.view.x(x) - px, stage.view.y(y) - py) < REACH;
  };
  canvas.addEventListener("pointerdown", (event) => {
    if (!isNear(event)) return;
    dragged = true;
    stage.frozen = true;
    canvas.setPointerCapture(event.pointerId);
    onTake();
  });
  // Elsewhere a finger scrolls the page
  canvas.addEventListener("touchstart", (event) => dragged && event.preventDefault(), { passive: false });
  canvas.addEventListener("pointermove", (event) => {
    if (!dragged) {
      canvas.style.cursor = isNear(event) ? "grab" : "";
      return;
    }
    const [px, py] = stage.placeOf(event);
    onMove(stage.toPlane(px, py));
  });
  const end = () => {
    if (!dragged) return;
    dragged = false;
    stage.frozen = false;
    onLetGo();
  };
  canvas.addEventListener("pointerup", end);
  canvas.addEventListener("pointercancel", end);
}

/** @type {Record<string, number[]>} */
const ARROW_KEYS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
/** With Shift an arrow key moves by so many steps. */
const LARGE_STEP = 10;

/** Have an element moved with mouse, finger or arrow keys. @param {HTMLElement} element @param {number} step of an arrow key [px]
 * @param {(x: number, y: number) => void} onMove by how much, to the right and down [px] */
export function makeMovable(element, step, onMove) {
  let last = [0, 0];
  element.addEventListener("pointerdown", (event) => {
    element.setPointerCapture(event.pointerId);
    last = [event.clientX, event.clientY];
  });
  element.addEventListener("pointermove", (event) => {
    if (!element.hasPointerCapture(event.pointerId)) return;
    onMove(event.clientX - last[0], event.clientY - last[1]);
    last = [event.clientX, event.clientY];
  });
  element.addEventListener("keydown", (event) => {
    const along = ARROW_KEYS[event.key];
    if (!along) return;
    // Elsewhere the arrows step through time
    event.preventDefault();
    event.stopPropagation();
    const by = event.shiftKey ? LARGE_STEP * step : step;
    onMove(by * along[0], by * along[1]);
  });
}

/** State with the light mass released at a place [m]. @param {State} state @param {number[]} place @returns {State} */
export function releasedAt(state, [x, y]) {
  const radius = settingsOf(state).rod_radius;
  const length = Math.sqrt(Math.max(x * x + y * y - radius * radius, 0));
  // The string is a tangent: from the rod's centre, the mass is seen by this angle ahead of the point where it leaves the rod
  const degrees = ((Math.atan2(y, x) - Math.atan2(length, radius)) * 180) / Math.PI;
  const angle = degrees < -90 ? degrees + 360 : degrees;
  const round = (/** @type {number} */ value) => Math.round(10 * value) / 10;
  const longer = withValue(state, "free_length", round(length * CENTIMETRES));
  return longer.release === "vertical" ? longer : withValue(longer, "release_angle", round(angle));
}
