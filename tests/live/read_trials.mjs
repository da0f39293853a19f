// Reads files of tracked points as the live page does: files as JSON on standard input, what was read or the message on standard output.
import { DataError, readTrial } from "../../looping_pendulum/live/assets/trial/reader.js";

let text = "";
for await (const part of process.stdin) text += part;
const results = JSON.parse(text).map(({ file, bytes, options }) => {
  try {
    return readTrial(file, Buffer.from(bytes, "base64"), options);
  } catch (error) {
    if (!(error instanceof DataError)) throw error;
    return { message: error.message, field: error.field };
  }
});
process.stdout.write(JSON.stringify(results));
