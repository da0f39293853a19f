/** Formulas that a pupil types: y as an expression of t, and constants of one's own after semicolons, "v*t + a*t^2/2; v = 3; a = 981". */

/** @typedef {(t: number) => number} Evaluated */

/** What a formula may call, each with one argument. @type {Record<string, (x: number) => number>} */
const FUNCTIONS = {
  sin: Math.sin, cos: Math.cos, tan: Math.tan, asin: Math.asin, acos: Math.acos, atan: Math.atan, sinh: Math.sinh, cosh: Math.cosh,
  tanh: Math.tanh, exp: Math.exp, ln: Math.log, log: Math.log10, sqrt: Math.sqrt, abs: Math.abs,
};
/** @type {Record<string, number>} */
const CONSTANTS = { pi: Math.PI, e: Math.E };
/** Characters that people paste or find on a telephone -> what is read. @type {Record<string, string>} */
const OTHER_SIGNS = { "·": "*", "×": "*", "⋅": "*", "−": "-", "–": "-", "÷": "/", ":": "/", "²": "^2", "³": "^3", "π": "pi", "√": "sqrt" };
const TOKEN = /\s*(?:(\d+[.,]?\d*(?:e[+-]?\d+)?|[.,]\d+(?:e[+-]?\d+)?)|([a-z]\w*)|(\*\*|[-+*/^()=;]))/iy;

/** @typedef {"formulaEmpty" | "formulaSign" | "formulaNeedsValue" | "formulaNeedsEnd" | "formulaNeedsBracket" | "formulaNeedsCall" |
 *   "formulaUnknown" | "formulaConstant"} FaultKey */

/** A formula that cannot be read: the key of the sentence that says why, where it is, counted from 1, and what was found there. */
export class FormulaError extends Error {
  /** @param {FaultKey} key @param {number} place @param {string} found */
  constructor(key, place, found = "") {
    super(`${key} ${place} ${found}`);
    this.key = key;
    this.place = place;
    this.found = found;
  }
}

/** @typedef {{kind: "number" | "name" | "sign" | "end", words: string, place: number}} Token */

/** @param {string} typed @returns {Token[]} */
function tokensOf(typed) {
  /** @type {Token[]} */
  const tokens = [];
  // A sign of two characters stands for one that was typed, so that places are kept for each character
  const places = [...typed].flatMap((sign, i) => [...(OTHER_SIGNS[sign] ?? sign)].map(() => i + 1));
  const plain = [...typed].map((sign) => OTHER_SIGNS[sign] ?? sign).join("");
  let at = 0;
  while (plain.slice(at).trim()) {
    TOKEN.lastIndex = at;
    const found = TOKEN.exec(plain);
    if (!found) {
      const start = plain.length - plain.slice(at).trimStart().length;
      throw new FormulaError("formulaSign", places[start], plain[start]);
    }
    const [whole, number, name, sign] = found;
    const words = number ?? name ?? sign;
    tokens.push({ kind: number ? "number" : name ? "name" : "sign", words, place: places[at + whole.length - words.length] });
    at = TOKEN.lastIndex;
  }
  return [...tokens, { kind: "end", words: "", place: typed.length + 1 }];
}

/** Reads tokens by the usual order: sums of products of powers; 2t and 2(t + 1) are products. */
class Reader {
  /** @param {Token[]} tokens @param {Map<string, Evaluated>} own constants */
  constructor(tokens, own) {
    this.tokens = tokens;
    this.own = own;
  }

  get next() {
    return this.tokens[0];
  }

  /** Take the next token if it is one of these signs. @param {string[]} signs */
  taken(...signs) {
    const { kind, words } = this.next;
    if (kind !== "sign" || !signs.includes(words)) return "";
    this.tokens.shift();
    return words;
  }

  /** @param {FaultKey} key @returns {never} */
  fail(key, { place, words } = this.next) {
    throw new FormulaError(key, place, words);
  }

  /** @returns {Evaluated} */
  sum() {
    let value = this.product();
    for (let sign = this.taken("+", "-"); sign; sign = this.taken("+", "-")) {
      const [left, right] = [value, this.product()];
      value = sign === "+" ? (t) => left(t) + right(t) : (t) => left(t) - right(t);
    }
    return value;
  }

  /** @returns {Evaluated} */
  product() {
    let value = this.signed();
    for (;;) {
      const sign = this.taken("*", "/");
      const { kind, words } = this.next;
      if (!sign && kind !== "name" && words !== "(") return value;
      const [left, right] = [value, sign ? this.signed() : this.power()];
      value = sign === "/" ? (t) => left(t) / right(t) : (t) => left(t) * right(t);
    }
  }

