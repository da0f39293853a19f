// Reads the frame times of films as the live page does: paths as JSON on standard input, times and camera's rates on standard output.
import { openAsBlob } from "node:fs";
import { frameTimes } from "../../looping_pendulum/live/assets/film/frame_times.js";

let text = "";
for await (const part of process.stdin) text += part;
const results = [];
for (const path of JSON.parse(text)) results.push(await frameTimes(await openAsBlob(path)));
process.stdout.write(JSON.stringify(results));
