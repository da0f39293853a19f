/** The list of stored runs with their switches, their numbers at the chosen time, and all their moments. */

import { html } from "../elements.js";
import { fixed, text } from "../texts.js";
import { placeOf } from "./motion.js";
import { REFERENCE, make, nameOf, swatch } from "./shapes.js";

/** @import { EngineRun, RunsData } from "./motion.js" */

export const MEASURED = "measured";
const COLUMNS = /** @type {const} */ (["now.run", "now.drop", "now.turns", "now.pull1", "now.pull2", "now.distance"]);
/** Language of what the package writes about runs. */
const lang = "en";

/** An element with the name of a run. @param {"span" | "strong" | "th"} tag @param {EngineRun} run */
function named(tag, run) {
  return html(tag, run.id === REFERENCE ? {} : { lang }, nameOf(run));
}

/** One switch per run, and one for the tracked points.
 * @param {RunsData} data @param {Set<string>} shown @param {(id: string, on: boolean) => void} onSwitch */
export function listOfRuns(data, shown, onSwitch) {
  const rows = data.runs.map((run) => {
    const caption = html("p", { className: "caption" });
    if (run.gap) caption.append(html("strong", {}, text("notRunWhy")), html("span", { lang }, ` ${run.gap}. `));
    caption.append(html("span", { lang }, run.caption));
    const made = row(run.id, named("span", run), Boolean(run.gap), swatch(run), caption);
    if (run.detail) made.append(html("details", { className: "caption" }, html("summary", {}, text("moreOfRun")), html("p", { lang }, run.detail)));
    return made;
  });
  if (data.trial) {
    const ring = make("svg", { width: 44, height: 14, "aria-hidden": "true" });
    make("circle", { cx: 22, cy: 7, r: 4, fill: "none", stroke: "currentColor", "stroke-width": 1.5 }, ring);
    const caption = html("p", { className: "caption" }, text("measuredCaption"));
    rows.push(row(MEASURED, html("span", {}, text("measured", { name: data.trial.name })), false, ring, caption));
  }
  const list = html("fieldset", { className: "runs" }, html("legend", {}, text("engines")), ...rows);
  for (const box of list.querySelectorAll("input")) {
    const id = box.dataset.run ?? "";
    box.checked = shown.has(id);
    box.addEventListener("change", () => onSwitch(id, box.checked));
  }
  return list;
}

/** @param {string} id @param {HTMLElement} name @param {boolean} gap @param {Element} picture @param {HTMLElement} caption */
function row(id, name, gap, picture, caption) {
  name.className = "name";
  const box = html("input", { type: "checkbox", disabled: gap });
  box.dataset.run = id;
  const made = html("div", { className: gap ? "run gap" : "run" }, html("label", {}, box, picture, name), caption);
  made.dataset.run = id;
  return made;
}

/** The numbers of every run at the chosen time. */
export class NumbersNow {
  /** @param {RunsData} data */
  constructor(data) {
    this.data = data;
    const head = html("tr", {}, ...COLUMNS.map((name) => html("th", { scope: "col" }, text(name))));
    const body = html("tbody");
    /** @type {Map<EngineRun, HTMLTableRowElement>} */
    this.rows = new Map(data.runs.filter(({ count }) => count).map((run) => {
      const cells = COLUMNS.slice(1).map(() => html("td"));
      const made = html("tr", {}, named("th", run), ...cells);
      made.cells[0].scope = "row";
      body.append(made);
      return [run, made];
    }));
    const box = html("div", { className: "table", tabIndex: 0 }, html("table", { id: "now" }, html("thead", {}, head), body));
    box.setAttribute("role", "region");
    box.setAttribute("aria-label", text("now"));
    this.element = html("div", {}, html("h3", {}, text("now")), box);
  }

  /** @param {number} time @param {Set<string>} shown */
  draw(time, shown) {
    for (const [run, made] of this.rows) {
      const place = placeOf(this.data, run, time);
      const numbers = !place || place.ended ? [text("ended"), "", "", "", ""] : [
        digits(place.drop, 1000, 1), digits(place.turns, 1, 3), digits(place.lightTension, 1, 3), digits(place.heavyTension, 1, 3),
        run.id === REFERENCE ? "0" : digits(place.distance, 1000, 3),
      ];
      numbers.forEach((words, i) => {
        if (made.cells[i + 1].textContent !== words) made.cells[i + 1].textContent = words;
      });
      made.className = shown.has(run.id) ? "" : "off";
    }
  }
}

/** @param {number | null} value @param {number} factor @param {number} count */
function digits(value, factor, count) {
  return value === null ? "–" : fixed(value * factor, count);
}

/** All moments as buttons, why each run departs, and where the runs come from.
 * @param {RunsData} data @param {(time: number) => void} onTime */
export function momentsAndSources(data, onTime) {
  const items = data.runs.map((run) => {
    const item = html("li", {}, named("strong", run), ": ");
    if (run.gap) item.append(html("span", {}, text("notRun")), ": ", html("span", { lang }, run.gap));
    else if (!run.events.length) item.append(text("noMoments", { time: fixed(run.end ?? 0, 3) }));
    for (const { kind, t } of run.gap ? [] : run.events) {
      const button = html("button", { type: "button", className: "moment" }, [text(`moment.${kind}`), fixed(t, 4), "s"].join(" "));
      button.addEventListener("click", () => onTime(t));
      item.append(button, " ");
    }
    if (run.story) item.append(html("details", {}, html("summary", {}, text("departs")), html("p", { lang }, run.story)));
    return item;
  });
  const words = Object.entries(data.words).flatMap(([word, meaning]) => [html("dt", {}, word), html("dd", {}, meaning)]);
  const about = text("aboutRuns", { rate: data.rate, window: Math.round(1e3 * data.tension_window) });
  return [
    html("h3", {}, text("allMoments")),
    html("ul", { className: "moments" }, ...items),
    html("details", {}, html("summary", {}, text("sources")), html("p", {}, about),
      html("ul", { lang }, ...data.versions.map((made) => html("li", {}, made)))),
    html("details", {}, html("summary", {}, text("words")), html("dl", { lang }, ...words)),
  ];
}
