// Writes studies as the live page's button does: settings and trials as JSON on standard input, studies on standard output.
import { studyYaml } from "../../looping_pendulum/live/assets/trial/study.js";

let text = "";
for await (const part of process.stdin) text += part;
process.stdout.write(JSON.stringify(JSON.parse(text).map(({ settings, trial }) => studyYaml(settings, trial))));
