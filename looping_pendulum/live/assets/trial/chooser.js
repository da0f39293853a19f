/** Asks which column of a table is what, with a preview, where the page cannot tell. */

import { html } from "../elements.js";
import { store, stored } from "../storage.js";
import { text } from "../texts.js";
import { ROLES, columnsOf, guessed, plainTable } from "./columns.js";

/** @typedef {{name: string, bytes: Uint8Array}} TableFile */

const PREVIEW_ROWS = 4;
/** Under which a browser keeps what was chosen for a table with the same headings. */
const KEPT = "columns";

export class Chooser {
  /** @param {(id: string) => HTMLElement} element @param {(file: TableFile) => void} onChosen gets a plain table */
  constructor(element, onChosen) {
    this.box = element("trial-columns");
    this.ask = element("trial-columns-ask");
    this.table = /** @type {HTMLTableElement} */ (element("trial-columns-table"));
    /** @type {{name: string, columns: import("./columns.js").Columns, roles: string[]} | null} */
    this.offered = null;
    element("trial-columns-use").addEventListener("click", () => {
      if (!this.offered) return;
      const { name, columns, roles } = this.offered;
      remember(columns.head, roles);
      this.close();
      onChosen({ name, bytes: new TextEncoder().encode(plainTable(columns, roles)) });
    });
  }

  /** Ask for the columns of a file, or say false where it is no table. @param {TableFile} file */
  offer({ name, bytes }) {
    const columns = columnsOf(bytes);
    if (!columns) return false;
    this.offered = { name, columns, roles: remembered(columns.head) ?? guessed(columns.head) };
    this.box.hidden = false;
    this.show();
    return true;
  }

  close() {
    this.offered = null;
    this.box.hidden = true;
  }

  /** In the language of the page. */
  show() {
    if (!this.offered) return;
    const { name, columns, roles } = this.offered;
    const others = columns.others ? [text("columnsOthers", { count: columns.others })] : [];
    this.ask.textContent = [text("columnsAsk", { file: name }), ...others].join(" ");
    const choices = columns.head.map((heading, i) => {
      const options = ["", ...Object.keys(ROLES)].map((role) => new Option(text(role ? `role.${role}` : "roleNone"), role));
      const select = html("select", { ariaLabel: text("columnIs", { heading }) }, ...options);
      select.value = roles[i];
      select.addEventListener("change", () => {
        roles[i] = select.value;
        this.check();
      });
      return html("th", { scope: "col" }, select);
    });
    const headings = columns.head.map((heading) => html("th", { scope: "col" }, heading));
    const rows = columns.rows.slice(0, PREVIEW_ROWS).map((row) => html("tr", {}, ...row.map((cell) => html("td", {}, cell))));
    this.table.replaceChildren(html("thead", {}, html("tr", {}, ...choices), html("tr", {}, ...headings)), html("tbody", {}, ...rows));
    this.check();
  }

  /** Allow what can be read: a time, both axes of a mass or one of the others, nothing twice. */
  check() {
    const roles = (this.offered?.roles ?? []).filter(Boolean);
    const has = (/** @type {string[]} */ ...names) => names.every((name) => roles.includes(name));
    const shows = has("light_x", "light_y") || has("heavy_x", "heavy_y") || has("angle") || has("height");
    const isWhole = has("t") && shows && new Set(roles).size === roles.length;
    /** @type {HTMLButtonElement} */ (this.box.querySelector("button")).disabled = !isWhole;
  }
}

/** @param {string[]} head @returns {string[] | null} */
function remembered(head) {
  const roles = keptChoices()[head.join("\n")];
  return Array.isArray(roles) && roles.length === head.length && roles.every((role) => role === "" || Object.hasOwn(ROLES, role)) ? roles : null;
}

/** Where a browser keeps nothing, it is asked again. @param {string[]} head @param {string[]} roles */
function remember(head, roles) {
  store(KEPT, "", { ...keptChoices(), [head.join("\n")]: roles });
}

/** @returns {Record<string, unknown>} */
function keptChoices() {
  const { value } = stored(KEPT);
  return value && typeof value === "object" && !Array.isArray(value) ? /** @type {Record<string, unknown>} */ (value) : {};
}
