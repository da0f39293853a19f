/** Computes the map of halts, a row at a time, coarse first. */

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

/** Compute a map, a row at a time; `isCurrent` tells whether no other map has been asked for since.
 * @param {MapJob} job @param {() => boolean} isCurrent @param {(row: MapRow) => void} send */
export function computeMap(job, isCurrent, send) {
  const rows = job.grids.flatMap(([columns, count], grid) =>
    Array.from({ length: count }, (_, row) => ({ columns, rows: count, row, last: grid === job.grids.length - 1 && row === count - 1 })),
  );
  const next = () => {
    const place = rows.shift();
    if (!isCurrent() || !place) return;
    send({ job: job.job, ...place, drops: rowOf(job, place) });
    // Between two rows the page may send another job
    setTimeout(next, 0);
  };
  next();
}

/** @param {MapJob} job @param {{columns: number, rows: number, row: number}} place */
function rowOf({ settings, angles, ratios }, { columns, rows, row }) {
  const ratio = ratios[0] + ((row + 0.5) / rows) * (ratios[1] - ratios[0]);
  return Array.from({ length: columns }, (_, i) => {
    const release_angle = angles[0] + ((i + 0.5) / columns) * (angles[1] - angles[0]);
    return dropAtHalt({ ...settings, release_angle, heavy_mass: ratio * settings.light_mass });
  });
}
