/** Angular rates: about which axis a body turns, and whether they are those of the angle beside them (`measured/readers.py`). */

import { shown, text } from "../texts.js";
import { at, largest, steps, where } from "./arrays.js";
import { count } from "./clock.js";
import { inQuotes, inSentence } from "./messages.js";
import { dot, normalMatrix, sumOfSquares } from "./statistics.js";

/** @typedef {import("./clock.js").Channel} Channel */
/** @typedef {import("./clock.js").Notes} Notes */
/** @typedef {import("./clock.js").Series} Series */

/** Squarings of a matrix, after which its second axis has the power 2^-40 of any difference from the first. */
const SQUARINGS = 40;
/** Smallest number of points of an angle that tell its rate. */
const MIN_POINTS = 5;

/** The rate about the axis about which a body turns, of rates about axes of its own.
 * @param {import("./table.js").Table} table @param {Series[]} axes @param {Notes} notes */
export function aboutOneAxis(table, axes, notes) {
  const known = where(axes[0].value, (_, i) => axes.every(({ value }) => Number.isFinite(value[i])));
  if (!known.length) throw table.error(null, axes[0].column, text("file.noValues", { name: axes[0].name }));
  const columns = axes.map(({ value }) => at(value, known));
  const total = columns.reduce((sum, column) => sum + sumOfSquares(column), 0);
  const axis = total ? mainAxis(normalMatrix(columns)) : axes.map((_, k) => Number(k === 0)); // it does not turn
  const rates = axes[0].value.map((_, i) => dot(axes.map(({ value }) => value[i]), axis));
  const share = total ? sumOfSquares(at(rates, known)) / total : 1;
  const named = axis.map((part) => shown((Number(part.toFixed(2)) + 0).toFixed(2))).join(", ");
  notes.assumptions.push(text("assumed.axis", { count: axes.length, axis: named, share: inSentence(100 * share, 3) }));
  return { ...axes[0], column: axes[indexOfLargest(axis)].column, value: rates };
}

/** Direction of the largest values, whose largest part is positive. @param {number[][]} matrix products of all pairs of columns */
function mainAxis(matrix) {
  let power = matrix;
  for (let i = 0; i < SQUARINGS; i++) {
    const trace = power.reduce((sum, row, k) => sum + row[k], 0);
    power = normalMatrix(power.map((row) => row.map((one) => one / trace)));
  }
  const column = power[indexOfLargest(power.map((row, k) => row[k]))];
  const size = Math.sqrt(sumOfSquares(column)) * Math.sign(column[indexOfLargest(column)]);
  return column.map((part) => part / size);
}

/** @param {number[]} parts */
function indexOfLargest(parts) {
  const sizes = parts.map(Math.abs);
  return sizes.indexOf(largest(sizes));
}

/** Leave out an angular rate that is not the rate of the angle beside it. @param {Channel[]} channels @param {Notes} notes */
export function withoutInconsistentRate(channels, notes) {
  const [angle, rate] = ["angle", "angle_rate"].map((name) => channels.find((channel) => channel.name === name));
  if (!angle || !rate || angle.t.length < MIN_POINTS) return channels;
  const slopes = new Map(gradient(angle).map((slope, i) => [angle.t[i], slope]));
  const both = where(rate.t, (t) => slopes.has(t));
  const [slope, value] = [at(rate.t, both).map((t) => slopes.get(t) ?? 0), at(rate.value, both)];
  const size = sumOfSquares(slope);
  const ratio = size ? dot(slope, value) / size : 0;
  const correlation = Math.abs(dot(slope, value)) / (Math.sqrt(size * sumOfSquares(value)) || 1);
  if (correlation > 0.9 && 0.8 < ratio && ratio < 1.25) return channels;
  const found = { column: inQuotes(rate.column), ratio: inSentence(ratio, 2), correlation: shown(correlation.toFixed(2)) };
  count(notes, "", text("unused.notRate", found), rate.t.length);
  return channels.filter((channel) => channel !== rate);
}

/** Slope of a channel at its points, of second order inside. @param {Channel} channel */
function gradient({ t, value }) {
  const dt = steps(t);
  const slopes = steps(value).map((step, i) => step / dt[i]);
  const last = t.length - 1;
  return t.map((_, i) => {
    if (i === 0 || i === last) return slopes[i ? last - 1 : 0];
    return (dt[i] * slopes[i - 1] + dt[i - 1] * slopes[i]) / (dt[i - 1] + dt[i]);
  });
}
