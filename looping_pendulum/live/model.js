// Written by `python -m looping_pendulum.live.generate` from reference_ode and scenarios.quantities: change them.
/**
 * Numbers of the apparatus, in SI.
 * @typedef {{light_mass: number, heavy_mass: number, rod_radius: number, free_length: number, release_angle: number, hanging_length: number, light_radius: number, gravity: number, kinetic_friction: number, static_friction: number, light_drag: number, heavy_drag: number, string_drag: number, light_linear_drag: number, heavy_linear_drag: number, wind_speed: number, side_force: number, push_across: number, push_along: number, end_length: number, string_length: number}} Numbers
 *
 * Piecewise constants that keep the equations analytic between events.
 * @typedef {{slide: number, across: number, heavy: number, phase: number}} Signs
 *
 * State of a run: free_length, wrap_angle, retreat_speed, across_speed, heavy_speed, slack.
 * @typedef {number[]} State
 *
 * A run at one instant.
 * @typedef {{mode: number, t: number, y: State, signs: Signs}} Motion
 *
 * Motion just after the release, and after the run has left rest; the terms of the series by which it does so.
 * @typedef {{released: Motion, after: Motion, bySeries: boolean, series: State[]}} Release
 *
 * What can be seen or drawn of one instant (SI; vectors are x and y).
 * @typedef {{
 *   light: number[], heavy: number[], lightVelocity: number[], heavyVelocity: number[], wrapAngle: number, freeLength: number,
 *   slack: number, lightTension: number, heavyTension: number, kineticEnergy: number, potentialEnergy: number,
 *   dragForce: number[], holding: {needed: number, bound: number} | null,
 * }} Quantities
 *
 * Equations of one mode. `z` has the entries of the state that it integrates, `y` all of them.
 * @typedef {{
 *   integrated: number[],
 *   events: string[][],
 *   rates(p: Numbers, t: number, z: Float64Array, s: Signs, out: Float64Array): void,
 *   eventValues(p: Numbers, t: number, z: Float64Array, s: Signs, out: Float64Array): void,
 *   fullState(z: Float64Array): State,
 *   quantities(p: Numbers, t: number, y: State, s: Signs): Quantities,
 *   apply: Record<string, (p: Numbers, t: number, y: State, s: Signs) => Motion>,
 * }} ModeEquations
 */
/** Default relative tolerance of a step. */
export const TOLERANCE = 1e-12;
/** Default limit on the simulated time [s]. */
export const DURATION = 5;
/** Number of events after which a run is given up as endless. */
export const MAX_EVENTS = 4000;
/** Number of steps in one mode after which a run is given up. */
export const MAX_STEPS = 200000;
/** First step in a mode [s]. */
export const FIRST_STEP = 1e-06;
/** Length of the step by which a run leaves rest [s]. */
export const REST_SERIES_DURATION = 1e-06;
/** Fraction of an event function's largest value; a lower dip is minimized. */
export const DIP_THRESHOLD = 0.01;
/** Fraction of the same by which a minimum must be below zero. */
export const MIN_DIP_DEPTH = 1e-06;
/** Fractions of a step at which event functions are evaluated. */
export const CHECKS = [0, 0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 1];
/** Fractions of a step at which the polynomial through those values is evaluated. */
export const BETWEEN = [0, 0.015625, 0.03125, 0.046875, 0.0625, 0.078125, 0.09375, 0.109375, 0.125, 0.140625, 0.15625, 0.171875, 0.1875, 0.203125, 0.21875, 0.234375, 0.25, 0.265625, 0.28125, 0.296875, 0.3125, 0.328125, 0.34375, 0.359375, 0.375, 0.390625, 0.40625, 0.421875, 0.4375, 0.453125, 0.46875, 0.484375, 0.5, 0.515625, 0.53125, 0.546875, 0.5625, 0.578125, 0.59375, 0.609375, 0.625, 0.640625, 0.65625, 0.671875, 0.6875, 0.703125, 0.71875, 0.734375, 0.75, 0.765625, 0.78125, 0.796875, 0.8125, 0.828125, 0.84375, 0.859375, 0.875, 0.890625, 0.90625, 0.921875, 0.9375, 0.953125, 0.96875, 0.984375, 1];
/** Coefficients of the method of Dormand and Prince of order 8 (DOP853), from SciPy. */
export const DOP853 = {
  B: [0.054293734116568765, 0, 0, 0, 0, 4.450312892752409, 1.8915178993145003, -5.801203960010585, 0.3111643669578199, -0.1521609496625161, 0.20136540080403034, 0.04471061572777259],
  C: [0, 0.05260015195876773, 0.0789002279381516, 0.1183503419072274, 0.2816496580927726, 0.3333333333333333, 0.25, 0.3076923076923077, 0.6512820512820513, 0.6, 0.8571428571428571, 1, 1, 0.1, 0.2, 0.7777777777777778],
  E3: [-0.18980075407240762, 0, 0, 0, 0, 4.450312892752409, 1.8915178993145003, -5.801203960010585, -0.4226823213237919, -0.1521609496625161, 0.20136540080403034, 0.02265179219836082, 0],
  E5: [0.01312004499419488, 0, 0, 0, 0, -1.2251564463762044, -0.4957589496572502, 1.6643771824549864, -0.35032884874997366, 0.3341791187130175, 0.08192320648511571, -0.022355307863886294, 0],
  A: [
    [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0],
    [0.05260015195876773, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0],
    [0.0197250569845379, 0.0591751709536137, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0],
    [0.02958758547680685, 0, 0.08876275643042054, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0],
    [0.2413651341592667, 0, -0.8845494793282861, 0.924834003261792, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0],
    [0.037037037037037035, 0, 0, 0.17082860872947386, 0.12546768756682242, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0],
    [0.037109375, 0, 0, 0.17025221101954405, 0.06021653898045596, -0.017578125, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0],
    [0.03709200011850479, 0, 0, 0.17038392571223998, 0.10726203044637328, -0.015319437748624402, 0.008273789163814023, 0, 0, 0, 0, 0, 0, 0, 0, 0],
    [0.6241109587160757, 0, 0, -3.3608926294469414, -0.868219346841726, 27.59209969944671, 20.154067550477894, -43.48988418106996, 0, 0, 0, 0, 0, 0, 0, 0],
    [0.47766253643826434, 0, 0, -2.4881146199716677, -0.590290826836843, 21.230051448181193, 15.279233632882423, -33.28821096898486, -0.020331201708508627, 0, 0, 0, 0, 0, 0, 0],
    [-0.9371424300859873, 0, 0, 5.186372428844064, 1.0914373489967295, -8.149787010746927, -18.52006565999696, 22.739487099350505, 2.4936055526796523, -3.0467644718982196, 0, 0, 0, 0, 0, 0],
    [2.273310147516538, 0, 0, -10.53449546673725, -2.0008720582248625, -17.9589318631188, 27.94888452941996, -2.8589982771350235, -8.87285693353063, 12.360567175794303, 0.6433927460157636, 0, 0, 0, 0, 0],
    [0.054293734116568765, 0, 0, 0, 0, 4.450312892752409, 1.8915178993145003, -5.801203960010585, 0.3111643669578199, -0.1521609496625161, 0.20136540080403034, 0.04471061572777259, 0, 0, 0, 0],
    [0.056167502283047954, 0, 0, 0, 0, 0, 0.25350021021662483, -0.2462390374708025, -0.12419142326381637, 0.15329179827876568, 0.00820105229563469, 0.007567897660545699, -0.008298, 0, 0, 0],
    [0.03183464816350214, 0, 0, 0, 0, 0.028300909672366776, 0.053541988307438566, -0.05492374857139099, 0, 0, -0.00010834732869724932, 0.0003825710908356584, -0.00034046500868740456, 0.1413124436746325, 0, 0],
    [-0.42889630158379194, 0, 0, 0, 0, -4.697621415361164, 7.683421196062599, 4.06898981839711, 0.3567271874552811, 0, 0, 0, -0.0013990241651590145, 2.9475147891527724, -9.15095847217987, 0],
  ],
  D: [
    [-8.428938276109013, 0, 0, 0, 0, 0.5667149535193777, -3.0689499459498917, 2.38466765651207, 2.117034582445028, -0.871391583777973, 2.2404374302607883, 0.6315787787694688, -0.08899033645133331, 18.148505520854727, -9.194632392478356, -4.436036387594894],
    [10.427508642579134, 0, 0, 0, 0, 242.28349177525817, 165.20045171727028, -374.5467547226902, -22.113666853125306, 7.733432668472264, -30.674084731089398, -9.332130526430229, 15.697238121770845, -31.139403219565178, -9.35292435884448, 35.81684148639408],
    [19.985053242002433, 0, 0, 0, 0, -387.0373087493518, -189.17813819516758, 527.8081592054236, -11.57390253995963, 6.8812326946963, -1.0006050966910838, 0.7777137798053443, -2.778205752353508, -60.19669523126412, 84.32040550667716, 11.99229113618279],
    [-25.69393346270375, 0, 0, 0, 0, -154.18974869023643, -231.5293791760455, 357.6391179106141, 93.40532418362432, -37.45832313645163, 104.0996495089623, 29.8402934266605, -43.53345659001114, 96.32455395918828, -39.17726167561544, -149.72683625798564],
  ],
};
/** Number of a mode -> its name.
 * @type {Record<number, string>} */
export const MODE_NAMES = {"0": "sticking", "1": "sliding_down", "2": "sliding_up", "3": "slack", "4": "clamped", "5": "clamped_slack", "6": "falling", "7": "ended"};
export const ENDED = 7;
export const STICKING = 0;
export const TIME_UP = "time_up";
export const LIGHT_REACHES_ROD = "light_reaches_rod";
export const STOP = "stop";
/** Events that change a sign or a phase, not the mode. */
export const PHASE_EVENTS = new Set(["slows", "across_reverses", "closes", "heavy_reverses", "first_turn", "rod_changes", "rod_slows"]);
/** Events that end the run. */
export const END_EVENTS = new Set(["light_reaches_rod", "heavy_reaches_rod", "unwrapped", "time_up"]);
/** Values of the settings that need not be given [SI]; `static_friction` then equals `kinetic_friction`.
 * @type {Record<string, number>} */
export const DEFAULTS = {"hanging_length": 0.03, "light_radius": 0.0, "gravity": 9.81, "kinetic_friction": 0.0, "static_friction": 0.0, "light_drag": 0.0, "heavy_drag": 0.0, "string_drag": 0.0, "light_linear_drag": 0.0, "heavy_linear_drag": 0.0, "wind_speed": 0.0, "side_force": 0.0, "push_across": 0.0, "push_along": 0.0};
/** Settings that must be given. */
export const REQUIRED = ["light_mass", "heavy_mass", "rod_radius", "free_length", "release_angle"];
/** Release -> the release angle that it demands [rad].
 * @type {Record<string, number>} */
export const DEMANDED_ANGLES = {"vertical": 3.141592653589793};
/** Setting -> its SI unit, as files have it.
 * @type {Record<string, string>} */
export const UNITS = {"light_mass": "kg", "heavy_mass": "kg", "rod_radius": "m", "free_length": "m", "release_angle": "rad", "hanging_length": "m", "light_radius": "m", "gravity": "m/s^2", "kinetic_friction": "", "static_friction": "", "light_drag": "kg/m", "heavy_drag": "kg/m", "string_drag": "kg/m^2", "light_linear_drag": "kg/s", "heavy_linear_drag": "kg/s", "wind_speed": "m/s", "side_force": "N", "push_across": "m/s", "push_along": "m/s"};
/** Setting or error of the camera -> least and greatest value [SI].
 * @type {Record<string, [number, number]>} */
export const BOUNDS = {
  light_mass: [0, Infinity],
  heavy_mass: [0, Infinity],
  rod_radius: [0, Infinity],
  free_length: [0, Infinity],
  release_angle: [0, 6.283185307179586],
  hanging_length: [0, Infinity],
  light_radius: [0, Infinity],
  gravity: [0, 100],
  kinetic_friction: [0, 5],
  static_friction: [0, 10],
  light_drag: [0, 1],
  heavy_drag: [0, 1],
  string_drag: [0, 1],
  light_linear_drag: [0, 1],
  heavy_linear_drag: [0, 10],
  wind_speed: [-20, 20],
  side_force: [-10, 10],
  push_across: [-20, 20],
  push_along: [-20, 20],
  origin_x: [-2000, 2000],
  origin_y: [-2000, 2000],
  scale: [0.2, 5],
  tilt: [-3.141592653589793, 3.141592653589793],
  foreshortening: [0.2, 5],
  shear: [-1, 1],
  perspective_x: [-1, 1],
  perspective_y: [-1, 1],
  distortion: [-1, 1],
  centre_x: [-10, 10],
  centre_y: [-10, 10],
  clock_offset: [-60, 60],
  clock_ratio: [0.01, 100],
  readout: [-0.1, 0.1],
  heavy_offset_x: [-0.1, 0.1],
  rate_offset: [-1, 1],
};
/** Coefficient of an effect beside those of the paper's model -> the effect.
 * @type {Record<string, string>} */
