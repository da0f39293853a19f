// Fits trials as the live page does: tasks as JSON on standard input, results on standard output.
import { fit } from "../../looping_pendulum/live/assets/trial/fit.js";

let text = "";
for await (const part of process.stdin) text += part;
process.stdout.write(JSON.stringify(JSON.parse(text).map(fit)));
