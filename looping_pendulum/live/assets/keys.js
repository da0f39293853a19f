/** Keys that act wherever the focus is, but where it needs them itself. */

/** What acts on the space bar while it has the focus. */
const KEEPS_SPACE = "button, summary, label:has(input[type=checkbox]), input[type=checkbox]";

/**
 * @typedef {{player: import("./player.js").Player,
 *   go: (where: "undo" | "redo") => void, goToMoment: (direction: number) => boolean}} KeyPage
 */

/** @param {KeyPage} page */
export function listenToKeys(page) {
  document.addEventListener("keydown", (event) => {
    if (isForPage(page, event)) event.preventDefault();
  });
  // A button or box that was clicked would keep the space bar to itself; one that Tab leads to acts on it, as it should
  document.addEventListener("click", (event) => {
    const clicked = event.detail > 0 && event.target instanceof Element && event.target.closest(KEEPS_SPACE);
    if (!clicked) return;
    requestAnimationFrame(() => {
      // The click may have led the focus elsewhere
      const { activeElement } = document;
      if (clicked.contains(activeElement)) /** @type {HTMLElement} */ (activeElement).blur();
    });
  });
}

/** Do what a key says; return whether it says anything. @param {KeyPage} page @param {KeyboardEvent} event */
function isForPage(page, event) {
  const target = /** @type {HTMLElement} */ (event.target);
  if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "z" && !target.matches("input[type=text]")) {
    page.go(event.shiftKey ? "redo" : "undo");
    return true;
  }
  if (event.ctrlKey || event.metaKey || event.altKey) return false;
  if (target.matches("input:not(#time, [type=checkbox]), select, textarea, summary, a, .table")) return false;
  if (event.key === " " && target.matches("button, input[type=checkbox]")) return false;
  const direction = { n: 1, p: -1 }[event.key.toLowerCase()];
  return direction === undefined ? page.player.onKey(event) : page.goToMoment(direction);
}
