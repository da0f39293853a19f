// Where everything of one run is at any time: the page's samples, joined smoothly. SI; x right and y up from the rod's centre.
const Motion = (() => {
  const TURN = 2 * Math.PI;

  /** Value of a list at a time, linear between samples; null where it is unknown. */
  function between(list, place) {
    if (!list) return null;
    const i = Math.min(Math.floor(place), list.length - 1);
    const a = list[i], b = list[Math.min(i + 1, list.length - 1)];
    if (a === null || b === null) return null;
    return a + (b - a) * (place - i);
  }

  /** State of ``run`` at ``time`` [s]; after its end it stays as it was there. null for a run without samples. */
  function at(data, run, time) {
    if (!run.count) return null;
    const place = Math.min(Math.max(time * data.rate, 0), run.count - 1);
    const length = between(run.length, place), angle = between(run.angle, place), drop = between(run.drop, place);
    let x = between(run.x, place), y = between(run.y, place);
    if (x === null && length !== null) {  // the length and the angle turn smoothly, where x and y would cut corners
      x = data.radius * Math.cos(angle) - length * Math.sin(angle);
      y = data.radius * Math.sin(angle) + length * Math.cos(angle);
    }
    return {
      x, y, length, angle, drop,
      heavyX: between(run.heavy_x, place) ?? run.heavy[0],
      heavyY: run.heavy[1] - drop,
      turns: angle === null ? null : angle / TURN,
      lightTension: between(run.light_tension, place),
      heavyTension: between(run.heavy_tension, place),
      distance: between(run.distance, place),
      ended: run.end !== null && time > run.end + 1e-9,
    };
  }

  /** Number of ascending times that are not after ``time``. */
  function upTo(times, time) {
    let low = 0, high = times.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (times[middle] <= time + 1e-9) low = middle + 1; else high = middle;
    }
    return low;
  }

  return { at, upTo };
})();
