/** A mass is found again in further frames: what differs from the background most as the clicked mass did, near where it should be. */

/** Half of a side of the square that is looked for, the standard deviation of its weight, and how far from its expected place it may be [px]. */
const [REACH, WIDTH, FARTHEST] = [12, 6, 24];
/** Smallest likeness to the clicked square, of at most 1, at which it is the same thing, and smallest part of its size. */
const [LEAST_LIKENESS, LEAST_SIZE] = [0.75, 0.3];

/** @import { Film } from "./film.js" */
/** @typedef {{time: number, x: number, y: number}} Mark by the film [s], and in its pixels */

/** Weight of each pixel of a square: those far from its centre are of the string, or of something else. */
const WEIGHTS = Float32Array.from({ length: (2 * REACH + 1) ** 2 }, (_, i) => {
  const [dx, dy] = [(i % (2 * REACH + 1)) - REACH, Math.floor(i / (2 * REACH + 1)) - REACH];
  return Math.exp(-(dx * dx + dy * dy) / (2 * WIDTH * WIDTH));
});

/** What is looked for: the square around a mark of the frame that is shown. @param {Film} film @param {Mark} mark */
export function templateOf(film, { x, y }) {
  const square = film.square(x, y, REACH);
  if (!square) return null;
  const size = Math.sqrt(square.reduce((sum, value, i) => sum + WEIGHTS[i] * value ** 2, 0)) || 1;
  // A click is between pixels, the square on whole ones
  return { square: square.map((value, i) => (WEIGHTS[i] * value) / size), size, dx: x - Math.round(x), dy: y - Math.round(y) };
}

/** Where a mass should be by its last marks: at a steady change of its velocity. @param {Mark[]} marks in order of time @param {number} time */
export function expectedAt(marks, time) {
  const [a, b, c] = marks.slice(-3).reverse();
  if (!b) return { x: a.x, y: a.y };
  const along = (/** @type {"x" | "y"} */ key) => {
    const speed = (a[key] - b[key]) / (a.time - b.time);
    const change = c ? (speed - (b[key] - c[key]) / (b.time - c.time)) / ((a.time - c.time) / 2) : 0;
    const ahead = time - a.time;
    return a[key] + (speed + (change * (a.time - b.time)) / 2) * ahead + (change * ahead ** 2) / 2;
  };
  return { x: along("x"), y: along("y") };
}

/**
 * Find a mass in the frame that is shown; null: nothing there is like it.
 * @param {Film} film
 * @param {NonNullable<ReturnType<typeof templateOf>>} template
 * @param {{x: number, y: number}} expected
 * @returns {Mark | null}
 */
export function findNear(film, template, expected) {
  const room = FARTHEST + REACH;
  const [cx, cy] = [Math.round(expected.x), Math.round(expected.y)];
  const around = film.square(cx, cy, room);
  if (!around) return null;
  const side = 2 * room + 1;
  const wide = 2 * FARTHEST + 1;
  const likeness = new Float32Array(wide * wide);
  let best = 0;
  for (let i = 0; i < likeness.length; i++) {
    likeness[i] = likenessAt(template, around, (i % wide) + side * Math.floor(i / wide), side);
    if (likeness[i] > likeness[best]) best = i;
  }
  const [col, row] = [best % wide, Math.floor(best / wide)];
  if (likeness[best] < LEAST_LIKENESS || col === 0 || row === 0 || col === wide - 1 || row === wide - 1) return null;
  // The top of a parabola through the neighbours
  const peak = (/** @type {number} */ before, /** @type {number} */ after) =>
    (likeness[before] - likeness[after]) / (2 * (likeness[before] - 2 * likeness[best] + likeness[after])) || 0;
  return {
    time: film.time,
    x: cx - FARTHEST + col + peak(best - 1, best + 1) + template.dx,
    y: cy - FARTHEST + row + peak(best - wide, best + wide) + template.dy,
  };
}

/** Likeness of a template to a square of the same size in a larger one; 0: what is there is too faint.
 * @param {NonNullable<ReturnType<typeof templateOf>>} template @param {Float32Array} around @param {number} from index of its first value
 * @param {number} side */
function likenessAt({ square, size }, around, from, side) {
  const own = 2 * REACH + 1;
  let [squares, product] = [0, 0];
  for (let row = 0, i = 0; row < own; row++) {
    for (let at = from + side * row; at < from + side * row + own; at++, i++) {
      squares += WEIGHTS[i] * around[at] ** 2;
      product += around[at] * square[i];
    }
  }
  const norm = Math.sqrt(squares);
  return norm > LEAST_SIZE * size ? product / norm : 0;
}
