/** What a file is by its first bytes, and the text in it. */

export const UTF_8_MARK = [0xef, 0xbb, 0xbf];
const UTF_16_MARKS = { "utf-16le": [0xff, 0xfe], "utf-16be": [0xfe, 0xff] };

/** @param {Uint8Array} bytes @param {number[]} start */
export const begins = (bytes, start) => start.every((byte, i) => bytes[i] === byte);

/** @param {Uint8Array} bytes */
export const isArchive = (bytes) => begins(bytes, [0x50, 0x4b, 3, 4]);

/** @param {Uint8Array} bytes */
export function textOf(bytes) {
  const encoding = Object.entries(UTF_16_MARKS).find(([, mark]) => begins(bytes, mark))?.[0] ?? "utf-8";
  try {
    return new TextDecoder(encoding, { fatal: true }).decode(bytes);
  } catch {
    // Older programs on Windows write names in their own code page; the numbers are the same in all
    return Array.from(bytes, (byte) => String.fromCharCode(byte)).join("");
  }
}
