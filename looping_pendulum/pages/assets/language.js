"use strict";
// The language of a report: what the reader chose, else the first that the page has of those that the browser prefers.
const Language = (() => {
  const root = document.documentElement, button = document.getElementById("language");
  const pages = JSON.parse(document.getElementById("languages").textContent);
  const has = (name) => name && Object.hasOwn(pages, name);
  let stored = null;
  try { stored = localStorage.getItem("looping-pendulum-language"); } catch { /* a page from a file may have no storage */ }

  /** A text of a figure in the language of the page. */
  const said = (text) => pages[root.lang].texts[text] ?? text;

  function speak(name) {
    const page = pages[name], other = Object.keys(pages).find((one) => one !== name);
    root.lang = name;
    document.title = page.title;
    button.textContent = pages[other].words.name;
    button.lang = other;
    button.hidden = false;
    const { dark, light, theme } = page.words, toggle = document.getElementById("theme");
    Object.assign(toggle.dataset, { dark, light });
    toggle.setAttribute("aria-label", theme);
    for (const box of document.querySelectorAll("figure [aria-label]")) {
      box.dataset.english ??= box.getAttribute("aria-label");
      box.setAttribute("aria-label", said(box.dataset.english));
    }
    Theme.apply();
  }

  button.addEventListener("click", () => {
    const name = Object.keys(pages).find((one) => one !== root.lang);
    try { localStorage.setItem("looping-pendulum-language", name); } catch { /* then it lasts until the page closes */ }
    speak(name);
  });
  speak(has(stored) ? stored : navigator.languages.map((one) => one.split("-")[0]).find(has) ?? root.lang);
  return { said, get decimalSign() { return pages[root.lang].words.decimal_sign; } };
})();
