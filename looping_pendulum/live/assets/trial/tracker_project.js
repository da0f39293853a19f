/** Reads projects of Tracker (.trk) as `identify` does; `measured/tracker_project.py` says what their numbers mean. */

import { text } from "../texts.js";
import { largest, rounded, steps } from "./arrays.js";
import { count } from "./clock.js";
import { isArchive, textOf } from "./encoding.js";
import { massOfTrack } from "./masses.js";
import { dataError, inQuotes, inSentence, listed, quote } from "./messages.js";
import { range } from "./statistics.js";
import { factorTo, isPixel } from "./units.js";

/** @typedef {import("./clock.js").Sheet} Sheet */
/** @typedef {{tag: string, name: string, class: string, text: string, children: Element[]}} Element of the XML, an object or a property */
/** @typedef {{name: string, frame: number[], x: number[], y: number[]}} Track in the project's unit of length */
/** @typedef {{object: Element, start: number, end: number, step: number, startTime: number}} Clip [frames], [ms] */
/** @typedef {(frame: number) => number[]} AxesAt origin [pixels], angle [deg] and scales [pixels per unit] at a frame */

const TRACKER = "org.opensourcephysics.cabrillo.tracker.";
/** Tracks that a user may take for point masses -> what they are. @type {Record<string, import("../texts.js").TextKey>} */
const OTHER_TRACKS = {
  Vector: "project.vector", VectorSum: "project.vector", CenterOfMass: "project.centre", AnalyticParticle: "project.model",
  DynamicParticle: "project.model", DynamicParticlePolar: "project.model", DynamicSystem: "project.model",
  ParticleDataTrack: "project.imported",
};
const [MAX_FRAMES, MAX_PIXEL, MAX_NUMBER, MIN_SCALE, MIN_DURATION, STRETCH_TOLERANCE] = [300_000, 1e6, 1e12, 1e-9, 1e-6, 1e-3];
const TOKEN = /<!-{2}[^]*?-{2}>|<!\[CDATA\[([^]*?)\]\]>|<[!?][^>]*>|<(\/?)(\w+)([^>]*?)(\/?)>|([^<]+)/g;
/** @type {Record<string, string>} */
const SIGNS = { lt: "<", gt: ">", quot: '"', apos: "'", amp: "&" };
/** Bytes at the start of a project that name its program, and at the end of an archive that name its files. */
const [START, DIRECTORY] = [4096, 65536];

/** Largest number of tracks that a message names. */
const MAX_SHOWN = 5;

/** Something in the XML is not as Tracker writes it. */
class Damage extends Error {}

/** Whether a file is a project, by its name or its content. @param {string} file @param {Uint8Array} bytes */
export function isProject(file, bytes) {
  if (/\.tr[kz]$/i.test(file)) return true;
  if (isArchive(bytes)) return /\.trk/i.test(textOf(bytes.slice(-DIRECTORY)));
  const start = textOf(bytes.slice(0, START)).trimStart();
  return start.startsWith("<") && start.includes("org.opensourcephysics");
}

/** The channels of a project. @param {string} file @param {Uint8Array} bytes @param {import("./reader.js").How} how @returns {Sheet[]} */
export function sheetsOfProject(file, bytes, { tracks: asked, units, notes }) {
  const { tracks, frameTime, unit, notes: said } = readProject(file, bytes);
  notes.assumptions.push(...said);
  const isUnknown = isPixel(unit) && (units.length === "m" || isPixel(units.length));
  if (isUnknown) throw dataError(file, null, "", text("file.pixels"));
  const factor = factorTo("m", isPixel(unit) ? units.length : unit);
  if (factor === null) throw dataError(file, null, "", text("project.unit", { unit: quote(unit) }));
  const masses = massOfTrack(file, new Map(tracks.map((track) => [track.name, track])), asked);
  const left = tracks.filter(({ name }) => !Object.hasOwn(masses, name));
  const names = listed(left.map(({ name }) => inQuotes(name)));
  count(notes, "", text("project.notAskedFor", { names }), left.reduce((sum, { frame }) => sum + 2 * frame.length, 0));
  return tracks.filter((track) => !left.includes(track)).map(({ name, frame, ...places }) => ({
    clock: "t",
    lines: frame,
    time: frame.map((one) => frameTime[one]),
    rounding: frame.map(() => 0),
    frame,
    channels: /** @type {const} */ (["x", "y"]).map((axis) => {
      const value = places[axis].map((one) => one * factor);
      return { name: `${masses[name]}_${axis}`, column: `${axis} (${name})`, value, digit: frame.map(() => 0) };
    }),
  }));
}

