/** Writes the study of a trial for `identify`, with what the page knows. */

import { FURTHER_EFFECTS, UNITS } from "../../model.js";
import { tidy } from "../controls.js";

/**
 * Return a study whose calibration is the page's fit: it believes the same numbers, and what the page fits is free in it.
 * @param {Record<string, any>} settings
 * @param {{file: string, tracks: Record<string, string>, length: string, time: string, rate: number | null, mirrored: boolean, start?: number, camera: import("./prediction.js").Camera, known: Record<string, number>}} trial `start`: as of a
 *   `Trial`; `known`: as of a `FitTask`
 */
export function studyYaml(settings, { file, tracks, length, time, rate, mirrored, start: clockStart = 0, camera, known }) {
  const quoted = (/** @type {string} */ words) => JSON.stringify(words);
  const si = (/** @type {string} */ name) => tidy(settings[name]);
  const inUnit = (/** @type {string} */ name) => `${si(name)} ${UNITS[name]}`;
  const inDegrees = (/** @type {number} */ angle) => `${tidy((angle * 180) / Math.PI)} deg`;
  const measured = (/** @type {string} */ name) =>
    `${inUnit(name)}${known[name] > 0 ? ` +/- ${tidy(known[name])} ${UNITS[name]}` : ""}`;
  const named = Object.entries(tracks).map(([mass, track]) => `${mass}: ${quoted(track)}`);
  const lengths = ["free_length", "hanging_length"].map((name) => `${name}: free from ${inUnit(name)}`).join(", ");
  const looping = settings.release === "looping";
  const { scale, tilt, ...places } = camera;
  const free = Object.entries(places)
    // A record of a swing may begin in its midst, which identify sees if it may believe the clock
    .filter(([name, value]) => looping || (name === "clock_offset" && value))
    // Stated, it is that of the file's own clock
    .map(([name, value]) => `${name}: free from ${name === "clock_offset" ? `${tidy(value - clockStart)} s` : `${tidy(value)} m`}`);
  const film = [
    ...(known.scale > 0 ? [`scale: ${tidy(scale)} +/- ${tidy(known.scale)}`] : []),
    ...(known.tilt > 0 ? [`tilt: ${inDegrees(tilt)} +/- ${inDegrees(known.tilt)}`] : []),
    ...free,
  ];
  const options = [
    ...(named.length ? [`tracks: {${named.join(", ")}}`] : []),
    ...(length !== "m" || time !== "s" ? [`units: {length: ${length}, time: ${time}}`] : []),
    ...(rate ? [`frame_rate: ${rate} Hz`] : []),
    ...(mirrored ? ["mirrored: true"] : []),
    ...(film.length ? [`camera: {${film.join(", ")}}`] : []),
  ];
  const { kinetic_friction: kinetic, static_friction: resting } = settings;
  // Not from 0, which would tell identify nothing of the size of friction
  const start = tidy(kinetic || resting / 2);
  const friction = resting > kinetic ? `{kinetic_friction: free from ${start}, static_friction: ${tidy(resting)}}` : "free";
  const further = Object.keys(FURTHER_EFFECTS).filter((name) => settings[name]);
  const radius = settings.light_radius ? `, radius: ${inUnit("light_radius")}` : "";
  const kind = looping ? "" : `kind: ${settings.release}, `;
  const others = further.map((name) => `  ${name}: ${inUnit(name)}\n`).join("");
  const said = options.map((line) => `    ${line}\n`).join("");
  return `# Written by the page live.html. Where you have measured what is free here, write the value, +/- and its standard error.
title: ${quoted(file)}
apparatus:
  light: {mass: ${measured("light_mass")}${radius}}
  rod: {radius: ${measured("rod_radius")}}
effects:
  gravity: ${inUnit("gravity")}
  capstan: ${friction}
  light_drag: free
  heavy_drag: ${measured("heavy_drag")}
  string_drag: ${measured("string_drag")}
${others}trials:
  - name: mine
    file: ${quoted(file)}
${said}    heavy: {mass: ${measured("heavy_mass")}}
    release: {${kind}angle: free from ${inUnit("release_angle")}, ${lengths}}
`;
}
