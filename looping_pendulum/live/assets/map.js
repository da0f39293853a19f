/** The map over angle and mass ratio, coloured by where the heavy mass halts. */

import { colours, fitted, polyline, stripes, ticks, write } from "./canvas.js";
import { controlOf, settingsOf, snapped } from "./controls.js";
import { shown, text } from "./texts.js";

/** @import { State } from "./controls.js" */
/** @import { MapRow } from "./map_worker.js" */

const EDGE = { left: 44, right: 12, top: 12, bottom: 34 };
const CURSOR_RADIUS = 9;
/** Columns and rows, coarse at once and finer while the page is idle. @type {[number, number][]} */
const GRIDS = [[10, 8], [20, 16], [40, 32], [60, 48]];
/** Time without a change of the settings after which the map is computed [ms]. */
const PATIENCE = 150;
/** Cividis, which colour-blind readers see as others do, from small to large. */
const CIVIDIS = [[0, 34, 78], [53, 69, 108], [102, 105, 112], [148, 142, 119], [200, 184, 102], [254, 232, 56]];

/** Draws the map and has a worker compute it. */
export class HaltMap {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {import("./map_cursor.js").MapCursor} cursor
   * @param {() => Worker} startWorker
   * @param {(place: import("./map_cursor.js").Place) => void} onPick
   * @param {() => void} onChange to be called when there is more to be drawn
   */
  constructor(canvas, cursor, startWorker, onPick, onChange) {
    this.canvas = canvas;
    this.cursor = cursor;
    this.startWorker = startWorker;
    this.onChange = onChange;
    /** @type {Worker | null} */
    this.worker = null;
    this.visible = false;
    this.wanted = "";
    this.job = 0;
    this.complete = false;
    /** @type {{columns: number, rows: number, drops: (number[] | null)[]}[]} */
    this.grids = [];
    /** Smallest and largest drop on the map [m]. */
    this.range = [Infinity, -Infinity];
    this.timer = 0;
    /** @type {State | null} */
    this.state = null;
    canvas.addEventListener("click", (event) => {
      const box = canvas.getBoundingClientRect();
      const shareX = (event.clientX - box.left - EDGE.left) / (box.width - EDGE.left - EDGE.right);
      const shareY = 1 - (event.clientY - box.top - EDGE.top) / (box.height - EDGE.top - EDGE.bottom);
      if (shareX < 0 || shareX > 1 || shareY < 0 || shareY > 1) return;
      const [angle, ratio] = [controlOf("release_angle"), controlOf("mass_ratio")];
      onPick({
        release_angle: snapped(angle.min + shareX * (angle.max - angle.min), angle.step),
        mass_ratio: snapped(ratio.min + shareY * (ratio.max - ratio.min), ratio.step),
      });
    });
    new IntersectionObserver((entries) => {
      this.visible = entries.some((entry) => entry.isIntersecting);
      if (this.visible && this.state) this.show(this.state);
    }).observe(canvas);
  }

  /** Take new settings. @param {State} state */
  show(state) {
    this.state = state;
    const settings = { ...settingsOf(state), release: "looping" };
    // The map depends on all but the two that it spans
    const wanted = JSON.stringify({ ...settings, release_angle: 0, heavy_mass: 0 });
    if (!this.visible || wanted === this.wanted) return;
    this.wanted = wanted;
    this.complete = false;
    clearTimeout(this.timer);
    this.timer = window.setTimeout(() => this.compute(settings), PATIENCE);
  }

  /** @param {Record<string, any>} settings */
  compute(settings) {
    const [angle, ratio] = [controlOf("release_angle"), controlOf("mass_ratio")];
    if (!this.worker) {
      this.worker = this.startWorker();
      this.worker.onmessage = ({ data }) => this.take(/** @type {MapRow} */ (data));
    }
    this.job += 1;
    this.grids = [];
    this.range = [Infinity, -Infinity];
    /** @type {import("./map_worker.js").MapJob} */
    const job = {
      job: this.job,
      settings,
      angles: [angle.min * angle.factor, angle.max * angle.factor],
      ratios: [ratio.min, ratio.max],
      grids: GRIDS,
    };
    this.worker.postMessage({ map: job });
  }

