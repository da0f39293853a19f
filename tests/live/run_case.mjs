// Returns what the tests compare of a run, or the message of its error.
export function runCase(simulate, { settings, duration, times }) {
  try {
    const run = simulate(settings, { duration });
    return {
      events: run.events,
      endTime: run.endTime,
      haltingTime: run.haltingTime,
      stops: run.stops,
      samples: times.map((t) => run.sample(Math.min(t, run.endTime))),
    };
  } catch (error) {
    return { error: error.message };
  }
}
