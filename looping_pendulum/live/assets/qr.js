/** QR codes (ISO/IEC 18004) of short texts: bytes, error correction L, mask 0, of versions 1 to 13. */

/** Bytes of each version, those that correct errors in each of its blocks, and number of blocks. */
const VERSIONS = [
  [26, 7, 1], [44, 10, 1], [70, 15, 1], [100, 20, 1], [134, 26, 1], [172, 18, 2], [196, 20, 2], [242, 24, 2], [292, 30, 2],
  [346, 18, 4], [404, 20, 4], [466, 24, 4], [532, 26, 4],
];
/** From this version on the length takes two bytes. */
const LONG_LENGTH = 10;
/** From this version on it is written beside the finders. */
const NAMED = 7;
/** Polynomials of the field of 256 elements, of the format's code, and of the version's. */
const [FIELD, FORMAT, VERSION] = [0x11d, 0x537, 0x1f25];
/** Error correction L and mask 0, and what the format's bits are mixed with. */
const [L_AND_MASK_0, FORMAT_MASK] = [0b01000, 0x5412];
/** Kind of content, bytes, and the two bytes that fill the rest. */
const [AS_BYTES, ...FILLERS] = [0b0100, 0xec, 0x11];

/**
 * Return which modules of a code are dark, row by row; null: the text is too long.
 * @param {string} words
 * @returns {boolean[][] | null}
 */
export function qrCode(words) {
  const content = [...new TextEncoder().encode(words)];
  const isEnough = (/** @type {number[]} */ [all, correcting, blocks], /** @type {number} */ i) =>
    all - correcting * blocks >= content.length + (i + 1 < LONG_LENGTH ? 2 : 3);
  const version = VERSIONS.findIndex(isEnough) + 1;
  if (!version) return null;
  const size = 17 + 4 * version;
  /** @type {(boolean | undefined)[][]} */
  const code = Array.from({ length: size }, () => Array(size).fill(undefined));
  drawPatterns(code, version);
  const bits = withCorrection(content, version).flatMap((byte) => bitsOf(byte, 8));
  let next = 0;
  for (let right = size - 1; right >= 1; right -= 2) {
    if (right === 6) right = 5; // the column of the timing pattern
    const isUp = ((right + 1) & 2) === 0;
    for (let i = 0; i < size; i++) {
      const y = isUp ? size - 1 - i : i;
      for (const x of [right, right - 1]) {
        if (code[y][x] === undefined) code[y][x] = Boolean(bits[next++]) !== ((y + x) % 2 === 0);
      }
    }
  }
  return /** @type {boolean[][]} */ (code);
}

/** Bits of a number, the highest first. @param {number} number @param {number} count */
const bitsOf = (number, count) => Array.from({ length: count }, (_, i) => (number >> (count - 1 - i)) & 1);

/** The content with its length, fillers and errors' correction, blocks in turn. @param {number[]} content @param {number} version */
function withCorrection(content, version) {
  const [all, correcting, count] = VERSIONS[version - 1];
  const room = all - correcting * count;
  const bits = [
    ...bitsOf(AS_BYTES, 4), ...bitsOf(content.length, version < LONG_LENGTH ? 8 : 16), ...content.flatMap((byte) => bitsOf(byte, 8)),
    0, 0, 0, 0,
  ];
  const data = Array.from({ length: bits.length / 8 }, (_, i) => bits.slice(8 * i, 8 * i + 8).reduce((sum, bit) => 2 * sum + bit, 0));
  for (let i = 0; data.length < room; i++) data.push(FILLERS[i % 2]);
  const short = Math.floor(room / count);
  const isLong = (/** @type {number} */ i) => i >= count - (room % count);
  /** @type {number[][]} */
  const blocks = [];
  for (let i = 0, from = 0; i < count; from += short + Number(isLong(i)), i++) blocks.push(data.slice(from, from + short + Number(isLong(i))));
  const divisor = generator(correcting);
  const corrections = blocks.map((block) => remainder(block, divisor));
  return [...inTurn(blocks), ...inTurn(corrections)];
}

