/** When a film's frames were taken, by the tables of an MP4 file (ISO/IEC 14496-12), and the camera's rate if a phone wrote it. */

/** @typedef {DataView} Box the content of a box @typedef {{times: number[], rate: number}} FrameTimes rate: 0 if it is not said */

/** Key by which phones state the camera's rate, and the type of a value that is no text. */
const [CAPTURE_RATE, FLOAT] = ["com.android.capture.fps", 23];

/**
 * Return the times [s] of the frames that are shown, in order; null: it is no MP4 file, or one in fragments.
 * @param {Blob} file
 * @returns {Promise<FrameTimes | null>}
 */
export async function frameTimes(file) {
  try {
    const movie = await contents(file);
    const track = movie && all(movie, "trak").find((box) => letters(inside(box, "mdia", "hdlr"), 8) === "vide");
    if (!movie || !track) return null;
    const times = shownTimes(track, perSecond(inside(movie, "mvhd")));
    return times.length > 1 ? { times, rate: captureRate(movie) } : null;
  } catch {
    return null; // a damaged table ends before its time
  }
}

/** Spread of times that were rounded to milliseconds about those of even frames: one, and a half as the rate is fitted [s]. */
const ROUNDED = 1.5e-3;

/**
 * Times of even frames of which a browser knows whole milliseconds only, as WebM has no others; null: the frames are not even.
 * @param {number[]} times in order, some frames perhaps left out [s]
 * @param {number} step how long a frame lasts, roughly [s]
 * @returns {{times: number[], step: number} | null} the step as the times have it
 */
export function evenTimes(times, step) {
  let frame = 0;
  const frames = times.map((time, i) => (frame += i ? Math.max(Math.round((time - times[i - 1]) / step), 1) : 0));
  const mean = (/** @type {number[]} */ all) => all.reduce((sum, one) => sum + one, 0) / all.length;
  const [middle, time] = [mean(frames), mean(times)];
  const slope = mean(frames.map((k, i) => (k - middle) * times[i])) / mean(frames.map((k) => (k - middle) ** 2));
  const even = frames.map((k) => time + slope * (k - middle));
  const beside = even.map((one, i) => one - times[i]);
  return Math.max(...beside) - Math.min(...beside) <= ROUNDED ? { times: even, step: slope } : null;
}

/** The table of contents, wherever it stands in the file. @param {Blob} file */
async function contents(file) {
  for (let at = 0; at + 16 <= file.size; ) {
    const head = new DataView(await file.slice(at, at + 16).arrayBuffer());
    const short = head.getUint32(0);
    const size = short === 1 ? Number(head.getBigUint64(8)) : short || file.size - at;
    if (letters(head, 4) === "moov") return new DataView(await file.slice(at + 8, at + size).arrayBuffer());
    if (size < 8) return null;
    at += size;
  }
  return null;
}

/** @param {Box} box @param {number} at @param {number} count */
const part = (box, at, count = box.byteLength - at) => new DataView(box.buffer, box.byteOffset + at, count);

/** @param {Box} box @param {number} at @param {number} count */
const letters = (box, at, count = 4) => new TextDecoder("latin1").decode(part(box, at, count));

/** Boxes of a kind in a box. @param {Box} box @param {string} kind */
function all(box, kind) {
  const found = [];
  for (let at = 0; at + 8 <= box.byteLength; ) {
    const size = box.getUint32(at);
    if (size < 8) break;
    if (letters(box, at + 4) === kind) found.push(part(box, at + 8, size - 8));
    at += size;
  }
  return found;
}

/** The box at a path. @param {Box} box @param {string[]} path */
const inside = (box, ...path) => path.reduce((outer, kind) => all(outer, kind)[0] ?? new DataView(new ArrayBuffer(64)), box);

/** Ticks of a clock in a second, by a header of the movie or of a track's media. @param {Box} header */
const perSecond = (header) => header.getUint32(header.getUint8(0) ? 20 : 12);

/** @param {Box} track @param {number} movieRate ticks of the movie's clock in a second */
function shownTimes(track, movieRate) {
  const table = inside(track, "mdia", "minf", "stbl");
  const rate = perSecond(inside(track, "mdia", "mdhd"));
  const delays = runs(inside(table, "ctts"));
  let tick = 0;
  const ticks = runs(inside(table, "stts")).map((length, i) => (tick += length) - length + (delays[i] ?? 0));
  const edits = inside(track, "edts", "elst");
  const long = edits.getUint8(0) ? 8 : 4;
  let [late, begin, end] = [0, 0, Infinity];
  for (let k = 0, at = 8; k < edits.getUint32(4); k++, at += 2 * long + 4) {
    const read = (/** @type {number} */ from) => long === 8 ? Number(edits.getBigInt64(from)) : edits.getInt32(from);
    const [lasting, media] = [read(at) / movieRate, read(at + long)];
    if (media < 0) late += lasting; // nothing is shown
    else {
      begin = media;
      if (lasting) end = media + lasting * rate;
      break;
    }
  }
  return ticks.filter((one) => one >= begin && one < end - 0.5).map((one) => late + (one - begin) / rate).sort((a, b) => a - b);
}

/** Values of a table of runs: how many samples have which. @param {Box} box */
const runs = (box) => Array.from({ length: box.getUint32(4) }, (_, k) => 8 + 8 * k)
  .flatMap((at) => Array(box.getUint32(at)).fill(box.getInt32(at + 4)));

/** Frames per second of the camera as phones state it [Hz]; 0: they do not. @param {Box} movie */
function captureRate(movie) {
  const [meta] = [movie, inside(movie, "udta")].flatMap((box) => all(box, "meta")).map((box) => (box.getUint32(0) ? box : part(box, 4))); // MP4 has four bytes more than MOV
  if (!meta) return 0;
  const keys = inside(meta, "keys");
  for (let k = 1, at = 8; k <= keys.getUint32(4); k++) {
    if (letters(keys, at + 8, keys.getUint32(at) - 8) === CAPTURE_RATE) {
      const data = inside(meta, "ilst", String.fromCharCode(0, 0, 0, k), "data");
      return data.getUint32(0) === FLOAT ? data.getFloat32(8) : Number(letters(data, 8, data.byteLength - 8)) || 0;
    }
    at += keys.getUint32(at);
  }
  return 0;
}
