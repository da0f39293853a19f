/** The address of the page, which holds all settings, and the language if one was chosen. */

import { RELEASES } from "../model.js";
import { codeOf, linkOf, linkOfCode, readLink } from "./controls.js";
import { text } from "./texts.js";

/**
 * @typedef {{state: import("./controls.js").State, history: import("./history.js").History, speech: import("./language.js").Speech,
 *   engines: import("./engine_runs/engine_runs.js").EngineRuns | null, change: () => void,
 *   fail: (words: string | (() => string)) => void}} AddressedPage
 */

/** What stands behind "#": read when it changes, written when the settings do. */
export class Address {
  /** @param {AddressedPage} page */
  constructor(page) {
    this.page = page;
    window.addEventListener("hashchange", () => this.read());
  }

  /** What the address says of the settings, and of the language if one was chosen. */
  get hash() {
    const { state, speech } = this.page;
    return ["#", linkOf(state), speech.chosen && "&lang=", speech.chosen].join("");
  }

  /** What can be given to others: the address where the page was served, and of a saved file a code. */
  get shared() {
    return location.protocol === "file:" ? codeOf(this.page.state) : location.href;
  }

  /** Take a code, or an address, from somebody else; return whether it is one. @param {string} words */
  take(words) {
    const code = words.trim();
    const link = linkOfCode(code) || code.split("#")[1];
    if (!link) return false;
    this.show(link);
    this.write();
    return true;
  }

  read() {
    const link = location.hash.slice(1);
    this.page.speech.speak(new URLSearchParams(link).get("lang") ?? "");
    if (link && `#${link}` !== this.hash) this.show(link);
  }

  /** Show what a link says. @param {string} link */
  show(link) {
    const { page } = this;
    const { state, faults } = readLink(link, page.state);
    const { release, values } = state;
    page.history.settle();
    // A stored run is shown with its own settings only
    page.history.present = page.engines?.belongTo(state) ? state : { release, values };
    page.history.settle();
    const [fault] = faults;
    const { key = "", text: found = "", min = "", max = "" } = fault ?? {};
    const words = () =>
      min === "" ? text("badRelease", { text: found, names: Object.keys(RELEASES).join(", ") }) : text("badLink", { key, text: found, min, max });
    page.fail(fault ? words : "");
    page.change();
  }

  write() {
    window.history.replaceState(null, "", this.hash);
  }
}
