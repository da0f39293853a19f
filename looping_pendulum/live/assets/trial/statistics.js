/** Sums, medians and small matrices. */

/** Standard deviation of a Gaussian in units of its median absolute value. */
export const GAUSSIAN_MAD = 1.4826;

/** @param {ArrayLike<number>} a @param {ArrayLike<number>} b */
export function dot(a, b) {
  let sum = 0;
  for (let i = 0; i < a.length; i++) sum += a[i] * b[i];
  return sum;
}

/** @param {ArrayLike<number>} values */
export const sumOfSquares = (values) => dot(values, values);

/** @param {ArrayLike<number>} values */
export function mean(values) {
  let sum = 0;
  for (let i = 0; i < values.length; i++) sum += values[i];
  return sum / values.length;
}

/** Middle value, or the mean of the two in the middle. @param {ArrayLike<number>} values */
export function median(values) {
  const sorted = Float64Array.from(values).sort();
  const half = sorted.length >> 1;
  return sorted.length % 2 ? sorted[half] : (sorted[half - 1] + sorted[half]) / 2;
}

/** Standard deviation about 0 by the median absolute value. @param {number[]} values */
export const robustDeviation = (values) => GAUSSIAN_MAD * median(values.map(Math.abs));

/** Whole numbers from `start` to before `end`. @param {number} start @param {number} end */
export const range = (start, end) => Array.from({ length: Math.max(end - start, 0) }, (_, i) => start + i);

/** Products of all pairs of columns. @param {ArrayLike<number>[]} columns */
export const normalMatrix = (columns) => columns.map((a) => columns.map((b) => dot(a, b)));

/**
 * Inverse of a positive matrix by Gauss and Jordan's method with pivots, scaled to a diagonal of ones. A parameter without a
 * slope has a variance without end.
 * @param {number[][]} matrix
 */
export function inverse(matrix) {
  const n = matrix.length;
  const scale = matrix.map((row, i) => (row[i] > 0 ? 1 / Math.sqrt(row[i]) : 0));
  const rows = matrix.map((row, i) => [
    ...row.map((x, j) => (scale[i] && scale[j] ? x * scale[i] * scale[j] : Number(i === j))),
    ...range(0, n).map((j) => Number(i === j)),
  ]);
  for (let i = 0; i < n; i++) {
    let pivot = i;
    for (let k = i + 1; k < n; k++) if (Math.abs(rows[k][i]) > Math.abs(rows[pivot][i])) pivot = k;
    [rows[i], rows[pivot]] = [rows[pivot], rows[i]];
    const divisor = rows[i][i];
    rows[i] = rows[i].map((x) => x / divisor);
    for (let k = 0; k < n; k++) {
      if (k === i) continue;
      const factor = rows[k][i];
      if (factor !== 0) rows[k] = rows[k].map((x, j) => x - factor * rows[i][j]);
    }
  }
  return rows.map((row, i) => row.slice(n).map((x, j) => (scale[i] && scale[j] ? x * scale[i] * scale[j] : i === j ? Infinity : 0)));
}
