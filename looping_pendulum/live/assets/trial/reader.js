/**
 * Reads a trial's tracked points from a plain table: a time, and x and y of each mass, an angle or a height. All other files are for
 * `looping-pendulum look`, which reads many forms, judges their clocks, and writes such a table.
 */

import { shown, text } from "../texts.js";
import { scatter, startOf } from "./start.js";
import { mean, median, range } from "./statistics.js";
import { DataError, isTime, notPlain, numbersOf, quote, readTable } from "./table.js";
import { factorTo } from "./units.js";

/** @import { Column, Table } from "./table.js" */
/** SI, without missing samples; `error`: standard errors that the file states, 0 for an empty one.
 * @typedef {{name: string, t: number[], value: number[], error?: number[]}} Channel */
/** What is said about a file. @typedef {{tracks?: Record<string, string>, units?: Record<string, string>, frame_rate?: number | null}} Options */
/** `empty`: number of empty cells; `start`: time by the file's clock that was taken as 0 [s].
 * @typedef {{channels: Channel[], empty: number, assumptions: string[], start: number}} Trial */
/** A column with a position, and the track that it is of; "": a file's only one. @typedef {Column & {role: string, track: string}} Place */

export { DataError };

/** "light_x", "ball x", "lightx", "x", "x1". */
const PLACE = /^(?:(?:(.*)[ _]|(light|heavy))?([xy])|([xy])[ _]?([0-9]+))$/i;
/** Channels that belong to no track -> their SI unit. @type {Record<string, string>} */
const OTHER_ROLES = { angle: "rad", height: "m" };
/** Largest plausible values; a larger one must be in another unit. @type {Record<string, number>} */
const MAX_VALUE = { light: 20, heavy: 20, height: 1000, angle: 4 * Math.PI };
/** Largest plausible time between rows [s]. */
const MAX_TIME_STEP = 0.5;
/** Channels of each body. */
const BODIES = [["light_x", "light_y"], ["heavy_x", "heavy_y"], ["angle"], ["height"]];
/** Of a body: rows that show anything, points that are left without copies, and copies, at least; the noise in which a copy tells
 * anything, as a part of the range of the values (`measured/edits.py`). */
const [MIN_ROWS, MIN_FRESH, MIN_COPIES, MIN_NOISE] = [12, 6, 3, 5e-5];
/** Relative difference of two frame rates that are the same. */
const RATE_TOLERANCE = 0.01;

/** Read the bytes of a file, or say in a `DataError` why not.
 * @param {string} file its name @param {Uint8Array} bytes @param {Options} options @returns {Trial} */
