// Prints the page's tables of texts, and the members of the families of keys that its scripts put together.
import { MOMENT_SHAPES } from "../../looping_pendulum/live/assets/engine_runs/shapes.js";
import { CONTROLS } from "../../looping_pendulum/live/assets/controls.js";
import { STEPS } from "../../looping_pendulum/live/assets/lesson/steps.js";
import { LANGUAGES, languageFor } from "../../looping_pendulum/live/assets/texts.js";
import { ROLES } from "../../looping_pendulum/live/assets/trial/columns.js";
import { FITTED_CHANNELS } from "../../looping_pendulum/live/assets/trial/prediction.js";
import { END_EVENTS, MODE_NAMES, RELEASES } from "../../looping_pendulum/live/model.js";

const modes = [...Object.values(MODE_NAMES), "unknown"];
let input = "";
for await (const part of process.stdin) input += part;
process.stdout.write(JSON.stringify({
  languages: LANGUAGES,
  families: {
    misfit: ["along", "across", ...FITTED_CHANNELS.filter((name) => !name.startsWith("light"))],
    setting: CONTROLS.map(({ name }) => name),
    mode: modes,
    band: modes,
    moment: Object.keys(MOMENT_SHAPES),
    release: Object.keys(RELEASES),
    lesson: STEPS.flatMap(({ name, options, task }) =>
      ["title", "text", "question", "why", ...options, ...(task ? ["task"] : [])].map((part) => `${name}.${part}`)),
    teacher: STEPS.flatMap(({ name }) => ["aim", "say", "ask"].map((part) => `${name}.${part}`)),
    role: Object.keys(ROLES),
    event: [...END_EVENTS, "stops", "sticks", "halts", "slips", "slack", "taut"],
  },
  preferred: JSON.parse(input).map(languageFor),
}));
