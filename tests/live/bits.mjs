// Carries out jobs of tests/reference_ode/core/bits.py: as JSON on standard input; the bytes of all results, in base64, as JSON.
import { Core } from "../../looping_pendulum/live/core.js";
import { DRIVER } from "../../looping_pendulum/live/model.js";
import { bitsOf } from "./bits_of.mjs";

let text = "";
for await (const part of process.stdin) text += part;
const results = [];
for (const job of JSON.parse(text)) results.push(await bitsOf(Core, DRIVER, job));
process.stdout.write(JSON.stringify(results));