export function readTrial(file, bytes, { tracks = {}, units = {}, frame_rate: frameRate = null } = {}) {
  const isRate = frameRate === null || (frameRate > 0 && frameRate < Infinity);
  if (!isRate) throw new DataError(`${file}: ${text("file.rate")}`, "trial-rate");
  const table = readTable(file, bytes);
  // With missing rows, a true rate is that of the frames
  const hasFrames = table.columns.some(({ name }) => name.toLowerCase() === "frame");
  if (frameRate !== null && hasFrames) throw notPlain(file, null, text("file.frames"));
  const places = placesOf(table);
  const masses = massOfTrack(file, [...new Set(places.map(({ track }) => track))], tracks);
  const positions = places.flatMap((place) => {
    const mass = masses[place.track];
    return mass ? [{ column: place, name: `${mass}_${place.role}`, si: "m" }] : [];
  });
  const others = table.columns.flatMap((column) => {
    const name = column.name.toLowerCase();
    return Object.hasOwn(OTHER_ROLES, name) ? [{ column, name, si: OTHER_ROLES[name] }] : [];
  });
  const found = positions.length ? positions : others;
  if (!found.length) throw notPlain(file, null, text("file.noPositions"), true);
  const twice = found.find(({ name }, i) => found.findIndex((one) => one.name === name) < i);
  if (twice) throw notPlain(file, null, text("file.second", { name: twice.name }), true);
  const alone = positions.find(({ name }) => !positions.some((one) => one.name === otherAxis(name)));
  if (alone) throw notPlain(file, null, text("file.oneAxis", { name: alone.name, other: otherAxis(alone.name) }), true);
  /** @type {string[]} */
  const assumptions = [];
  let empty = 0;
  const channels = found.map(({ column, name, si }) => {
    if (si === "m" && !column.unit) assumptions.push(text("assumed.lengths", { unit: units.length ?? "m" }));
    const value = inSi(table, column, si, units.length);
    const time = timesFor(table, column, units.time);
    const kept = value.flatMap((one, i) => (Number.isFinite(one + time[i]) ? [i] : []));
    empty += value.length - kept.length;
    if (!kept.length) throw notPlain(file, null, text("file.noValues", { name }));
    const back = kept.findIndex((i, k) => k > 0 && time[i] <= time[kept[k - 1]]);
    if (back >= 0) throw notPlain(file, table.lines[kept[back]], text("file.timesGrow"));
    const errors = errorsOf(table, column, si, units.length);
    /** @type {Channel} */
    const channel = { name, t: kept.map((i) => time[i]), value: kept.map((i) => value[i]) };
    if (errors) channel.error = kept.map((i) => errors[i] || 0);
    refuseImplausible(file, channel);
    return channel;
  });
  const step = usualStep(channels);
  if (frameRate === null && step > MAX_TIME_STEP) {
    throw new DataError(`${file}: ${text("file.slow", { step: shown(Number(step.toPrecision(4))) })}`, "trial-clock");
  }
  const trueTimes = frameRate === null ? channels : atRate(channels, 1 / step, frameRate, assumptions);
  const start = startOf(trueTimes);
  if (start) assumptions.push(text("assumed.start", { start: shown(Number(start.toPrecision(4))) }));
  const fromStart = start ? trueTimes.map((one) => ({ ...one, t: one.t.map((t) => t - start) })) : trueTimes;
  const fresh = BODIES.flatMap((body) => withoutCopies(fromStart.filter(({ name }) => body.includes(name)), assumptions));
  const named = (/** @type {string} */ wanted) => fresh.filter(({ name }) => name === wanted);
  return { channels: fromStart.flatMap(({ name }) => named(name)), empty, assumptions: [...new Set(assumptions)], start };
}

/**
 * The channels of a body without points that repeat the one before in every digit: a copy has no noise of its own, and would
 * count twice in a fit.
 * @param {Channel[]} body @param {string[]} assumptions
 */
function withoutCopies(body, assumptions) {
  const [first] = body;
  if (!first || first.t.length < MIN_ROWS || body.some(({ t }) => t.length !== first.t.length)) return body;
  const fresh = range(0, first.t.length).filter((i) => !i || body.some(({ value }) => value[i] !== value[i - 1]));
  const copies = first.t.length - fresh.length;
  const part = (/** @type {number[]} */ all) => fresh.map((i) => all[i]);
  const left = body.map((one) => ({ ...one, t: part(one.t), value: part(one.value), ...(one.error && { error: part(one.error) }) }));
  // Of rounded points many that are no neighbours are equal, too
  const byChance = Math.max(...left.map(({ value }) => value.length - new Set(value).size));
  const hasNoise = left.every(({ t, value }) => scatter(t, value) > MIN_NOISE * (Math.max(...value) - Math.min(...value)));
  if (fresh.length < MIN_FRESH || copies < Math.max(MIN_COPIES, byChance) || !hasNoise) return body;
  assumptions.push(text("assumed.copies", { mass: first.name.startsWith("heavy") ? "M2" : "M1", count: copies }));
  return left;
}

/** Names of the tracks of a file, without saying which is which. @param {string} file @param {Uint8Array} bytes */
export const tracksOf = (file, bytes) => [...new Set(placesOf(readTable(file, bytes)).map(({ track }) => track))];

/** The columns of positions; one whose unit is no length is something else, such as a velocity. @param {Table} table @returns {Place[]} */
function placesOf({ columns }) {
  return columns.flatMap((column) => {
    const [match, named = "", joined = "", role = "", numbered = "", number = ""] = PLACE.exec(column.name) ?? [];
    const isLength = !column.unit || factorTo("m", column.unit) !== null || ["px", "pixel"].includes(column.unit);
    if (match === undefined || !isLength) return [];
    return [{ ...column, role: (role || numbered).toLowerCase(), track: named || joined || number || column.title }];
  });
}

/** The mass of each track, as chosen or by the track's own name. @param {string} file @param {string[]} names
 * @param {Record<string, string>} chosen mass -> name of its track @returns {Record<string, string>} */
