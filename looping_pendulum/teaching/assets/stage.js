// The apparatus on two canvases: all of it, and the rod enlarged.
const Stage = (() => {
  const MARKS = {
    o: (c, r) => c.arc(0, 0, r, 0, 2 * Math.PI),
    s: (c, r) => c.rect(-0.85 * r, -0.85 * r, 1.7 * r, 1.7 * r),
    D: (c, r) => polygon(c, [[0, -1.2], [1.2, 0], [0, 1.2], [-1.2, 0]], r),
    "^": (c, r) => polygon(c, [[0, -1.2], [1.1, 0.8], [-1.1, 0.8]], r),
    v: (c, r) => polygon(c, [[0, 1.2], [1.1, -0.8], [-1.1, -0.8]], r),
    P: (c, r) => polygon(c, [[-0.4, -1.1], [0.4, -1.1], [0.4, -0.4], [1.1, -0.4], [1.1, 0.4], [0.4, 0.4], [0.4, 1.1], [-0.4, 1.1],
      [-0.4, 0.4], [-1.1, 0.4], [-1.1, -0.4], [-0.4, -0.4]], r),
  };
  const LANE = 0.055;  // distance between wound strings on the enlarged rod, in rod radii
  const LEAST_VIEW = 2.2;  // half height of the enlarged view, in rod radii

  function polygon(c, corners, r) {
    corners.forEach(([x, y], i) => (i ? c.lineTo(x * r, y * r) : c.moveTo(x * r, y * r)));
    c.closePath();
  }

  /** Fit a canvas to its box, sharp on any screen; return its context and size in CSS pixels. */
  function fitted(canvas) {
    const { clientWidth: width, clientHeight: height } = canvas;
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    const context = canvas.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    context.lineJoin = context.lineCap = "round";
    return { context, width, height };
  }

  /** Smallest box that holds every place of every run [m], with a margin. */
  function bounds(data) {
    const box = { left: -data.radius, right: data.radius, low: -data.radius, high: data.radius };
    for (const run of data.runs) {
      for (let i = 0; i < run.count; i += 4) {
        const s = Motion.at(data, run, i / data.rate);
        if (s.x === null) continue;
        box.left = Math.min(box.left, s.x, s.heavyX);
        box.right = Math.max(box.right, s.x, s.heavyX);
        box.low = Math.min(box.low, s.y, s.heavyY);
        box.high = Math.max(box.high, s.y, s.heavyY);
      }
    }
    const { light, heavy } = data.trial?.stage ?? {};
    for (const points of [light, heavy]) {
      for (const x of points?.x ?? []) { box.left = Math.min(box.left, x); box.right = Math.max(box.right, x); }
      for (const y of points?.y ?? []) { box.low = Math.min(box.low, y); box.high = Math.max(box.high, y); }
    }
    const margin = 0.06 * Math.max(box.right - box.left, box.high - box.low);
    return { left: box.left - margin, right: box.right + margin, low: box.low - margin, high: box.high + margin };
  }

  function mark(c, shape, x, y, r, colour, hollow, edge) {
    c.save();
    c.translate(x, y);
    c.beginPath();
    MARKS[shape](c, r);
    c.lineWidth = hollow ? 2.6 : 1.2;
    c.strokeStyle = hollow ? colour : edge;
    if (!hollow) { c.fillStyle = colour; c.fill(); }
    c.stroke();
    c.restore();
  }

  class View {
    constructor(data, stage, rod) {
      Object.assign(this, { data, stage, rod, box: bounds(data) });
      this.paths = new Map(data.runs.map((run) => [run.id, this.path(run)]));
      this.pitch = LANE * (data.runs.length + 1);  // each turn of the enlarged string lies outside the one before it
      const most = Math.max(0, ...data.runs.flatMap((run) => run.angle ?? []));
      this.view = Math.max(LEAST_VIEW, 1.15 * this.wound(most, data.runs.length));
    }

    /** Every drawn place of a run [m], at the page's rate. */
    path(run) {
      return Array.from({ length: run.count }, (_, i) => {
        const s = Motion.at(this.data, run, i / this.data.rate);
        return [s.x, s.y];
      });
    }

    /** Radius of the enlarged string at an angle, in rod radii. */
    wound(angle, lane) {
      return 1 + LANE * (lane + 0.7) + (this.pitch * Math.max(angle, 0)) / (2 * Math.PI);
    }

    draw(time, shown, measured) {
      const colours = new Map(this.data.runs.map((run) => [run.id, Theme.colour(run.colour)]));
      const ink = Theme.colour("var(--ink)"), soft = Theme.colour("var(--soft)"), ground = Theme.colour("var(--panel)");
      const states = shown.map((run) => ({ run, s: Motion.at(this.data, run, time), colour: colours.get(run.id) })).filter((e) => e.s);
      this.drawStage(time, states, { ink, soft, ground }, measured);
      if (this.rod) this.drawRod(states, ink);
    }

    drawStage(time, states, { ink, soft, ground }, measured) {
      const { context: c, width, height } = fitted(this.stage);
      const { left, right, low, high } = this.box;
      const scale = Math.min(width / (right - left), height / (high - low));
      const px = (x) => width / 2 + (x - (left + right) / 2) * scale, py = (y) => height / 2 - (y - (low + high) / 2) * scale;
      this.scaleBar(c, width, height, scale, soft);
      for (const { run, colour } of states) this.trace(c, run, time, colour, px, py);
      const radius = Math.max(this.data.radius * scale, 2.5);
      c.beginPath();
      c.arc(px(0), py(0), radius, 0, 2 * Math.PI);
      c.fillStyle = soft;
      c.fill();
      for (const { run, s, colour } of states) {
        c.globalAlpha = s.ended ? 0.35 : 1;
        if (this.data.string) this.string(c, s, run, colour, px, py, scale, run.id === "reference" && this.slack(time));
        c.globalAlpha = 1;
      }
      for (const { run, s, colour } of states) {
        c.globalAlpha = s.ended ? 0.35 : 1;
        const reference = run.id === "reference";
        mark(c, run.marker, px(s.heavyX), py(s.heavyY), reference ? 14 : 10, colour, reference, ground);
        mark(c, run.marker, px(s.x), py(s.y), reference ? 9 : 6, colour, reference, ground);
        c.globalAlpha = 1;
      }
      if (measured) for (const points of Object.values(this.data.trial?.stage ?? {})) this.points(c, points, time, ink, ground, px, py);
      if (states.length) {
        const { s } = states[0];
        c.fillStyle = ink;
        c.font = "600 13px system-ui, sans-serif";
        c.textAlign = "left";
        c.textBaseline = "middle";
        c.fillText("M2", px(s.heavyX) + 20, py(s.heavyY));
        c.fillText("M1", px(s.x) + 14, py(s.y) - 12);
      }
    }

    /** Tracked points of a mass up to the time, the latest large while it is younger than two frames. */
    points(c, { t, x, y }, time, ink, ground, px, py) {
      const count = Motion.upTo(t, time), heavyX = this.data.runs[0].heavy[0];
      c.strokeStyle = ink;
      c.fillStyle = ground;  // hollow, so that they show on a line of the same colour
      for (let i = 0; i < count; i++) {
        const latest = i === count - 1 && time - t[i] < 2 * (i ? t[i] - t[i - 1] : 0.02);
        c.beginPath();
        c.arc(px(x?.[i] ?? heavyX), py(y[i]), latest ? 6.5 : 2.4, 0, 2 * Math.PI);
        c.lineWidth = latest ? 2 : 1;
        if (!latest) c.fill();
        c.stroke();
      }
    }

    /** Whether the reference's string is slack. */
    slack(time) {
      return this.data.modes.findLast((mode) => mode.from <= time + 1e-9)?.moves === "slack";
    }

    trace(c, run, time, colour, px, py) {
      const path = this.paths.get(run.id), last = Math.min(Math.floor(time * this.data.rate), path.length - 1);
      c.beginPath();
      for (let i = 0; i <= last; i++) {
        const [x, y] = path[i];
        if (x === null) continue;
        if (i) c.lineTo(px(x), py(y)); else c.moveTo(px(x), py(y));
      }
      c.strokeStyle = colour;
      c.globalAlpha = 0.55;
      c.lineWidth = run.id === "reference" ? 3 : 1.8;
      c.setLineDash(run.dashes[1] ? run.dashes.map((d) => 1.6 * d) : []);
      c.stroke();
      c.setLineDash([]);
      c.globalAlpha = 1;
    }

    /** From the heavy mass up to the rod, round it, and along the tangent to the light mass. */
    string(c, s, run, colour, px, py, scale, slack) {
      const r = this.data.radius;
      c.beginPath();
      c.moveTo(px(s.heavyX), py(s.heavyY));
      c.lineTo(px(r), py(0));
      c.arc(px(0), py(0), r * scale, 0, -Math.max(s.angle, 0), true);
      c.lineTo(px(s.x), py(s.y));
      c.strokeStyle = colour;
      c.lineWidth = run.id === "reference" ? 2 : 1.2;
      c.setLineDash(slack ? [3, 5] : []);  // it hangs somewhere between; only its ends are known
      c.stroke();
      c.setLineDash([]);
    }

    scaleBar(c, width, height, scale, soft) {
      const metres = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1].find((m) => m * scale > 50) ?? 1;
      c.strokeStyle = c.fillStyle = soft;
      c.lineWidth = 2;
      c.beginPath();
      c.moveTo(14, height - 14);
      c.lineTo(14 + metres * scale, height - 14);
      c.stroke();
      c.font = "12px system-ui, sans-serif";
      c.textAlign = "left";
      c.textBaseline = "bottom";
      c.fillText(`${Math.round(metres * 100)} cm`, 14, height - 18);
    }

    /** The rod enlarged; not there without a string. */
    drawRod(states, ink) {
      const { context: c, width, height } = fitted(this.rod);
      const r = this.data.radius, scale = height / (2 * this.view * r), px = (x) => width / 2 + x * scale, py = (y) => height / 2 - y * scale;
      c.beginPath();
      c.arc(px(0), py(0), r * scale, 0, 2 * Math.PI);
      c.fillStyle = Theme.colour("var(--line)");
      c.fill();
      states.forEach(({ run, s, colour }, lane) => {
        const at = (angle) => r * this.wound(angle, lane);
        c.beginPath();
        c.moveTo(px(at(0)), height + 5);
        c.lineTo(px(at(0)), py(0));
        for (let a = 0; a < s.angle; a += 0.05) c.lineTo(px(at(a) * Math.cos(a)), py(at(a) * Math.sin(a)));
        const [cos, sin] = [Math.cos(s.angle), Math.sin(s.angle)];
        c.lineTo(px(at(s.angle) * cos), py(at(s.angle) * sin));
        c.lineTo(px(at(s.angle) * cos - s.length * sin), py(at(s.angle) * sin + s.length * cos));
        c.strokeStyle = colour;
        c.globalAlpha = s.ended ? 0.35 : 1;
        c.lineWidth = run.id === "reference" ? 3 : 2;
        c.setLineDash(run.dashes[1] ? run.dashes.map((d) => 1.6 * d) : []);
        c.stroke();
        c.setLineDash([]);
        c.globalAlpha = 1;
      });
      const first = states[0];
      if (first && first.s.turns !== null) {
        c.fillStyle = ink;
        c.textAlign = "center";
        c.textBaseline = "middle";
        c.font = "600 14px system-ui, sans-serif";
        c.fillText(first.s.turns.toFixed(2), px(0), py(0) - 8);
        c.font = "12px system-ui, sans-serif";
        c.fillText("turns", px(0), py(0) + 9);
      }
    }
  }

  return { View };
})();