/**
 * Read a project: its point masses, the times of the film's frames [s], its unit of length, and what was used and left out.
 * @param {string} file @param {Uint8Array} bytes
 */
export function readProject(file, bytes) {
  if (isArchive(bytes)) throw dataError(file, null, "", text("project.archive"));
  try {
    const panel = panelOf(textOf(bytes));
    const [clip, axesAt] = [clipOf(panel), axesOf(panel)];
    const { tracks, others, notes } = tracksOf(panel, clip, axesAt);
    if (!tracks.length) {
      const message = text(others.length ? "project.onlyOthers" : "project.noTracks", { others: others.slice(0, MAX_SHOWN).join(", ") });
      throw dataError(file, null, "", message);
    }
    if (others.length) notes.push(text("project.others", { others: others.join(", ") }));
    const frames = [...new Set(tracks.flatMap(({ frame }) => frame))];
    const settings = new Map(frames.map((frame) => [axesAt(frame).join(), axesAt(frame)]));
    if (settings.size > 1) notes.push(text("project.axes", { count: settings.size }));
    const reference = wordsOf(panel, "referenceframe");
    if (reference) notes.push(text("project.reference", { name: quote(reference) }));
    const isCalibrated = [...settings.values()].some(([, , , scaleX, scaleY]) => scaleX !== 1 || scaleY !== 1);
    if (!isCalibrated) notes.push(text("project.pixels"));
    if (clip.step > 1) notes.push(text("project.step", { count: clip.step }));
    const frameTime = frameTimes(panel, clip, largest(frames), notes);
    return { tracks, frameTime, unit: isCalibrated ? wordsOf(panel, "length_unit") || "m" : "px", notes };
  } catch (error) {
    // What is wrong inside, `identify` says
    throw error instanceof Damage ? dataError(file, null, "", text("project.damaged")) : error;
  }
}

/** The main object of a project. @param {string} xml */
function panelOf(xml) {
  /** @type {Element[]} */
  const open = [{ tag: "", name: "", class: "", text: "", children: [] }];
  const panels = [];
  for (const [, data, closing, tag, attributes, empty, words] of xml.matchAll(TOKEN)) {
    const parent = open[open.length - 1];
    if (!tag) parent.text += data ?? plain(words ?? "");
    else if (closing && open.pop()?.tag !== tag) throw new Damage();
    if (!tag || closing) continue;
    const [name, className] = [/\bname="([^"]*)"/, /\bclass="([^"]*)"/].map((key) => plain(key.exec(attributes)?.[1] ?? ""));
    const element = { tag, name, class: className, text: "", children: [] };
    parent.children.push(element);
    if (!empty) open.push(element);
    if (className === `${TRACKER}TrackerPanel`) panels.push(element);
  }
  if (open.length !== 1 || panels.length !== 1) throw new Damage();
  return panels[0];
}

/** Words with the signs that XML names. @param {string} words */
const plain = (words) => words.replace(/&(\w+);/g, (whole, name) => SIGNS[name] ?? whole);

/** What stands in the properties of an object that have a name. @param {Element | undefined} object @param {string} name */
const inside = (object, name) => (object?.children ?? []).filter((one) => one.name === name).flatMap(({ children }) => children);

/** @param {Element} object @param {string} name */
const wordsOf = (object, name) => object.children.find((one) => one.name === name)?.text.trim() ?? "";

/** A number of an object; one without a default must be there. @param {Element} object @param {string} name @param {string} absent */
const numberOf = (object, name, absent = "") => numberIn(wordsOf(object, name) || absent);

/** @param {string} words */
function numberIn(words) {
  if (!words || !(Math.abs(Number(words)) <= MAX_NUMBER)) throw new Damage();
  return Number(words);
}

/** The objects of an array of frames, ascending; a null is left out. @param {Element | undefined} object */
function framesOf(object) {
  const entries = inside(object, "framedata").filter(({ children }) => children.length);
  const frames = entries.map(({ name, children }) => ({ frame: Number(name.slice(1, -1)), entry: children[0] }));
  return frames.filter(({ frame }) => Number.isInteger(frame)).sort((a, b) => a.frame - b.frame);
}

/** The part of the film that the project uses. @param {Element} panel @returns {Clip} */
function clipOf(panel) {
  const [object] = inside(panel, "videoclip");
  if (!object) throw new Damage();
  const start = Math.max(rounded(numberOf(object, "startframe", "0")), 0);
  const step = Math.abs(rounded(numberOf(object, "stepsize", "1"))) || 1;
  const count = Math.abs(rounded(numberOf(object, "stepcount", String(MAX_FRAMES))));
  const end = Math.min(start + step * (count - 1), MAX_FRAMES - 1);
  return { object, start, end, step, startTime: numberOf(object, "starttime", "0") };
}

