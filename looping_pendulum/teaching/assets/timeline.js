// Under the slider: what the reference does, and the moments of every run.
const Timeline = (() => {
  const ROW = 20, BAND = 18, INSET = 8;  // INSET: half of the slider's thumb, so that marks stand where the slider does
  const DOES = { down: "slides, M2 falls", up: "slides, M2 rises", stick: "sticks", slack: "slack", free: "no string", unknown: "" };

  class View {
    constructor(data, parent, slider, onTime) {
      Object.assign(this, { data, parent, slider, onTime });
      this.rows = new Map();
    }

    layout() {
      const { data, parent } = this;
      const box = parent.getBoundingClientRect(), track = this.slider.getBoundingClientRect();
      const left = track.left - box.left + INSET, wide = track.width - 2 * INSET;
      this.x = (t) => left + (Math.min(t, data.duration) / data.duration) * wide;
      const height = BAND + 6 + ROW * data.runs.length;
      const svg = Svg.make("svg", { viewBox: `0 0 ${box.width} ${height}`, height, role: "group", "aria-label": "Moments of every run" });
      this.band(svg, left, wide);
      data.runs.forEach((run, i) => this.row(svg, run, BAND + 6 + ROW * (i + 0.5), left));
      this.cursor = Svg.make("line", { class: "cursor", y1: 0, y2: height }, svg);
      parent.replaceChildren(svg);
    }

    /** What the reference's string does. */
    band(svg, left, wide) {
      const { modes } = this.data, end = this.data.runs[0].end;
      if (left > 100) Svg.make("text", { x: 0, y: 13, style: "fill:var(--soft)" }, svg, "the reference's string");
      modes.forEach((mode, i) => {
        const from = this.x(mode.from), to = this.x(modes[i + 1]?.from ?? end);
        const fill = { stick: "var(--line)", slack: "var(--ground)" }[mode.moves] ?? "var(--panel)";
        const box = Svg.make("rect", { x: from, y: 1, width: Math.max(to - from, 0.5), height: BAND - 3,
          style: `fill:${fill};stroke:var(--line);${mode.moves === "slack" ? "stroke-dasharray:3 2" : ""}` }, svg);
        Svg.make("title", {}, box, mode.words);
        const words = DOES[mode.moves];
        if (to - from > 6.5 * words.length) Svg.make("text", { x: (from + to) / 2, y: 13, "text-anchor": "middle" }, svg, words);
      });
    }

    row(svg, run, y, left) {
      const group = Svg.make("g", { "data-run": run.id }, svg);
      this.rows.set(run.id, group);
      if (left > 100) {
        const name = Svg.make("text", { x: 0, y: y + 4 }, group, run.name.length > 20 ? `${run.name.slice(0, 19)}…` : run.name);
        Svg.make("title", {}, name, run.name);
      } else {
        const small = Svg.make("svg", { x: 0, y: y - 7, width: 30, height: 14, viewBox: "7 0 30 14" }, group);
        Svg.swatch(run, small);
      }
      if (run.gap) {
        Svg.make("text", { x: left, y: y + 4, style: "fill:var(--bad)" }, group, "not run");
        return;
      }
      const dash = run.dashes[1] ? run.dashes.map((d) => 2 * d).join(" ") : "none";
      Svg.make("path", { d: `M${this.x(0)},${y}H${this.x(run.end)}`, style: `stroke:${run.colour};stroke-width:1.5;stroke-dasharray:${dash};opacity:.55` }, group);
      for (const event of run.events) {
        const place = Svg.make("g", { class: "mark", transform: `translate(${this.x(event.t)},${y})`, "data-kind": event.kind, "data-time": event.t }, group);
        Svg.make("circle", { r: 9, style: "fill:transparent" }, place);
        Svg.moment(event.kind, run.colour, place);
        Svg.make("title", {}, place, `${run.name}: ${event.words} (${event.t.toFixed(4)} s)`);
        place.addEventListener("click", () => this.onTime(event.t));
      }
    }

    draw(time, shown) {
      this.cursor.setAttribute("x1", this.x(time));
      this.cursor.setAttribute("x2", this.x(time));
      for (const [id, row] of this.rows) row.style.opacity = shown.has(id) ? 1 : 0.25;
    }
  }

  /** What the shapes mean; only those that occur. */
  function key(data, parent) {
    const present = new Set(data.runs.flatMap((run) => run.events.map((event) => event.kind)));
    for (const [kind, words] of Object.entries(data.kinds)) {
      if (!present.has(kind)) continue;
      const item = document.createElement("span");
      const svg = Svg.make("svg", { width: 14, height: 14, viewBox: "-7 -7 14 14" }, item);
      Svg.moment(kind, "var(--ink)", svg);
      item.append(words);
      parent.append(item);
    }
  }

  return { View, key };
})();
