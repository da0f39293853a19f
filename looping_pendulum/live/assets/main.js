/** The one script of the page; a worker that is made from its text runs it, too. */

import { startWorker } from "./map_worker.js";
import { startPage } from "./page.js";

if (typeof document === "undefined") startWorker();
else startPage(document.currentScript?.textContent ?? "");
