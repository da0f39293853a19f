/**
 * What was set, one after the other: each is an entry of the browser's own history, through which its buttons go and Undo, too.
 *
 * An entry holds all that is to be there again after a reload, so that it needs no storage. Its address holds the settings only, and the
 * language if one was chosen: addresses are given to others, and answers are not for them.
 */

import { RELEASES } from "../model.js";
import { codeOf, linkOf, linkOfCode, readLink, same } from "./controls.js";
import { STEPS } from "./lesson/steps.js";
import { beginWith, store, stored } from "./storage.js";
import { text } from "./texts.js";

/** @import { State } from "./controls.js" */
/**
 * @typedef {{speech: import("./language.js").Speech, engines: import("./engine_runs/engine_runs.js").EngineRuns | null,
 *   lesson: import("./lesson/panel.js").LessonPanel, change: () => void, say: (id: string, words: string | (() => string)) => void,
 *   fail: (words: string | (() => string)) => void}} PageWithHistory
 * @typedef {{place: number, last: number, link: string, before: string, step: number, tab: string, work?: Record<string, unknown>}} Entry
 *   `place`: its number, from 0, and that of the last one; `link`: of the setting, and of the one before it; `step`: of the lesson
 */

/** Entries that browsers keep of a tab. */
const MOST_ENTRIES = 50;
/** Characters of work that an entry holds at most: it is copied into each. */
const MOST_WORK = 1e5;
/** Time without a further key after which an entry has what is typed [ms]; browsers bear some ten changes of entries in a second. */
const PATIENCE = 200;

export class History {
  /** @param {State} state with which the page starts @param {PageWithHistory} page */
  constructor(state, page) {
    this.page = page;
    /** The state that is shown, which may be on its way. */
    this.present = state;
    /** The last state that was not on its way. */
    this.settled = state;
    /** The setting before that one. @type {State | null} */
    this.previous = null;
    /** Number of the entry that is shown, and of the last one. */
    this.place = 0;
    this.last = 0;
    /** Whether the browser is on the way to another entry. */
    this.travels = false;
    /** Whether the address names the settings: not before anything is set. */
    this.isNamed = location.hash !== "";
    this.timer = 0;
    /** By this the page knows what it has stored itself from what another tab of the same page has. */
    this.tab = String(Math.random());
    window.addEventListener("popstate", () => this.arrive());
  }

  /** The setting before this one; null without one. */
  get before() {
    return same(this.present, this.settled) ? this.previous : this.settled;
  }

  get canUndo() {
    return this.place > Math.max(0, this.last - MOST_ENTRIES + 1);
  }

  get canRedo() {
    return this.place < this.last;
  }

  /** What the address says of the settings, and of the language if one was chosen. */
  get hash() {
    const { chosen } = this.page.speech;
    return ["#", linkOf(this.settled), chosen && "&lang=", chosen].join("");
  }

  /** What can be given to others: the address where the page was served, and of a saved file a code. */
  get shared() {
    return location.protocol === "file:" ? codeOf(this.present) : location.href.split("#")[0] + this.hash;
  }

  /** Keep the shown state as a setting of its own. */
  settle() {
    this.isNamed = true;
    if (same(this.present, this.settled)) {
      this.save();
      return;
    }
    this.previous = this.settled;
    this.settled = this.present;
    this.add();
  }

  /** Add an entry for what is shown; those that were undone are gone. */
  add() {
    const { place, last } = this;
    this.place = this.last = place + 1;
    this.travels = false;
    // Without a new entry, a step back would lead too far
    if (!this.save("pushState")) [this.place, this.last] = [place, last];
  }

  undo() {
    this.settle();
    if (this.canUndo) this.travel(-1);
  }

  redo() {
    this.settle();
    if (this.canRedo) this.travel(1);
  }

  /** @param {number} direction */
  travel(direction) {
    if (this.travels) return; // else a second one might leave the page
    this.travels = true;
    window.history.go(direction);
  }

  /** Take a code, or an address, from somebody else; return whether it is one. @param {string} words */
  take(words) {
    const code = words.trim();
    const link = linkOfCode(code) || code.split("#")[1];
    if (!link) return false;
    this.settle();
    this.present = this.stateOf(link);
    this.settle();
    this.page.change();
    return true;
  }

