"""Newton's second law for effects that change the geometry, by computer algebra, against the lines that are solved."""

from types import SimpleNamespace

import pytest

from looping_pendulum.reference_ode.effects import EFFECTS
from looping_pendulum.reference_ode.equations import Equations
from looping_pendulum.reference_ode.state import Signs, State
from looping_pendulum.reference_ode.transitions import Mode

sp = pytest.importorskip("sympy", reason="sympy derives the equations of motion")

t = sp.Symbol("t", positive=True)
M1, M2, R, g, mu, d, L0, rho = sp.symbols("M1 M2 R g mu d L rho", positive=True)
length, theta, z, phi = (sp.Function(name)(t) for name in ("l", "theta", "z", "phi"))
l0, th0, z0, ph0, u0, w0, v0, w2 = sp.symbols("l0 theta0 z0 phi0 u w v w2")
ud, wd, vd, T1, T2, u2d, w2d = sp.symbols("ud wd vd T1 T2 u2d w2d")
ABSENT = {c.name: 0 for effect in EFFECTS.values() for c in effect.coefficients}
BASE = tuple(effect for effect in EFFECTS.values() if effect.in_base_model)
SLIDE = -1


def values(**given):
    numbers = {"light_mass": M1, "heavy_mass": M2, "rod_radius": R, "string_length": L0, "end_length": 0}
    return SimpleNamespace(**(ABSENT | {"gravity": g, "kinetic_friction": mu, "static_friction": mu} | numbers | given))


def rates(y, signs, p, *names):
    return Equations(sp, p, (*BASE, *(EFFECTS[name] for name in names))).rates(Mode.SLIDING_DOWN, t, y, signs)


SYMBOLS = (M1, M2, R, g, mu, d, th0, l0, z0, ph0, u0, w0, v0, w2)
POINTS = [{s: sp.Float(0.37 + 0.11 * i + 0.05 * seed, 30) for i, s in enumerate(SYMBOLS)} for seed in range(3)]
for _point in POINTS:
    _point[L0] = sp.Float(4, 30)  # longer than what is wound and straight


def number(expression, point, solved=()):
    return float(sp.sympify(expression).xreplace(point | dict(solved)))


def solve(laws, unknowns, point):
    """Solve equations that are linear in the unknowns, at a point."""
    actual = sp.linsolve([sp.sympify(law).xreplace(point) for law in laws], unknowns)
    return dict(zip(unknowns, next(iter(actual)), strict=True))


def equal(actual, expected, solved=({}, {}, {})):
    """Whether two expressions agree at the points, but for rounding."""
    pairs = [(number(actual, p), number(expected, p, s)) for p, s in zip(POINTS, solved, strict=True)]
    return all(abs(a - b) < 1e-11 * max(1, abs(b)) for a, b in pairs)


def at_instant(expression, first, second):
    now = {length: l0, theta: th0, z: z0, phi: ph0}
    return expression.doit().subs(second).subs(first).subs(now)


def light_derivatives(radius):
    """First and second derivatives of l and theta in terms of u, w and their derivatives; ``radius``: of curvature."""
    th_d = w0 / l0
    l_d = u0 - radius * th_d
    th_dd = (wd - l_d * th_d) / l0
    slope = sp.diff(radius, th0)
    l_dd = ud - radius * th_dd - slope * th_d**2
    return {length.diff(t): l_d, theta.diff(t): th_d}, {length.diff(t, 2): l_dd, theta.diff(t, 2): th_dd}


normal = sp.Matrix([sp.cos(theta), sp.sin(theta)])
away = sp.Matrix([-sp.sin(theta), sp.cos(theta)])
weight = sp.Matrix([0, -M1 * g])


@pytest.mark.long
def test_a_string_wound_on_itself():
    h = R + d / (2 * sp.pi) * (theta - 2 * sp.pi)  # support function of the spiral; h'' = 0
    slope = d / (2 * sp.pi)
    place = h * normal + (slope + length) * away
    first, second = light_derivatives(h.subs(theta, th0))
    velocity = at_instant(place.diff(t), first, second)
    n0, a0 = normal.subs(theta, th0), away.subs(theta, th0)
    assert equal(velocity.dot(a0), u0)
    assert equal(velocity.dot(n0), -w0)
    left = at_instant(M1 * place.diff(t, 2) - weight, first, second)
    heavy = M2 * ud - (T2 - M2 * g)
    capstan = T2 - T1 * sp.exp(-SLIDE * mu * th0)
    solved = [solve([left.dot(a0) + T1, left.dot(n0), heavy, capstan], [ud, wd, T1, T2], point) for point in POINTS]
    y, signs = State(l0, th0, u0, w0, u0, 0), Signs(SLIDE, 1, 0, 1, overlap=1)
    actual = rates(y, signs, values(string_thickness=d), "string_thickness")
    assert equal(actual.retreat_speed, ud, solved)
    assert equal(actual.across_speed, wd, solved)
    assert equal(actual.free_length, first[length.diff(t)])


