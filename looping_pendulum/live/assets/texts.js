/** Words that the scripts of the page write; a further language is a further table of these. */

/** Release -> its name. */
export const RELEASES = {
  looping: "let the light mass go",
  vertical: "both hang straight down",
  held: "heavy mass clamped",
  drop: "no string",
};

/** Event of a run -> what happens. */
export const EVENTS = {
  stops: "the heavy mass stops and turns round",
  sticks: "the string grips the rod",
  halts: "the heavy mass halts for good",
  slips: "the string slides again",
  slack: "the string goes slack",
  taut: "the string is taut again",
  light_reaches_rod: "the light mass reaches the rod",
  heavy_reaches_rod: "the heavy mass is pulled up to the rod",
  unwrapped: "the string comes off the rod",
  time_up: "here the page stops",
};

/** Mode of a run -> what the string does. */
export const MODES = {
  sticking: "the rod holds the string",
  sliding_down: "the string slides; the heavy mass falls",
  sliding_up: "the string slides; the heavy mass rises",
  slack: "the string is slack",
  clamped: "the light mass swings",
  clamped_slack: "the string is slack",
  falling: "both masses fall freely",
  ended: "the end",
  rolling: "the string sticks to the rod, which turns",
  unknown: "",
};

/** Kind of a moment of a stored run -> its short name. */
export const MOMENTS = {
  stop: "stop", stick: "stick", slip: "slip", slack: "slack", taut: "taut", halt: "halt", rod: "at the rod", broke: "broke off",
  other: "event",
};

/** Mode of the reference -> what stands in its band under the time. */
export const BAND = {
  sliding_down: "slides, M2 falls", sliding_up: "slides, M2 rises", sticking: "sticks", rolling: "sticks", slack: "slack",
  clamped: "sticks", clamped_slack: "slack", falling: "no string",
};

export const TEXTS = {
  start: "Drag the light mass M1, or press Play.",
  play: "Play",
  pause: "Pause",
  halts: "The heavy mass halts after {time} s, {drop}\u00a0cm below its start.",
  neverHalts: "The heavy mass never halts: {ending} after {time} s.",
  goesOn: "The heavy mass does not halt within {time} s.",
  stays: "Nothing moves: the rod holds the string.",
  pulledUp: "The heavy mass falls without a halt: {ending} after {time} s.",
  held: "The heavy mass is clamped; the light one swings, and its string winds on and off the rod.",
  drop: "Without a string both fall, slowed only by the air.",
  change: "Before: {time} s, {drop} cm. Change: {moreTime} s, {moreDrop} cm.",
  before: "Before: {time} s, {drop} cm.",
  beforeNever: "Before, it never halted.",
  notANumber: "{label}: found '{text}', needed a number such as {example}",
  outOfRange: "{label}: found {value} {unit}, needed {min} to {max} {unit}",
  badLink: "the link: {key}: found '{text}', needed {min} to {max}; the rest of the link is used",
  badRelease: "the link: release: found '{text}', needed one of {names}; the rest of the link is used",
  cannotRun: "This cannot be built: {fault}",
  films: "Filming until the end, or until you press Pause …",
  copied: "The link is copied.",
  notCopied: "Copy the address from the address bar: it holds all settings.",
  trialUsed: "{file}: {used}. {typical}",
  trialDistance: "Typical distance from the run: {distance} cm.",
  trialNone: "No point falls into the time of the run.",
  notUsed: "not used: {count} ({reason})",
  fitWorks: "Fitting …",
  fitFails: "The fit broke down; set the sliders nearer to your trial and fit again.",
  fitNeedsLoop: "Set the release to: let the light mass go.",
  fitNeedsPoints: "found {count} points of M1 after the release, needed at least 10",
  fitDone: "Typical distance in x or y: {before} cm before the fit, {after} cm after it.",
  fitNoise: "What is left looks like noise.",
  fitNotNoise: "What is left is not noise: neighbouring points err alike (correlation {alike}), so something is missing. Save the study file; looping-pendulum identify looks for it.",
  fitNotConverged: "It has not come to rest; fit again.",
  originX: "Rod's axis in your file, x",
  originY: "Rod's axis in your file, y",
  engines: "Engines beside it",
  otherSettings: "The engines' runs belong to {title}; with other settings they are not drawn.",
  back: "Back to {title}",
  standIn: "This page's model does not have {effects}. What moves is the stored run of the reference; a slider sets the page's model going, without {effects}.",
  without: "This motion is without {effects}.",
  notKnown: "What moves is a stored run; what is known of it is in the results of compare.",
  measured: "measured: {name}",
  measuredCaption: "Tracked points up to the chosen time, each at its own time; the large rings are the latest.",
  notRun: "not run",
  notRunWhy: "Not run:",
  moments: "Moments of every run",
  allMoments: "All moments",
  noMoments: "none before {time} s",
  lastMoment: "; last moment: {moment} at {time} s",
  stringOfReference: "the reference's string",
  departs: "where, when and why it departs",
  sources: "Where the runs come from",
  aboutRuns: "Positions are those that each engine computed, thinned to {rate} a second; moments and all numbers come from the full runs. The reference is the model of this page. Its pulls are exact; an engine's are what Newton's law asks of its motion, over {window} ms. A run that ends early fades where it ends. Keys: N and P go to the next and the previous moment of the runs that are shown.",
  words: "Words",
  turns: "turns",
  rodOfRuns: "the rod, enlarged",
  unknownToRuns: "no run here knows it",
  plotPullM1: "Pull of the string at M1 [N]",
  plotPullM2: "Pull of the string at M2 [N]",
  plotDistance: "Distance of M1 from the reference's [mm]",
  now: "Now",
  ended: "ended",
  colRun: "run",
  colDrop: "drop of M2 [mm]",
  colTurns: "wrap angle [turns]",
  colPullM1: "string at M1 pulls [N]",
  colPullM2: "string at M2 pulls [N]",
  colDistance: "M1 from the reference [mm]",
  mapWithout: "It is computed without {effects}.",
  mapNoLoop: "It stands for a light mass that is let go, not for this release.",
};

/**
 * Return a text of `TEXTS` with its values filled in.
 * @param {keyof typeof TEXTS} name
 * @param {Record<string, string | number>} values
 */
export function text(name, values = {}) {
  return TEXTS[name].replace(/\{(\w+)\}/g, (_, key) => String(values[key]));
}
