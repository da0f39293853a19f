/** What the browser keeps when its tab is closed; a page from a file, or in a window that keeps nothing, may have no storage. */

const BEGINNING = "looping-pendulum-";
/** Name -> what this tab had of it last: what another tab has stored in the meantime stays, if here nothing has changed.
 * @type {Map<string, string>} */
const known = new Map();

/** What is kept under a name, and which tab wrote it; nothing if nothing can be read. @param {string} name
 * @returns {{tab?: unknown, value?: unknown}} */
export function stored(name) {
  try {
    return JSON.parse(window.localStorage.getItem(BEGINNING + name) ?? "") ?? {};
  } catch {
    return {};
  }
}

/** Take a value as one with which this tab begins, and which it need not store. @param {string} name @param {unknown} value */
export function beginWith(name, value) {
  known.set(name, JSON.stringify(value));
}

/** Store a value that JSON can hold, if it has changed; return whether it is kept. @param {string} name @param {string} tab
 * @param {unknown} value */
export function store(name, tab, value) {
  const content = JSON.stringify(value);
  if (known.get(name) === content) return true;
  try {
    window.localStorage.setItem(BEGINNING + name, JSON.stringify({ tab, value }));
    known.set(name, content);
    return true;
  } catch {
    known.delete(name);
    forget(name);
    return false; // forbidden, or full
  }
}

/** Leave nothing that is out of date. @param {string} name */
function forget(name) {
  try {
    window.localStorage.removeItem(BEGINNING + name);
  } catch {
    // Where storing is forbidden nothing is there
  }
}
