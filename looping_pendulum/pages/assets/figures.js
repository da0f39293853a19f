"use strict";
// Draws the page's figures in the colours of the chosen ground, and again when that changes or the page is printed.
(() => {
  const PAPER = 680;  // width of a figure on paper [px]: what A4 and letter hold
  const figures = JSON.parse(document.getElementById("figures").textContent);

  /** A colour faint enough for a band that lies under a line. */
  function faint(colour) {
    return `rgba(${[1, 3, 5].map((i) => parseInt(colour.slice(i, i + 2), 16)).join(",")},0.25)`;
  }

  /** A copy of plain data with every "var(--name)" turned into its colour, and "faint var(--name)" into a faint one. */
  function coloured(value) {
    if (typeof value === "string") return value.startsWith("faint var(--") ? faint(Theme.colour(value.slice(6))) : Theme.colour(value);
    if (Array.isArray(value)) return typeof value[0] === "number" ? value : value.map(coloured);
    if (value && typeof value === "object") return Object.fromEntries(Object.entries(value).map(([key, inner]) => [key, coloured(inner)]));
    return value;
  }

  function layout(figure, width) {
    const axis = { gridcolor: "var(--grid)", zerolinecolor: "var(--line)", linecolor: "var(--line)", automargin: true };
    const merged = { ...figure.layout }, narrow = width < 600;
    const named = figure.traces.filter((trace) => trace.showlegend !== false).length;
    const { rows, columns } = merged.grid ?? { rows: 1, columns: 1 };
    // On a phone the panels of a row stand below each other
    if (merged.grid && narrow) merged.grid = { ...merged.grid, rows: rows * columns, columns: 1 };
    for (const name of Object.keys(merged)) if (/^[xy]axis\d*$/.test(name)) merged[name] = { ...axis, ...merged[name] };
    return coloured({
      paper_bgcolor: "var(--ground)", plot_bgcolor: "var(--ground)",
      font: { color: "var(--ink)", family: "system-ui, Segoe UI, Roboto, Arial, sans-serif", size: 13 },
      hovermode: "closest", autosize: true,
      ...merged,
      legend: { orientation: "h", yref: "container", y: 0, yanchor: "bottom", ...merged.legend },
      ...(Theme.printing ? { width: PAPER, autosize: false } : {}),
      // On a phone no taller than wide, as a path to scale would have blank above and below it; the legend needs room beside that
      height: narrow ? rows * columns * Math.min(merged.height / rows, Math.max(width, 340) + 60) + 22 * named : merged.height,
      margin: { l: 64, r: 12, t: 24, b: named ? 90 : 50, ...merged.margin },
    });
  }

  function draw() {
    for (const figure of figures) {
      const box = document.getElementById(figure.id);
      const made = layout(figure, Theme.printing ? PAPER : box.clientWidth);
      box.style.height = `${made.height}px`;
      Plotly.react(box, coloured(figure.traces), made, { responsive: true, displaylogo: false });
    }
  }

  Theme.onChange(draw);  // first when the page has been read
})();
