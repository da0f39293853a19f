/** States of the settings, one after the other, to go back and forth. */

import { same } from "./controls.js";

/** @typedef {import("./controls.js").State} State */

/** Longest row of states that is kept. */
const MAX_STATES = 200;

/** What was set, what is set, and what was undone. */
export class History {
  /** @param {State} state */
  constructor(state) {
    /** The state that is shown, which may be on its way. */
    this.present = state;
    /** @type {State[]} */
    this.past = [];
    /** @type {State[]} */
    this.undone = [];
    /** The last state that was not on its way. */
    this.settled = state;
  }

  /** The setting before this one; null without one. */
  get before() {
    const settled = same(this.present, this.settled);
    return settled ? (this.past[this.past.length - 1] ?? null) : this.settled;
  }

  /** Keep the shown state as a setting of its own. */
  settle() {
    if (same(this.present, this.settled)) return;
    this.past.push(this.settled);
    if (this.past.length > MAX_STATES) this.past.shift();
    this.settled = this.present;
    this.undone = [];
  }

  undo() {
    this.settle();
    const state = this.past.pop();
    if (!state) return;
    this.undone.push(this.settled);
    this.present = this.settled = state;
  }

  redo() {
    this.settle();
    const state = this.undone.pop();
    if (!state) return;
    this.past.push(this.settled);
    this.present = this.settled = state;
  }
}
