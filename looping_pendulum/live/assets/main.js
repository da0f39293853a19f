/** The one script of the page; a worker that is made from its text runs it, too. */

import { ready } from "../run.js";
import { sayThatNothingRuns, showPage, startPage } from "./page.js";
import { startWorker } from "./worker.js";

if (typeof document === "undefined") startWorker();
else {
  const source = document.currentScript?.textContent ?? "";
  showPage();
  ready.then(() => startPage(source), () => sayThatNothingRuns("noWebAssembly")).catch((error) => {
    sayThatNothingRuns("doesNotStart");
    throw error;
  });
}
