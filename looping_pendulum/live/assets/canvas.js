/** What all drawings share: sharp canvases, colours of the page, steps of axes. */

/** @typedef {CanvasRenderingContext2D} Context */

const MAX_PIXEL_RATIO = 2;
/** Distance of stripes [px]. */
const STRIPE = 6;
/** From the middle of a mass to that of its name [px]. */
const NAME_DISTANCE = 20;
const FONT = "system-ui, sans-serif";

/** Sizes of the canvases' boxes, and pixels in one of them where that is not the screen's: to ask for them anew in each frame would have
 * the browser lay out the page anew. @type {WeakMap<Element, [number, number, number?]>} */
const sizes = new WeakMap();
let onResize = () => {};
const observer = typeof ResizeObserver === "undefined" ? null : new ResizeObserver((entries) => {
  for (const { target } of entries) sizes.set(target, [target.clientWidth, target.clientHeight]);
  onResize();
});

/** Have a function called when a canvas has another size. @param {() => void} listener */
export function whenResized(listener) {
  onResize = listener;
}

/** Draw a canvas that is not on the screen in a size. @param {HTMLCanvasElement} canvas @param {number} width @param {number} height
 * @param {number} ratio pixels in one of CSS */
export function setSize(canvas, width, height, ratio) {
  sizes.set(canvas, [width, height, ratio]);
}

/** @param {HTMLCanvasElement} canvas @returns {[number, number, number?]} */
function sizeOf(canvas) {
  const known = sizes.get(canvas);
  if (known) return known;
  observer?.observe(canvas);
  const size = /** @type {[number, number]} */ ([canvas.clientWidth, canvas.clientHeight]);
  sizes.set(canvas, size);
  return size;
}

/**
 * Fit a canvas to its box, sharp on any screen, and empty it.
 * @param {HTMLCanvasElement} canvas
 * @returns {{c: Context, width: number, height: number}} size in CSS pixels
 */
export function fitted(canvas) {
  const [width, height, ratio = Math.min(window.devicePixelRatio || 1, MAX_PIXEL_RATIO)] = sizeOf(canvas);
  const [wide, high] = [Math.round(width * ratio), Math.round(height * ratio)];
  if (canvas.width !== wide || canvas.height !== high) [canvas.width, canvas.height] = [wide, high];
  const c = /** @type {Context} */ (canvas.getContext("2d"));
  c.setTransform(ratio, 0, 0, ratio, 0, 0);
  c.clearRect(0, 0, width, height);
  c.lineJoin = c.lineCap = "round";
  return { c, width, height };
}

const NAMES = {
  ink: "--ink", soft: "--soft", ground: "--ground", panel: "--panel", line: "--line", grid: "--grid", accent: "--accent",
  blue: "--run-0", orange: "--run-1", green: "--run-2", pink: "--run-3", yellow: "--run-4", sky: "--run-5",
};
/** @type {Record<string, string> | null} */
let known = null;

/** Colours of the page as it is now. @returns {Record<keyof typeof NAMES, string>} */
export function colours() {
  if (!known) {
    const style = getComputedStyle(document.documentElement);
    known = Object.fromEntries(Object.entries(NAMES).map(([name, property]) => [name, style.getPropertyValue(property).trim()]));
  }
  return /** @type {Record<keyof typeof NAMES, string>} */ (known);
}

/** To be called when the page turns dark or light. */
export function forgetColours() {
  known = null;
}

/**
 * @param {Context} c
 * @param {string} words
 * @param {number} x
 * @param {number} y
 * @param {{colour: string, size?: number, align?: CanvasTextAlign, baseline?: CanvasTextBaseline, bold?: boolean, clear?: boolean}} style
 *   `clear`: no line crosses the words, whatever was drawn before
 */
export function write(c, words, x, y, { colour, size = 12, align = "left", baseline = "middle", bold = false, clear = false }) {
  c.font = `${bold ? "600 " : ""}${size}px ${FONT}`;
  c.textAlign = align;
  c.textBaseline = baseline;
  if (clear) {
    c.strokeStyle = colours().panel;
    c.lineWidth = 5;
    c.strokeText(words, x, y);
  }
  c.fillStyle = colour;
  c.fillText(words, x, y);
}

/** Name both masses where their string is not: beside the heavy one, and beyond the light one, or where there is room beside it.
 * @param {Context} c @param {number[]} light @param {number[]} heavy @param {number[]} from where the string comes from [px] */
