/** The one script of the page; a worker that is made from its text runs it, too. */

import { startPage } from "./page.js";
import { startWorker } from "./worker.js";

if (typeof document === "undefined") startWorker();
else startPage(document.currentScript?.textContent ?? "");