export const FURTHER_EFFECTS = {"light_linear_drag": "light_linear_drag", "heavy_linear_drag": "heavy_linear_drag", "wind_speed": "wind", "side_force": "side_force", "push_across": "push_across", "push_along": "push_along"};
/** Setting -> its slider: the shown unit, that unit in a link, SI units in one of it, and the range in it.
 * @type {Record<string, {unit: string, unitInLink: string, factor: number, min: number, max: number, step: number}>} */
export const SLIDERS = {
  light_mass: {"unit": "g", "unitInLink": "g", "factor": 0.001, "min": 1, "max": 100, "step": 1},
  light_radius: {"unit": "mm", "unitInLink": "mm", "factor": 0.001, "min": 0, "max": 20, "step": 0.5},
  rod_radius: {"unit": "mm", "unitInLink": "mm", "factor": 0.001, "min": 1, "max": 40, "step": 0.25},
  kinetic_friction: {"unit": "", "unitInLink": "", "factor": 1, "min": 0, "max": 1, "step": 0.01},
  static_friction: {"unit": "", "unitInLink": "", "factor": 1, "min": 0, "max": 1, "step": 0.01},
  light_drag: {"unit": "g/m", "unitInLink": "g_per_m", "factor": 0.001, "min": 0, "max": 5, "step": 0.05},
  heavy_drag: {"unit": "g/m", "unitInLink": "g_per_m", "factor": 0.001, "min": 0, "max": 5, "step": 0.05},
  string_drag: {"unit": "g/m²", "unitInLink": "g_per_m2", "factor": 0.001, "min": 0, "max": 10, "step": 0.05},
  gravity: {"unit": "m/s²", "unitInLink": "m_per_s2", "factor": 1.0, "min": 1, "max": 25, "step": 0.01},
  release_angle: {"unit": "°", "unitInLink": "deg", "factor": 0.017453292519943295, "min": 5, "max": 175, "step": 1},
  free_length: {"unit": "cm", "unitInLink": "cm", "factor": 0.01, "min": 10, "max": 150, "step": 1},
  hanging_length: {"unit": "cm", "unitInLink": "cm", "factor": 0.01, "min": 1, "max": 30, "step": 0.5},
  light_linear_drag: {"unit": "g/s", "unitInLink": "g_per_s", "factor": 0.001, "min": 0, "max": 10, "step": 0.1},
  heavy_linear_drag: {"unit": "g/s", "unitInLink": "g_per_s", "factor": 0.001, "min": 0, "max": 10, "step": 0.1},
  wind_speed: {"unit": "m/s", "unitInLink": "m_per_s", "factor": 1.0, "min": -3, "max": 3, "step": 0.1},
  side_force: {"unit": "mN", "unitInLink": "mN", "factor": 0.001, "min": -20, "max": 20, "step": 0.5},
  push_across: {"unit": "m/s", "unitInLink": "m_per_s", "factor": 1.0, "min": -3, "max": 3, "step": 0.05},
  push_along: {"unit": "m/s", "unitInLink": "m_per_s", "factor": 1.0, "min": -3, "max": 3, "step": 0.05},
  mass_ratio: {"unit": "", "unitInLink": "", "factor": 1, "min": 1, "max": 20, "step": 0.1},
};
/** Return the settings with the numbers that follow from them.
 * @param {any} p @returns {Numbers} */
export function withDerived(p) {
  const a0 = p.light_radius > 0 ? Math.sqrt(p.light_radius * p.light_radius + 2 * p.light_radius * p.rod_radius) : 0.3333333333333333 * p.rod_radius;
  return { ...p, end_length: a0, string_length: p.free_length + p.rod_radius * p.release_angle + p.hanging_length };
}
/** Return a number with six significant digits.
 * @param {number} x */
const general = (x) => String(Number(x.toPrecision(6)));
/** Return what is impossible in an apparatus; "" if nothing is.
 * @param {Numbers} p */
export function faultOf(p) {
  const a0 = p.kinetic_friction >= 0 && p.kinetic_friction <= 5 && Math.abs(p.kinetic_friction) < Infinity;
  const a1 = p.static_friction >= 0 && p.static_friction <= 10 && Math.abs(p.static_friction) < Infinity;
  const a2 = p.light_linear_drag >= 0 && p.light_linear_drag <= 1 && Math.abs(p.light_linear_drag) < Infinity;
  const a3 = p.heavy_linear_drag >= 0 && p.heavy_linear_drag <= 10 && Math.abs(p.heavy_linear_drag) < Infinity;
  if (!(p.light_mass > 0 && p.light_mass <= 1000000000)) return `light_mass: found ${general(p.light_mass)}, needed a finite number above 0 and at most 1e+09`;
  if (!(p.heavy_mass > 0 && p.heavy_mass <= 1000000000)) return `heavy_mass: found ${general(p.heavy_mass)}, needed a finite number above 0 and at most 1e+09`;
  if (!(p.rod_radius > 0 && p.rod_radius <= 1000000000)) return `rod_radius: found ${general(p.rod_radius)}, needed a finite number above 0 and at most 1e+09`;
  if (!(p.free_length > 0 && p.free_length <= 1000000000)) return `free_length: found ${general(p.free_length)}, needed a finite number above 0 and at most 1e+09`;
  if (!(p.hanging_length > 0 && p.hanging_length <= 1000000000)) return `hanging_length: found ${general(p.hanging_length)}, needed a finite number above 0 and at most 1e+09`;
  if (!(p.light_radius >= 0 && p.light_radius < Infinity)) return `light_radius: found ${general(p.light_radius)}, needed 0 or more`;
  if (!(p.release_angle > 0 && p.release_angle < 6.283185307179586)) return `release_angle: found ${general(p.release_angle * 57.29577951308232)} deg, needed between 0 and 360 deg`;
  if (!(p.gravity >= 0 && p.gravity <= 100 && Math.abs(p.gravity) < Infinity)) return `gravity: found ${general(p.gravity)}, needed between 0 and 100`;
  if (!(a0)) return `kinetic_friction: found ${general(p.kinetic_friction)}, needed between 0 and 5`;
  if (!(a1)) return `static_friction: found ${general(p.static_friction)}, needed between 0 and 10`;
  if (!(p.light_drag >= 0 && p.light_drag <= 1 && Math.abs(p.light_drag) < Infinity)) return `light_drag: found ${general(p.light_drag)}, needed between 0 and 1`;
  if (!(p.heavy_drag >= 0 && p.heavy_drag <= 1 && Math.abs(p.heavy_drag) < Infinity)) return `heavy_drag: found ${general(p.heavy_drag)}, needed between 0 and 1`;
  if (!(p.string_drag >= 0 && p.string_drag <= 1 && Math.abs(p.string_drag) < Infinity)) return `string_drag: found ${general(p.string_drag)}, needed between 0 and 1`;
  if (!(a2)) return `light_linear_drag: found ${general(p.light_linear_drag)}, needed between 0 and 1`;
  if (!(a3)) return `heavy_linear_drag: found ${general(p.heavy_linear_drag)}, needed between 0 and 10`;
  if (!(p.wind_speed >= -20 && p.wind_speed <= 20 && Math.abs(p.wind_speed) < Infinity)) return `wind_speed: found ${general(p.wind_speed)}, needed between -20 and 20`;
  if (!(p.side_force >= -10 && p.side_force <= 10 && Math.abs(p.side_force) < Infinity)) return `side_force: found ${general(p.side_force)}, needed between -10 and 10`;
  if (!(p.push_across >= -20 && p.push_across <= 20 && Math.abs(p.push_across) < Infinity)) return `push_across: found ${general(p.push_across)}, needed between -20 and 20`;
  if (!(p.push_along >= -20 && p.push_along <= 20 && Math.abs(p.push_along) < Infinity)) return `push_along: found ${general(p.push_along)}, needed between -20 and 20`;
  if (!(p.static_friction >= p.kinetic_friction)) return `static_friction: found ${general(p.static_friction)}, needed at least kinetic_friction (${general(p.kinetic_friction)})`;
  if (!(p.free_length > p.end_length)) return `free_length: found ${general(p.free_length)} m, but the light mass already touches the rod at ${general(p.end_length)} m; lengthen the string or shrink light_radius`;
  return "";
}
/** How each release begins.
 * @type {Record<string, (p: Numbers) => Release>} */
