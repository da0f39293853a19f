/** What a file is by its first bytes, and the text in it. */

export const UTF_8_MARK = [0xef, 0xbb, 0xbf];

/** @param {Uint8Array} bytes @param {number[]} start */
export const begins = (bytes, start) => start.every((byte, i) => bytes[i] === byte);

/** @param {Uint8Array} bytes */
export const isArchive = (bytes) => begins(bytes, [0x50, 0x4b, 3, 4]);

/** @param {Uint8Array} bytes */
export function textOf(bytes) {
  const encoding = begins(bytes, [0xff, 0xfe]) ? "utf-16le" : begins(bytes, [0xfe, 0xff]) ? "utf-16be" : "utf-8";
  try {
    return new TextDecoder(encoding, { fatal: true }).decode(bytes);
  } catch {
    // Older programs on Windows write names in their own code page; the numbers are the same in all
    return Array.from(bytes, (byte) => String.fromCharCode(byte)).join("");
  }
}
