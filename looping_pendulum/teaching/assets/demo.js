// Time, keys and switches. Everything on the page is a function of the time and of which runs are shown.
(() => {
  const data = JSON.parse(document.getElementById("demo-data").textContent);
  const element = (id) => document.getElementById(id);
  const slider = element("time"), play = element("play"), clock = element("clock"), doing = element("doing");
  const shown = new Set(data.runs.filter((run) => run.count).map((run) => run.id));
  if (data.trial) shown.add("measured");
  const STEP = 0.002;  // of the arrow keys [s]
  let time = 0, playing = false, slow = 4, previous = null, stale = true, frames = 0;

  const stage = new Stage.View(data, element("stage"), element("rod"));
  const panels = Panels.make(data, element("panels"), (t) => { pause(); setTime(t); });
  const timeline = new Timeline.View(data, element("timeline"), slider, (t) => { pause(); setTime(t); });
  Timeline.key(data, element("kinds"));

  function setTime(t) {
    time = Math.min(Math.max(t, 0), data.duration);
    stale = true;
    wake();
  }

  function start() {
    if (time >= data.duration) time = 0;
    playing = true;
    previous = null;
    stale = true;
    wake();
  }

  function pause() {
    playing = false;
    stale = true;
    wake();
  }

  function setSpeed(times) {
    slow = times;
    for (const button of document.querySelectorAll("[data-slow]")) button.setAttribute("aria-pressed", Number(button.dataset.slow) === slow);
  }

  /** The next moment of a shown run, or the one before (-1); the time stays where there is none. */
  function moment(direction) {
    const times = data.runs.filter((run) => shown.has(run.id)).flatMap((run) => run.events.map((event) => event.t));
    const ahead = times.filter((t) => direction * (t - time) > 1e-9);
    return ahead.length ? direction * Math.min(...ahead.map((t) => direction * t)) : time;
  }

  /** What the reference is doing, in words. */
  function words() {
    const mode = data.modes.findLast((m) => m.from <= time + 1e-9);
    const reference = data.runs[0], past = reference.events.findLast((event) => event.t <= time + 1e-9);
    if (time > reference.end + 1e-9) return "The reference ends: the light mass has reached the rod.";
    const now = mode ? `The reference: ${mode.words}` : "";
    return past ? `${now}; last moment: ${data.kinds[past.kind]} at ${past.t.toFixed(4)} s.` : `${now}.`;
  }

  const rows = new Map(data.runs.filter((run) => run.count).map((run) => {
    const row = element("now").tBodies[0].insertRow();
    const head = document.createElement("th");
    head.scope = "row";
    head.textContent = run.name;
    row.append(head);
    for (let i = 0; i < 5; i++) row.insertCell();
    return [run.id, row];
  }));

  function number(value, factor, digits) {
    return value === null ? "–" : (value * factor).toFixed(digits);
  }

  function readings() {
    for (const run of data.runs.filter((one) => one.count)) {
      const s = Motion.at(data, run, time), row = rows.get(run.id);
      const texts = s.ended ? ["ended", "", "", "", ""] : [number(s.drop, 1000, 1), number(s.turns, 1, 3), number(s.lightTension, 1, 3),
        number(s.heavyTension, 1, 3), run.id === "reference" ? "0" : number(s.distance, 1000, 3)];
      texts.forEach((text, i) => { if (row.cells[i + 1].textContent !== text) row.cells[i + 1].textContent = text; });
      row.className = shown.has(run.id) ? "" : "off";
    }
  }

  function draw() {
    const on = data.runs.filter((run) => shown.has(run.id));
    slider.value = time;
    slider.setAttribute("aria-valuetext", `${time.toFixed(3)} seconds`);
    clock.textContent = `${time.toFixed(3)} s`;
    play.textContent = playing ? "Pause" : "Play";
    doing.textContent = words();
    stage.draw(time, on, shown.has("measured"));
    for (const panel of panels) panel.draw(time, shown);
    timeline.draw(time, shown);
    readings();
    frames += 1;
  }

  let pending = false;
  function wake() {
    if (!pending) { pending = true; requestAnimationFrame(frame); }
  }

  function frame(now) {
    pending = false;
    if (playing) {
      if (previous !== null) time += Math.min(now - previous, 100) / 1000 / slow;
      previous = now;
      if (time >= data.duration) { time = data.duration; playing = false; }
      stale = true;
    }
    if (stale) { stale = false; draw(); }
    if (playing) wake();
  }

  function layout() {
    for (const panel of panels) panel.layout();
    timeline.layout();
    stale = true;
    wake();
  }

  play.addEventListener("click", () => (playing ? pause() : start()));
  element("start").addEventListener("click", () => { pause(); setTime(0); });
  element("end").addEventListener("click", () => { pause(); setTime(data.duration); });
  element("back").addEventListener("click", () => { pause(); setTime(time - STEP); });
  element("forward").addEventListener("click", () => { pause(); setTime(time + STEP); });
  slider.addEventListener("input", () => { pause(); setTime(Number(slider.value)); });
  for (const button of document.querySelectorAll("[data-slow]")) button.addEventListener("click", () => setSpeed(Number(button.dataset.slow)));
  for (const button of document.querySelectorAll(".moment")) {
    button.addEventListener("click", () => { pause(); setTime(Number(button.dataset.time)); });
  }
  for (const box of document.querySelectorAll("#runs input")) {
    box.addEventListener("change", () => {
      if (box.checked) shown.add(box.dataset.run); else shown.delete(box.dataset.run);
      stale = true;
      wake();
    });
  }
  for (const svg of document.querySelectorAll("svg.swatch")) Svg.swatch(data.runs.find((run) => run.id === svg.dataset.run), svg);

  // A button or box that was clicked would keep the space bar to itself; one that Tab leads to acts on it, as it should
  document.addEventListener("click", (event) => {
    const target = event.detail > 0 && event.target instanceof Element && event.target.closest("button, summary, label, input[type=checkbox]");
    if (target) requestAnimationFrame(() => document.activeElement?.blur());  // after a label has handed the focus on
  });

  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const target = event.target, kind = target.tagName;
    if (event.key === " " && kind !== "BUTTON" && kind !== "SUMMARY" && target.type !== "checkbox") {
      if (playing) pause(); else start();
    } else if (["n", "p"].includes(event.key.toLowerCase())) {
      pause();
      setTime(moment(event.key.toLowerCase() === "n" ? 1 : -1));
    } else if (target === slider) {
      return;  // it has its own arrows, Home and End
    } else if (event.key === "ArrowLeft" || event.key === "ArrowRight") {
      pause();
      setTime(time + (event.key === "ArrowLeft" ? -1 : 1) * STEP * (event.shiftKey ? 10 : 1));
    } else if (event.key === "Home" || event.key === "End") {
      pause();
      setTime(event.key === "Home" ? 0 : data.duration);
    } else {
      return;
    }
    event.preventDefault();
  });

  Theme.onChange(() => { stale = true; wake(); });
  new ResizeObserver(layout).observe(element("panels"));
  setSpeed(4);
  layout();
  if (!window.matchMedia("(prefers-reduced-motion: reduce)").matches) start();

  /** For the console and for tests: the same switches as on the page. */
  window.demo = {
    data, play: start, pause, setTime,
    get time() { return time; },
    get playing() { return playing; },
    get frames() { return frames; },
    get shown() { return [...shown]; },
    place: (id) => Motion.at(data, data.runs.find((run) => run.id === id), time),
  };
})();
