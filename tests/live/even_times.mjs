// Puts times back on even frames as the live page does: times and a step of each as JSON on standard input.
import { evenTimes } from "../../looping_pendulum/live/assets/film/frame_times.js";

let text = "";
for await (const part of process.stdin) text += part;
process.stdout.write(JSON.stringify(JSON.parse(text).map(([times, step]) => evenTimes(times, step))));
