/** Files that the page writes: a picture, the run's numbers, a scenario. */

import { FURTHER_EFFECTS, UNITS } from "../model.js";
import { simulate } from "../run.js";
import { colours } from "./canvas.js";
import { tidy } from "./controls.js";
import { durationOf } from "./shown_run.js";
import { shown } from "./texts.js";

const TIME_BETWEEN_ROWS = 1e-3;
const FRAMES_PER_SECOND = 30;
/** What a scenario without a string does not have. */
const OF_THE_STRING = ["kinetic_friction", "static_friction", "string_drag"];
/**
 * Return the settings as a scenario file, which `looping-pendulum compare` runs.
 * @param {Record<string, any>} settings
 * @param {Record<string, string>} keys parameter -> where a scenario file writes it, "light.mass"
 * @param {string} link
 */
export function scenarioYaml(settings, keys, link) {
  const { release } = settings;
  /** @type {Map<string, string[]>} */
  const groups = new Map();
  const put = (/** @type {string} */ key, /** @type {string} */ value) => {
    const [group, name] = key.includes(".") ? key.split(".") : ["", key];
    const line = name === key ? `${name}: ${value}` : `  ${name}: ${value}`;
    groups.set(group, [...(groups.get(group) ?? []), line]);
  };
  for (const [name, unit] of Object.entries(UNITS)) {
    const value = tidy(settings[name]);
    if (value === 0 && (name === "light_radius" || name in FURTHER_EFFECTS)) continue;
    if (release === "vertical" && name === "release_angle") continue;
    if (release === "drop" && OF_THE_STRING.includes(name)) continue;
    put(keys[name], unit ? `${value} ${unit}` : `${value}`);
  }
  put(keys.release, release);
  put("duration", `${durationOf(release)} s`);
  const lines = [...groups].flatMap(([group, entries]) => (group ? [`${group}:`, ...entries] : entries));
  return `# Written by the page live.html with the settings\n# ${link}\ntitle: Live\n${lines.join("\n")}\n`;
}

/** Return the run as a table, a row each millisecond, with units; in German with semicolons and decimal commas.
 * @param {Record<string, any>} settings */
export function runCsv(settings) {
  const run = simulate(settings, { duration: durationOf(settings.release) });
  // As spreadsheets of the language have it
  const separator = shown(0.5).includes(",") ? ";" : ",";
  const columns = ["t [s]", "light_x [m]", "light_y [m]", "heavy_x [m]", "heavy_y [m]", "wrap_angle [rad]", "light_tension [N]", "heavy_tension [N]"];
  const rows = [[...columns, "mode"].join(separator)];
  const count = Math.floor(run.endTime / TIME_BETWEEN_ROWS);
  for (let i = 0; i <= count; i++) {
    const s = run.sample(i * TIME_BETWEEN_ROWS);
    const numbers = [i * TIME_BETWEEN_ROWS, ...s.light, ...s.heavy, s.wrapAngle, s.lightTension, s.heavyTension];
    rows.push([...numbers.map((x) => shown(Number(x.toPrecision(9)))), s.mode].join(separator));
  }
  return `${rows.join("\n")}\n`;
}

/**
 * Return a picture of the stage with words below it.
 * @param {HTMLCanvasElement} stage
 * @param {string[]} words each is kept on one line
 */
export function captioned(stage, words) {
  const size = Math.max(12, Math.round(stage.width / 60));
  const made = document.createElement("canvas");
  const c = /** @type {CanvasRenderingContext2D} */ (made.getContext("2d"));
  const font = `${size}px system-ui, sans-serif`;
  c.font = font;
  /** @type {string[]} */
  const lines = [];
  for (const part of words) {
    const longer = lines.length ? `${lines[lines.length - 1]}, ${part}` : part;
    if (lines.length && c.measureText(longer).width < stage.width - 2 * size) lines[lines.length - 1] = longer;
    else lines.push(part);
  }
  [made.width, made.height] = [stage.width, stage.height + Math.round(1.5 * size * (lines.length + 0.5))];
  const { ink, panel } = colours();
  c.fillStyle = panel;
  c.fillRect(0, 0, made.width, made.height);
  c.drawImage(stage, 0, 0);
  c.fillStyle = ink;
  c.font = font; // a canvas of another size forgets it
  lines.forEach((line, i) => c.fillText(line, size, stage.height + 1.5 * size * (i + 1)));
  return made;
}

/** Kind of film that this browser can make; "" if none. */
export function filmType() {
  const types = ["video/webm;codecs=vp9", "video/webm", "video/mp4"];
  return typeof MediaRecorder === "undefined" ? "" : (types.find((type) => MediaRecorder.isTypeSupported(type)) ?? "");
}

/**
 * Begin to film a canvas; return what ends the film and saves it.
 * @param {HTMLCanvasElement} canvas
 * @returns {() => void}
 */
export function film(canvas) {
  const mimeType = filmType();
  const recorder = new MediaRecorder(canvas.captureStream(FRAMES_PER_SECOND), { mimeType });
  /** @type {Blob[]} */
  const parts = [];
  recorder.ondataavailable = ({ data }) => parts.push(data);
  recorder.onstop = () => save(`looping-pendulum.${mimeType.includes("mp4") ? "mp4" : "webm"}`, new Blob(parts, { type: mimeType }));
  recorder.start();
  return () => recorder.stop();
}

/** Copy words for pasting elsewhere; return whether the browser lets a page do so: from a folder it may not. @param {string} words */
export async function copyText(words) {
  try {
    await navigator.clipboard.writeText(words);
    return true;
  } catch {
    return false;
  }
}

/** Have the browser save a file. @param {string} name @param {Blob} content */
export function save(name, content) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(content);
  link.download = name;
  link.click();
  // The browser has begun to read it when the click returns, but need not have ended
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}
