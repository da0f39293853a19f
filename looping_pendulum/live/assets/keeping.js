/** Keep and share: the link, a film and a picture of the stage, the run's numbers, and files that the package reads. */

import { generate } from "lean-qr";
import { linkOf, settingsOf } from "./controls.js";
import { captioned, copyText, film, filmType, runCsv, save, scenarioYaml } from "./export.js";
import { settingsInWords } from "./handout.js";
import { fixed, text } from "./texts.js";

/** Behind a QR code, also where the page is dark. */
const WHITE = /** @type {const} */ ([255, 255, 255]);

/**
 * @typedef {{state: import("./controls.js").State, data: {keys: Record<string, string>}, player: import("./player.js").Player,
 *   fit: import("./fit_panel.js").FitPanel, history: import("./history.js").History,
 *   say: (id: string, words: string | (() => string)) => void}} KeptPage
 */

/** What the buttons of "Keep and share", and the one for the study, do. */
export class Keeping {
  /** @param {(id: string) => HTMLElement} element @param {KeptPage} page */
  constructor(element, page) {
    this.page = page;
    this.canvas = /** @type {HTMLCanvasElement} */ (element("stage"));
    /** Ends the film that is being made. @type {(() => void) | null} */
    this.stopFilm = null;
    this.code = /** @type {HTMLCanvasElement} */ (element("qr"));
    const field = /** @type {HTMLInputElement} */ (element("code"));
    field.addEventListener("change", () => this.take(field));
    const yaml = (/** @type {string} */ content) => new Blob([content], { type: "application/yaml" });
    element("save-film").hidden = !filmType();
    /** @type {Record<string, () => void>} */
    const actions = {
      copy: () => this.copyLink(),
      "show-qr": () => this.showCode(),
      "save-picture": () => captioned(this.canvas, this.words()).toBlob((blob) => blob && save("looping-pendulum.png", blob)),
      "save-film": () => this.startFilm(),
      "save-numbers": () => save("looping-pendulum.csv", new Blob([runCsv(settingsOf(page.state))], { type: "text/csv" })),
      "save-scenario": () => save("live.scenario.yaml", yaml(this.scenario())),
      "trial-study": () => save("study.yaml", yaml(page.fit.study())),
    };
    for (const [id, action] of Object.entries(actions)) element(id).addEventListener("click", action);
  }

  async copyLink() {
    this.page.history.settle();
    const { shared } = this.page.history;
    const isLink = shared.includes("#");
    const isCopied = await copyText(shared);
    const key = isLink ? (isCopied ? "copied" : "notCopied") : isCopied ? "copiedCode" : "copyCode";
    this.page.say("copied", () => text(key, { code: shared }));
  }

  /** The time and the settings, as a picture has them below it. */
  words() {
    const { state, player } = this.page;
    return [`t = ${fixed(player.time, 3)} s`, ...settingsInWords(state).map((words) => words.join(" "))];
  }

  /** Draw the link or the code for cameras, or hide it. */
  showCode() {
    const { code } = this;
    const isShown = code.hidden;
    if (isShown) generate(this.page.history.shared).toCanvas(code, { off: WHITE });
    code.hidden = !isShown;
  }

  /** @param {HTMLInputElement} field with a code or a link from somebody else */
  take(field) {
    const found = field.value;
    const isTaken = found.trim() !== "" && this.page.history.take(found);
    this.page.say("code-fault", isTaken || !found ? "" : () => text("badCode", { found }));
    if (isTaken) field.value = "";
  }

  /** Play from the release and film the stage until it ends or is stopped. */
  startFilm() {
    if (this.stopFilm) return;
    this.page.player.stopAt(0);
    this.stopFilm = film(this.canvas);
    this.page.say("copied", () => text("films"));
    this.page.player.play();
  }

  /** Save the film, if one is being made, since nothing moves any more. */
  endFilm() {
    if (!this.stopFilm) return;
    this.stopFilm();
    this.stopFilm = null;
    this.page.say("copied", "");
  }

  /** The settings as a scenario file. */
  scenario() {
    const { state, data } = this.page;
    return scenarioYaml(settingsOf(state), data.keys, linkOf(state));
  }
}
