/** What runs beside the page: maps and fits. */

import { ready } from "../run.js";
import { computeMap } from "./map_worker.js";
import { fit } from "./trial/fit.js";

/** @typedef {{map: import("./map_worker.js").MapJob} | {fit: import("./trial/fit.js").FitTask}} Job */

/** Answer the page's jobs; a new map ends the one before. */
export function startWorker() {
  const scope = /** @type {{onmessage: ((event: MessageEvent) => void) | null, postMessage(answer: unknown): void}} */ (
    /** @type {unknown} */ (self)
  );
  let current = 0;
  const answer = (/** @type {Job} */ job) => {
    if ("fit" in job) {
      scope.postMessage(fit(job.fit));
      return;
    }
    const { map } = job;
    current = map.job;
    computeMap(map, () => map.job === current, (row) => scope.postMessage(row));
  };
  // Not in the promise itself, whose errors would not reach the page
  scope.onmessage = ({ data }) => ready.then(() => setTimeout(answer, 0, data));
}