  /** @returns {Evaluated} */
  signed() {
    let isNegative = false;
    for (let sign = this.taken("+", "-"); sign; sign = this.taken("+", "-")) isNegative = isNegative !== (sign === "-");
    const value = this.power();
    return isNegative ? (t) => -value(t) : value;
  }

  /** @returns {Evaluated} */
  power() {
    const base = this.atom();
    if (!this.taken("^", "**")) return base;
    const exponent = this.signed();
    return (t) => base(t) ** exponent(t);
  }

  /** @returns {Evaluated} */
  atom() {
    const token = this.next;
    if (this.taken("(")) {
      const value = this.sum();
      if (!this.taken(")")) this.fail("formulaNeedsBracket");
      return value;
    }
    if (token.kind !== "number" && token.kind !== "name") this.fail("formulaNeedsValue");
    this.tokens.shift();
    if (token.kind === "number") {
      const value = Number(token.words.replace(",", "."));
      return () => value;
    }
    const name = token.words;
    if (name === "t") return (t) => t;
    const own = this.own.get(name);
    if (own) return own;
    if (Object.hasOwn(CONSTANTS, name)) return () => CONSTANTS[name];
    if (!Object.hasOwn(FUNCTIONS, name)) this.fail("formulaUnknown", token);
    if (this.next.words !== "(") this.fail("formulaNeedsCall", token);
    const [call, argument] = [FUNCTIONS[name], this.atom()];
    return (t) => call(argument(t));
  }
}

/** Return a formula as a function of t. @param {string} typed @returns {Evaluated} @throws {FormulaError} */
export function readFormula(typed) {
  /** @type {Token[][]} */
  const parts = [[]];
  for (const token of tokensOf(typed)) {
    if (token.words === ";") {
      parts[parts.length - 1].push({ ...token, kind: "end" });
      parts.push([]);
    } else parts[parts.length - 1].push(token);
  }
  const [formula, ...constants] = parts;
  const isNamed = formula[0].kind === "name" && formula[0].words === "y" && formula[1].words === "=";
  if (isNamed) formula.splice(0, 2);
  if (formula.length === 1) throw new FormulaError("formulaEmpty", formula[0].place);
  /** @type {Map<string, Evaluated>} */
  const own = new Map();
  // A constant may be made of those after it
  for (const [name, equals, ...rest] of constants.reverse()) {
    if (!equals) continue; // nothing stands after the last semicolon
    const changes = [name, ...rest].find(({ words }) => words === "t");
    const wrong = name.kind !== "name" || equals.words !== "=" ? name : changes;
    if (wrong) throw new FormulaError("formulaConstant", wrong.place, wrong.words);
    const value = whole(rest, own)(NaN);
    own.set(name.words, () => value);
  }
  return whole(formula, own);
}

/** All of some tokens. @param {Token[]} tokens @param {Map<string, Evaluated>} own */
function whole(tokens, own) {
  const reader = new Reader(tokens, own);
  const value = reader.sum();
  if (reader.next.kind !== "end") reader.fail("formulaNeedsEnd");
  return value;
}

/**
 * Root mean square distance of points from a function of time; NaN without points, or where it has no value.
 * @param {[number, number][]} points time [s] and value @param {Evaluated} y
 */
export function rmsDistance(points, y) {
  return Math.sqrt(points.reduce((sum, [t, value]) => sum + (value - y(t)) ** 2, 0) / points.length);
}

/**
 * Straight line through points by least squares: slope and intercept with their standard errors, and the RMS distance.
 * @param {[number, number][]} points time and value, at two times at least
 */
export function straightLine(points) {
  const count = points.length;
  const mean = (/** @type {0 | 1} */ i) => points.reduce((sum, point) => sum + point[i], 0) / count;
  const [middle, height] = [mean(0), mean(1)];
  const spread = points.reduce((sum, [t]) => sum + (t - middle) ** 2, 0);
  const slope = points.reduce((sum, [t, value]) => sum + (t - middle) * (value - height), 0) / spread;
  const intercept = height - slope * middle;
  const rms = rmsDistance(points, (t) => slope * t + intercept);
  // Two points lie on their line, whatever their errors are
  const noise = count > 2 ? rms * Math.sqrt(count / (count - 2)) : NaN;
  return { slope, intercept, rms, slopeError: noise / Math.sqrt(spread), interceptError: noise * Math.sqrt(1 / count + middle ** 2 / spread) };
}
