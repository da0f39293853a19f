// Runs the live model in Node: cases as JSON on standard input; runs, or the messages of their errors, as JSON on standard output.
import { ready, simulate } from "../../looping_pendulum/live/run.js";
import { runCase } from "./run_case.mjs";

await ready;
let text = "";
for await (const part of process.stdin) text += part;
process.stdout.write(JSON.stringify(JSON.parse(text).map((item) => runCase(simulate, item))));
