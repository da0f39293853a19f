// Fits trials as the live page does: tasks as JSON on standard input, results on standard output.
import { ready } from "../../looping_pendulum/live/run.js";
import { fit } from "../../looping_pendulum/live/assets/trial/fit.js";

await ready;
let text = "";
for await (const part of process.stdin) text += part;
process.stdout.write(JSON.stringify(JSON.parse(text).map(fit)));
