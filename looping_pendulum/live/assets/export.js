/** Files that the page writes: a picture, the run's numbers, a scenario. */

import { FURTHER_EFFECTS, UNITS } from "../model.js";
import { simulate } from "../run.js";
import { tidy } from "./controls.js";
import { durationOf } from "./shown_run.js";

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

/** Return the run as a table, a row each millisecond [SI]. @param {Record<string, any>} settings */
export function runCsv(settings) {
  const run = simulate(settings, { duration: durationOf(settings.release) });
  const rows = ["t,light_x,light_y,heavy_x,heavy_y,wrap_angle,light_tension,heavy_tension,mode"];
  const count = Math.floor(run.endTime / TIME_BETWEEN_ROWS);
  for (let i = 0; i <= count; i++) {
    const s = run.sample(i * TIME_BETWEEN_ROWS);
    const numbers = [i * TIME_BETWEEN_ROWS, ...s.light, ...s.heavy, s.wrapAngle, s.lightTension, s.heavyTension];
    rows.push([...numbers.map((x) => Number(x.toPrecision(9))), s.mode].join(","));
  }
  return `${rows.join("\n")}\n`;
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

/** Have the browser save a file. @param {string} name @param {Blob} content */
export function save(name, content) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(content);
  link.download = name;
  link.click();
  // The browser has begun to read it when the click returns, but need not have ended
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}
