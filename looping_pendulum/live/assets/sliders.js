/** The sliders: each with its range, a field for a typed number, and steps by keyboard. */

import { RELEASES } from "../model.js";
import { CONTROLS, controlOf, isMeaningful, parsed, snapped } from "./controls.js";
import { html } from "./elements.js";
import { shown, text } from "./texts.js";

/** @import { Control, State } from "./controls.js" */
/**
 * @typedef {{current: () => Record<string, number>, onMove: (name: string, value: number) => void,
 *   onSettle: (later: boolean) => void, onRelease: (release: string) => void, onFault: (message: () => string, row: HTMLElement | undefined) => void}} Callbacks
 *   `onMove`: on its way; `onSettle`: as it shall stay, at once or when no further key follows
 */

const LARGE_STEP = 10;
/** Rows of sliders in two boxes, those that are seldom needed in the second. */
export class Sliders {
  /** @param {HTMLElement} main @param {HTMLElement} more @param {HTMLSelectElement} release @param {Callbacks} callbacks */
  constructor(main, more, release, callbacks) {
    this.callbacks = callbacks;
    this.release = release;
    /** @type {Map<string, {row: HTMLElement, range: HTMLInputElement, field: HTMLInputElement, words: HTMLElement, limits: HTMLElement}>} */
    this.rows = new Map();
    /** Fields in which a number is being typed. @type {Set<HTMLInputElement>} */
    this.typing = new Set();
    for (const control of CONTROLS) (control.more ? more : main).append(this.row(control));
    for (const name of Object.keys(RELEASES)) release.append(new Option("", name));
    this.relabel();
    release.addEventListener("change", () => callbacks.onRelease(release.value));
  }

  /** @param {Control} control */
  row(control) {
    const { name, unit, min, max, step } = control;
    const words = html("label", { htmlFor: `range-${name}` });
    const range = html("input", { type: "range", id: `range-${name}`, min: String(min), max: String(max), step: "any" });
    const field = html("input", { type: "text", id: `field-${name}`, inputMode: "decimal", autocomplete: "off" });
    const typed = html("span", { className: "typed" }, field, html("span", { className: "unit" }, unit));
    const limits = html("span", { className: "limits", ariaHidden: "true" }, html("span"), html("span"));
    const row = html("div", { className: "setting" }, words, range, typed, limits);
    row.dataset.name = name;
    range.addEventListener("input", () => this.callbacks.onMove(name, snapped(Number(range.value), step)));
    range.addEventListener("change", () => this.callbacks.onSettle(false));
    range.addEventListener("keydown", (event) => this.onKey(event, control));
    field.addEventListener("input", () => this.typing.add(field));
    field.addEventListener("change", () => this.onTyped(control, field));
    this.rows.set(name, { row, range, field, words, limits });
    return row;
  }

  /** Write all names and limits in the language of the page. */
  relabel() {
    for (const [name, { words, field, limits }] of this.rows) {
      const { unit, min, max } = controlOf(name);
      const setting = text(`setting.${name}`);
      words.textContent = setting;
      field.setAttribute("aria-label", unit ? text("typedIn", { setting, unit }) : text("typed", { setting }));
      [min, max].forEach((limit, i) => (limits.children[i].textContent = shown(limit)));
    }
    for (const option of this.release.options) option.text = text(`release.${option.value}`);
  }

  /** Step by a round number; the browser's own step of a range without steps is none. @param {KeyboardEvent} event
   * @param {Control} control */
  onKey(event, { name, min, max, step }) {
    /** @type {Record<string, number>} */
    const steps = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, PageUp: LARGE_STEP, PageDown: -LARGE_STEP };
    const value = this.callbacks.current()[name];
    let wanted;
    if (event.key in steps) {
      const count = steps[event.key];
      wanted = snapped(value, step) + count * step;
    } else if (event.key === "Home") wanted = min;
    else if (event.key === "End") wanted = max;
    else return;
    event.preventDefault();
    event.stopPropagation();
    this.callbacks.onMove(name, wanted);
    this.callbacks.onSettle(true);
  }

  /** @param {Control} control @param {HTMLInputElement} field */
  onTyped(control, field) {
    this.typing.delete(field);
    const value = parsed(field.value);
    const { name, unit, min, max } = control;
    if (value >= min && value <= max) {
      this.callbacks.onMove(name, value);
      this.callbacks.onSettle(false);
      return;
    }
    const example = this.callbacks.current()[name];
    const typed = field.value.trim();
    field.value = shown(example);
    this.callbacks.onFault(() => {
      const label = text(`setting.${name}`);
      return Number.isNaN(value)
        ? text("notANumber", { label, text: typed, example })
        : text("outOfRange", { label, value: typed, unit, min, max }).replaceAll("  ", " ").trim();
    }, this.rows.get(name)?.row);
  }

  /** @param {State} state */
  show(state) {
    if (this.release.value !== state.release) this.release.value = state.release;
    for (const [name, { row, range, field }] of this.rows) {
      const value = state.values[name];
      range.value = String(value);
      const { unit } = controlOf(name);
      range.setAttribute("aria-valuetext", `${shown(value)} ${unit}`.trim());
      if (!this.typing.has(field)) field.value = shown(value);
      row.hidden = !isMeaningful(name, state);
    }
  }
}
