// Returns the bytes of samples, events, and derivatives of samples, event times and end of a run, in base64.
export async function bitsOf(Core, driver, job) {
  const core = await Core.start(driver);
  const { address } = await core.load(job);
  const { n, rtol } = job;
  const [most, count, state, row] = [500, job.times.length, 13, 23];
  const sizes = { samples: count * state, events: most * row, partials: count * state * n, event_partials: most * n, end_partials: state * n };
  const rooms = Object.fromEntries(Object.entries(sizes).map(([name, size]) => [name, core.room(8 * size)]));
  const status = core.room(16);
  const doubles = { p: job.p, durations: [job.duration], times: job.times, seed_weights: job.seed_weights };
  const integers = { starts: [0, count], seed_starts: job.seed_starts, seed_columns: job.seed_columns };
  const placed = [[Float64Array, doubles], [Int32Array, integers]].flatMap(([Kind, given]) =>
    Object.entries(given).map(([name, values]) => [name, core.put(Kind, values)]));
  core.carryOut(rtol, { ...rooms, ...Object.fromEntries(placed), model: address, runs: 1, n, status, max_events: most });
  const [, events] = core.integers(status, 4);
  const used = { ...sizes, events: events * row, event_partials: events * n };
  const parts = Object.keys(used).map((name) => new Uint8Array(core.driver.memory.buffer, rooms[name], 8 * used[name]));
  return btoa(parts.map((part) => Array.from(part, (byte) => String.fromCharCode(byte)).join("")).join(""));
}
