/** Tells which track shows which mass, as `identify` does (`measured/readers.py`). */

import { text } from "../texts.js";
import { percentile } from "./arrays.js";
import { stem } from "./columns.js";
import { dataError, listed, quote } from "./messages.js";

/** @typedef {Map<string, {x: number[], y: number[]}>} Places of every track, in the file's units, without missing points */

const MASSES = ["light", "heavy"];
/** Percentage of the points at either end of a range that do not count, as an autotracker slips. */
const OUTLIER_SHARE = 5;

/**
 * The mass of each track, as asked for or by the track's own name.
 * @param {string} file @param {Places} places @param {Record<string, string>} tracks mass -> name of its track
 * @returns {Record<string, string>}
 */
export function massOfTrack(file, places, tracks) {
  const error = (/** @type {string} */ message) => dataError(file, null, "", message);
  const names = [...places.keys()];
  const have = listed(names.map((track) => (track ? `'${track}'` : text("file.withoutName"))));
  const proposed = Object.entries(proposedMasses(places)).map(([mass, track]) => `${mass}: ${track || stem(file)}`).join(", ");
  const asked = Object.entries(tracks);
  if (asked.length) {
    const unknown = asked.find(([mass]) => !MASSES.includes(mass));
    if (unknown) throw error(text("file.unknownMass", { name: quote(unknown[0]) }));
    const wanted = asked.map(([, track]) => track);
    if (new Set(wanted).size < wanted.length) throw error(text("file.bothMasses", { name: quote(wanted[0]) }));
    if (names.length === 1 && asked.length === 1 && [names[0], wanted[0]].includes("")) return { [names[0]]: asked[0][0] };
    const missing = wanted.find((track) => !places.has(track));
    if (missing !== undefined && names.length) throw error(text("file.missingTrack", { have, name: quote(missing), proposed }));
    return Object.fromEntries(asked.map(([mass, track]) => [track, mass]));
  }
  const known = names.flatMap((track) => (massInName(track) ? [[track, massInName(track)]] : []));
  if (names.length && !known.length) throw error(text("file.whichTrack", { have, proposed }));
  return Object.fromEntries(known);
}

/** The mass that the name of a track says; "" if it says none, or both. @param {string} track */
function massInName(track) {
  const words = track.toLowerCase().replaceAll("_", " ");
  const said = MASSES.filter((mass) => new RegExp(`\\b${mass}\\b`).test(words));
  return said.length === 1 ? said[0] : "";
}

/**
 * Mass -> name of its track, by the names of the tracks or by their motion: the light mass swings, the heavy one falls along a
 * vertical line. If none is clearly narrower, as in a vertical release, it is the one that falls farther.
 * @param {Places} places @returns {Record<string, string>}
 */
function proposedMasses(places) {
  /** @type {Record<string, string>} */
  const named = {};
  for (const track of places.keys()) if (massInName(track)) named[massInName(track)] = track;
  const rest = [...places].filter(([track]) => !Object.values(named).includes(track))
    .map(([track, { x, y }]) => ({ track, width: widthOf(x), fall: y.length ? y[0] - y[y.length - 1] : 0 }));
  let missing = MASSES.filter((mass) => !(mass in named));
  if (!rest.length || !missing.length) return named;
  const [byWidth, byFall] = [[...rest].sort((a, b) => a.width - b.width), [...rest].sort((a, b) => a.fall - b.fall)];
  let [narrow, wide] = [byWidth[0], byWidth[rest.length - 1]];
  if (rest.length > 1 && 2 * narrow.width > wide.width) [narrow, wide] = [byFall[rest.length - 1], byFall[0]];
  if (rest.length === 1 && missing.length > 1) missing = [2 * wide.width < wide.fall ? "heavy" : "light"];
  return { ...named, ...Object.fromEntries(missing.map((mass) => [mass, mass === "light" ? wide.track : narrow.track])) };
}

/** Range of values without outliers. @param {number[]} x */
const widthOf = (x) => (x.length ? percentile(x, 100 - OUTLIER_SHARE) - percentile(x, OUTLIER_SHARE) : 0);