export function nameMasses(c, [lx, ly], [hx, hy], [x, y]) {
  const style = /** @type {const} */ ({ colour: colours().ink, size: 13, bold: true, clear: true });
  write(c, "M2", hx + NAME_DISTANCE - 2, hy, style);
  const length = Math.hypot(lx - x, ly - y) || 1;
  const beyond = [(lx - x) / length, (ly - y) / length];
  const { a: ratio } = c.getTransform();
  const place = (/** @type {number[]} */ [dx, dy]) => [lx + NAME_DISTANCE * dx, ly + NAME_DISTANCE * dy];
  const isFree = (/** @type {number[]} */ direction) => {
    const [px, py] = place(direction);
    const isInside = px > 12 && px < c.canvas.width / ratio - 12 && py > 8 && py < c.canvas.height / ratio - 8;
    const isOffString = direction[0] * beyond[0] + direction[1] * beyond[1] > -0.6;
    return isInside && isOffString && Math.hypot(px - hx, py - hy) > 1.5 * NAME_DISTANCE;
  };
  const [px, py] = place([beyond, [-1.5, 0], [1.5, 0], [0, 1], [0, -1]].find(isFree) ?? beyond);
  write(c, "M1", px, py, { ...style, align: "center" });
}

/**
 * Draw a line through points, with a gap where one has no place.
 * @param {Context} c
 * @param {Iterable<number[]>} points
 * @param {{colour: string, width?: number, dash?: number[], alpha?: number}} style
 */
export function polyline(c, points, { colour, width = 2, dash = [], alpha = 1 }) {
  c.beginPath();
  let isOpen = false;
  for (const [x, y] of points) {
    if (isOpen) c.lineTo(x, y);
    else c.moveTo(x, y);
    isOpen = Number.isFinite(x + y);
  }
  c.strokeStyle = colour;
  c.lineWidth = width;
  c.globalAlpha = alpha;
  c.setLineDash(dash);
  c.stroke();
  c.setLineDash([]);
  c.globalAlpha = 1;
}

/** Draw a disc. @param {Context} c @param {number[]} middle @param {number} radius
 * @param {{fill: string, line?: string, width?: number}} style `line`: its edge; none without it */
export function disc(c, [x, y], radius, { fill, line, width = 1 }) {
  c.beginPath();
  c.arc(x, y, radius, 0, 2 * Math.PI);
  c.fillStyle = fill;
  c.fill();
  if (!line) return;
  c.strokeStyle = line;
  c.lineWidth = width;
  c.stroke();
}

/**
 * Stripes to fill a shape with, which can be told from any colour.
 * @param {Context} c
 */
export function stripes(c) {
  const { line, soft } = colours();
  const tile = Object.assign(document.createElement("canvas"), { width: STRIPE, height: STRIPE });
  const t = /** @type {Context} */ (tile.getContext("2d"));
  t.fillStyle = line;
  t.fillRect(0, 0, STRIPE, STRIPE);
  // Beyond the corners, too, so that tiles join
  for (const shift of [-STRIPE, 0, STRIPE]) polyline(t, [[shift - 1, STRIPE + 1], [shift + STRIPE + 1, -1]], { colour: soft, width: 1 });
  return /** @type {CanvasPattern} */ (c.createPattern(tile, "repeat"));
}

/**
 * Draw an arrow; none if it is too short to be seen.
 * @param {Context} c
 * @param {number[]} from
 * @param {number[]} along its length and direction [px]
 * @param {{colour: string, dash?: number[], heads?: number}} style `heads`: one behind the other
 */
export function arrow(c, [x, y], [dx, dy], { colour, dash = [], heads = 1 }) {
  const length = Math.hypot(dx, dy);
  if (length < 3) return;
  const head = Math.min(9, length);
  const [ux, uy] = [dx / length, dy / length];
  const [ex, ey] = [x + dx, y + dy];
  const { ink } = colours();
  const end = heads ? 0.6 * head : 0;
  const shaft = [[x, y], [ex - end * ux, ey - end * uy]];
  // Outlined, as not every colour has enough contrast with the ground
  polyline(c, shaft, { colour: ink, width: 5, dash });
  polyline(c, shaft, { colour, width: 3.5, dash });
  for (let i = 0; i < heads; i++) {
    const [hx, hy] = [ex - i * head * ux, ey - i * head * uy];
    c.beginPath();
    c.moveTo(hx, hy);
    c.lineTo(hx - head * ux - 0.6 * head * uy, hy - head * uy + 0.6 * head * ux);
    c.lineTo(hx - head * ux + 0.6 * head * uy, hy - head * uy - 0.6 * head * ux);
    c.closePath();
    c.strokeStyle = ink;
    c.lineWidth = 1.5;
    c.stroke();
    c.fillStyle = colour;
    c.fill();
  }
}

/**
 * Round numbers in a range, about as many as asked for.
 * @param {number} low
 * @param {number} high
 * @param {number} count
 */
export function ticks(low, high, count = 4) {
  const raw = (high - low) / count;
  if (!(raw > 0)) return [low];
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = ([1, 2, 5, 10].find((m) => m * power >= raw) ?? 10) * power;
  const found = [];
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; i++) found.push(Number((i * step).toPrecision(6)));
  return found;
}
