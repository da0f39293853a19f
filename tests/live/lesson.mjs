// Answers questions about the lesson's steps: {ask, ...} as JSON on standard input, answers on standard output.
import { ready } from "../../looping_pendulum/live/run.js";
import { settingsOf, withValue } from "../../looping_pendulum/live/assets/controls.js";
import { filmedPoints, madeUpTrial } from "../../looping_pendulum/live/assets/lesson/made_up.js";
import {
  STEPS, distanceOf, filmedState, isOfRatioStep, judgeRatio, judgeTrial, lowestRatio, placeOfRatio, trialState,
} from "../../looping_pendulum/live/assets/lesson/steps.js";
import { ShownRun } from "../../looping_pendulum/live/assets/shown_run.js";
import { fit } from "../../looping_pendulum/live/assets/trial/fit.js";
import { readTrial } from "../../looping_pendulum/live/assets/trial/reader.js";

const stepOf = (name) => STEPS.find((step) => step.name === name);
const runOf = (state) => new ShownRun(settingsOf(state));
const changed = (state, changes = {}) => Object.entries(changes).reduce((one, [name, value]) => withValue(one, name, value), state);
const otherOf = (step) => (step.task === "drag" ? filmedState(1) : (step.beside?.() ?? null));

function searched() {
  const search = lowestRatio(stepOf("lowest").state());
  let runs = 1;
  for (;;) {
    const { done, value } = search.next();
    if (done) return { lowest: value, runs };
    runs += 1;
  }
}

const answers = {
  steps: () => STEPS.map(({ name, options, task }) => ({ name, options, task })),
  judge({ name, said, changes }) {
    const step = stepOf(name);
    const [state, other] = [changed(step.state(), changes), otherOf(step)];
    const run = runOf(state);
    return {
      ...step.judge(said, run, other && runOf(other)),
      settings: settingsOf(state),
      other: other && settingsOf(other),
      seenAt: step.seenAt(run),
      end: run.end,
    };
  },
  lowest: searched,
  place({ ratio, lowest }) {
    const state = changed(stepOf("lowest").state(), { mass_ratio: ratio });
    return { place: placeOfRatio(ratio, runOf(state).halt !== null, lowest), isOfStep: isOfRatioStep(state) };
  },
  settings: ({ name, changes }) => settingsOf(changed(stepOf(name).state(), changes)),
  isOfStep: ({ changes }) => isOfRatioStep(changed(stepOf("lowest").state(), changes)),
  guess: ({ said, lowest }) => judgeRatio(said, 3.2, lowest).right,
  film({ seed, off }) {
    const state = filmedState(seed);
    const points = filmedPoints(runOf(state), seed);
    const drag = state.values.light_drag;
    return { drag, ...distanceOf(points, runOf(withValue(state, "light_drag", drag + off))), ofStep: distanceOf(points, runOf(stepOf("drag").state())) };
  },
  trial({ seed }) {
    const { csv, wind, state } = madeUpTrial(trialState(), seed);
    const { channels } = readTrial("made-up.csv", new TextEncoder().encode(csv));
    const settings = settingsOf(trialState());
    const measured = ["light_mass", "heavy_mass", "rod_radius"].map((name) => [name, 0.01 * settings[name]]);
    const known = Object.fromEntries([...measured, ...["heavy_drag", "string_drag"].map((name) => [name, 1e-3])]);
    const task = { settings, channels, camera: { origin_x: 0, origin_y: 0, clock_offset: 0, scale: 1, tilt: 0 }, known };
    return { wind, hidden: settingsOf(state), csv, ...fit(task) };
  },
  trialJudged: ({ said, isNoise }) => judgeTrial(said, isNoise, 0.002),
};

await ready;
let text = "";
for await (const part of process.stdin) text += part;
process.stdout.write(JSON.stringify(JSON.parse(text).map((item) => answers[item.ask](item))));
