/** Reads a trial's tracked points as `identify` does (`discrepancy/data/readers.py`), with the same messages (in English). */

import { shown, text } from "../texts.js";
import { readColumns, stem } from "./columns.js";
import { DataError, dataError, general, inQuotes, quote, readTable } from "./table.js";

/** @typedef {import("./table.js").Table} Table */
/** @typedef {import("./table.js").TableLine} TableLine */
/** @typedef {import("./columns.js").Column} Column */
/** @typedef {{name: string, column: string, t: number[], value: number[]}} Channel SI */
/** @typedef {{channel: Channel, rows: TableLine[], column: Column}} ReadChannel */
/**
 * @typedef {{tracks?: Record<string, string>, units?: Record<string, string>, frame_rate?: number | null,
 *   clip_rate?: number | null, drop?: number | null}} Options
 */
/** @typedef {{channel: string, reason: string, count: number}} Unused values of a channel, or of a column that is none */
/** @typedef {{channels: Channel[], unused: Unused[], assumptions: string[]}} Trial */

export { DataError };

/** Channel -> its SI unit. @type {Record<string, string>} */
const UNITS = {
  light_x: "m", light_y: "m", heavy_x: "m", heavy_y: "m", angle: "rad", angle_rate: "rad/s", height: "m",
};
/** SI unit -> unit -> its factor. @type {Record<string, Record<string, number>>} */
const FACTORS = {
  m: { m: 1, meter: 1, metre: 1, dm: 0.1, cm: 1e-2, mm: 1e-3, km: 1e3, um: 1e-6, "µm": 1e-6, in: 0.0254, inch: 0.0254, ft: 0.3048 },
  s: { s: 1, sec: 1, second: 1, ms: 1e-3, us: 1e-6, "µs": 1e-6, min: 60 },
  rad: { rad: 1, radian: 1, mrad: 1e-3, deg: Math.PI / 180, degree: Math.PI / 180, "°": Math.PI / 180, turn: 2 * Math.PI },
  "rad/s": { "rad/s": 1, "deg/s": Math.PI / 180, "°/s": Math.PI / 180 },
};
/** @type {Record<string, string>} */
const DEFAULT_UNITS = { length: "m", time: "s", angle: "rad" };
/** @type {Record<string, string>} */
const KIND_OF_UNIT = { t: "time", x: "length", y: "length", height: "length", angle: "angle" };
const MASSES = ["light", "heavy"];
/** Largest plausible values; a larger one must be in another unit. @type {Record<string, number>} */
const MAX_VALUE = { m: 1000, light: 20, heavy: 20, rad: 4 * Math.PI, "rad/s": 1000 };
const MAX_TIME_STEP = 0.5;
const RATE_TOLERANCE = 0.01;

/**
 * Read the bytes of a file.
 * @param {string} file its name
 * @param {Uint8Array} bytes
 * @param {Options} options
 * @returns {Trial}
 * @throws {DataError}
 */
export function readTrial(file, bytes, options = {}) {
  const { tracks = {}, drop = null, frame_rate: rate = null } = options;
  for (const key of /** @type {const} */ (["frame_rate", "clip_rate"])) {
    const value = options[key] ?? null;
    if (value !== null && !(value > 0 && value < Infinity)) {
      throw dataError(file, null, "", text("file.rate", { key, value: inSentence(value) }));
    }
  }
  const table = readTable(file, bytes);
  if (table.head.length && table.head[table.head.length - 1].cells[0].toLowerCase() === "quantity") {
    throw table.error(null, "", text("file.eventTable"));
  }
  /** @type {string[]} */
  const assumptions = [];
  const columns = readColumns(table, tracks, assumptions);
  refuseIncompleteRows(table, columns);
  const rows = rowsOfOneDrop(table, columns, drop);
  /** @type {Unused[]} */
  const unused = [];
  const units = { ...DEFAULT_UNITS, ...options.units };
  const read = readChannels(table, rows, columns, tracks, units, { unused, assumptions });
  if (!read.length) throw table.error(null, "", text("file.nothing"));
  refuseImplausible(table, read, columns.some(({ role }) => role === "t") && rate === null);
  const channels = withTrueRate(table, columns, read, rate, options.clip_rate ?? null, assumptions);
  return { channels, unused, assumptions: [...new Set(assumptions)] };
}