export const RELEASES = {};
RELEASES.looping = (p) => {
  const a0 = p.push_across < 0 ? -1 : 1;
  const a1 = a0 * p.push_across;
  const a2 = p.push_across * p.push_across;
  const a3 = p.light_mass * p.gravity;
  const a4 = Math.cos(p.release_angle);
  const a5 = a3 * a4;
  const a6 = Math.sin(p.release_angle);
  const a7 = a3 * a6;
  const a8 = p.light_drag * a1;
  const a9 = -p.light_drag;
  const a10 = -p.string_drag * p.free_length * a1 * p.push_across;
  const a11 = p.light_linear_drag === 0;
  const a12 = a11 ? 0 : -p.light_linear_drag * p.push_across;
  const a13 = p.wind_speed * a6;
  const a14 = -p.push_along - a13;
  const a15 = p.push_across - -p.wind_speed * a4;
  const a16 = a15 * a15;
  const a17 = p.light_linear_drag + a8;
  const a18 = -(p.light_linear_drag + p.light_drag * Math.sqrt(a14 * a14 + a16)) * a14 - a17 * p.push_along;
  const a19 = p.wind_speed === 0;
  const a20 = a5 + a8 * p.push_along + (a11 ? 0 : p.light_linear_drag * p.push_along) + (a19 ? 0 : a18);
  const a21 = p.side_force === 0;
  const a22 = a21 ? 0 : p.side_force * a6;
  const a23 = a21 ? 0 : -p.side_force * a4;
  const a24 = -p.heavy_mass * p.gravity;
  const a25 = -p.heavy_drag;
  const a26 = p.heavy_linear_drag === 0;
  const a27 = -p.heavy_linear_drag;
  const a28 = p.push_across / p.free_length;
  const a29 = p.light_mass * p.push_across * a28;
  const a30 = a29 - (a20 + a22);
  const a31 = Math.exp(p.static_friction * p.release_angle);
  const a32 = -a24;
  const a33 = 1e-12 * a32;
  const a34 = a32 * a31;
  const a35 = a34 - a30 + a33 < 0;
  const a36 = a30 * a31 - a32 + a33 < 0;
  const a37 = p.push_along > 0;
  const a38 = p.kinetic_friction * p.release_angle;
  const a39 = Math.exp(-1 * a38) * p.light_mass;
  const a40 = a39 * p.push_along / (p.heavy_mass + a39);
  const a41 = Math.exp(a38) * p.light_mass;
  const a42 = a41 * p.push_along / (p.heavy_mass + a41);
  const a43 = -a13;
  const a44 = a5 + (a19 ? 0 : -(p.light_linear_drag + p.light_drag * Math.sqrt(a43 * a43 + a16)) * a43);
  const a45 = a29 - (a44 + a22);
  const a46 = a34 - a45 + a33 < 0;
  const a47 = a45 * a31 - a32 + a33 < 0;
  const a48 = a42 < 0;
  const a49 = a40 > 0;
  const a50 = a49 ? a40 : (a48 ? a42 : 0);
  const a51 = a37 ? a50 : p.push_along;
  const a52 = a37 ? a50 : 0;
  const a53 = a37 ? (a49 ? false : (a48 ? true : a47)) : a36;
  const a54 = a37 ? (a49 ? true : (a48 ? false : (a47 ? false : a46))) : (a36 ? false : a35);
  const a55 = a53 || a54;
  const a56 = a55 ? (a54 ? 1 : -1) : -1;
  const a57 = a11 ? 0 : p.light_linear_drag * a51;
  const a58 = -a51 - a13;
  const a59 = -(p.light_linear_drag + p.light_drag * Math.sqrt(a58 * a58 + a16)) * a58;
  const a60 = p.light_drag * Math.sqrt(a51 * a51 + a2);
  const a61 = a29 - (a5 + a60 * a51 + a57 + (a19 ? 0 : a59 - (p.light_linear_drag + a60) * a51) + a22);
  const a62 = Math.exp(-a56 * a38);
  const a63 = (a62 * a61 + (a24 + a25 * (a56 * a52) * a52 + (a26 ? 0 : a27 * a52))) / (p.heavy_mass + p.light_mass * a62);
  const a64 = a61 - p.light_mass * a63;
  const a65 = a53 ? a64 : (a54 ? a64 : a29 - (a5 + a8 * a51 + a57 + (a19 ? 0 : a59 - a17 * a51) + a22));
  const a66 = a65 >= (p.push_across >= 0 ? -1e-14 * a3 : 0);
  const a67 = p.push_along < 0;
  const a68 = a66 ? (a37 ? (a49 ? 2 : (a48 ? 1 : (a47 ? 1 : (a46 ? 2 : 0)))) : (a36 ? 1 : (a35 ? 2 : 0))) : 3;
  const a69 = a67 ? 3 : a68;
  const a70 = a67 ? p.push_along : a51;
  const a71 = a67 ? 0 : a52;
  const a72 = a67 ? -1 : a56;
  const a73 = a67 ? 0 : (a55 ? (Math.abs(a52) <= 1e-300 ? 0 : 1) : 0);
  const a74 = a67 ? false : (a66 ? a53 : false);
  const a75 = a67 ? false : (a66 ? a54 : false);
  const a76 = a74 || a75;
  const a77 = a76 ? (a75 ? 1 : -1) : a72;
  const a78 = a67 ? true : (a66 ? false : true);
  const a79 = a49 ? a40 === 0 : (a48 ? a42 === 0 : true);
  const a80 = a78 && (a67 ? true : (a37 ? a79 : true)) ? -1e-300 : a71;
  const a81 = a78 ? (a80 > 0 ? 1 : -1) : -1;
  const a82 = p.push_across === 0;
  const a83 = -a70 - a13;
  const a84 = -(p.light_linear_drag + p.light_drag * Math.sqrt(a83 * a83 + a16));
  const a85 = a84 * a15;
  const a86 = a26 ? 0 : a27 * a80;
  const a87 = (a7 + a9 * a1 * p.push_across + a10 + a12 + (a19 ? 0 : a85 + a17 * p.push_across) + a23) / p.light_mass;
  const a88 = a70 * a28;
  const a89 = Math.sqrt(a70 * a70 + a2);
  const a90 = p.light_drag * a89;
  const a91 = p.light_linear_drag + a90;
  const a92 = a5 + a90 * a70 + (a11 ? 0 : p.light_linear_drag * a70) + (a19 ? 0 : a84 * a83 - a91 * a70);
  const a93 = a29 - (a92 + a22);
  const a94 = (a7 + a9 * a89 * p.push_across + a10 + a12 + (a19 ? 0 : a85 + a91 * p.push_across) + a23) / p.light_mass;
  const a95 = a94 - a88;
  const a96 = Math.exp(-a77 * a38);
  const a97 = (a96 * a93 + (a24 + a25 * (a77 * a80) * a80 + a86)) / (p.heavy_mass + p.light_mass * a96);
  const a98 = a74 ? a97 : (a75 ? a97 : (a78 ? a93 / p.light_mass : 0));
  const a99 = a74 ? a95 : (a75 ? a95 : (a78 ? a95 : a87 - a88));
  const a100 = a74 ? a97 : (a75 ? a97 : (a78 ? (a24 + a25 * (a81 * a80) * a80 + a86) / p.heavy_mass : 0));
  const a101 = a82 ? (a99 >= 0 ? 1 : -1) : a0;
  const a102 = p.push_along === 0;
  const a103 = a82 && (a67 ? a102 : (a37 ? a79 : a102)) && (a76 || a78);
  const a104 = a99 / p.free_length;
  const a105 = 1e-06 * (a70 - p.rod_radius * a28);
  const a106 = 1e-06 * a28;
  const a107 = 1e-06 * a98;
  const a108 = 1e-06 * a99;
  const a109 = 1e-06 * a100;
  const a110 = 1e-06 * (a80 - a70);
  const a111 = 5e-13 * (a98 - p.rod_radius * a104);
  const a112 = 5e-13 * a104;
  const a113 = 5e-13 * (a100 - a98);
  return {
    released: { mode: a69, t: 0, y: [p.free_length, p.release_angle, a70, p.push_across, a71, 0], signs: { slide: a72, across: a0, heavy: -1, phase: a73 } },
    after: { mode: a69, t: a103 ? 1e-06 : 0, y: [a103 ? p.free_length + a105 + a111 : p.free_length, a103 ? p.release_angle + a106 + a112 : p.release_angle, a103 ? a70 + a107 : a70, a103 ? p.push_across + a108 : (a82 ? p.push_across + 1e-300 * a101 : p.push_across), a103 ? a80 + a109 : a80, a103 ? a110 + a113 : 0], signs: { slide: a77, across: a101, heavy: a81, phase: a78 ? 0 : (a76 ? (Math.abs(a71) <= 1e-300 ? 0 : 1) : a73) } },
    bySeries: a103,
    series: [[p.free_length, p.release_angle, a70, p.push_across, a80, 0], [a105, a106, a107, a108, a109, a110], [a111, a112, 0, 0, 0, a113]],
  };
};
RELEASES.vertical = RELEASES.looping;
RELEASES.held = (p) => {
  const a0 = p.push_across < 0 ? -1 : 1;
  const a1 = p.push_along < 0;
  const a2 = a1 ? p.push_along : 0;
  const a3 = p.light_mass * p.gravity;
  const a4 = a0 * p.push_across;
  const a5 = Math.cos(p.release_angle);
  const a6 = a3 * a5;
  const a7 = Math.sin(p.release_angle);
  const a8 = a3 * a7;
  const a9 = p.light_drag * a4;
  const a10 = -p.light_drag;
  const a11 = -p.string_drag * p.free_length * a4 * p.push_across;
  const a12 = p.light_linear_drag === 0;
  const a13 = a12 ? 0 : -p.light_linear_drag * p.push_across;
  const a14 = p.wind_speed * a7;
  const a15 = -a2 - a14;
  const a16 = p.push_across - -p.wind_speed * a5;
  const a17 = a16 * a16;
  const a18 = p.light_linear_drag + a9;
  const a19 = p.wind_speed === 0;
  const a20 = a19 ? 0 : -(p.light_linear_drag + p.light_drag * Math.sqrt(a15 * a15 + a17)) * a15 - a18 * a2;
  const a21 = p.side_force === 0;
  const a22 = a21 ? 0 : p.side_force * a7;
  const a23 = a21 ? 0 : -p.side_force * a5;
  const a24 = p.push_across / p.free_length;
  const a25 = p.light_mass * p.push_across * a24;
  const a26 = a25 - (a6 + a9 * a2 + (a12 ? 0 : p.light_linear_drag * a2) + a20 + a22) >= (p.push_across >= 0 ? -1e-14 * a3 : 0);
  const a27 = a1 ? 5 : (a26 ? 4 : 5);
  const a28 = a1 ? p.push_along : a2;
  const a29 = a1 ? true : (a26 ? false : true);
  const a30 = p.push_across === 0;
  const a31 = -a28;
  const a32 = a31 - a14;
  const a33 = -(p.light_linear_drag + p.light_drag * Math.sqrt(a32 * a32 + a17));
  const a34 = a33 * a16;
  const a35 = (a8 + a10 * a4 * p.push_across + a11 + a13 + (a19 ? 0 : a34 + a18 * p.push_across) + a23) / p.light_mass;
  const a36 = a28 * a24;
  const a37 = Math.sqrt(a28 * a28 + p.push_across * p.push_across);
  const a38 = p.light_drag * a37;
  const a39 = p.light_linear_drag + a38;
  const a40 = a6 + a38 * a28 + (a12 ? 0 : p.light_linear_drag * a28) + (a19 ? 0 : a33 * a32 - a39 * a28);
  const a41 = (a8 + a10 * a37 * p.push_across + a11 + a13 + (a19 ? 0 : a34 + a39 * p.push_across) + a23) / p.light_mass;
  const a42 = a29 ? (a25 - (a40 + a22)) / p.light_mass : 0;
  const a43 = a29 ? a41 - a36 : a35 - a36;
  const a44 = a30 ? (a43 >= 0 ? 1 : -1) : a0;
  const a45 = p.push_along === 0;
  const a46 = a30 && (a1 ? a45 : (a1 ? a45 : true)) && a29;
  const a47 = a43 / p.free_length;
  const a48 = 1e-06 * (a28 - p.rod_radius * a24);
  const a49 = 1e-06 * a24;
  const a50 = 1e-06 * a42;
  const a51 = 1e-06 * a43;
  const a52 = 1e-06 * a31;
  const a53 = 5e-13 * (a42 - p.rod_radius * a47);
  const a54 = 5e-13 * a47;
  const a55 = 5e-13 * -a42;
  return {
    released: { mode: a27, t: 0, y: [p.free_length, p.release_angle, a28, p.push_across, 0, 0], signs: { slide: -1, across: a0, heavy: -1, phase: 0 } },
    after: { mode: a27, t: a46 ? 1e-06 : 0, y: [a46 ? p.free_length + a48 + a53 : p.free_length, a46 ? p.release_angle + a49 + a54 : p.release_angle, a46 ? a28 + a50 : a28, a46 ? p.push_across + a51 : (a30 ? p.push_across + 1e-300 * a44 : p.push_across), 0, a46 ? a52 + a55 : 0], signs: { slide: -1, across: a44, heavy: -1, phase: 0 } },
    bySeries: a46,
    series: [[p.free_length, p.release_angle, a28, p.push_across, 0, 0], [a48, a49, a50, a51, 0, a52], [a53, a54, 0, 0, 0, a55]],
  };
};
RELEASES.drop = (p) => {
  const a0 = p.push_across < 0 ? -1 : 1;
  const a1 = p.push_across === 0;
  const a2 = Math.sqrt(p.push_along * p.push_along + p.push_across * p.push_across);
  const a3 = p.light_mass * p.gravity;
  const a4 = Math.cos(p.release_angle);
  const a5 = Math.sin(p.release_angle);
  const a6 = p.light_drag * a2;
  const a7 = p.light_linear_drag === 0;
  const a8 = a3 * a5 + -p.light_drag * a2 * p.push_across + (a7 ? 0 : -p.light_linear_drag * p.push_across);
  const a9 = -p.push_along;
  const a10 = a9 - p.wind_speed * a5;
  const a11 = p.push_across - -p.wind_speed * a4;
  const a12 = p.light_linear_drag + a6;
  const a13 = -(p.light_linear_drag + p.light_drag * Math.sqrt(a10 * a10 + a11 * a11));
  const a14 = p.wind_speed === 0;
  const a15 = a3 * a4 + a6 * p.push_along + (a7 ? 0 : p.light_linear_drag * p.push_along) + (a14 ? 0 : a13 * a10 - a12 * p.push_along);
  const a16 = p.side_force === 0;
  const a17 = p.push_across / p.free_length;
  const a18 = -p.heavy_mass * p.gravity / p.heavy_mass;
  const a19 = (p.light_mass * p.push_across * a17 - (a15 + (a16 ? 0 : p.side_force * a5))) / p.light_mass;
  const a20 = (a8 + (a14 ? 0 : a13 * a11 + a12 * p.push_across) + (a16 ? 0 : -p.side_force * a4)) / p.light_mass;
  const a21 = a20 - p.push_along * a17;
  const a22 = a1 ? (a21 >= 0 ? 1 : -1) : a0;
  const a23 = a1 && p.push_along === 0;
  const a24 = a21 / p.free_length;
  const a25 = 1e-06 * (p.push_along - p.rod_radius * a17);
  const a26 = 1e-06 * a17;
  const a27 = 1e-06 * a19;
  const a28 = 1e-06 * a21;
  const a29 = 1e-06 * a18;
  const a30 = 1e-06 * a9;
  const a31 = 5e-13 * (a19 - p.rod_radius * a24);
  const a32 = 5e-13 * a24;
  const a33 = 5e-13 * (a18 - a19);
  return {
    released: { mode: 6, t: 0, y: [p.free_length, p.release_angle, p.push_along, p.push_across, 0, 0], signs: { slide: -1, across: a0, heavy: -1, phase: 0 } },
    after: { mode: 6, t: a23 ? 1e-06 : 0, y: [a23 ? p.free_length + a25 + a31 : p.free_length, a23 ? p.release_angle + a26 + a32 : p.release_angle, a23 ? p.push_along + a27 : p.push_along, a23 ? p.push_across + a28 : (a1 ? p.push_across + 1e-300 * a22 : p.push_across), a23 ? a29 : 0, a23 ? a30 + a33 : 0], signs: { slide: -1, across: a22, heavy: -1, phase: 0 } },
    bySeries: a23,
    series: [[p.free_length, p.release_angle, p.push_along, p.push_across, 0, 0], [a25, a26, a27, a28, a29, a30], [a31, a32, 0, 0, 0, a33]],
  };
};
/** Number of a mode -> its equations.
 * @type {Record<number, ModeEquations>} */
