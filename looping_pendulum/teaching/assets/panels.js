// Quantities over time, one small SVG each; one cursor for all.
const Svg = (() => {
  const NAMESPACE = "http://www.w3.org/2000/svg";

  /** Make an SVG element; text goes in as text, never as markup. */
  function make(name, attributes = {}, parent = null, text = null) {
    const element = document.createElementNS(NAMESPACE, name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    if (text !== null) element.textContent = text;
    if (parent) parent.append(element);
    return element;
  }

  const SHAPES = {
    stop: "M-4.5,0a4.5,4.5 0 1,0 9,0a4.5,4.5 0 1,0 -9,0Z",
    stick: "M-4.5,0a4.5,4.5 0 1,0 9,0a4.5,4.5 0 1,0 -9,0Z",
    slip: "M-4,-5L5,0L-4,5Z",
    slack: "M-6,0C-3,-6 -3,-6 0,0S3,6 6,0",
    taut: "M0,-6V6",
    halt: "M-4.5,-4.5H4.5V4.5H-4.5Z",
    rod: "M-4.5,-4.5L4.5,4.5M-4.5,4.5L4.5,-4.5",
    broke: "M0,-6L5.5,4.5H-5.5Z",
    other: "M0,-5L5,0L0,5L-5,0Z",
  };
  const FILLED = new Set(["stick", "slip", "halt"]);

  /** Mark of one moment; stick, slip and halt are filled, the others hollow or lines. */
  function moment(kind, colour, parent) {
    const style = `stroke:${colour};stroke-width:2;fill:${FILLED.has(kind) ? colour : "none"}`;
    return make("path", { d: SHAPES[kind], style }, parent);
  }

  /** A run's line and marker, as the legend shows it. */
  function swatch(run, svg) {
    svg.replaceChildren();
    const dash = run.dashes[1] ? run.dashes.map((d) => 2 * d).join(" ") : "none";
    make("path", { d: "M0,7H44", style: `stroke:${run.colour};stroke-width:${run.id === "reference" ? 3 : 2};stroke-dasharray:${dash}` }, svg);
    const corners = { o: "M16,7a6,6 0 1,0 12,0a6,6 0 1,0 -12,0Z", s: "M17,2H27V12H17Z", D: "M22,0L29,7L22,14L15,7Z",
      "^": "M22,0L28.5,12H15.5Z", v: "M22,14L28.5,2H15.5Z", P: "M20,1H24V5H28V9H24V13H20V9H16V5H20Z" };
    const fill = run.id === "reference" ? "var(--ground)" : run.colour;
    make("path", { d: corners[run.marker], style: `stroke:${run.colour};stroke-width:${run.id === "reference" ? 2.5 : 1};fill:${fill}` }, svg);
  }

  return { make, moment, swatch };
})();

const Panels = (() => {
  const KINDS = [
    { key: "drop", title: "Drop of the heavy mass [mm]", factor: 1000, down: true },
    { key: "angle", title: "Wrap angle [turns]", factor: 1 / (2 * Math.PI) },
    { key: "light_tension", title: "Pull of the string at the light mass [N]", factor: 1 },
    { key: "heavy_tension", title: "Pull of the string at the heavy mass [N]", factor: 1 },
    { key: "distance", title: "Distance of the light mass from the reference's [mm]", factor: 1000, log: true },
  ];
  const HEIGHT = 190, EDGE = { left: 46, right: 10, top: 26, bottom: 22 };
  const FLOOR = 1e-3;  // smallest distance that is drawn [mm]

  /** Steps of 1, 2 or 5 that divide a range into about four. */
  function ticks(low, high) {
    const raw = (high - low) / 4, power = 10 ** Math.floor(Math.log10(raw));
    const step = [1, 2, 5, 10].find((m) => m * power >= raw) * power;
    const found = [];
    for (let v = Math.ceil(low / step) * step; v <= high + 1e-9 * step; v += step) found.push(v);
    return found.map((v) => Number(v.toPrecision(6)));
  }

  function text(value) {
    return Math.abs(value) >= 1e4 || (value !== 0 && Math.abs(value) < 1e-3) ? value.toExponential(0) : String(Number(value.toPrecision(4)));
  }

  class Panel {
    constructor(data, kind, parent, onTime) {
      Object.assign(this, { data, kind, onTime });
      this.runs = data.runs.filter((run) => run[kind.key]?.some((v) => v !== null));
      this.box = document.createElement("div");
      this.box.className = "panel";
      parent.append(this.box);
      this.svg = Svg.make("svg", { role: "img", height: HEIGHT }, this.box);
      this.svg.setAttribute("aria-label", `${kind.title} over time: ${this.runs.map((run) => run.name).join(", ") || "no run knows it"}`);
      const follow = (event) => {
        const x = event.clientX - this.svg.getBoundingClientRect().left;
        onTime(((x - EDGE.left) / (this.width - EDGE.left - EDGE.right)) * data.duration);
      };
      this.svg.addEventListener("pointerdown", (event) => { this.svg.setPointerCapture(event.pointerId); follow(event); });
      this.svg.addEventListener("pointermove", (event) => { if (event.buttons) follow(event); });
    }

    /** Lowest and highest value that the axis shows; a short spike (a light mass at the rod, a jerk) does not flatten the rest. */
    range() {
      const lists = [...this.runs.map((run) => run[this.kind.key]), this.data.trial?.panels[this.kind.key]?.v ?? []];
      const values = lists.flatMap((list) => list.filter((v) => v !== null)).map((v) => v * this.kind.factor);
      if (!values.length) return [0, 1];
      if (this.kind.log) return [FLOOR, Math.max(10 ** Math.ceil(Math.log10(Math.max(...values, 1e-2))), 1e-2)];
      values.sort((a, b) => a - b);
      const least = values[Math.ceil(0.005 * (values.length - 1))], most = values[Math.floor(0.995 * (values.length - 1))];
      const low = Math.min(least < 0.6 * values[0] ? values[0] : 1.15 * least, 0);
      const high = Math.max(most > 0.6 * values.at(-1) ? values.at(-1) : 1.15 * most, low + 1e-6);
      return [low, high + 0.04 * (high - low)];
    }

    layout() {
      const { svg, kind, data } = this;
      this.width = this.box.clientWidth - 12;
      svg.replaceChildren();
      svg.setAttribute("viewBox", `0 0 ${this.width} ${HEIGHT}`);
      const [low, high] = this.range(), tall = HEIGHT - EDGE.top - EDGE.bottom;
      const share = kind.log ? (v) => Math.log(Math.max(v, low) / low) / Math.log(high / low) : (v) => (v - low) / (high - low);
      this.x = (t) => EDGE.left + (t / data.duration) * (this.width - EDGE.left - EDGE.right);
      this.y = (v) => EDGE.top + tall * (kind.down ? share(v) : 1 - share(v));
      Svg.make("text", { class: "title", x: 4, y: 16 }, svg, kind.title);
      const steps = kind.log ? this.decades(low, high) : ticks(low, high);
      for (const v of steps) {
        Svg.make("line", { class: "grid", x1: EDGE.left, x2: this.width - EDGE.right, y1: this.y(v), y2: this.y(v) }, svg);
        Svg.make("text", { x: EDGE.left - 5, y: this.y(v) + 4, "text-anchor": "end" }, svg, text(v));
      }
      for (const t of ticks(0, data.duration)) {
        Svg.make("text", { x: this.x(t), y: HEIGHT - 6, "text-anchor": "middle" }, svg, `${text(t)} s`);
      }
      const id = `clip-${kind.key}`, clip = Svg.make("clipPath", { id }, Svg.make("defs", {}, svg));
      Svg.make("rect", { x: EDGE.left, y: EDGE.top - 3, width: this.width - EDGE.left - EDGE.right + 6, height: tall + 6 }, clip);
      const inside = Svg.make("g", { "clip-path": `url(#${id})` }, svg);
      this.dots = new Map();
      this.groups = new Map();
      for (const run of this.runs) {
        const group = Svg.make("g", { "data-run": run.id }, inside);
        this.groups.set(run.id, group);
        this.curve(run, group);
        this.dots.set(run.id, Svg.make("circle", { r: 4, style: `fill:${run.colour};stroke:var(--ground)` }, group));
      }
      const measured = data.trial?.panels[kind.key];
      if (measured) {
        const group = Svg.make("g", { "data-run": "measured", style: "fill:var(--ground);stroke:var(--ink);opacity:.7" }, inside);
        this.groups.set("measured", group);
        measured.t.forEach((t, i) => {
          if (measured.v[i] !== null && t <= data.duration) Svg.make("circle", { cx: this.x(t).toFixed(1), cy: this.y(measured.v[i] * kind.factor).toFixed(1), r: 1.8 }, group);
        });
      }
      if (!this.runs.length) Svg.make("text", { x: this.width / 2, y: HEIGHT / 2, "text-anchor": "middle" }, svg, "no run here knows it");
      this.cursor = Svg.make("line", { class: "cursor", y1: EDGE.top, y2: HEIGHT - EDGE.bottom }, svg);
    }

    decades(low, high) {
      const count = Math.round(Math.log10(high / low));
      return Array.from({ length: count + 1 }, (_, i) => low * 10 ** i).filter((_, i) => count < 6 || i % 2 === count % 2);
    }

    curve(run, group) {
      const list = run[this.kind.key], { factor } = this.kind;
      let d = "", pen = false;
      list.forEach((value, i) => {
        if (value === null) { pen = false; return; }
        d += `${pen ? "L" : "M"}${this.x(i / this.data.rate).toFixed(1)},${this.y(value * factor).toFixed(1)}`;
        pen = true;
      });
      const dash = run.dashes[1] ? run.dashes.map((length) => 1.6 * length).join(" ") : "none";
      Svg.make("path", { d, style: `fill:none;stroke:${run.colour};stroke-width:${run.id === "reference" ? 3 : 1.8};stroke-dasharray:${dash}` }, group);
      for (const event of run.events) {
        const value = this.value(run, event.t);
        if (value === null || event.t > this.data.duration) continue;
        const place = Svg.make("g", { transform: `translate(${this.x(event.t)},${this.y(value)})`, "data-kind": event.kind }, group);
        Svg.moment(event.kind, run.colour, place);
        Svg.make("title", {}, place, `${run.name}: ${this.data.kinds[event.kind]} at ${event.t.toFixed(4)} s`);
      }
    }

    value(run, time) {
      const s = Motion.at(this.data, run, time);
      const raw = { drop: s.drop, angle: s.angle, light_tension: s.lightTension, heavy_tension: s.heavyTension, distance: s.distance }[this.kind.key];
      return raw === null ? null : raw * this.kind.factor;
    }

    draw(time, shown) {
      const x = this.x(time);
      this.cursor.setAttribute("x1", x);
      this.cursor.setAttribute("x2", x);
      if (this.groups.has("measured")) this.groups.get("measured").style.display = shown.has("measured") ? "" : "none";
      for (const run of this.runs) {
        const on = shown.has(run.id), dot = this.dots.get(run.id);
        this.groups.get(run.id).style.display = on ? "" : "none";
        const value = on && !(run.end !== null && time > run.end + 1e-9) ? this.value(run, time) : null;
        dot.style.display = value === null ? "none" : "";
        if (value !== null) { dot.setAttribute("cx", x); dot.setAttribute("cy", this.y(value)); }
      }
    }
  }

  return { make: (data, parent, onTime) => KINDS.map((kind) => new Panel(data, kind, parent, onTime)) };
})();