/** Names of the tracks of a file, without saying which is which. @param {string} file @param {Uint8Array} bytes */
export function tracksOf(file, bytes) {
  const columns = readColumns(readTable(file, bytes), {}, []);
  return [...new Set(columns.filter(({ role }) => role === "x" || role === "y").map(({ track }) => track))];
}

/** @param {Unused[]} unused @param {string} channel @param {string} reason @param {number} more */
function count(unused, channel, reason, more = 1) {
  const known = unused.find((one) => one.channel === channel && one.reason === reason);
  if (known) known.count += more;
  else if (more) unused.push({ channel, reason, count: more });
}

/** A number in a sentence. @param {number} x @param {number} [digits] */
const inSentence = (x, digits) => shown(general(x, digits));

/** @param {Table} table @param {Column[]} columns @param {number | null} drop */
function rowsOfOneDrop(table, columns, drop) {
  const column = columns.find(({ role }) => role === "drop");
  if (!column) {
    if (drop !== null) throw table.error(null, "", text("file.noDrop", { drop }));
    return table.rows;
  }
  const numbers = table.rows.map((row) => table.number(row, column.index, column.label));
  const have = [...new Set(numbers.flatMap((n) => (n === null ? [] : [n])))].sort((a, b) => a - b);
  const found = have.map((n) => general(n)).join(", ");
  if (drop === null && have.length > 1) {
    throw table.error(null, column.label, text("file.severalDrops", { have: found, first: general(have[0]) }));
  }
  const wanted = drop ?? have[0];
  if (!have.includes(wanted)) {
    throw table.error(null, column.label, text("file.otherDrops", { have: found, wanted: general(wanted) }));
  }
  return table.rows.filter((_, i) => numbers[i] === wanted);
}

/** @param {Table} table @param {Column[]} columns */
function refuseIncompleteRows(table, columns) {
  const width = columns[columns.length - 1].index + 1;
  for (const row of table.rows) {
    const filled = row.cells.findLastIndex((cell) => cell) + 1;
    // Editors trim tabs at the end of a line, so that a short row there only lacks its last points
    const short = row.cells.length < width && table.delimiter !== "\t";
    if (filled > width || short) {
      const tooMany = table.delimiter === "," && filled > width;
      throw table.error(row.line, "", text(tooMany ? "file.cellsWithCommas" : "file.cells", { count: row.cells.length, width }));
    }
  }
}

/**
 * @param {Table} table
 * @param {TableLine[]} rows
 * @param {Column[]} columns
 * @param {Record<string, string>} tracks
 * @param {Record<string, string>} units
 * @param {{unused: Unused[], assumptions: string[]}} notes
 * @returns {ReadChannel[]}
 */
function readChannels(table, rows, columns, tracks, units, notes) {
  const masses = massOfTrack(table, columns, tracks);
  const timed = columns.filter(({ role }) => role === "t");
  const clocks = timed.length ? timed : columns.filter(({ role }) => role === "frame");
  /** @type {Map<string, ReadChannel>} */
  const channels = new Map();
  for (const column of columns) {
    const { role, index, label } = column;
    if (["t", "frame", "drop"].includes(role)) continue;
    const name = role === "x" || role === "y" ? `${masses[column.track] ?? ""}_${role}` : role;
    if (!Object.hasOwn(UNITS, name)) {
      const reason = text(role ? "unused.notAskedFor" : "unused.otherKind", { column: inQuotes(label) });
      count(notes.unused, "", reason, rows.filter(({ cells }) => cells[index]).length);
      continue;
    }
    if (channels.has(name)) {
      throw table.error(null, label, text("file.second", { name }));
    }
    const clock = clocks.findLast((one) => one.index < index) ?? clocks[0];
    channels.set(name, readChannel(table, rows, { clock, column, name, units, ...notes }));
  }
  return [...channels.values()];
}