  /** @param {MapRow} row */
  take({ job, columns, rows, row, drops, last }) {
    if (job !== this.job) return;
    let grid = this.grids[this.grids.length - 1];
    if (!grid || grid.columns !== columns) {
      grid = { columns, rows, drops: Array.from({ length: rows }, () => null) };
      this.grids.push(grid);
    }
    grid.drops[row] = drops;
    const halting = drops.filter((drop) => drop === drop);
    this.range = [Math.min(this.range[0], ...halting), Math.max(this.range[1], ...halting)];
    this.complete = last;
    this.onChange();
  }

  /** Draw the map with the present point. @param {State} state */
  draw(state) {
    const { c, width, height } = fitted(this.canvas);
    const { soft, ink, line, panel } = colours();
    const [wide, tall] = [width - EDGE.left - EDGE.right, height - EDGE.top - EDGE.bottom];
    c.fillStyle = line;
    c.fillRect(EDGE.left, EDGE.top, wide, tall);
    const [least, most] = this.range;
    const never = stripes(c);
    for (const { columns, rows, drops } of this.grids) {
      drops.forEach((row, j) => row?.forEach((drop, i) => {
        c.fillStyle = drop === drop ? tint((drop - least) / (most - least || 1)) : never;
        const [x, y] = [EDGE.left + (i / columns) * wide, EDGE.top + (1 - (j + 1) / rows) * tall];
        c.fillRect(x, y, wide / columns + 0.6, tall / rows + 0.6);
      }));
    }
    const [angle, ratio] = [controlOf("release_angle"), controlOf("mass_ratio")];
    const px = (/** @type {number} */ v) => EDGE.left + ((v - angle.min) / (angle.max - angle.min)) * wide;
    const py = (/** @type {number} */ v) => EDGE.top + tall * (1 - (v - ratio.min) / (ratio.max - ratio.min));
    for (const v of ticks(angle.min, angle.max)) write(c, `${shown(v)}°`, px(v), height - 24, { colour: soft, size: 11, align: "center" });
    for (const v of ticks(ratio.min, ratio.max)) write(c, shown(v), EDGE.left - 6, py(v), { colour: soft, size: 11, align: "right" });
    write(c, text("mapAngle"), EDGE.left + wide / 2, height - 8, { colour: soft, size: 11, align: "center" });
    c.save();
    c.translate(11, EDGE.top + tall / 2);
    c.rotate(-Math.PI / 2);
    write(c, text("mapRatio"), 0, 0, { colour: soft, size: 11, align: "center" });
    c.restore();
    const [x, y] = [px(state.values.release_angle), py(state.values.mass_ratio)];
    const { place } = this.cursor;
    for (const [colour, width] of /** @type {[string, number][]} */ ([[panel, 5], [ink, 2]])) {
      polyline(c, [[x - 9, y], [x + 9, y]], { colour, width });
      polyline(c, [[x, y - 9], [x, y + 9]], { colour, width });
      if (place) polyline(c, circle(px(place.release_angle), py(place.mass_ratio)), { colour, width });
    }
  }
}

/** Points round a place [px]. @param {number} x @param {number} y */
function circle(x, y) {
  const angles = Array.from({ length: 25 }, (_, i) => (i * Math.PI) / 12);
  return angles.map((a) => [x + CURSOR_RADIUS * Math.cos(a), y + CURSOR_RADIUS * Math.sin(a)]);
}

/** Colour of a share from 0 to 1. @param {number} share */
export function tint(share) {
  const place = Math.min(Math.max(share, 0), 1) * (CIVIDIS.length - 1);
  const i = Math.min(Math.floor(place), CIVIDIS.length - 2);
  const mixed = CIVIDIS[i].map((first, k) => Math.round(first + (place - i) * (CIVIDIS[i + 1][k] - first)));
  return `rgb(${mixed.join(" ")})`;
}