  /** The state that a link says; what is wrong with it is said. @param {string} link @returns {State} */
  stateOf(link) {
    const { page } = this;
    const { state, faults } = readLink(link, this.present);
    const [fault] = faults;
    const { key = "", text: found = "", min = "", max = "" } = fault ?? {};
    const words = () =>
      min === "" ? text("badRelease", { text: found, names: Object.keys(RELEASES).join(", ") }) : text("badLink", { key, text: found, min, max });
    page.fail(fault ? words : "");
    // A stored run is shown with its own settings only
    return page.engines?.belongTo(state) ? state : { release: state.release, values: state.values };
  }

  /** Begin with what the browser still has of this page, and with what its address says. */
  begin() {
    const entry = entryOf(window.history.state);
    const kept = (/** @type {string} */ name) => {
      const { tab, value } = stored(name);
      // What this tab has stored may be newer than its entry
      return entry?.work && tab !== entry.tab ? entry.work[name] : value;
    };
    this.page.lesson.restore(kept("lesson"), kept("class"));
    for (const [name, value] of Object.entries(this.work)) beginWith(name, value);
    this.last = entry?.last ?? 0;
    this.tab = entry?.tab ?? this.tab;
    this.show(entry);
    this.save();
  }

  /** Show what the entry at which the browser has arrived holds; one that is not of this page is a link that somebody followed. */
  arrive() {
    this.travels = false;
    const entry = entryOf(window.history.state);
    const { settled } = this;
    if (!entry) this.place = this.last = this.place + 1;
    this.show(entry);
    if (!entry && !same(settled, this.settled)) this.previous = settled;
    this.save();
  }

  /** @param {Entry | null} entry null: what the address says */
  show(entry) {
    const link = location.hash.slice(1);
    this.page.speech.speak(new URLSearchParams(link).get("lang") ?? "");
    if (entry) {
      this.place = entry.place;
      this.previous = entry.before ? this.stateOf(entry.before) : null;
      this.page.lesson.show(entry.step);
    }
    if (entry || link) this.present = this.settled = this.stateOf(entry ? entry.link : link);
    this.page.change();
  }

  /** What was answered, by the name under which it is stored. */
  get work() {
    const { lesson } = this.page;
    return { lesson: lesson.record, class: lesson.classroom.record };
  }

  /** Keep what is typed: in the storage at once, in the entry when no further key follows. */
  saveSoon() {
    this.storeWork();
    clearTimeout(this.timer);
    this.timer = window.setTimeout(() => this.save(), PATIENCE);
  }

  storeWork() {
    const isKept = Object.entries(this.work).map(([name, value]) => store(name, this.tab, value)).every(Boolean);
    this.page.say("not-kept", isKept || this.page.lesson.isEmpty ? "" : () => text("notKept"));
  }

  /** Keep all that is set and answered, in the browser's history and in its storage; return whether its history took it.
   * @param {"replaceState" | "pushState"} how */
  save(how = "replaceState") {
    this.storeWork();
    clearTimeout(this.timer);
    const { place, last, settled, previous, tab, page, work } = this;
    /** @type {Entry} */
    const entry = { place, last, link: linkOf(settled), before: previous ? linkOf(previous) : "", step: page.lesson.place, tab };
    const isSmall = JSON.stringify(work).length < MOST_WORK;
    const isNamed = this.isNamed || page.speech.chosen !== "";
    return write(how, isSmall ? { ...entry, work } : entry, isNamed ? this.hash : undefined);
  }
}

/** An entry of the browser's history, if it is one of this page. @param {any} state @returns {Entry | null} */
function entryOf(state) {
  const isOurs = Number.isInteger(state?.place) && typeof state.link === "string" && state.step in STEPS;
  return isOurs ? state : null;
}

/** Write an entry; return whether the browser took it. @param {"replaceState" | "pushState"} how @param {Entry} entry
 * @param {string | undefined} address undefined: as it is */
function write(how, entry, address) {
  // A page within a page may not change its address
  for (const one of [address, undefined]) {
    try {
      window.history[how](entry, "", one);
      return true;
    } catch {
      // Refused, or too often within a short time
    }
  }
  return false;
}
