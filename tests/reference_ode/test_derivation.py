"""Newton's second law, by computer algebra, against the lines that are solved."""

from types import SimpleNamespace

import pytest

from looping_pendulum.reference_ode.effects import EFFECTS
from looping_pendulum.reference_ode.equations import Equations
from looping_pendulum.reference_ode.state import Signs, State
from looping_pendulum.reference_ode.transitions import Event, Mode

sp = pytest.importorskip("sympy", reason="sympy derives the equations of motion")

t = sp.Symbol("t", positive=True)
M1, M2, R, g, mu, mu_s, g1, g2, alpha = sp.symbols("M1 M2 R g mu mu_s gamma1 gamma2 alpha", positive=True)
length, theta = sp.Function("l")(t), sp.Function("theta")(t)
l0, th0, u0, w0, ud, wd, T1, T2 = sp.symbols("l0 theta0 u w ud wd T1 T2")
p = SimpleNamespace(
    light_mass=M1,
    heavy_mass=M2,
    rod_radius=R,
    gravity=g,
    kinetic_friction=mu,
    static_friction=mu_s,
    light_drag=g1,
    heavy_drag=g2,
    string_drag=alpha,
    end_length=sp.Integer(0),
    string_length=sp.Symbol("L"),
)
ALL = tuple(effect for effect in EFFECTS.values() if effect.in_base_model)

e1 = sp.Matrix([sp.sin(theta), -sp.cos(theta)])
t1 = sp.Matrix([-sp.cos(theta), -sp.sin(theta)])
r1 = -length * e1 - R * t1  # the paper's position of the light mass


def newton_along_and_across() -> tuple[sp.Expr, sp.Expr]:
    """M1 a - (all forces but T1), along e1 and across t1, in the paper's Cartesian vectors."""
    v, a = r1.diff(t), r1.diff(t, 2)
    speed = sp.sqrt(u0**2 + w0**2)
    across_speed = v.dot(t1)
    gravity = sp.Matrix([0, -M1 * g])
    air = -g1 * speed * v
    string_air = -alpha * length * sp.Abs(across_speed) * across_speed * t1
    left = M1 * a - gravity - air - string_air
    return left.dot(e1), left.dot(t1)


def in_speeds(expression: sp.Expr) -> sp.Expr:
    """Write l', theta' and their derivatives through u = l' + R theta' and w = l theta'."""
    th_d = w0 / l0
    l_d = u0 - R * th_d
    th_dd = (wd - l_d * th_d) / l0
    l_dd = ud - R * th_dd
    second = {length.diff(t, 2): l_dd, theta.diff(t, 2): th_dd}
    first = {length.diff(t): l_d, theta.diff(t): th_d}
    return expression.doit().subs(second).subs(first).subs({length: l0, theta: th0})


def is_zero(expression: sp.Expr) -> bool:
    """Whether an expression vanishes at exact rational points, to 30 digits; simplification takes a hundred times as long.

    All are positive, so that |w| and sqrt(w^2) are +w: the sign that a mode carries.
    """
    names = sorted(expression.free_symbols, key=str)
    for seed in range(3):
        values = {s: sp.Rational(3 + 2 * i + seed, 7 + i) for i, s in enumerate(names)}
        if abs(sp.N(expression.xreplace(values), 40)) > sp.Float("1e-30"):
            return False
    return True


def solve(laws: list[sp.Expr], *unknowns: sp.Symbol) -> dict[sp.Symbol, sp.Expr]:
    """Solve equations that are linear in the unknowns; what comes out is as long as it happens to be."""
    (solution,) = sp.solve(laws, unknowns, dict=True, simplify=False)
    return solution


@pytest.fixture(scope="module")
def balance() -> tuple[sp.Expr, sp.Expr]:
    """The balance along and across in speeds; no constant, as every worker of pytest collects this file."""
    along, across = (in_speeds(side) for side in newton_along_and_across())
    return along, across


@pytest.mark.parametrize(("mode", "slide"), [(Mode.SLIDING_DOWN, -1), (Mode.SLIDING_UP, 1)])
def test_sliding_equations_follow_from_newton_with_the_capstan_law(mode, slide, balance):
    along, across = balance
    heavy = M2 * ud - (T2 - M2 * g - g2 * slide * u0 * u0)  # |u| = slide u while sliding
    unknown = solve([along - T1, across, heavy, T2 - T1 * sp.exp(-slide * mu * th0)], ud, wd, T1, T2)
    y, signs = State(l0, th0, u0, w0, u0, 0), Signs(slide, 1, 0, 1)
    ours = Equations(sp, p, ALL).rates(mode, t, y, signs)
    assert is_zero(ours.retreat_speed - unknown[ud])
    assert is_zero(ours.across_speed - unknown[wd])
    tension = Equations(sp, p, ALL).tensions(mode, t, y, signs)
    assert is_zero(tension[0] - unknown[T1])
    assert is_zero(tension[1] - unknown[T2])
    slack = Equations(sp, p, ALL).event_functions(mode, t, y, signs)[Event.LOSES_TENSION]
    assert is_zero(slack - unknown[T1] * (M2 + M1 * sp.exp(-slide * mu * th0)))


def test_sticking_equation_follows_from_newton_with_a_resting_heavy_mass(balance):
    along, across = balance
    rest = {u0: 0, ud: 0}
    unknown = solve([(along - T1).subs(rest), across.subs(rest)], wd, T1)
    y, signs = State(l0, th0, 0, w0, 0, 0), Signs(-1, 1, 0, 1)
    ours = Equations(sp, p, ALL).rates(Mode.STICKING, t, y, signs)
    assert is_zero(ours.across_speed - unknown[wd])
    assert is_zero(Equations(sp, p, ALL).tensions(Mode.STICKING, t, y, signs)[0] - unknown[T1])


def test_slack_equations_are_free_flight_of_the_light_mass(balance):
    along, across = balance
    unknown = solve([along, across], ud, wd)
    y, signs = State(l0, th0, u0, w0, sp.Symbol("u2"), 0), Signs(-1, 1, -1, 1)
    ours = Equations(sp, p, ALL).rates(Mode.SLACK, t, y, signs)
    assert is_zero(ours.retreat_speed - unknown[ud])
    assert is_zero(ours.across_speed - unknown[wd])


def test_the_papers_combined_equation_lacks_the_light_mass_under_its_string_drag(balance):
    """The erratum: eq. Eqn1 has alpha |l theta'| l^2 theta', the paper's own force balance demands that divided by M1."""
    _, across = balance
    th_d, l_d = w0 / l0, u0 - R * w0 / l0
    th_dd = (wd - l_d * th_d) / l0
    speed = sp.sqrt(u0**2 + w0**2)
    printed = (
        2 * l_d * th_d + l0 * th_dd + R * th_d**2 - g * sp.sin(th0)
        + g1 / M1 * speed * w0 + alpha * sp.Abs(w0) * l0 * w0
    )  # fmt: skip
    difference = across / M1 - printed
    expected = alpha * sp.Abs(w0) * l0 * w0 * (1 / M1 - 1)
    assert is_zero(difference - expected)
    assert not is_zero(difference)


def test_only_the_string_drag_over_mass_is_an_acceleration():
    pint = pytest.importorskip("pint")
    unit = pint.UnitRegistry()
    term = (1 * unit("kg/m**2")) * (1 * unit("m/s")) * (1 * unit("m**2/s"))  # alpha |l theta'| l^2 theta'
    assert term.check("[force]")
    assert (term / unit("kg")).check("[acceleration]")