/** First bytes of all blocks, second ones, and so on. @param {number[][]} blocks */
function inTurn(blocks) {
  const longest = Math.max(...blocks.map((block) => block.length));
  return Array.from({ length: longest }, (_, i) => blocks.filter((block) => i < block.length).map((block) => block[i])).flat();
}

/** Product in the field. @param {number} a @param {number} b */
function product(a, b) {
  let sum = 0;
  for (let i = 7; i >= 0; i--) sum = ((sum << 1) ^ ((sum >> 7) * FIELD)) ^ (((b >> i) & 1) * a);
  return sum;
}

/** Coefficients of (x - 1)(x - 2)(x - 4)... after the leading one. @param {number} degree */
function generator(degree) {
  const found = [...Array(degree - 1).fill(0), 1];
  for (let i = 0, root = 1; i < degree; i++, root = product(root, 2)) {
    for (let j = 0; j < degree; j++) found[j] = product(found[j], root) ^ (found[j + 1] ?? 0);
  }
  return found;
}

/** @param {number[]} data @param {number[]} divisor */
function remainder(data, divisor) {
  let rest = divisor.map(() => 0);
  for (const byte of data) {
    const factor = byte ^ rest[0];
    rest = [...rest.slice(1), 0].map((value, i) => value ^ product(divisor[i], factor));
  }
  return rest;
}

/** Finders, timing and alignment patterns, format and version. @param {(boolean | undefined)[][]} code @param {number} version */
function drawPatterns(code, version) {
  const size = code.length;
  const last = size - 7;
  const square = (/** @type {number} */ y, /** @type {number} */ x, /** @type {number} */ reach, /** @type {(ring: number) => boolean} */ isDark) => {
    for (let dy = -reach; dy <= reach; dy++) {
      for (let dx = -reach; dx <= reach; dx++) {
        if (code[y + dy]?.[x + dx] !== undefined || y + dy < 0 || y + dy >= size || x + dx < 0 || x + dx >= size) continue;
        code[y + dy][x + dx] = isDark(Math.max(Math.abs(dy), Math.abs(dx)));
      }
    }
  };
  for (const [y, x] of [[3, 3], [3, size - 4], [size - 4, 3]]) square(y, x, 4, (ring) => ring !== 2 && ring !== 4);
  const places = version === 1 ? [] : version < NAMED ? [6, last] : [6, 22 + 2 * (version - NAMED), last];
  for (const y of places) {
    for (const x of places) {
      const isAtFinder = (x === 6 && (y === 6 || y === last)) || (x === last && y === 6);
      if (!isAtFinder) square(y, x, 2, (ring) => ring !== 1);
    }
  }
  for (let i = 8; i < size - 8; i++) code[6][i] = code[i][6] = i % 2 === 0;
  const format = bitsOf(((L_AND_MASK_0 << 10) | divided(L_AND_MASK_0 << 10, FORMAT)) ^ FORMAT_MASK, 15).reverse().map(Boolean);
  format.forEach((bit, i) => {
    code[i < 6 ? i : i < 8 ? i + 1 : size - 15 + i][8] = bit;
    code[8][i < 8 ? size - 1 - i : i === 8 ? 7 : 14 - i] = bit;
  });
  code[size - 8][8] = true;
  if (version < NAMED) return;
  bitsOf((version << 12) | divided(version << 12, VERSION), 18).reverse().forEach((bit, i) => {
    const [near, far] = [Math.floor(i / 3), size - 11 + (i % 3)];
    code[near][far] = code[far][near] = bit === 1;
  });
}

/** Remainder of a number, whose bits are coefficients, by a polynomial. @param {number} number @param {number} polynomial */
function divided(number, polynomial) {
  const degree = 31 - Math.clz32(polynomial);
  let rest = number;
  for (let shift = 31 - Math.clz32(rest) - degree; shift >= 0; shift = 31 - Math.clz32(rest) - degree) rest ^= polynomial << shift;
  return rest;
}