def test_a_light_mass_that_also_moves_along_the_rod():
    place = R * normal + length * away
    first, second = light_derivatives(R)
    first, second = first | {z.diff(t): v0}, second | {z.diff(t, 2): vd}
    whole = sp.sqrt((length + R * theta) ** 2 + z**2)
    left = at_instant(M1 * place.diff(t, 2) - weight, first, second)
    string_speed, string_rate = (at_instant(whole.diff(t, n), first, second) for n in (1, 2))
    share, share_z = ((x / whole).subs({length: l0, theta: th0, z: z0}) for x in (length + R * theta, z))
    n0, a0 = normal.subs(theta, th0), away.subs(theta, th0)
    heavy = M2 * string_rate - (T2 - M2 * g)
    capstan = T2 - T1 * sp.exp(-SLIDE * mu * th0)
    laws = [left.dot(a0) + share * T1, left.dot(n0), M1 * vd + share_z * T1, heavy, capstan]
    solved = [solve(laws, [ud, wd, vd, T1, T2], point) for point in POINTS]
    y = State(l0, th0, u0, w0, string_speed, 0, sideways=z0, sideways_speed=v0)
    actual = rates(y, Signs(SLIDE, 1, 0, 1), values(), "out_of_plane")
    assert equal(actual.retreat_speed, ud, solved)
    assert equal(actual.across_speed, wd, solved)
    assert equal(actual.sideways_speed, vd, solved)
    assert equal(actual.heavy_speed, string_rate, solved)
    assert equal(actual.slack, sp.Integer(0))


def test_a_heavy_mass_that_swings():
    hanging = sp.Function("L2")(t)  # from where the string leaves the rod
    down, across = sp.Matrix([sp.sin(phi), -sp.cos(phi)]), sp.Matrix([sp.cos(phi), sp.sin(phi)])
    place = R * across + hanging * down
    free = L0 - l0 - R * th0 + R * ph0
    turning = w2 / free
    first = {phi.diff(t): turning, hanging.diff(t): -u0 + R * turning}
    ph_dd = (w2d - first[hanging.diff(t)] * turning) / free
    second = {phi.diff(t, 2): ph_dd, hanging.diff(t, 2): -u2d + R * ph_dd}

    def now(expression):
        return expression.doit().subs(second).subs(first).subs({hanging: free, phi: ph0})

    d0, m0 = down.subs(phi, ph0), across.subs(phi, ph0)
    assert equal(now(place.diff(t)).dot(d0), -u0)
    assert equal(now(place.diff(t)).dot(m0), w2)
    left = now(M2 * place.diff(t, 2) - sp.Matrix([0, -M2 * g]))
    light = M1 * (w0**2 / l0 - u2d) - M1 * g * sp.cos(th0) - T1
    capstan = T2 - T1 * sp.exp(-SLIDE * mu * (th0 - ph0))
    solved = [solve([left.dot(d0) + T2, left.dot(m0), light, capstan], [u2d, w2d, T1, T2], point) for point in POINTS]
    y = State(l0, th0, u0, w0, u0, 0, heavy_tilt=ph0, heavy_across_speed=w2)
    actual = rates(y, Signs(SLIDE, 1, 0, 1), values(), "heavy_swing")
    assert equal(actual.heavy_speed, u2d, solved)
    assert equal(actual.heavy_across_speed, w2d, solved)
    assert equal(actual.heavy_tilt, turning)


@pytest.mark.long
def test_a_light_mass_with_a_moment_of_inertia():
    """Lagrange's equations of a body that turns with its string, whose tension T1 pulls at the path l + R theta."""
    inertia, speeds = sp.Symbol("I", positive=True), sp.symbols("dl dtheta")
    place = R * normal + length * away
    velocity = place.diff(t).subs({length.diff(t): speeds[0], theta.diff(t): speeds[1]})
    kinetic = M1 * velocity.dot(velocity) / 2 + inertia * speeds[1] ** 2 / 2
    first, second = light_derivatives(R)
    laws = []
    for coordinate, speed, path in zip((length, theta), speeds, (1, R), strict=True):
        momentum = kinetic.diff(speed).subs(dict(zip(speeds, (length.diff(t), theta.diff(t)), strict=True)))
        force = weight.dot(place.diff(coordinate)) - T1 * path
        law = momentum.diff(t) - kinetic.diff(coordinate).subs(dict(zip(speeds, (length.diff(t), theta.diff(t)), strict=True)))
        laws.append(at_instant(law - force, first, second))
    laws += [M2 * ud - (T2 - M2 * g), T2 - T1 * sp.exp(-SLIDE * mu * th0)]
    points = [point | {inertia: sp.Float(0.23, 30)} for point in POINTS]
    solved = [solve(laws, [ud, wd, T1, T2], point) for point in points]
    actual = rates(State(l0, th0, u0, w0, u0, 0), Signs(SLIDE, 1, 0, 1), values(light_inertia=inertia), "light_inertia")
    for own, expected in ((actual.retreat_speed, ud), (actual.across_speed, wd)):
        pairs = [(number(own, p), number(expected, p, s)) for p, s in zip(points, solved, strict=True)]
        assert all(abs(a - b) < 1e-11 * max(1, abs(b)) for a, b in pairs)
