// Evaluates the equations of a mode: {mode, p, t, z, y, signs} as JSON on standard input.
import { MODES } from "../../looping_pendulum/live/model.js";

let text = "";
for await (const part of process.stdin) text += part;
const results = JSON.parse(text).map(({ mode, p, t, z, y, signs }) => {
  const { rates, eventValues, events, quantities, integrated } = MODES[mode];
  const [of_rates, of_events] = [new Float64Array(z.length), new Float64Array(events.length)];
  rates(p, t, z, signs, of_rates);
  eventValues(p, t, z, signs, of_events);
  const { lightTension, heavyTension } = quantities(p, t, y, signs);
  return { integrated, rates: [...of_rates], events: [...of_events], tensions: [lightTension, heavyTension] };
});
process.stdout.write(JSON.stringify(results));
