"use strict";
// Dark or light: what the reader chose, else what the system prefers; on paper light. Set before the first paint.
const Theme = (() => {
  const root = document.documentElement;
  const preferred = window.matchMedia("(prefers-color-scheme: dark)");
  const listeners = [];
  let chosen = null, printing = false;
  try { chosen = localStorage.getItem("looping-pendulum-theme"); } catch { /* a page from a file may have no storage */ }

  function apply() {
    root.dataset.theme = printing ? "light" : chosen ?? (preferred.matches ? "dark" : "light");
    const button = document.getElementById("theme");
    if (button) button.textContent = root.dataset.theme === "dark" ? "Light" : "Dark";
    listeners.forEach((listener) => listener());
  }

  function toggle() {
    chosen = root.dataset.theme === "dark" ? "light" : "dark";
    try { localStorage.setItem("looping-pendulum-theme", chosen); } catch { /* then it lasts until the page closes */ }
    apply();
  }

  /** The colour that a CSS value such as "var(--run-0)" has now. */
  function colour(value) {
    const name = /^var\((--[\w-]+)\)$/.exec(value);
    return name ? getComputedStyle(root).getPropertyValue(name[1]).trim() : value;
  }

  preferred.addEventListener("change", apply);
  window.addEventListener("beforeprint", () => { printing = true; apply(); });
  window.addEventListener("afterprint", () => { printing = false; apply(); });
  document.addEventListener("DOMContentLoaded", () => {
    document.getElementById("theme")?.addEventListener("click", toggle);
    apply();
  });
  apply();
  return { colour, onChange: (listener) => listeners.push(listener), get printing() { return printing; } };
})();
