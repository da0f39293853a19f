"use strict";
// The language of a report: what the reader chose, else the first that the page has of those that the browser prefers.
const Language = (() => {
  const root = document.documentElement, button = document.getElementById("language"), theme = document.getElementById("theme");
  const { names, titles, texts } = JSON.parse(document.getElementById("languages").textContent);
  const has = (name) => name && Object.hasOwn(names, name);
  const other = () => Object.keys(names).find((name) => name !== root.lang);
  let stored = null;
  try { stored = localStorage.getItem("looping-pendulum-language"); } catch { /* a page from a file may have no storage */ }

  /** A text of the page in its language. */
  const said = (text) => texts[root.lang]?.[text] ?? text;

  function speak(name) {
    root.lang = name;
    document.title = titles[name];
    button.textContent = names[other()];
    button.lang = other();
    button.hidden = false;
    theme.dataset.dark = said("Dark");
    theme.dataset.light = said("Light");
    theme.setAttribute("aria-label", said("Change between dark and light"));
    for (const box of document.querySelectorAll("figure [aria-label]")) {
      box.dataset.english ??= box.getAttribute("aria-label");
      box.setAttribute("aria-label", said(box.dataset.english));
    }
    Theme.apply();
  }

  button.addEventListener("click", () => {
    speak(other());
    try { localStorage.setItem("looping-pendulum-language", root.lang); } catch { /* then it lasts until the page closes */ }
  });
  speak(has(stored) ? stored : navigator.languages.map((one) => one.split("-")[0]).find(has) ?? root.lang);
  return { said, get separators() { return root.lang === "de" ? ", " : ". "; } };
})();