/** @param {Table} table @param {Column[]} columns @param {Record<string, string>} tracks @returns {Record<string, string>} */
function massOfTrack(table, columns, tracks) {
  const have = [...new Set(columns.filter(({ role }) => role === "x" || role === "y").map(({ track }) => track))];
  const found = have.map((track) => (track ? `'${track}'` : text("file.withoutName"))).join(", ");
  const asked = Object.entries(tracks);
  if (asked.length) {
    const unknown = asked.find(([mass]) => !MASSES.includes(mass));
    if (unknown) throw table.error(null, "", text("file.unknownMass", { name: quote(unknown[0]) }));
    const names = asked.map(([, track]) => track);
    if (new Set(names).size < names.length) {
      throw table.error(null, "", text("file.bothMasses", { name: quote(names[0]) }));
    }
    if (have.length === 1 && asked.length === 1 && (have[0] === "" || names[0] === "")) return { [have[0]]: asked[0][0] };
    const missing = names.find((track) => !have.includes(track));
    if (missing !== undefined) {
      throw table.error(null, "", text("file.missingTrack", { have: found, name: quote(missing) }));
    }
    return Object.fromEntries(asked.map(([mass, track]) => [track, mass]));
  }
  /** @type {Record<string, string>} */
  const known = {};
  for (const track of have) {
    const words = track.toLowerCase().replaceAll("_", " ");
    for (const mass of MASSES) {
      if (new RegExp(`\\b${mass}\\b`).test(words)) known[track] = mass;
    }
  }
  if (have.length && !Object.keys(known).length) {
    throw table.error(null, "", text("file.whichTrack", { have: found, track: have[0] || stem(table.file) }));
  }
  return known;
}

/**
 * @param {Table} table
 * @param {TableLine[]} rows
 * @param {{clock: Column, column: Column, name: string, units: Record<string, string>, unused: Unused[],
 *   assumptions: string[]}} how
 * @returns {ReadChannel}
 */
function readChannel(table, rows, { clock, column, name, units, unused, assumptions }) {
  const timeFactor = clock.role === "frame" ? 1 : factorOf(table, clock, "s", units);
  const valueFactor = factorOf(table, column, UNITS[name], units);
  /** @type {number[]} */
  const times = [];
  /** @type {number[]} */
  const values = [];
  /** @type {TableLine[]} */
  const kept = [];
  for (const row of rows) {
    const value = table.number(row, column.index, column.label);
    const time = table.number(row, clock.index, clock.label);
    if (value === null || time === null) {
      count(unused, name, text(value === null ? "unused.empty" : "unused.withoutTime"));
      continue;
    }
    const last = times.length - 1;
    if (last >= 0 && time <= times[last]) {
      if (time === times[last] && value === values[last]) {
        count(unused, name, text("unused.repeated"));
        continue;
      }
      const found = { time: inSentence(time), before: inSentence(times[last]), line: kept[last].line };
      throw table.error(row.line, clock.label, text("file.timesGrow", found));
    }
    times.push(time);
    values.push(value);
    kept.push(row);
  }
  if (!times.length) throw table.error(null, column.label, text("file.noValues", { name }));
  if (!column.unit && KIND_OF_UNIT[column.role] === "length") assumptions.push(text("assumed.lengths", { unit: units.length }));
  const channel = { name, column: column.label, t: times.map((t) => t * timeFactor), value: values.map((v) => v * valueFactor) };
  return { channel, rows: kept, column };
}

/** @param {Table} table @param {Column} column @param {string} si @param {Record<string, string>} units */
function factorOf(table, column, si, units) {
  const unit = column.unit || units[KIND_OF_UNIT[column.role] ?? ""] || si;
  if (Object.hasOwn(FACTORS[si], unit)) return FACTORS[si][unit];
  const line = table.head.length && column.unit ? table.head[table.head.length - 1].line : null;
  throw table.error(line, column.label, text("file.unit", { unit: quote(unit), si }));
}

