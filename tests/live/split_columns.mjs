// Splits tables of any program as the live page does: {bytes, roles} as JSON on standard input; what is guessed, and what is read with
// the roles (or, without them, with what is guessed) on standard output.
import { columnsOf, guessed, plainTable, tableOf } from "../../looping_pendulum/live/assets/trial/columns.js";
import { DataError, readTrial } from "../../looping_pendulum/live/assets/trial/reader.js";

let text = "";
for await (const part of process.stdin) text += part;
const results = JSON.parse(text).map(({ bytes, roles, options }) => {
  const columns = columnsOf(Buffer.from(bytes, "base64"));
  if (!columns) return null;
  const guess = guessed(columns.head);
  const plain = plainTable(columns, roles ?? guess);
  try {
    const { channels } = readTrial("clip.csv", Buffer.from(plain), options);
    return { guess, others: columns.others, plain, channels, again: readTrial("plain.csv", Buffer.from(tableOf(channels))).channels };
  } catch (error) {
    if (!(error instanceof DataError)) throw error;
    return { guess, others: columns.others, plain, message: error.message };
  }
});
process.stdout.write(JSON.stringify(results));
