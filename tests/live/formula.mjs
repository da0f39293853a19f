// Reads formulas that pupils type: {formulas: [typed, times][], lines: points[]} on standard input; values or faults, and straight lines.
import { readFileSync } from "node:fs";
import { FormulaError, readFormula, rmsDistance, straightLine } from "../../looping_pendulum/live/assets/formula.js";

function read([typed, times]) {
  try {
    const y = readFormula(typed);
    return { values: times.map(y) };
  } catch (error) {
    if (!(error instanceof FormulaError)) throw error;
    return { fault: error.key, place: error.place, found: error.found };
  }
}

const { formulas = [], lines = [] } = JSON.parse(readFileSync(0, "utf8"));
process.stdout.write(JSON.stringify({
  formulas: formulas.map(read),
  lines: lines.map((points) => ({ ...straightLine(points), zero: rmsDistance(points, () => 0) })),
}));
