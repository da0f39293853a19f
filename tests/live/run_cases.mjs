// Runs the live model in Node: cases as JSON on standard input, runs as JSON on standard output.
import { simulate } from "../../looping_pendulum/live/run.js";

let text = "";
for await (const part of process.stdin) text += part;
const runs = JSON.parse(text).map(({ settings, duration, times }) => {
  const run = simulate(settings, { duration });
  return {
    events: run.events,
    haltingTime: run.haltingTime,
    stops: run.stops,
    samples: times.map((t) => run.sample(Math.min(t, run.endTime))),
  };
});
process.stdout.write(JSON.stringify(runs));
