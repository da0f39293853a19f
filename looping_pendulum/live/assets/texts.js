/** Words of the page in the language that is chosen; a further language is a file in texts/ and its name in `LANGUAGES`. */

import { de } from "./texts/de.js";
import { en } from "./texts/en.js";

/** @typedef {keyof typeof en | `${"setting" | "misfit" | "event" | "mode" | "release" | "lesson" | "moment" | "band" | "effect" | "role" | "teacher"}.${string}`} TextKey
 * a family has a text for each member */

/** Language -> its table, the first for readers of any other. @type {Record<string, Record<string, string>>} */
export const LANGUAGES = { en, de };
const state = { language: "en" };

/** Language that is shown. */
export const language = () => state.language;

/** @param {string} name */
export function setLanguage(name) {
  if (Object.hasOwn(LANGUAGES, name)) state.language = name;
}

/** The first language that the page has of those that a reader prefers. @param {readonly string[]} preferred "de-AT" */
export function languageFor(preferred) {
  return preferred.map((tag) => tag.slice(0, 2).toLowerCase()).find((tag) => Object.hasOwn(LANGUAGES, tag)) ?? "en";
}

/**
 * Return a text with its values filled in; numbers get the decimal sign of the language.
 * @param {TextKey} key
 * @param {Record<string, string | number | undefined>} values
 */
export function text(key, values = {}) {
  return LANGUAGES[state.language][key].replace(/\{(\w+)\}/g, (_, name) => {
    const value = values[name];
    return typeof value === "number" ? shown(value) : String(value);
  });
}

/** Title and story of an example, which the English table leaves to the scenario files.
 * @param {{name: string, title: string, description: string, shipped: boolean}} preset */
export function textsOf({ name, title, description, shipped }) {
  const table = shipped ? LANGUAGES[state.language] : {};
  return { title: table[`scenario.${name}.title`] ?? title, description: table[`scenario.${name}.description`] ?? description };
}

/** Names of effects; those that a reader's own package brings have no text here. @param {string[]} effects */
export function namesOf(effects) {
  const table = LANGUAGES[state.language];
  return effects.map((name) => table[`effect.${name}`] ?? name.replaceAll("_", " ")).join(", ");
}

/** A number, or one in digits, with the decimal sign of the language. @param {number | string} number */
export function shown(number) {
  return String(number).replace(".", LANGUAGES[state.language].decimalSign);
}

/** A number in words, and its unit if it has one. @param {string} number @param {string} unit */
export const withUnit = (number, unit) => (unit ? `${number} ${unit}` : number);

/** A number as people write it: its first digits, in groups of three from 10 000 on, never with an exponent.
 * @param {number} number @param {number} digits */
export function written(number, digits) {
  const [whole, part] = String(Number(number.toPrecision(digits))).split(".");
  const grouped = whole.length > 4 ? whole.replace(/\B(?=(\d{3})+$)/g, "\u202f") : whole;
  return shown(part ? `${grouped}.${part}` : grouped);
}

/** A number with some digits behind the decimal sign; what rounds to zero has no sign. @param {number} number @param {number} digits */
export const fixed = (number, digits) => shown(number.toFixed(digits).replace(/^-(?=[0.]+$)/, ""));
