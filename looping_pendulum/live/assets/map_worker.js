/** Computes the map of halts beside the page, a row at a time, coarse first. */

import { simulate } from "../run.js";

/** Relative tolerance of a step: the map's colours show millimetres. */
const TOLERANCE = 1e-6;
const DURATION = 5;

/**
 * @typedef {{job: number, settings: Record<string, any>, angles: [number, number], ratios: [number, number],
 *   grids: [number, number][]}} MapJob ranges of angle [rad] and mass ratio; columns and rows of each grid
 * @typedef {{job: number, columns: number, rows: number, row: number, drops: number[], last: boolean}} MapRow
 */

/** Drop at which the heavy mass halts [m]; NaN if it never does. @param {Record<string, any>} settings */
export function dropAtHalt(settings) {
  try {
    const run = simulate(settings, { duration: DURATION, tolerance: TOLERANCE });
    return run.haltingTime === null ? NaN : run.sample(0).heavy[1] - run.sample(run.haltingTime).heavy[1];
  } catch {
    return NaN; // an apparatus that cannot be built, or a run that breaks down, halts nowhere
  }
}

/** Answer the page's jobs; a new one ends the one before. */
export function startWorker() {
  const scope = /** @type {{onmessage: ((event: MessageEvent) => void) | null, postMessage(row: MapRow): void}} */ (
    /** @type {unknown} */ (self)
  );
  let current = 0;
  scope.onmessage = ({ data }) => {
    const job = /** @type {MapJob} */ (data);
    current = job.job;
    const rows = job.grids.flatMap(([columns, count], grid) =>
      Array.from({ length: count }, (_, row) => ({ columns, rows: count, row, last: grid === job.grids.length - 1 && row === count - 1 })),
    );
    const next = () => {
      const place = rows.shift();
      // Between two rows the page may have sent another job
      if (job.job !== current || !place) return;
      scope.postMessage({ job: job.job, ...place, drops: rowOf(job, place) });
      setTimeout(next, 0);
    };
    next();
  };
}

/** @param {MapJob} job @param {{columns: number, rows: number, row: number}} place */
function rowOf({ settings, angles, ratios }, { columns, rows, row }) {
  const ratio = ratios[0] + ((row + 0.5) / rows) * (ratios[1] - ratios[0]);
  return Array.from({ length: columns }, (_, i) => {
    const release_angle = angles[0] + ((i + 0.5) / columns) * (angles[1] - angles[0]);
    return dropAtHalt({ ...settings, release_angle, heavy_mass: ratio * settings.light_mass });
  });
}