/** @param {number[]} values */
function median(values) {
  const sorted = [...values].sort((a, b) => a - b);
  const middle = sorted.length >> 1;
  return sorted.length % 2 ? sorted[middle] : (sorted[middle - 1] + sorted[middle]) / 2;
}

/** @param {number[]} ascending */
const steps = (ascending) => ascending.slice(1).map((t, i) => t - ascending[i]);

/** @param {Table} table @param {ReadChannel[]} read @param {boolean} checkTimes */
function refuseImplausible(table, read, checkTimes) {
  for (const { channel, rows } of read) {
    const unit = UNITS[channel.name];
    const limit = MAX_VALUE[channel.name.split("_")[0]] ?? MAX_VALUE[unit];
    let worst = 0;
    channel.value.forEach((value, i) => {
      if (Math.abs(value) > Math.abs(channel.value[worst])) worst = i;
    });
    if (Math.abs(channel.value[worst]) > limit) {
      const [kind, other] = unit.startsWith("rad") ? ["angle", "deg"] : ["length", "cm"];
      const values = { value: inSentence(channel.value[worst]), unit, limit: inSentence(limit, 4), kind, other };
      throw table.error(rows[worst].line, channel.column, text("file.tooLarge", values));
    }
    const step = channel.t.length > 1 ? median(steps(channel.t)) : 0;
    if (checkTimes && step > MAX_TIME_STEP) {
      throw table.error(rows[0].line, "t", text("file.slow", { step: inSentence(step) }));
    }
  }
}

/**
 * Replace the frame rate that the file's times were computed with by the true one.
 * @param {Table} table
 * @param {Column[]} columns
 * @param {ReadChannel[]} read
 * @param {number | null} rate
 * @param {number | null} clipRate
 * @param {string[]} assumptions
 * @returns {Channel[]}
 */
function withTrueRate(table, columns, read, rate, clipRate, assumptions) {
  const frames = columns.filter(({ role }) => role === "frame");
  const channels = read.map(({ channel }) => channel);
  if (rate === null) {
    if (columns.some(({ role }) => role === "t")) return channels;
    throw table.error(null, "", text("file.needsRate"));
  }
  if (frames.length) return withTimesFromFrames(table, frames, read, rate);
  const all = [...new Set(channels.flatMap(({ t }) => t))].sort((a, b) => a - b);
  const fileRate = clipRate ?? (all.length > 1 ? 1 / median(steps(all)) : rate);
  if (Math.abs(fileRate / rate - 1) < RATE_TOLERANCE) return channels;
  const rates = { from: inSentence(fileRate, 4), to: inSentence(rate, 4) };
  assumptions.push(text(clipRate ? "assumed.rate" : "assumed.rateByRows", rates));
  return channels.map((one) => ({ ...one, t: one.t.map((t) => (t * fileRate) / rate) }));
}

/** @param {Table} table @param {Column[]} frames @param {ReadChannel[]} read @param {number} rate */
function withTimesFromFrames(table, frames, read, rate) {
  const numbers = read.map(({ rows, column }) => {
    const clock = frames.find(({ track }) => track === column.track) ?? frames[0];
    /** @type {number[]} */
    const counts = [];
    for (const row of rows) {
      const frame = table.number(row, clock.index, clock.label);
      const last = counts[counts.length - 1];
      if (frame === null || (counts.length && frame <= last)) {
        const message = frame === null ? text("file.noFrame") : text("file.framesGrow", { frame: general(frame), before: general(last) });
        throw table.error(row.line, clock.label, message);
      }
      counts.push(frame);
    }
    return counts;
  });
  const first = Math.min(...numbers.map(([start]) => start));
  return read.map(({ channel }, i) => ({ ...channel, t: numbers[i].map((frame) => (frame - first) / rate) }));
}
