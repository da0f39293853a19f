// How runs end, in words: {settings, duration}[] as JSON on standard input, {language: sentence}[] on standard output.
import { readFileSync } from "node:fs";
import { resultOf } from "../../looping_pendulum/live/assets/outcome.js";
import { ShownRun } from "../../looping_pendulum/live/assets/shown_run.js";
import { LANGUAGES, setLanguage } from "../../looping_pendulum/live/assets/texts.js";
import { ready } from "../../looping_pendulum/live/run.js";

const cases = JSON.parse(readFileSync(0, "utf8"));
await ready;
const answers = cases.map((settings) => {
  const run = new ShownRun(settings);
  return Object.fromEntries(Object.keys(LANGUAGES).map((language) => {
    setLanguage(language);
    return [language, resultOf(run)];
  }));
});
process.stdout.write(JSON.stringify(answers));
