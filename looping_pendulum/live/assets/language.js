/** The language of the page: fills its words into the elements, which name their keys, and keeps what they say. */

import { html } from "./elements.js";
import { LANGUAGES, language, languageFor, setLanguage, text } from "./texts.js";

/** @import { TextKey } from "./texts.js" */

/** Attribute that holds a key -> the attribute that gets the words. */
const ATTRIBUTES = { label: "aria-label", tip: "title", hint: "placeholder" };

/** What the page says, in the language that its reader prefers or chose. */
export class Speech {
  /** @param {(id: string) => HTMLElement} element @param {() => void} onLanguage to be called when all words are to be written anew */
  constructor(element, onLanguage) {
    this.element = element;
    this.onLanguage = onLanguage;
    /** Language that was chosen, which links then name. */
    this.chosen = "";
    /** Element -> what it says, in whatever language. @type {Map<string, () => string>} */
    this.said = new Map();
    setLanguage(languageFor(navigator.languages));
    this.select = /** @type {HTMLSelectElement} */ (element("language"));
    // Each by its own name, which its readers know
    this.select.replaceChildren(...Object.entries(LANGUAGES).map(([name, table]) => Object.assign(new Option(table.language, name), { lang: name })));
  }

  /** @param {string} id @param {string | (() => string)} words a function if they shall stay in another language, too */
  say(id, words) {
    const now = typeof words === "string" ? words : words();
    if (typeof words === "string") this.said.delete(id);
    else this.said.set(id, words);
    if (this.element(id).textContent !== now) this.element(id).textContent = now;
  }

  /** Choose a language; one that the page does not have is left. @param {string} name */
  speak(name) {
    if (!Object.hasOwn(LANGUAGES, name)) return;
    this.chosen = name;
    if (name === language()) return;
    setLanguage(name);
    this.onLanguage();
  }

  /** Write all fixed words of the page, and again what was said. */
  fill() {
    document.documentElement.lang = this.select.value = language();
    document.title = text("pageTitle");
    for (const element of all("text")) write(element, wordsOf(element, "text"));
    for (const [name, attribute] of Object.entries(ATTRIBUTES)) {
      for (const element of all(name)) element.setAttribute(attribute, wordsOf(element, name));
    }
    for (const [id, words] of this.said) this.element(id).textContent = words();
    this.nameTheme();
  }

  /** Name the colours to which the button changes. */
  nameTheme() {
    this.say("theme", text(document.documentElement.dataset.theme === "dark" ? "light" : "dark"));
  }
}

/** @param {string} name @returns {HTMLElement[]} */
function all(name) {
  return [...document.querySelectorAll(`[data-${name}]`)].map((element) => /** @type {HTMLElement} */ (element));
}

/** Words of the key that an element names; values of the text are its other data. @param {HTMLElement} element @param {string} name */
function wordsOf(element, name) {
  return text(/** @type {TextKey} */ (element.dataset[name]), element.dataset);
}

/** Write words into an element; what stands between backticks is typed or read by a program. @param {HTMLElement} element
 * @param {string} words */
export function write(element, words) {
  element.replaceChildren(...words.split("\x60").map((part, i) => (i % 2 ? html("code", {}, part) : part)));
}