/** @param {Element} panel @returns {AxesAt} */
function axesOf(panel) {
  const names = ["xorigin", "yorigin", "angle", "xscale", "yscale"];
  const settings = framesOf(inside(panel, "coords")[0])
    .map(({ frame, entry }) => ({ frame, axes: names.map((name) => numberOf(entry, name)) }));
  if (!settings.length || settings.some(({ axes }) => axes.slice(3).some((scale) => Math.abs(scale) < MIN_SCALE))) throw new Damage();
  return (frame) => (settings.findLast((one) => one.frame <= frame) ?? settings[0]).axes;
}

/** The point masses that have points in the clip, the other tracks, and notes about points that were left out.
 * @param {Element} panel @param {Clip} clip @param {AxesAt} axesAt */
function tracksOf(panel, { start, end }, axesAt) {
  const [tracks, others, notes] = [/** @type {Track[]} */ ([]), /** @type {string[]} */ ([]), /** @type {string[]} */ ([])];
  for (const object of inside(panel, "tracks").flatMap(({ children }) => children)) {
    const [name, kind] = [wordsOf(object, "name") || "mass", object.class.replace(TRACKER, "")];
    if (Object.hasOwn(OTHER_TRACKS, kind)) others.push(`${quote(name)} (${text(OTHER_TRACKS[kind])})`);
    if (kind !== "PointMass") continue;
    // Not a number: this frame has no mark
    const marked = framesOf(object).filter(({ entry }) => ["x", "y"].every((axis) => wordsOf(entry, axis).toLowerCase() !== "nan"));
    const kept = marked.filter(({ frame }) => frame >= start && frame <= end);
    const left = marked.length - kept.length;
    if (left) notes.push(text("project.outside", { name: quote(name), start, end, count: left }));
    if (!kept.length) {
      others.push(`${quote(name)} (${text("project.noPoints")})`);
      continue;
    }
    if (tracks.some((track) => track.name === name)) throw new Damage();
    const places = kept.map(({ frame, entry }) => placeOf(numberOf(entry, "x"), numberOf(entry, "y"), axesAt(frame)));
    tracks.push({ name, frame: kept.map(({ frame }) => frame), x: places.map(([x]) => x), y: places.map(([, y]) => y) });
  }
  return { tracks, others, notes };
}

/** A place in the axes of a point in the picture. @param {number} x @param {number} y @param {number[]} axes */
function placeOf(x, y, [originX, originY, degrees, scaleX, scaleY]) {
  if (Math.max(Math.abs(x), Math.abs(y)) > MAX_PIXEL) throw new Damage();
  const [right, up, angle] = [(x - originX) / scaleX, (originY - y) / scaleY, (degrees * Math.PI) / 180];
  return [Math.cos(angle) * right + Math.sin(angle) * up, Math.cos(angle) * up - Math.sin(angle) * right];
}

/**
 * Times of all frames up to the last [s]: the film's own count from the clip's start, and are stretched to the project's clock.
 * @param {Element} panel @param {Clip} clip @param {number} last @param {string[]} notes
 */
function frameTimes(panel, { object, start, end, startTime }, last, notes) {
  const [video] = inside(object, "video");
  const durations = [inside(panel, "clipcontrol")[0], video].map((holder) => holder && Math.abs(numberOf(holder, "delta_t", "0")));
  const words = inside(video, "start_times").map((entry) => entry.text.replace(/[\s{}]/g, "")).join();
  let film = words ? words.split(",").map(numberIn) : [];
  if (!steps(film).every((step) => step >= MIN_DURATION)) {
    notes.push(text("project.times"));
    film = [];
  }
  const until = Math.min(end, film.length - 1);
  const ofFilm = until > start ? (film[until] - film[start]) / (until - start) : 0;
  const duration = durations.find(Boolean) ?? ofFilm;
  if (duration < MIN_DURATION) throw new Damage();
  const stretch = ofFilm ? duration / ofFilm : 1;
  if (Math.abs(stretch - 1) > STRETCH_TOLERANCE) {
    notes.push(text("project.stretched", { duration: inSentence(duration, 4), film: inSentence(ofFilm, 4) }));
  }
  if (film.length > 1 && film.length <= last) notes.push(text("project.late", { last: film.length - 1 }));
  if (startTime) notes.push(text("project.start", { time: inSentence(startTime / 1000), frame: start }));
  const known = film.length ? film : [0];
  const times = range(0, Math.max(last + 1, known.length)).map((frame) => {
    const nearest = Math.min(frame, known.length - 1);
    return known[nearest] * stretch + (frame - nearest) * duration;
  });
  return times.map((time) => (time - times[start] + startTime) / 1000);
}