export const MODES = {
  0: {  // sticking
    integrated: [0, 1, 3],
    events: [["light_reaches_rod", "light_reaches_rod"], ["across_reverses", "across_reverses"], ["unwrapped", "unwrapped"], ["slip_onset_down", "slip_onset_down"], ["slip_onset_up", "slip_onset_up"]],
    rates(p, t, z, s, out) {
      const free_length = z[0];
      const wrap_angle = z[1];
      const across_speed = z[2];
      const a0 = s.across * across_speed;
      const a1 = Math.cos(wrap_angle);
      const a2 = Math.sin(wrap_angle);
      const a3 = p.light_mass * p.gravity * a2 + -p.light_drag * a0 * across_speed + -p.string_drag * free_length * a0 * across_speed;
      const a4 = -(p.wind_speed * a2);
      const a5 = across_speed - -p.wind_speed * a1;
      const a6 = -(p.light_linear_drag + p.light_drag * Math.sqrt(a4 * a4 + a5 * a5)) * a5 + (p.light_linear_drag + p.light_drag * a0) * across_speed;
      const a7 = a3 + (p.light_linear_drag === 0 ? 0 : -p.light_linear_drag * across_speed) + (p.wind_speed === 0 ? 0 : a6);
      const a8 = across_speed / free_length;
      out[0] = -(p.rod_radius * a8);
      out[1] = a8;
      out[2] = (a7 + (p.side_force === 0 ? 0 : -p.side_force * a1)) / p.light_mass;
    },
    eventValues(p, t, z, s, out) {
      const free_length = z[0];
      const wrap_angle = z[1];
      const across_speed = z[2];
      const a0 = Math.cos(wrap_angle);
      const a1 = Math.sin(wrap_angle);
      const a2 = -(p.wind_speed * a1);
      const a3 = across_speed - -p.wind_speed * a0;
      const a4 = p.wind_speed === 0 ? 0 : -(p.light_linear_drag + p.light_drag * Math.sqrt(a2 * a2 + a3 * a3)) * a2;
      const a5 = p.light_mass * across_speed * (across_speed / free_length) - (p.light_mass * p.gravity * a0 + a4 + (p.side_force === 0 ? 0 : p.side_force * a1));
      const a6 = Math.exp(p.static_friction * wrap_angle);
      const a7 = -(-p.heavy_mass * p.gravity);
      const a8 = 1e-12 * a7;
      out[0] = free_length - p.end_length;
      out[1] = s.across * across_speed;
      out[2] = wrap_angle;
      out[3] = a5 * a6 - a7 + a8;
      out[4] = a7 * a6 - a5 + a8;
    },
    fullState(z) {
      const free_length = z[0];
      const wrap_angle = z[1];
      const across_speed = z[2];
      return [free_length, wrap_angle, 0, across_speed, 0, 0];
    },
    quantities(p, t, y, s) {
      const free_length = y[0];
      const wrap_angle = y[1];
      const retreat_speed = y[2];
      const across_speed = y[3];
      const heavy_speed = y[4];
      const slack = y[5];
      const a0 = s.across * across_speed;
      const a1 = Math.cos(wrap_angle);
      const a2 = Math.sin(wrap_angle);
      const a3 = p.light_drag * a0;
      const a4 = a3 * retreat_speed;
      const a5 = p.light_linear_drag === 0;
      const a6 = a5 ? 0 : p.light_linear_drag * retreat_speed;
      const a7 = -retreat_speed;
      const a8 = a7 - p.wind_speed * a2;
      const a9 = across_speed - -p.wind_speed * a1;
      const a10 = p.light_linear_drag + a3;
      const a11 = -(p.light_linear_drag + p.light_drag * Math.sqrt(a8 * a8 + a9 * a9));
      const a12 = p.wind_speed === 0;
      const a13 = a12 ? 0 : a11 * a8 - a10 * retreat_speed;
      const a14 = p.light_mass * p.gravity * a1 + a4 + a6 + a13 + (p.side_force === 0 ? 0 : p.side_force * a2);
      const a15 = -p.heavy_mass * p.gravity + (p.heavy_linear_drag === 0 ? 0 : -p.heavy_linear_drag * heavy_speed);
      const a16 = p.light_mass * across_speed * (across_speed / free_length) - a14;
      const a17 = -a15;
      const a18 = p.rod_radius * a2 + free_length * a1;
      const a19 = p.free_length + p.rod_radius * p.release_angle - (free_length + p.rod_radius * wrap_angle + slack);
      const a20 = -p.hanging_length - a19;
      const a21 = a7 * a2 - across_speed * a1;
      const a22 = -a7 * a1 - across_speed * a2;
      const a23 = 0.5 * p.light_mass * (a21 * a21 + a22 * a22) + 0.5 * p.heavy_mass * (heavy_speed * heavy_speed);
      const a24 = -p.light_drag * a0 * across_speed + -p.string_drag * free_length * a0 * across_speed + (a5 ? 0 : -p.light_linear_drag * across_speed);
      const a25 = a4 + a6 + a13;
      const a26 = a24 + (a12 ? 0 : a11 * a9 + a10 * across_speed);
      return {
        light: [p.rod_radius * a1 - free_length * a2, a18],
        heavy: [p.rod_radius, a20],
        lightVelocity: [a21, a22],
        heavyVelocity: [0, heavy_speed],
        wrapAngle: wrap_angle,
        freeLength: free_length,
        slack: slack,
        lightTension: a16,
        heavyTension: a17,
        kineticEnergy: a23,
        potentialEnergy: p.gravity * (p.light_mass * a18 + p.heavy_mass * a20),
        dragForce: [a25 * a2 - a26 * a1, -a25 * a1 - a26 * a2],
        holding: { needed: Math.abs(Math.log(a17 / a16)), bound: p.static_friction * wrap_angle },
      };
    },
    apply: {
      time_up(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const across_speed = y[3];
        const heavy_speed = y[4];
        const slack = y[5];
        return { mode: 7, t: t, y: [free_length, wrap_angle, retreat_speed, across_speed, heavy_speed, slack], signs: { slide: s.slide, across: s.across, heavy: s.heavy, phase: s.phase } };
      },
      light_reaches_rod(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const across_speed = y[3];
        const heavy_speed = y[4];
        const slack = y[5];
        return { mode: 7, t: t, y: [free_length, wrap_angle, retreat_speed, across_speed, heavy_speed, slack], signs: { slide: s.slide, across: s.across, heavy: s.heavy, phase: s.phase } };
      },
      across_reverses(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const heavy_speed = y[4];
        const slack = y[5];
        const a0 = -1 * s.across;
        return { mode: 0, t: t, y: [free_length, wrap_angle, retreat_speed, 1e-300 * a0, heavy_speed, slack], signs: { slide: s.slide, across: a0, heavy: s.heavy, phase: s.phase } };
      },
      unwrapped(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const across_speed = y[3];
        const heavy_speed = y[4];
        const slack = y[5];
        return { mode: 7, t: t, y: [free_length, wrap_angle, retreat_speed, across_speed, heavy_speed, slack], signs: { slide: s.slide, across: s.across, heavy: s.heavy, phase: s.phase } };
      },
      slip_onset_down(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const across_speed = y[3];
        const heavy_speed = y[4];
        const slack = y[5];
        return { mode: 1, t: t, y: [free_length, wrap_angle, retreat_speed, across_speed, heavy_speed, slack], signs: { slide: -1, across: s.across, heavy: s.heavy, phase: Math.abs(heavy_speed) <= 1e-300 ? 0 : 1 } };
      },
      slip_onset_up(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const across_speed = y[3];
        const heavy_speed = y[4];
        const slack = y[5];
        return { mode: 2, t: t, y: [free_length, wrap_angle, retreat_speed, across_speed, heavy_speed, slack], signs: { slide: 1, across: s.across, heavy: s.heavy, phase: Math.abs(heavy_speed) <= 1e-300 ? 0 : 1 } };
      },
    },
},
  1: {  // sliding_down
    integrated: [0, 1, 2, 3],
    events: [["light_reaches_rod", "light_reaches_rod"], ["across_reverses", "across_reverses"], ["unwrapped", "unwrapped"], ["heavy_reaches_rod", "heavy_reaches_rod"], ["slows", "stop"], ["slack", "slack"]],
    rates(p, t, z, s, out) {
      const free_length = z[0];
      const wrap_angle = z[1];
      const retreat_speed = z[2];
      const across_speed = z[3];
      const a0 = Math.sqrt(retreat_speed * retreat_speed + across_speed * across_speed);
      const a1 = p.light_mass * p.gravity;
      const a2 = Math.cos(wrap_angle);
      const a3 = Math.sin(wrap_angle);
      const a4 = p.light_drag * a0;
      const a5 = a1 * a3 + -p.light_drag * a0 * across_speed + -p.string_drag * free_length * (s.across * across_speed) * across_speed;
      const a6 = p.light_linear_drag === 0;
      const a7 = -retreat_speed - p.wind_speed * a3;
      const a8 = across_speed - -p.wind_speed * a2;
      const a9 = p.light_linear_drag + a4;
      const a10 = -(p.light_linear_drag + p.light_drag * Math.sqrt(a7 * a7 + a8 * a8));
      const a11 = p.wind_speed === 0;
      const a12 = a1 * a2 + a4 * retreat_speed + (a6 ? 0 : p.light_linear_drag * retreat_speed) + (a11 ? 0 : a10 * a7 - a9 * retreat_speed);
      const a13 = a5 + (a6 ? 0 : -p.light_linear_drag * across_speed) + (a11 ? 0 : a10 * a8 + a9 * across_speed);
      const a14 = p.side_force === 0;
      const a15 = -p.heavy_mass * p.gravity + -p.heavy_drag * (s.slide * retreat_speed) * retreat_speed + (p.heavy_linear_drag === 0 ? 0 : -p.heavy_linear_drag * retreat_speed);
      const a16 = across_speed / free_length;
      const a17 = Math.exp(-s.slide * (p.kinetic_friction * wrap_angle));
      const a18 = (a17 * (p.light_mass * across_speed * a16 - (a12 + (a14 ? 0 : p.side_force * a3))) + a15) / (p.heavy_mass + p.light_mass * a17);
      out[0] = retreat_speed - p.rod_radius * a16;
      out[1] = a16;
      out[2] = a18;
      out[3] = (a13 + (a14 ? 0 : -p.side_force * a2)) / p.light_mass - retreat_speed * a16;
    },
    eventValues(p, t, z, s, out) {
      const free_length = z[0];
      const wrap_angle = z[1];
      const retreat_speed = z[2];
      const across_speed = z[3];
      const a0 = s.slide * retreat_speed;
      const a1 = Math.cos(wrap_angle);
      const a2 = Math.sin(wrap_angle);
      const a3 = p.light_drag * Math.sqrt(retreat_speed * retreat_speed + across_speed * across_speed);
      const a4 = p.light_mass * p.gravity * a1 + a3 * retreat_speed + (p.light_linear_drag === 0 ? 0 : p.light_linear_drag * retreat_speed);
      const a5 = -retreat_speed - p.wind_speed * a2;
      const a6 = across_speed - -p.wind_speed * a1;
      const a7 = -(p.light_linear_drag + p.light_drag * Math.sqrt(a5 * a5 + a6 * a6)) * a5 - (p.light_linear_drag + a3) * retreat_speed;
      const a8 = -p.heavy_mass * p.gravity + -p.heavy_drag * a0 * retreat_speed + (p.heavy_linear_drag === 0 ? 0 : -p.heavy_linear_drag * retreat_speed);
      const a9 = p.light_mass * across_speed * (across_speed / free_length) - (a4 + (p.wind_speed === 0 ? 0 : a7) + (p.side_force === 0 ? 0 : p.side_force * a2));
      const a10 = (1 - s.phase) * (s.slide * (Math.exp(-s.slide * (p.kinetic_friction * wrap_angle)) * a9 + a8) + 1e-18);
      out[0] = free_length - p.end_length;
      out[1] = s.across * across_speed;
      out[2] = wrap_angle;
      out[3] = p.string_length - (free_length + p.rod_radius * wrap_angle);
      out[4] = s.phase * a0 + a10;
      out[5] = p.heavy_mass * a9 - p.light_mass * a8;
    },
    fullState(z) {
      const free_length = z[0];
      const wrap_angle = z[1];
      const retreat_speed = z[2];
      const across_speed = z[3];
      return [free_length, wrap_angle, retreat_speed, across_speed, retreat_speed, 0];
    },
    quantities(p, t, y, s) {
      const free_length = y[0];
      const wrap_angle = y[1];
      const retreat_speed = y[2];
      const across_speed = y[3];
      const heavy_speed = y[4];
      const slack = y[5];
      const a0 = Math.sqrt(retreat_speed * retreat_speed + across_speed * across_speed);
      const a1 = Math.cos(wrap_angle);
      const a2 = Math.sin(wrap_angle);
      const a3 = p.light_drag * a0;
      const a4 = a3 * retreat_speed;
      const a5 = p.light_linear_drag === 0;
      const a6 = a5 ? 0 : p.light_linear_drag * retreat_speed;
      const a7 = -retreat_speed;
      const a8 = a7 - p.wind_speed * a2;
      const a9 = across_speed - -p.wind_speed * a1;
      const a10 = p.light_linear_drag + a3;
      const a11 = -(p.light_linear_drag + p.light_drag * Math.sqrt(a8 * a8 + a9 * a9));
      const a12 = p.wind_speed === 0;
      const a13 = a12 ? 0 : a11 * a8 - a10 * retreat_speed;
      const a14 = p.light_mass * p.gravity * a1 + a4 + a6 + a13 + (p.side_force === 0 ? 0 : p.side_force * a2);
      const a15 = -p.heavy_mass * p.gravity + -p.heavy_drag * (s.slide * heavy_speed) * heavy_speed + (p.heavy_linear_drag === 0 ? 0 : -p.heavy_linear_drag * heavy_speed);
      const a16 = p.light_mass * across_speed * (across_speed / free_length) - a14;
      const a17 = Math.exp(-s.slide * (p.kinetic_friction * wrap_angle));
      const a18 = (a17 * a16 + a15) / (p.heavy_mass + p.light_mass * a17);
      const a19 = a16 - p.light_mass * a18;
      const a20 = p.heavy_mass * a18 - a15;
      const a21 = p.rod_radius * a2 + free_length * a1;
      const a22 = p.free_length + p.rod_radius * p.release_angle - (free_length + p.rod_radius * wrap_angle + slack);
      const a23 = -p.hanging_length - a22;
      const a24 = a7 * a2 - across_speed * a1;
      const a25 = -a7 * a1 - across_speed * a2;
      const a26 = 0.5 * p.light_mass * (a24 * a24 + a25 * a25) + 0.5 * p.heavy_mass * (heavy_speed * heavy_speed);
      const a27 = -p.light_drag * a0 * across_speed + -p.string_drag * free_length * (s.across * across_speed) * across_speed;
      const a28 = a4 + a6 + a13;
      const a29 = a27 + (a5 ? 0 : -p.light_linear_drag * across_speed) + (a12 ? 0 : a11 * a9 + a10 * across_speed);
      return {
        light: [p.rod_radius * a1 - free_length * a2, a21],
        heavy: [p.rod_radius, a23],
        lightVelocity: [a24, a25],
        heavyVelocity: [0, heavy_speed],
        wrapAngle: wrap_angle,
        freeLength: free_length,
        slack: slack,
        lightTension: a19,
        heavyTension: a20,
        kineticEnergy: a26,
        potentialEnergy: p.gravity * (p.light_mass * a21 + p.heavy_mass * a23),
        dragForce: [a28 * a2 - a29 * a1, -a28 * a1 - a29 * a2],
        holding: { needed: Math.abs(Math.log(a20 / a19)), bound: p.static_friction * wrap_angle },
      };
    },
    apply: {
      time_up(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const across_speed = y[3];
        const heavy_speed = y[4];
        const slack = y[5];
        return { mode: 7, t: t, y: [free_length, wrap_angle, retreat_speed, across_speed, heavy_speed, slack], signs: { slide: s.slide, across: s.across, heavy: s.heavy, phase: s.phase } };
      },
      light_reaches_rod(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const across_speed = y[3];
        const heavy_speed = y[4];
        const slack = y[5];
        return { mode: 7, t: t, y: [free_length, wrap_angle, retreat_speed, across_speed, heavy_speed, slack], signs: { slide: s.slide, across: s.across, heavy: s.heavy, phase: s.phase } };
      },
      across_reverses(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const heavy_speed = y[4];
        const slack = y[5];
        const a0 = -1 * s.across;
        return { mode: 1, t: t, y: [free_length, wrap_angle, retreat_speed, 1e-300 * a0, heavy_speed, slack], signs: { slide: s.slide, across: a0, heavy: s.heavy, phase: s.phase } };
      },
      unwrapped(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const across_speed = y[3];
        const heavy_speed = y[4];
        const slack = y[5];
        return { mode: 7, t: t, y: [free_length, wrap_angle, retreat_speed, across_speed, heavy_speed, slack], signs: { slide: s.slide, across: s.across, heavy: s.heavy, phase: s.phase } };
      },
      heavy_reaches_rod(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const across_speed = y[3];
        const heavy_speed = y[4];
        const slack = y[5];
        return { mode: 7, t: t, y: [free_length, wrap_angle, retreat_speed, across_speed, heavy_speed, slack], signs: { slide: s.slide, across: s.across, heavy: s.heavy, phase: s.phase } };
      },
      slows(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const across_speed = y[3];
        const heavy_speed = y[4];
        const slack = y[5];
        return { mode: 1, t: t, y: [free_length, wrap_angle, retreat_speed, across_speed, heavy_speed, slack], signs: { slide: s.slide, across: s.across, heavy: s.heavy, phase: 1 } };
      },
      stop(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const across_speed = y[3];
        const slack = y[5];
        const a0 = Math.cos(wrap_angle);
        const a1 = Math.sin(wrap_angle);
        const a2 = -(p.wind_speed * a1);
        const a3 = across_speed - -p.wind_speed * a0;
        const a4 = p.wind_speed === 0 ? 0 : -(p.light_linear_drag + p.light_drag * Math.sqrt(a2 * a2 + a3 * a3)) * a2;
        const a5 = p.light_mass * across_speed * (across_speed / free_length) - (p.light_mass * p.gravity * a0 + a4 + (p.side_force === 0 ? 0 : p.side_force * a1));
        const a6 = Math.exp(p.static_friction * wrap_angle);
        const a7 = -(-p.heavy_mass * p.gravity);
        const a8 = 1e-12 * a7;
        const a9 = a7 * a6 - a5 + a8 < 0;
        const a10 = a5 * a6 - a7 + a8 < 0;
        const a11 = a10 ? false : a9;
        const a12 = a10 || a11;
        return { mode: a10 ? 1 : (a9 ? 2 : 0), t: t, y: [free_length, wrap_angle, 0, across_speed, 0, slack], signs: { slide: a12 ? (a11 ? 1 : -1) : s.slide, across: s.across, heavy: s.heavy, phase: a12 ? 0 : s.phase } };
      },
      slack(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const across_speed = y[3];
        const heavy_speed = y[4];
        const a0 = heavy_speed === 0 ? -1e-300 : heavy_speed;
        return { mode: 3, t: t, y: [free_length, wrap_angle, retreat_speed, across_speed, a0, 0], signs: { slide: s.slide, across: s.across, heavy: a0 > 0 ? 1 : -1, phase: 0 } };
      },
    },
},
  2: {  // sliding_up
    integrated: [0, 1, 2, 3],
    events: [["light_reaches_rod", "light_reaches_rod"], ["across_reverses", "across_reverses"], ["unwrapped", "unwrapped"], ["heavy_reaches_rod", "heavy_reaches_rod"], ["slows", "stop"], ["slack", "slack"]],
    rates(p, t, z, s, out) {
      const free_length = z[0];
      const wrap_angle = z[1];
      const retreat_speed = z[2];
      const across_speed = z[3];
      const a0 = Math.sqrt(retreat_speed * retreat_speed + across_speed * across_speed);
      const a1 = p.light_mass * p.gravity;
      const a2 = Math.cos(wrap_angle);
      const a3 = Math.sin(wrap_angle);
      const a4 = p.light_drag * a0;
      const a5 = a1 * a3 + -p.light_drag * a0 * across_speed + -p.string_drag * free_length * (s.across * across_speed) * across_speed;
      const a6 = p.light_linear_drag === 0;
      const a7 = -retreat_speed - p.wind_speed * a3;
      const a8 = across_speed - -p.wind_speed * a2;
      const a9 = p.light_linear_drag + a4;
      const a10 = -(p.light_linear_drag + p.light_drag * Math.sqrt(a7 * a7 + a8 * a8));
      const a11 = p.wind_speed === 0;
      const a12 = a1 * a2 + a4 * retreat_speed + (a6 ? 0 : p.light_linear_drag * retreat_speed) + (a11 ? 0 : a10 * a7 - a9 * retreat_speed);
      const a13 = a5 + (a6 ? 0 : -p.light_linear_drag * across_speed) + (a11 ? 0 : a10 * a8 + a9 * across_speed);
      const a14 = p.side_force === 0;
      const a15 = -p.heavy_mass * p.gravity + -p.heavy_drag * (s.slide * retreat_speed) * retreat_speed + (p.heavy_linear_drag === 0 ? 0 : -p.heavy_linear_drag * retreat_speed);
      const a16 = across_speed / free_length;
      const a17 = Math.exp(-s.slide * (p.kinetic_friction * wrap_angle));
      const a18 = (a17 * (p.light_mass * across_speed * a16 - (a12 + (a14 ? 0 : p.side_force * a3))) + a15) / (p.heavy_mass + p.light_mass * a17);
      out[0] = retreat_speed - p.rod_radius * a16;
      out[1] = a16;
      out[2] = a18;
      out[3] = (a13 + (a14 ? 0 : -p.side_force * a2)) / p.light_mass - retreat_speed * a16;
    },
    eventValues(p, t, z, s, out) {
      const free_length = z[0];
      const wrap_angle = z[1];
      const retreat_speed = z[2];
      const across_speed = z[3];
      const a0 = s.slide * retreat_speed;
      const a1 = Math.cos(wrap_angle);
      const a2 = Math.sin(wrap_angle);
      const a3 = p.light_drag * Math.sqrt(retreat_speed * retreat_speed + across_speed * across_speed);
      const a4 = p.light_mass * p.gravity * a1 + a3 * retreat_speed + (p.light_linear_drag === 0 ? 0 : p.light_linear_drag * retreat_speed);
      const a5 = -retreat_speed - p.wind_speed * a2;
      const a6 = across_speed - -p.wind_speed * a1;
      const a7 = -(p.light_linear_drag + p.light_drag * Math.sqrt(a5 * a5 + a6 * a6)) * a5 - (p.light_linear_drag + a3) * retreat_speed;
      const a8 = -p.heavy_mass * p.gravity + -p.heavy_drag * a0 * retreat_speed + (p.heavy_linear_drag === 0 ? 0 : -p.heavy_linear_drag * retreat_speed);
      const a9 = p.light_mass * across_speed * (across_speed / free_length) - (a4 + (p.wind_speed === 0 ? 0 : a7) + (p.side_force === 0 ? 0 : p.side_force * a2));
      const a10 = (1 - s.phase) * (s.slide * (Math.exp(-s.slide * (p.kinetic_friction * wrap_angle)) * a9 + a8) + 1e-18);
      out[0] = free_length - p.end_length;
      out[1] = s.across * across_speed;
      out[2] = wrap_angle;
      out[3] = p.string_length - (free_length + p.rod_radius * wrap_angle);
      out[4] = s.phase * a0 + a10;
      out[5] = p.heavy_mass * a9 - p.light_mass * a8;
    },
    fullState(z) {
      const free_length = z[0];
      const wrap_angle = z[1];
      const retreat_speed = z[2];
      const across_speed = z[3];
      return [free_length, wrap_angle, retreat_speed, across_speed, retreat_speed, 0];
    },
    quantities(p, t, y, s) {
      const free_length = y[0];
      const wrap_angle = y[1];
      const retreat_speed = y[2];
      const across_speed = y[3];
      const heavy_speed = y[4];
      const slack = y[5];
      const a0 = Math.sqrt(retreat_speed * retreat_speed + across_speed * across_speed);
      const a1 = Math.cos(wrap_angle);
      const a2 = Math.sin(wrap_angle);
      const a3 = p.light_drag * a0;
      const a4 = a3 * retreat_speed;
      const a5 = p.light_linear_drag === 0;
      const a6 = a5 ? 0 : p.light_linear_drag * retreat_speed;
      const a7 = -retreat_speed;
      const a8 = a7 - p.wind_speed * a2;
      const a9 = across_speed - -p.wind_speed * a1;
      const a10 = p.light_linear_drag + a3;
      const a11 = -(p.light_linear_drag + p.light_drag * Math.sqrt(a8 * a8 + a9 * a9));
      const a12 = p.wind_speed === 0;
      const a13 = a12 ? 0 : a11 * a8 - a10 * retreat_speed;
      const a14 = p.light_mass * p.gravity * a1 + a4 + a6 + a13 + (p.side_force === 0 ? 0 : p.side_force * a2);
      const a15 = -p.heavy_mass * p.gravity + -p.heavy_drag * (s.slide * heavy_speed) * heavy_speed + (p.heavy_linear_drag === 0 ? 0 : -p.heavy_linear_drag * heavy_speed);
      const a16 = p.light_mass * across_speed * (across_speed / free_length) - a14;
      const a17 = Math.exp(-s.slide * (p.kinetic_friction * wrap_angle));
      const a18 = (a17 * a16 + a15) / (p.heavy_mass + p.light_mass * a17);
      const a19 = a16 - p.light_mass * a18;
      const a20 = p.heavy_mass * a18 - a15;
      const a21 = p.rod_radius * a2 + free_length * a1;
      const a22 = p.free_length + p.rod_radius * p.release_angle - (free_length + p.rod_radius * wrap_angle + slack);
      const a23 = -p.hanging_length - a22;
      const a24 = a7 * a2 - across_speed * a1;
      const a25 = -a7 * a1 - across_speed * a2;
      const a26 = 0.5 * p.light_mass * (a24 * a24 + a25 * a25) + 0.5 * p.heavy_mass * (heavy_speed * heavy_speed);
      const a27 = -p.light_drag * a0 * across_speed + -p.string_drag * free_length * (s.across * across_speed) * across_speed;
      const a28 = a4 + a6 + a13;
      const a29 = a27 + (a5 ? 0 : -p.light_linear_drag * across_speed) + (a12 ? 0 : a11 * a9 + a10 * across_speed);
      return {
        light: [p.rod_radius * a1 - free_length * a2, a21],
        heavy: [p.rod_radius, a23],
        lightVelocity: [a24, a25],
        heavyVelocity: [0, heavy_speed],
        wrapAngle: wrap_angle,
        freeLength: free_length,
        slack: slack,
        lightTension: a19,
        heavyTension: a20,
        kineticEnergy: a26,
        potentialEnergy: p.gravity * (p.light_mass * a21 + p.heavy_mass * a23),
        dragForce: [a28 * a2 - a29 * a1, -a28 * a1 - a29 * a2],
        holding: { needed: Math.abs(Math.log(a20 / a19)), bound: p.static_friction * wrap_angle },
      };
    },
    apply: {
      time_up(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const across_speed = y[3];
        const heavy_speed = y[4];
        const slack = y[5];
        return { mode: 7, t: t, y: [free_length, wrap_angle, retreat_speed, across_speed, heavy_speed, slack], signs: { slide: s.slide, across: s.across, heavy: s.heavy, phase: s.phase } };
      },
      light_reaches_rod(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const across_speed = y[3];
        const heavy_speed = y[4];
        const slack = y[5];
        return { mode: 7, t: t, y: [free_length, wrap_angle, retreat_speed, across_speed, heavy_speed, slack], signs: { slide: s.slide, across: s.across, heavy: s.heavy, phase: s.phase } };
      },
      across_reverses(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const heavy_speed = y[4];
        const slack = y[5];
        const a0 = -1 * s.across;
        return { mode: 2, t: t, y: [free_length, wrap_angle, retreat_speed, 1e-300 * a0, heavy_speed, slack], signs: { slide: s.slide, across: a0, heavy: s.heavy, phase: s.phase } };
      },
      unwrapped(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const across_speed = y[3];
        const heavy_speed = y[4];
        const slack = y[5];
        return { mode: 7, t: t, y: [free_length, wrap_angle, retreat_speed, across_speed, heavy_speed, slack], signs: { slide: s.slide, across: s.across, heavy: s.heavy, phase: s.phase } };
      },
      heavy_reaches_rod(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const across_speed = y[3];
        const heavy_speed = y[4];
        const slack = y[5];
        return { mode: 7, t: t, y: [free_length, wrap_angle, retreat_speed, across_speed, heavy_speed, slack], signs: { slide: s.slide, across: s.across, heavy: s.heavy, phase: s.phase } };
      },
      slows(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const across_speed = y[3];
        const heavy_speed = y[4];
        const slack = y[5];
        return { mode: 2, t: t, y: [free_length, wrap_angle, retreat_speed, across_speed, heavy_speed, slack], signs: { slide: s.slide, across: s.across, heavy: s.heavy, phase: 1 } };
      },
      stop(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const across_speed = y[3];
        const slack = y[5];
        const a0 = Math.cos(wrap_angle);
        const a1 = Math.sin(wrap_angle);
        const a2 = -(p.wind_speed * a1);
        const a3 = across_speed - -p.wind_speed * a0;
        const a4 = p.wind_speed === 0 ? 0 : -(p.light_linear_drag + p.light_drag * Math.sqrt(a2 * a2 + a3 * a3)) * a2;
        const a5 = p.light_mass * across_speed * (across_speed / free_length) - (p.light_mass * p.gravity * a0 + a4 + (p.side_force === 0 ? 0 : p.side_force * a1));
        const a6 = Math.exp(p.static_friction * wrap_angle);
        const a7 = -(-p.heavy_mass * p.gravity);
        const a8 = 1e-12 * a7;
        const a9 = a7 * a6 - a5 + a8 < 0;
        const a10 = a5 * a6 - a7 + a8 < 0;
        const a11 = a10 ? false : a9;
        const a12 = a10 || a11;
        return { mode: a10 ? 1 : (a9 ? 2 : 0), t: t, y: [free_length, wrap_angle, 0, across_speed, 0, slack], signs: { slide: a12 ? (a11 ? 1 : -1) : s.slide, across: s.across, heavy: s.heavy, phase: a12 ? 0 : s.phase } };
      },
      slack(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const across_speed = y[3];
        const heavy_speed = y[4];
        const a0 = heavy_speed === 0 ? -1e-300 : heavy_speed;
        return { mode: 3, t: t, y: [free_length, wrap_angle, retreat_speed, across_speed, a0, 0], signs: { slide: s.slide, across: s.across, heavy: a0 > 0 ? 1 : -1, phase: 0 } };
      },
    },
},
  3: {  // slack
    integrated: [0, 1, 2, 3, 4, 5],
    events: [["light_reaches_rod", "light_reaches_rod"], ["across_reverses", "across_reverses"], ["unwrapped", "unwrapped"], ["heavy_reaches_rod", "heavy_reaches_rod"], ["closes", "taut"], ["heavy_reverses", "heavy_reverses"]],
    rates(p, t, z, s, out) {
      const free_length = z[0];
      const wrap_angle = z[1];
      const retreat_speed = z[2];
      const across_speed = z[3];
      const heavy_speed = z[4];
      const a0 = Math.sqrt(retreat_speed * retreat_speed + across_speed * across_speed);
      const a1 = p.light_mass * p.gravity;
      const a2 = Math.cos(wrap_angle);
      const a3 = Math.sin(wrap_angle);
      const a4 = p.light_drag * a0;
      const a5 = a1 * a3 + -p.light_drag * a0 * across_speed + -p.string_drag * free_length * (s.across * across_speed) * across_speed;
      const a6 = p.light_linear_drag === 0;
      const a7 = -retreat_speed - p.wind_speed * a3;
      const a8 = across_speed - -p.wind_speed * a2;
      const a9 = p.light_linear_drag + a4;
      const a10 = -(p.light_linear_drag + p.light_drag * Math.sqrt(a7 * a7 + a8 * a8));
      const a11 = p.wind_speed === 0;
      const a12 = a1 * a2 + a4 * retreat_speed + (a6 ? 0 : p.light_linear_drag * retreat_speed) + (a11 ? 0 : a10 * a7 - a9 * retreat_speed);
      const a13 = a5 + (a6 ? 0 : -p.light_linear_drag * across_speed) + (a11 ? 0 : a10 * a8 + a9 * across_speed);
      const a14 = p.side_force === 0;
      const a15 = -p.heavy_mass * p.gravity + -p.heavy_drag * (s.heavy * heavy_speed) * heavy_speed + (p.heavy_linear_drag === 0 ? 0 : -p.heavy_linear_drag * heavy_speed);
      const a16 = across_speed / free_length;
      const a17 = (p.light_mass * across_speed * a16 - (a12 + (a14 ? 0 : p.side_force * a3))) / p.light_mass;
      out[0] = retreat_speed - p.rod_radius * a16;
      out[1] = a16;
      out[2] = a17;
      out[3] = (a13 + (a14 ? 0 : -p.side_force * a2)) / p.light_mass - retreat_speed * a16;
      out[4] = a15 / p.heavy_mass;
      out[5] = heavy_speed - retreat_speed;
    },
    eventValues(p, t, z, s, out) {
      const free_length = z[0];
      const wrap_angle = z[1];
      const retreat_speed = z[2];
      const across_speed = z[3];
      const heavy_speed = z[4];
      const slack = z[5];
      out[0] = free_length - p.end_length;
      out[1] = s.across * across_speed;
      out[2] = wrap_angle;
      out[3] = p.string_length - (free_length + p.rod_radius * wrap_angle) - slack;
      out[4] = s.phase * slack + (1 - s.phase) * (heavy_speed - retreat_speed + 1e-18);
      out[5] = s.heavy * heavy_speed;
    },
    fullState(z) {
      const free_length = z[0];
      const wrap_angle = z[1];
      const retreat_speed = z[2];
      const across_speed = z[3];
      const heavy_speed = z[4];
      const slack = z[5];
      return [free_length, wrap_angle, retreat_speed, across_speed, heavy_speed, slack];
    },
    quantities(p, t, y, s) {
      const free_length = y[0];
      const wrap_angle = y[1];
      const retreat_speed = y[2];
      const across_speed = y[3];
      const heavy_speed = y[4];
      const slack = y[5];
      const a0 = Math.sqrt(retreat_speed * retreat_speed + across_speed * across_speed);
      const a1 = Math.cos(wrap_angle);
      const a2 = Math.sin(wrap_angle);
      const a3 = p.light_drag * a0;
      const a4 = p.light_linear_drag === 0;
      const a5 = -retreat_speed;
      const a6 = a5 - p.wind_speed * a2;
      const a7 = across_speed - -p.wind_speed * a1;
      const a8 = p.light_linear_drag + a3;
      const a9 = -(p.light_linear_drag + p.light_drag * Math.sqrt(a6 * a6 + a7 * a7));
      const a10 = p.wind_speed === 0;
      const a11 = p.rod_radius * a2 + free_length * a1;
      const a12 = p.free_length + p.rod_radius * p.release_angle - (free_length + p.rod_radius * wrap_angle + slack);
      const a13 = -p.hanging_length - a12;
      const a14 = a5 * a2 - across_speed * a1;
      const a15 = -a5 * a1 - across_speed * a2;
      const a16 = 0.5 * p.light_mass * (a14 * a14 + a15 * a15) + 0.5 * p.heavy_mass * (heavy_speed * heavy_speed);
      const a17 = -p.light_drag * a0 * across_speed + -p.string_drag * free_length * (s.across * across_speed) * across_speed;
      const a18 = a3 * retreat_speed + (a4 ? 0 : p.light_linear_drag * retreat_speed) + (a10 ? 0 : a9 * a6 - a8 * retreat_speed);
      const a19 = a17 + (a4 ? 0 : -p.light_linear_drag * across_speed) + (a10 ? 0 : a9 * a7 + a8 * across_speed);
      return {
        light: [p.rod_radius * a1 - free_length * a2, a11],
        heavy: [p.rod_radius, a13],
        lightVelocity: [a14, a15],
        heavyVelocity: [0, heavy_speed],
        wrapAngle: wrap_angle,
        freeLength: free_length,
        slack: slack,
        lightTension: 0,
        heavyTension: 0,
        kineticEnergy: a16,
        potentialEnergy: p.gravity * (p.light_mass * a11 + p.heavy_mass * a13),
        dragForce: [a18 * a2 - a19 * a1, -a18 * a1 - a19 * a2],
        holding: null,
      };
    },
    apply: {
      time_up(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const across_speed = y[3];
        const heavy_speed = y[4];
        const slack = y[5];
        return { mode: 7, t: t, y: [free_length, wrap_angle, retreat_speed, across_speed, heavy_speed, slack], signs: { slide: s.slide, across: s.across, heavy: s.heavy, phase: s.phase } };
      },
      light_reaches_rod(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const across_speed = y[3];
        const heavy_speed = y[4];
        const slack = y[5];
        return { mode: 7, t: t, y: [free_length, wrap_angle, retreat_speed, across_speed, heavy_speed, slack], signs: { slide: s.slide, across: s.across, heavy: s.heavy, phase: s.phase } };
      },
      across_reverses(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const heavy_speed = y[4];
        const slack = y[5];
        const a0 = -1 * s.across;
        return { mode: 3, t: t, y: [free_length, wrap_angle, retreat_speed, 1e-300 * a0, heavy_speed, slack], signs: { slide: s.slide, across: a0, heavy: s.heavy, phase: s.phase } };
      },
      unwrapped(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const across_speed = y[3];
        const heavy_speed = y[4];
        const slack = y[5];
        return { mode: 7, t: t, y: [free_length, wrap_angle, retreat_speed, across_speed, heavy_speed, slack], signs: { slide: s.slide, across: s.across, heavy: s.heavy, phase: s.phase } };
      },
      heavy_reaches_rod(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const across_speed = y[3];
        const heavy_speed = y[4];
        const slack = y[5];
        return { mode: 7, t: t, y: [free_length, wrap_angle, retreat_speed, across_speed, heavy_speed, slack], signs: { slide: s.slide, across: s.across, heavy: s.heavy, phase: s.phase } };
      },
      closes(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const across_speed = y[3];
        const heavy_speed = y[4];
        const slack = y[5];
        return { mode: 3, t: t, y: [free_length, wrap_angle, retreat_speed, across_speed, heavy_speed, slack], signs: { slide: s.slide, across: s.across, heavy: s.heavy, phase: 1 } };
      },
      taut(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const across_speed = y[3];
        const heavy_speed = y[4];
        const a0 = Math.cos(wrap_angle);
        const a1 = p.light_mass * p.gravity * a0;
        const a2 = Math.sin(wrap_angle);
        const a3 = p.wind_speed * a2;
        const a4 = across_speed - -p.wind_speed * a0;
        const a5 = a4 * a4;
        const a6 = p.wind_speed === 0;
        const a7 = p.side_force === 0 ? 0 : p.side_force * a2;
        const a8 = -p.heavy_mass * p.gravity;
        const a9 = p.light_mass * across_speed * (across_speed / free_length);
        const a10 = p.kinetic_friction * wrap_angle;
        const a11 = p.heavy_mass * heavy_speed;
        const a12 = Math.exp(-1 * a10) * p.light_mass;
        const a13 = (a11 + a12 * retreat_speed) / (p.heavy_mass + a12);
        const a14 = Math.exp(a10) * p.light_mass;
        const a15 = (a11 + a14 * retreat_speed) / (p.heavy_mass + a14);
        const a16 = p.light_drag * (s.across * across_speed);
        const a17 = -a3;
        const a18 = a1 + (a6 ? 0 : -(p.light_linear_drag + p.light_drag * Math.sqrt(a17 * a17 + a5)) * a17) + a7;
        const a19 = a9 - a18;
        const a20 = Math.exp(p.static_friction * wrap_angle);
        const a21 = -a8;
        const a22 = 1e-12 * a21;
        const a23 = a21 * a20 - a19 + a22 < 0;
        const a24 = a19 * a20 - a21 + a22 < 0;
        const a25 = a15 < 0;
        const a26 = a13 > 0;
        const a27 = a26 ? a13 : (a25 ? a15 : 0);
        const a28 = a26 ? false : (a25 ? true : a24);
        const a29 = a26 ? true : (a25 ? false : (a24 ? false : a23));
        const a30 = a28 || a29;
        const a31 = a30 ? (a29 ? 1 : -1) : s.slide;
        const a32 = p.light_linear_drag === 0 ? 0 : p.light_linear_drag * a27;
        const a33 = -a27 - a3;
        const a34 = -(p.light_linear_drag + p.light_drag * Math.sqrt(a33 * a33 + a5)) * a33;
        const a35 = p.light_drag * Math.sqrt(a27 * a27 + across_speed * across_speed);
        const a36 = a8 + -p.heavy_drag * (a31 * a27) * a27 + (p.heavy_linear_drag === 0 ? 0 : -p.heavy_linear_drag * a27);
        const a37 = a9 - (a1 + a35 * a27 + a32 + (a6 ? 0 : a34 - (p.light_linear_drag + a35) * a27) + a7);
        const a38 = Math.exp(-a31 * a10);
        const a39 = a37 - p.light_mass * ((a38 * a37 + a36) / (p.heavy_mass + p.light_mass * a38));
        const a40 = a29 ? a39 : a9 - (a1 + a16 * a27 + a32 + (a6 ? 0 : a34 - (p.light_linear_drag + a16) * a27) + a7);
        const a41 = (a28 ? a39 : a40) < 0;
        const a42 = (a26 ? a13 === 0 : (a25 ? a15 === 0 : true)) ? -1e-300 : a27;
        return { mode: a41 ? 3 : (a26 ? 2 : (a25 ? 1 : (a24 ? 1 : (a23 ? 2 : 0)))), t: t, y: [free_length, wrap_angle, a27, across_speed, a41 ? a42 : a27, 0], signs: { slide: a31, across: s.across, heavy: a41 ? (a42 > 0 ? 1 : -1) : s.heavy, phase: a41 ? 0 : (a30 ? (Math.abs(a27) <= 1e-300 ? 0 : 1) : s.phase) } };
      },
      heavy_reverses(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const across_speed = y[3];
        const slack = y[5];
        const a0 = -1 * s.heavy;
        return { mode: 3, t: t, y: [free_length, wrap_angle, retreat_speed, across_speed, 1e-300 * a0, slack], signs: { slide: s.slide, across: s.across, heavy: a0, phase: s.phase } };
      },
    },
},
  4: {  // clamped
    integrated: [0, 1, 3],
    events: [["light_reaches_rod", "light_reaches_rod"], ["across_reverses", "across_reverses"], ["unwrapped", "unwrapped"], ["slack", "slack"]],
    rates(p, t, z, s, out) {
      const free_length = z[0];
      const wrap_angle = z[1];
      const across_speed = z[2];
      const a0 = s.across * across_speed;
      const a1 = Math.cos(wrap_angle);
      const a2 = Math.sin(wrap_angle);
      const a3 = p.light_mass * p.gravity * a2 + -p.light_drag * a0 * across_speed + -p.string_drag * free_length * a0 * across_speed;
      const a4 = -(p.wind_speed * a2);
      const a5 = across_speed - -p.wind_speed * a1;
      const a6 = -(p.light_linear_drag + p.light_drag * Math.sqrt(a4 * a4 + a5 * a5)) * a5 + (p.light_linear_drag + p.light_drag * a0) * across_speed;
      const a7 = a3 + (p.light_linear_drag === 0 ? 0 : -p.light_linear_drag * across_speed) + (p.wind_speed === 0 ? 0 : a6);
      const a8 = across_speed / free_length;
      out[0] = -(p.rod_radius * a8);
      out[1] = a8;
      out[2] = (a7 + (p.side_force === 0 ? 0 : -p.side_force * a1)) / p.light_mass;
    },
    eventValues(p, t, z, s, out) {
      const free_length = z[0];
      const wrap_angle = z[1];
      const across_speed = z[2];
      const a0 = Math.cos(wrap_angle);
      const a1 = Math.sin(wrap_angle);
      const a2 = -(p.wind_speed * a1);
      const a3 = across_speed - -p.wind_speed * a0;
      const a4 = p.wind_speed === 0 ? 0 : -(p.light_linear_drag + p.light_drag * Math.sqrt(a2 * a2 + a3 * a3)) * a2;
      const a5 = p.light_mass * across_speed * (across_speed / free_length) - (p.light_mass * p.gravity * a0 + a4 + (p.side_force === 0 ? 0 : p.side_force * a1));
      out[0] = free_length - p.end_length;
      out[1] = s.across * across_speed;
      out[2] = wrap_angle;
      out[3] = a5;
    },
    fullState(z) {
      const free_length = z[0];
      const wrap_angle = z[1];
      const across_speed = z[2];
      return [free_length, wrap_angle, 0, across_speed, 0, 0];
    },
    quantities(p, t, y, s) {
      const free_length = y[0];
      const wrap_angle = y[1];
      const retreat_speed = y[2];
      const across_speed = y[3];
      const heavy_speed = y[4];
      const slack = y[5];
      const a0 = s.across * across_speed;
      const a1 = Math.cos(wrap_angle);
      const a2 = Math.sin(wrap_angle);
      const a3 = p.light_drag * a0;
      const a4 = a3 * retreat_speed;
      const a5 = p.light_linear_drag === 0;
      const a6 = a5 ? 0 : p.light_linear_drag * retreat_speed;
      const a7 = -retreat_speed;
      const a8 = a7 - p.wind_speed * a2;
      const a9 = across_speed - -p.wind_speed * a1;
      const a10 = p.light_linear_drag + a3;
      const a11 = -(p.light_linear_drag + p.light_drag * Math.sqrt(a8 * a8 + a9 * a9));
      const a12 = p.wind_speed === 0;
      const a13 = a12 ? 0 : a11 * a8 - a10 * retreat_speed;
      const a14 = p.light_mass * p.gravity * a1 + a4 + a6 + a13 + (p.side_force === 0 ? 0 : p.side_force * a2);
      const a15 = -p.heavy_mass * p.gravity + (p.heavy_linear_drag === 0 ? 0 : -p.heavy_linear_drag * heavy_speed);
      const a16 = p.rod_radius * a2 + free_length * a1;
      const a17 = p.free_length + p.rod_radius * p.release_angle - (free_length + p.rod_radius * wrap_angle + slack);
      const a18 = -p.hanging_length - a17;
      const a19 = a7 * a2 - across_speed * a1;
      const a20 = -a7 * a1 - across_speed * a2;
      const a21 = 0.5 * p.light_mass * (a19 * a19 + a20 * a20) + 0.5 * p.heavy_mass * (heavy_speed * heavy_speed);
      const a22 = -p.light_drag * a0 * across_speed + -p.string_drag * free_length * a0 * across_speed + (a5 ? 0 : -p.light_linear_drag * across_speed);
      const a23 = a4 + a6 + a13;
      const a24 = a22 + (a12 ? 0 : a11 * a9 + a10 * across_speed);
      return {
        light: [p.rod_radius * a1 - free_length * a2, a16],
        heavy: [p.rod_radius, a18],
        lightVelocity: [a19, a20],
        heavyVelocity: [0, heavy_speed],
        wrapAngle: wrap_angle,
        freeLength: free_length,
        slack: slack,
        lightTension: p.light_mass * across_speed * (across_speed / free_length) - a14,
        heavyTension: -a15,
        kineticEnergy: a21,
        potentialEnergy: p.gravity * (p.light_mass * a16 + p.heavy_mass * a18),
        dragForce: [a23 * a2 - a24 * a1, -a23 * a1 - a24 * a2],
        holding: null,
      };
    },
    apply: {
      time_up(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const across_speed = y[3];
        const heavy_speed = y[4];
        const slack = y[5];
        return { mode: 7, t: t, y: [free_length, wrap_angle, retreat_speed, across_speed, heavy_speed, slack], signs: { slide: s.slide, across: s.across, heavy: s.heavy, phase: s.phase } };
      },
      light_reaches_rod(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const across_speed = y[3];
        const heavy_speed = y[4];
        const slack = y[5];
        return { mode: 7, t: t, y: [free_length, wrap_angle, retreat_speed, across_speed, heavy_speed, slack], signs: { slide: s.slide, across: s.across, heavy: s.heavy, phase: s.phase } };
      },
      across_reverses(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const heavy_speed = y[4];
        const slack = y[5];
        const a0 = -1 * s.across;
        return { mode: 4, t: t, y: [free_length, wrap_angle, retreat_speed, 1e-300 * a0, heavy_speed, slack], signs: { slide: s.slide, across: a0, heavy: s.heavy, phase: s.phase } };
      },
      unwrapped(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const across_speed = y[3];
        const heavy_speed = y[4];
        const slack = y[5];
        return { mode: 7, t: t, y: [free_length, wrap_angle, retreat_speed, across_speed, heavy_speed, slack], signs: { slide: s.slide, across: s.across, heavy: s.heavy, phase: s.phase } };
      },
      slack(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const across_speed = y[3];
        const heavy_speed = y[4];
        return { mode: 5, t: t, y: [free_length, wrap_angle, retreat_speed, across_speed, heavy_speed, 0], signs: { slide: s.slide, across: s.across, heavy: heavy_speed > 0 ? 1 : -1, phase: 0 } };
      },
    },
},
  5: {  // clamped_slack
    integrated: [0, 1, 2, 3, 4, 5],
    events: [["light_reaches_rod", "light_reaches_rod"], ["across_reverses", "across_reverses"], ["unwrapped", "unwrapped"], ["closes", "taut"]],
    rates(p, t, z, s, out) {
      const free_length = z[0];
      const wrap_angle = z[1];
      const retreat_speed = z[2];
      const across_speed = z[3];
      const heavy_speed = z[4];
      const a0 = Math.sqrt(retreat_speed * retreat_speed + across_speed * across_speed);
      const a1 = p.light_mass * p.gravity;
      const a2 = Math.cos(wrap_angle);
      const a3 = Math.sin(wrap_angle);
      const a4 = p.light_drag * a0;
      const a5 = a1 * a3 + -p.light_drag * a0 * across_speed + -p.string_drag * free_length * (s.across * across_speed) * across_speed;
      const a6 = p.light_linear_drag === 0;
      const a7 = -retreat_speed - p.wind_speed * a3;
      const a8 = across_speed - -p.wind_speed * a2;
      const a9 = p.light_linear_drag + a4;
      const a10 = -(p.light_linear_drag + p.light_drag * Math.sqrt(a7 * a7 + a8 * a8));
      const a11 = p.wind_speed === 0;
      const a12 = a1 * a2 + a4 * retreat_speed + (a6 ? 0 : p.light_linear_drag * retreat_speed) + (a11 ? 0 : a10 * a7 - a9 * retreat_speed);
      const a13 = a5 + (a6 ? 0 : -p.light_linear_drag * across_speed) + (a11 ? 0 : a10 * a8 + a9 * across_speed);
      const a14 = p.side_force === 0;
      const a15 = across_speed / free_length;
      const a16 = (p.light_mass * across_speed * a15 - (a12 + (a14 ? 0 : p.side_force * a3))) / p.light_mass;
      out[0] = retreat_speed - p.rod_radius * a15;
      out[1] = a15;
      out[2] = a16;
      out[3] = (a13 + (a14 ? 0 : -p.side_force * a2)) / p.light_mass - retreat_speed * a15;
      out[4] = 0;
      out[5] = heavy_speed - retreat_speed;
    },
    eventValues(p, t, z, s, out) {
      const free_length = z[0];
      const wrap_angle = z[1];
      const retreat_speed = z[2];
      const across_speed = z[3];
      const heavy_speed = z[4];
      const slack = z[5];
      out[0] = free_length - p.end_length;
      out[1] = s.across * across_speed;
      out[2] = wrap_angle;
      out[3] = s.phase * slack + (1 - s.phase) * (heavy_speed - retreat_speed + 1e-18);
    },
    fullState(z) {
      const free_length = z[0];
      const wrap_angle = z[1];
      const retreat_speed = z[2];
      const across_speed = z[3];
      const heavy_speed = z[4];
      const slack = z[5];
      return [free_length, wrap_angle, retreat_speed, across_speed, heavy_speed, slack];
    },
    quantities(p, t, y, s) {
      const free_length = y[0];
      const wrap_angle = y[1];
      const retreat_speed = y[2];
      const across_speed = y[3];
      const heavy_speed = y[4];
      const slack = y[5];
      const a0 = Math.sqrt(retreat_speed * retreat_speed + across_speed * across_speed);
      const a1 = Math.cos(wrap_angle);
      const a2 = Math.sin(wrap_angle);
      const a3 = p.light_drag * a0;
      const a4 = p.light_linear_drag === 0;
      const a5 = -retreat_speed;
      const a6 = a5 - p.wind_speed * a2;
      const a7 = across_speed - -p.wind_speed * a1;
      const a8 = p.light_linear_drag + a3;
      const a9 = -(p.light_linear_drag + p.light_drag * Math.sqrt(a6 * a6 + a7 * a7));
      const a10 = p.wind_speed === 0;
      const a11 = p.rod_radius * a2 + free_length * a1;
      const a12 = p.free_length + p.rod_radius * p.release_angle - (free_length + p.rod_radius * wrap_angle + slack);
      const a13 = -p.hanging_length - a12;
      const a14 = a5 * a2 - across_speed * a1;
      const a15 = -a5 * a1 - across_speed * a2;
      const a16 = 0.5 * p.light_mass * (a14 * a14 + a15 * a15) + 0.5 * p.heavy_mass * (heavy_speed * heavy_speed);
      const a17 = -p.light_drag * a0 * across_speed + -p.string_drag * free_length * (s.across * across_speed) * across_speed;
      const a18 = a3 * retreat_speed + (a4 ? 0 : p.light_linear_drag * retreat_speed) + (a10 ? 0 : a9 * a6 - a8 * retreat_speed);
      const a19 = a17 + (a4 ? 0 : -p.light_linear_drag * across_speed) + (a10 ? 0 : a9 * a7 + a8 * across_speed);
      return {
        light: [p.rod_radius * a1 - free_length * a2, a11],
        heavy: [p.rod_radius, a13],
        lightVelocity: [a14, a15],
        heavyVelocity: [0, heavy_speed],
        wrapAngle: wrap_angle,
        freeLength: free_length,
        slack: slack,
        lightTension: 0,
        heavyTension: 0,
        kineticEnergy: a16,
        potentialEnergy: p.gravity * (p.light_mass * a11 + p.heavy_mass * a13),
        dragForce: [a18 * a2 - a19 * a1, -a18 * a1 - a19 * a2],
        holding: null,
      };
    },
    apply: {
      time_up(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const across_speed = y[3];
        const heavy_speed = y[4];
        const slack = y[5];
        return { mode: 7, t: t, y: [free_length, wrap_angle, retreat_speed, across_speed, heavy_speed, slack], signs: { slide: s.slide, across: s.across, heavy: s.heavy, phase: s.phase } };
      },
      light_reaches_rod(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const across_speed = y[3];
        const heavy_speed = y[4];
        const slack = y[5];
        return { mode: 7, t: t, y: [free_length, wrap_angle, retreat_speed, across_speed, heavy_speed, slack], signs: { slide: s.slide, across: s.across, heavy: s.heavy, phase: s.phase } };
      },
      across_reverses(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const heavy_speed = y[4];
        const slack = y[5];
        const a0 = -1 * s.across;
        return { mode: 5, t: t, y: [free_length, wrap_angle, retreat_speed, 1e-300 * a0, heavy_speed, slack], signs: { slide: s.slide, across: a0, heavy: s.heavy, phase: s.phase } };
      },
      unwrapped(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const across_speed = y[3];
        const heavy_speed = y[4];
        const slack = y[5];
        return { mode: 7, t: t, y: [free_length, wrap_angle, retreat_speed, across_speed, heavy_speed, slack], signs: { slide: s.slide, across: s.across, heavy: s.heavy, phase: s.phase } };
      },
      closes(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const across_speed = y[3];
        const heavy_speed = y[4];
        const slack = y[5];
        return { mode: 5, t: t, y: [free_length, wrap_angle, retreat_speed, across_speed, heavy_speed, slack], signs: { slide: s.slide, across: s.across, heavy: s.heavy, phase: 1 } };
      },
      taut(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const across_speed = y[3];
        const a0 = Math.cos(wrap_angle);
        const a1 = Math.sin(wrap_angle);
        const a2 = across_speed - -p.wind_speed * a0;
        const a3 = -(p.wind_speed * a1);
        const a4 = p.wind_speed === 0 ? 0 : -(p.light_linear_drag + p.light_drag * Math.sqrt(a3 * a3 + a2 * a2)) * a3;
        const a5 = p.light_mass * across_speed * (across_speed / free_length) - (p.light_mass * p.gravity * a0 + a4 + (p.side_force === 0 ? 0 : p.side_force * a1));
        const a6 = a5 < 0;
        return { mode: a6 ? 5 : 4, t: t, y: [free_length, wrap_angle, 0, across_speed, 0, 0], signs: { slide: s.slide, across: s.across, heavy: a6 ? -1 : s.heavy, phase: a6 ? 0 : s.phase } };
      },
    },
},
  6: {  // falling
    integrated: [0, 1, 2, 3, 4, 5],
    events: [["light_reaches_rod", "light_reaches_rod"], ["across_reverses", "across_reverses"]],
    rates(p, t, z, s, out) {
      const free_length = z[0];
      const wrap_angle = z[1];
      const retreat_speed = z[2];
      const across_speed = z[3];
      const heavy_speed = z[4];
      const a0 = Math.sqrt(retreat_speed * retreat_speed + across_speed * across_speed);
      const a1 = p.light_mass * p.gravity;
      const a2 = Math.cos(wrap_angle);
      const a3 = Math.sin(wrap_angle);
      const a4 = p.light_drag * a0;
      const a5 = p.light_linear_drag === 0;
      const a6 = a1 * a3 + -p.light_drag * a0 * across_speed + (a5 ? 0 : -p.light_linear_drag * across_speed);
      const a7 = -retreat_speed - p.wind_speed * a3;
      const a8 = across_speed - -p.wind_speed * a2;
      const a9 = p.light_linear_drag + a4;
      const a10 = -(p.light_linear_drag + p.light_drag * Math.sqrt(a7 * a7 + a8 * a8));
      const a11 = p.wind_speed === 0;
      const a12 = a1 * a2 + a4 * retreat_speed + (a5 ? 0 : p.light_linear_drag * retreat_speed) + (a11 ? 0 : a10 * a7 - a9 * retreat_speed);
      const a13 = p.side_force === 0;
      const a14 = -p.heavy_mass * p.gravity + -p.heavy_drag * (s.heavy * heavy_speed) * heavy_speed + (p.heavy_linear_drag === 0 ? 0 : -p.heavy_linear_drag * heavy_speed);
      const a15 = across_speed / free_length;
      const a16 = (p.light_mass * across_speed * a15 - (a12 + (a13 ? 0 : p.side_force * a3))) / p.light_mass;
      const a17 = (a6 + (a11 ? 0 : a10 * a8 + a9 * across_speed) + (a13 ? 0 : -p.side_force * a2)) / p.light_mass;
      out[0] = retreat_speed - p.rod_radius * a15;
      out[1] = a15;
      out[2] = a16;
      out[3] = a17 - retreat_speed * a15;
      out[4] = a14 / p.heavy_mass;
      out[5] = heavy_speed - retreat_speed;
    },
    eventValues(p, t, z, s, out) {
      const free_length = z[0];
      const across_speed = z[3];
      out[0] = free_length - p.end_length;
      out[1] = s.across * across_speed;
    },
    fullState(z) {
      const free_length = z[0];
      const wrap_angle = z[1];
      const retreat_speed = z[2];
      const across_speed = z[3];
      const heavy_speed = z[4];
      const slack = z[5];
      return [free_length, wrap_angle, retreat_speed, across_speed, heavy_speed, slack];
    },
    quantities(p, t, y, s) {
      const free_length = y[0];
      const wrap_angle = y[1];
      const retreat_speed = y[2];
      const across_speed = y[3];
      const heavy_speed = y[4];
      const slack = y[5];
      const a0 = Math.sqrt(retreat_speed * retreat_speed + across_speed * across_speed);
      const a1 = Math.cos(wrap_angle);
      const a2 = Math.sin(wrap_angle);
      const a3 = p.light_drag * a0;
      const a4 = p.light_linear_drag === 0;
      const a5 = -retreat_speed;
      const a6 = a5 - p.wind_speed * a2;
      const a7 = across_speed - -p.wind_speed * a1;
      const a8 = p.light_linear_drag + a3;
      const a9 = -(p.light_linear_drag + p.light_drag * Math.sqrt(a6 * a6 + a7 * a7));
      const a10 = p.wind_speed === 0;
      const a11 = p.rod_radius * a2 + free_length * a1;
      const a12 = p.free_length + p.rod_radius * p.release_angle - (free_length + p.rod_radius * wrap_angle + slack);
      const a13 = -p.hanging_length - a12;
      const a14 = a5 * a2 - across_speed * a1;
      const a15 = -a5 * a1 - across_speed * a2;
      const a16 = 0.5 * p.light_mass * (a14 * a14 + a15 * a15) + 0.5 * p.heavy_mass * (heavy_speed * heavy_speed);
      const a17 = a3 * retreat_speed + (a4 ? 0 : p.light_linear_drag * retreat_speed) + (a10 ? 0 : a9 * a6 - a8 * retreat_speed);
      const a18 = -p.light_drag * a0 * across_speed + (a4 ? 0 : -p.light_linear_drag * across_speed) + (a10 ? 0 : a9 * a7 + a8 * across_speed);
      return {
        light: [p.rod_radius * a1 - free_length * a2, a11],
        heavy: [p.rod_radius, a13],
        lightVelocity: [a14, a15],
        heavyVelocity: [0, heavy_speed],
        wrapAngle: wrap_angle,
        freeLength: free_length,
        slack: slack,
        lightTension: 0,
        heavyTension: 0,
        kineticEnergy: a16,
        potentialEnergy: p.gravity * (p.light_mass * a11 + p.heavy_mass * a13),
        dragForce: [a17 * a2 - a18 * a1, -a17 * a1 - a18 * a2],
        holding: null,
      };
    },
    apply: {
      time_up(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const across_speed = y[3];
        const heavy_speed = y[4];
        const slack = y[5];
        return { mode: 7, t: t, y: [free_length, wrap_angle, retreat_speed, across_speed, heavy_speed, slack], signs: { slide: s.slide, across: s.across, heavy: s.heavy, phase: s.phase } };
      },
      light_reaches_rod(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const across_speed = y[3];
        const heavy_speed = y[4];
        const slack = y[5];
        return { mode: 7, t: t, y: [free_length, wrap_angle, retreat_speed, across_speed, heavy_speed, slack], signs: { slide: s.slide, across: s.across, heavy: s.heavy, phase: s.phase } };
      },
      across_reverses(p, t, y, s) {
        const free_length = y[0];
        const wrap_angle = y[1];
        const retreat_speed = y[2];
        const heavy_speed = y[4];
        const slack = y[5];
        const a0 = -1 * s.across;
        return { mode: 6, t: t, y: [free_length, wrap_angle, retreat_speed, 1e-300 * a0, heavy_speed, slack], signs: { slide: s.slide, across: a0, heavy: s.heavy, phase: s.phase } };
      },
    },
},
};