function massOfTrack(file, names, chosen) {
  const asked = Object.entries(chosen);
  if (asked.length) {
    if (new Set(Object.values(chosen)).size < asked.length) throw new DataError(`${file}: ${text("file.bothMasses")}`, "trial-heavy");
    return Object.fromEntries(asked.map(([mass, track]) => [track, mass]));
  }
  const known = names.flatMap((name) => (massInName(name) ? [[name, massInName(name)]] : []));
  if (names.length && !known.length) {
    const have = names.map((name) => (name ? quote(name) : text("onlyTrack"))).join(", ");
    throw new DataError(`${file}: ${text("file.whichTrack", { have })}`, "trial-light");
  }
  return Object.fromEntries(known);
}

/** The mass that the name of a track says; "" if it says none, or both. @param {string} track */
function massInName(track) {
  const words = track.toLowerCase().split(/[^a-z]+/);
  const said = ["light", "heavy"].filter((mass) => words.includes(mass));
  return said.length === 1 ? said[0] : "";
}

/** The values of a column. @param {Table} table @param {Column} column @param {string} si @param {string} unit where the column names none */
function inSi(table, column, si, unit = si) {
  const named = column.unit || (si === "rad" ? si : unit);
  const factor = factorTo(si, named);
  if (factor === null) throw notPlain(table.file, null, text("file.unit", { column: quote(column.name), unit: quote(named) }));
  return numbersOf(table, column).map((value) => factor * value);
}

/** Standard errors of a column's values, from the column "light_x_error" for "light_x"; null: there is none.
 * @param {Table} table @param {Column} column @param {string} si @param {string} [unit] */
function errorsOf(table, { name, title }, si, unit) {
  const wanted = `${name}_error`.toLowerCase();
  const column = table.columns.find((one) => one.name.toLowerCase() === wanted && one.title === title);
  if (!column) return null;
  const errors = inSi(table, column, si, unit);
  const negative = errors.findIndex((error) => error < 0);
  if (negative < 0) return errors;
  const words = { column: quote(column.name), cell: quote(column.cells[negative]) };
  throw notPlain(table.file, table.lines[negative], text("file.error", words));
}

/** The times of a column's rows. Tracker repeats the times for each track; those of a column stand left of it.
 * @param {Table} table @param {Column} column @param {string} [unit] */
function timesFor(table, column, unit) {
  const clocks = table.columns.filter(({ name }) => isTime(name));
  return inSi(table, clocks.findLast(({ index }) => index < column.index) ?? clocks[0], "s", unit);
}

/** Mean time from row to row where none is missing, as each may be rounded [s]. @param {Channel[]} channels */
function usualStep(channels) {
  const steps = channels.flatMap(({ t }) => t.slice(1).map((later, i) => later - t[i]));
  const usual = median(steps);
  return mean(steps.filter((step) => step < 1.5 * usual));
}

/** The channels with the times of the camera's true frame rate. @param {Channel[]} channels @param {number} rowsPerSecond by the file
 * @param {number} rate @param {string[]} assumptions */
function atRate(channels, rowsPerSecond, rate, assumptions) {
  if (!(Math.abs(rowsPerSecond / rate - 1) >= RATE_TOLERANCE)) return channels;
  const [from, to] = [rowsPerSecond, rate].map((one) => shown(Number(one.toPrecision(4))));
  assumptions.push(text("assumed.rate", { from, to }));
  return channels.map((one) => ({ ...one, t: one.t.map((t) => (t * rowsPerSecond) / rate) }));
}

/** "light_y" for "light_x". @param {string} name */
const otherAxis = (name) => name.replace(/[xy]$/, (axis) => (axis === "x" ? "y" : "x"));

/** Refuse values that must be in another unit than was said. @param {string} file @param {Channel} channel */
function refuseImplausible(file, { name, value }) {
  const limit = MAX_VALUE[name.split("_")[0]];
  const large = value.find((one) => Math.abs(one) > limit);
  if (large === undefined) return;
  const unit = name === "angle" ? "rad" : "m";
  const words = { name, unit, value: shown(Number(large.toPrecision(6))), limit: shown(Number(limit.toPrecision(4))) };
  throw new DataError(`${file}: ${text("file.tooLarge", words)}`, "trial-length");
}
