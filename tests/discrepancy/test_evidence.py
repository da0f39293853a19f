"""Explanations are compared by the evidence of the data: closed forms, invariance, and a planted effect."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.stats import multivariate_normal

from looping_pendulum.discrepancy.blas import one_blas_thread
from looping_pendulum.discrepancy.evidence import prior
from looping_pendulum.discrepancy.evidence.explanation import NOTHING, Parts, explained, raw
from looping_pendulum.discrepancy.evidence.laws import covariance_root, laws_beside, with_law
from looping_pendulum.discrepancy.evidence.marginal import MAX_DECREASE, SETTINGS, Marginal, NoiseGrid
from looping_pendulum.discrepancy.evidence.motions import COORDINATES_OF, TARGETS, Closure, factors_of
from looping_pendulum.discrepancy.evidence.prior import VISIBLE
from looping_pendulum.discrepancy.evidence.search import Search, posterior
from looping_pendulum.discrepancy.evidence.templates import _chosen, _next_try, columns, finer, smallest_visible, templates
from looping_pendulum.discrepancy.fit.calibration import Fit, calibrate, minimise
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.discrepancy.fit.residual_noise import refit_with_estimated_noise
from looping_pendulum.discrepancy.inputs import read_inputs
from looping_pendulum.measured.study_io import load
from tests.blind.cases import CASES
from tests.discrepancy.blind_sample import BlindStudy, write_files
from tests.discrepancy.blind_study import write_study

DRAG = "light_linear_drag"
OTHERS = ("wind_speed", "side_force", "friction_per_speed", "scale", "clock_offset", "wrong_light_mass")


def read(folder, case, trials=("ten_a", "six")):
    return read_inputs(load(write_study(folder, CASES[case], 3, trials=list(trials))))


@pytest.fixture(scope="module", autouse=True)
def one_thread():
    """As in `identify`: sums by two threads differ in their last digits."""
    with one_blas_thread():
        yield


def declared(inputs):
    return refit_with_estimated_noise(calibrate(Problem(inputs.study, inputs.training, inputs.free_parameters)))


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    return read(tmp_path_factory.mktemp("drag"), "linear_drag")


@pytest.fixture(scope="module")
def base(inputs):
    return declared(inputs)


@pytest.fixture(scope="module")
def library(inputs):
    by_name = {c.name: c for c in inputs.library}
    return [by_name[name] for name in (DRAG, *OTHERS)]


@pytest.fixture(scope="module")
def search(base, library):
    found = Search(base, library)
    found.run()
    return found


def covariance(d, setting, grid):
    """Covariance of a trial's noise, by its definition."""
    matrix = np.diag(d.sigma**2)
    for body, noise in grid.noises(setting).items():
        for c in d.channels:
            if c.name.startswith(body):
                part = d.slices[c.name]
                white = noise.white_sigma(d.sigma[part], c.time_step)
                lag = np.abs(c.t[:, None] - c.t)
                matrix[part, part] = np.diag(white**2) + noise.amplitude**2 * np.exp(-lag / noise.correlation_time)
    return matrix


@pytest.mark.parametrize("setting", [0, 5, len(SETTINGS), 3 * len(SETTINGS) + 7])
def test_the_evidence_of_a_linear_model_is_its_closed_form(base, setting):
    d = base.problem.data[0].until(0.25)
    d = dataclasses.replace(d, sigma=np.where(np.isfinite(d.sigma), d.sigma, 1e-3))
    grid = NoiseGrid([d])
    rng = np.random.default_rng(1)
    n, p = len(d.t), 4
    jacobian, root = rng.normal(0, 5e-3, (n, p)), np.diag([1.0, 0.5, 2.0, 0.1])
    noise = covariance(d, setting, grid)
    whole = noise + jacobian @ np.linalg.inv(root.T @ root) @ jacobian.T
    y = rng.multivariate_normal(np.zeros(n), whole)
    precision = np.linalg.inv(noise if setting == 0 else np.diag(d.sigma**2))  # the fit is with white noise
    x = np.linalg.solve(jacobian.T @ precision @ jacobian + root.T @ root, jacobian.T @ precision @ y)
    fitted = np.column_stack([np.concatenate([y - jacobian @ x, -root @ x]), np.vstack([jacobian, root])])
    found = Marginal(grid, fitted, settings=[setting]).log_z_of_settings[0] - grid.log_prior[setting]
    oracle = multivariate_normal(np.zeros(n), whole).logpdf(y) + 0.5 * n * math.log(2 * math.pi)
    assert found == pytest.approx(oracle, abs=1e-6 * n)


def test_the_evidence_of_a_law_is_that_of_its_weights(base):
    """Oracle: the model that is linear in the weights, with derivatives by the law itself in place of pulses."""
    grid = NoiseGrid(base.problem.data)
    n = grid.count
    m = Marginal(grid, raw(base), settings=[0])
    known = laws_beside(base, grid, [0], m.log_z_of_settings, raw(base), np.zeros((n, 0)))
    for target, name in (("light mass", "time"), ("heavy mass", "hanging_length"), ("string on rod", "wrap_angle")):
        law = known.law(known.runs.closure(target, name))
        problem, weights = with_law(base.problem, law)
        root = covariance_root(law.length, len(TARGETS[target]))
        at_null = np.append(base.x, np.zeros(len(weights)))
        jacobian = problem.jacobian(at_null)
        jacobian[:n] *= np.concatenate([d.sigma for d in base.problem.data])[:, None]
        fitted = np.column_stack([np.append(raw(base)[:, 0], np.zeros(len(weights))), jacobian])
        np.testing.assert_allclose(fitted[n:, 1:], block_diag(base.problem.prior_weights, np.linalg.inv(root)), atol=1e-9)
        whole = Marginal(grid, fitted, settings=[0])
        # With its whole step, of which the evidence of a fit believes but a little
        left = whole.gram[0, 0, 0] - MAX_DECREASE - whole.complement[0, 0, 0]
        oracle = whole.log_z_of_settings[0] + 0.5 * max(left, 0.0) - m.log_z_of_settings[0]
        assert law.log_bayes_factor - law.mixed == pytest.approx(oracle, abs=0.25 * abs(oracle) + 0.3), (
            law.closure
        )  # pulses are some ms wide


def test_the_priors_add_to_one(library):
    count = len(library)
    effects = sum(math.comb(count, k) * math.exp(prior.log_prior(k, count)) for k in range(4))
    closures = [
        Closure(coordinate=name, factor=factor, target=target, first_centre=0.0, spacing=1.0)
        for target, names in COORDINATES_OF.items()
        for name in names
        for factor in factors_of(target)
    ]
    laws = sum(math.comb(count, k) * math.exp(prior.log_prior(k, count, c)) for c in closures for k in (0, 1))
    assert effects + laws == pytest.approx(1.0, abs=1e-9)


def test_a_planted_effect_is_recovered(search, inputs):
    ranked = posterior(search.fitted)
    assert ranked[0][0] == {DRAG}
    assert ranked[0][1] > prior.CREDIBLE
    assert search.passes(search.best)
    assert sum(p for _, p in ranked) == pytest.approx(1.0)
    value, error = (search.best.fit.values[DRAG], search.best.fit.errors[DRAG])
    assert abs(value - dict(CASES["linear_drag"].effects)["linear_drag"]) < 3 * error


def test_what_adds_too_little_to_be_seen_counts_as_a_part(search):
    ranked = dict(posterior(search.fitted))
    wholes = [e for e in search.fitted.values() if e.key > {DRAG}]
    assert all(e.log_posterior < search.best.log_posterior for e in wholes)
    assert not any(e.key in ranked for e in wholes)


@pytest.mark.long
def test_the_order_of_the_candidates_does_not_matter(search, base, library):
    again = Search(base, library[::-1])
    again.run()
    ranked, reverse = posterior(search.fitted), posterior(again.fitted)
    assert [key for key, _ in ranked] == [key for key, _ in reverse]
    np.testing.assert_allclose([p for _, p in ranked], [p for _, p in reverse], atol=1e-9)


def test_the_unit_of_a_value_does_not_matter(search):
    """The same fit with an effect in units a hundred times larger: its evidence is that of its size."""
    e = search.best
    p, i = e.fit.problem, e.fit.problem.names.index(DRAG)
    parameters = list(p.free_parameters)
    parameters[i] = dataclasses.replace(parameters[i], scale=100 * parameters[i].scale)
    change = np.ones(len(parameters))
    change[i] = 100.0
    # The wide prior of the fit is that of the new unit, too, which the evidence takes out again
    problem = Problem(p.study, p.data, parameters, (p.prior_mean, p.prior_weights))
    x = e.fit.x / change
    jacobian = e.fit.jacobian * change
    jacobian[p.measured_rows :] = p.prior_weights
    fit = Fit(problem=problem, x=x, residuals=problem.residuals(x), final_jacobian=jacobian)
    again = explained(search.grid, fit, e.parts, len(search.library))
    assert again.log_z == pytest.approx(e.log_z, abs=1e-3)


def test_templates_beside_a_fit_say_what_a_small_value_does(base, library):
    """Oracle: the difference of two predictions."""
    found = [t for t in templates(base, library[:3]) if t.linear and not t.square]
    assert {t.candidate.name for t in found} >= {"wind_speed"}
    for t in found:
        problem = base.problem.with_parameters(dataclasses.replace(t.candidate.free_parameter(1.0)))
        at = [np.append(base.x, side * 0.3 * t.delta) for side in (1, -1)]
        ahead, behind = (np.concatenate([problem.predict(x, k) for k in range(len(problem.data))]) for x in at)
        used = np.isfinite(np.concatenate([d.sigma for d in problem.data]))
        difference = 0.5 * (ahead - behind) / 0.3
        scale = float(np.abs(t.change).max())
        np.testing.assert_allclose(t.change[used], difference[used], atol=0.05 * scale)


@pytest.mark.long
def test_of_a_clean_study_nothing_is_missing(tmp_path, library):
    inputs = read(tmp_path, "clean_varied")
    by_name = {c.name: c for c in inputs.library}
    search = Search(declared(inputs), [by_name[c.name] for c in library])
    search.run()
    assert posterior(search.fitted)[0] == (NOTHING, pytest.approx(1.0, abs=0.2))
    assert search.passes(search.best)
    assert search.fitted[NOTHING].parts.key == Parts().key


# ---- templates of listed effects: changes of a given size are found, whatever their power of the value; what would show, shows


def found(change, first, reach, sizes, smallest):
    """Look for changes of these sizes as templates do; return them, and every value that was tried."""
    rms, tries, steps = {}, [first], 0
    while tries and steps < 12:
        rms |= {value: change(value) for value in tries}
        known = sorted(rms.items())
        tries = [value for size in sizes if (value := _next_try(known, reach, size, smallest)) is not None]
        steps += 1
    return [_chosen(sorted(rms.items()), 1.0, reach, size) for size in sizes], rms, steps


def visible(fit, chosen):
    """Return candidate's name -> its smallest visible size beside a fit."""
    found = templates(fit, chosen)
    grid = NoiseGrid(fit.problem.data)
    m = Marginal(grid, raw(fit), columns(found, grid.count), settings=[0])
    return {v.name: v for v in smallest_visible(fit, found, m.complement[0])}


@pytest.mark.parametrize("power", [0.5, 1.0, 2.0, 3.0])
@pytest.mark.parametrize("first", [1e-6, 4.0])
def test_sizes_are_met_in_few_steps(power, first):
    values, rms, steps = found(lambda value: 40.0 * value**power, first, 5.0, [0.3, 3.0, 12.0], 0.0)
    for value, size in zip(values, [0.3, 3.0, 12.0], strict=True):
        assert 0.5 < rms[value] / size < 2
    assert steps <= 8


@pytest.mark.parametrize("first", [1e-6, 1e-3])
def test_below_a_value_that_cannot_run_nothing_is_tried(first):
    """A string that stretches too little takes more steps than the integrator has: no smaller value would run."""
    (value,), rms, _ = found(lambda value: 1e5 * value if value > 5e-5 else math.inf, first, 0.1, [0.3], 1e-6)
    assert value is None
    assert len(rms) <= 2


def test_the_reach_is_taken_if_something_changes_there():
    assert found(lambda value: 0.2 * value, 1e-3, 0.5, [0.3], 0.0)[0] == [0.5]
    assert found(lambda value: 0.01 * value, 1e-3, 0.5, [0.3], 0.0)[0] == [None]


def test_a_push_out_of_the_plane_counts_by_its_square(tmp_path):
    inputs = read_inputs(load(write_study(tmp_path, CASES["clean"], 0, trials=["ten_a"])))
    fit = calibrate(Problem(inputs.study, inputs.training, inputs.free_parameters))
    (push,) = (c for c in inputs.library if c.name == "push_sideways")
    assert push.bounds[0] < 0
    assert push.free_parameter(1.0).bounds == (0.0, push.bounds[1])
    problem = fit.problem.with_parameters(push.free_parameter(1.0))
    here = fit.problem.residuals(fit.x)

    def independent(value):
        moved = problem.residuals(np.append(fit.x, value))
        difference = (here - moved[: len(here)])[: fit.problem.measured_rows]
        basis, _ = np.linalg.qr(fit.jacobian[: len(difference)])
        return np.linalg.norm(difference - basis @ (basis.T @ difference))

    size = visible(fit, [push])["push_sideways"].value
    # At twice the value it is four times as many standard errors large
    assert independent(size) == pytest.approx(VISIBLE, rel=0.1)
    assert independent(2 * size) == pytest.approx(4 * VISIBLE, rel=0.2)


def test_a_rod_whose_bearing_holds_it_can_hide_at_any_size(tmp_path):
    """Of blind studies that missed an effect of more than twice its smallest visible size, two thirds hid such a rod."""
    inputs = read_inputs(load(write_study(tmp_path, CASES["clean"], 0, trials=["ten_a"])))
    fit = calibrate(Problem(inputs.study, inputs.training, inputs.free_parameters))
    chosen = [c for c in inputs.library if c.name in ("rod_mobility", "push_sideways", "light_linear_drag")]
    assert {name: v.can_hide for name, v in visible(fit, chosen).items()} == {
        "rod_mobility": True, "push_sideways": False, "light_linear_drag": False,
    }  # fmt: skip


@pytest.mark.long
def test_a_wrong_mass_beside_a_fitted_one_is_judged_by_what_is_linear(tmp_path):
    """Oracle: the fitted mass's own derivative. Only its weighing tells the two apart, so that curvature had passed for more.

    That nothing was missing had been the verdict, though by the report an error of a twentieth would have shown.
    """
    study = BlindStudy(hidden=("wrong_mass",), size=0.05, noise=1e-3, trials=3, seed=115974613)
    inputs = read_inputs(load(write_files(study, tmp_path)))
    fit = calibrate(Problem(inputs.study, inputs.training, inputs.free_parameters))
    size = visible(fit, [c for c in inputs.library if c.name == "wrong_light_mass"])["wrong_light_mass"].value
    i = fit.problem.names.index("light_mass")
    factor = fit.jacobian[:, i] * fit.values["light_mass"] / fit.problem.free_parameters[i].scale
    factor[fit.problem.measured_rows :] = 0.0  # the prior is that of the weighed mass
    basis, _ = np.linalg.qr(fit.jacobian)
    assert size == pytest.approx(VISIBLE / np.linalg.norm(factor - basis @ (basis.T @ factor)), rel=0.02)


CHOSEN = ("scale", "tilt", "clock_offset", "wrong_free_length", "wrong_light_mass", "light_linear_drag")


@pytest.mark.long
def test_the_smallest_visible_size_is_four_standard_errors_of_a_fit(tmp_path):
    """Oracle: the standard error of a fit with the effect. From finite changes, linear drag's was 6.3 times too small."""
    inputs = read_inputs(load(write_study(tmp_path, CASES["clean"], 2)))
    fit = calibrate(Problem(inputs.study, inputs.training, inputs.free_parameters))
    found = visible(fit, [c for c in inputs.library if c.name in CHOSEN])
    assert set(found) == set(CHOSEN)
    for candidate in (c for c in inputs.library if c.name in CHOSEN):
        name, v = candidate.name, found[candidate.name]
        own = dataclasses.replace(candidate.free_parameter(v.value), prior=1e3)  # the data alone say how large it is
        fitted = minimise(fit.problem.with_parameters(own), np.append(fit.x, 0.0))
        assert v.value == pytest.approx(VISIBLE * fitted.errors[name], rel=0.1), name


@pytest.mark.parametrize("central", [True, False])
def test_a_change_that_fitted_parameters_nearly_undo_is_taken_where_it_is_linear(central):
    linear, curved = np.array([1.0, 0.0]), np.array([0.0, 0.5])

    def change(delta):
        return linear * delta + curved * delta * abs(delta)

    known = {2.0 * share: change(2.0 * share) for share in (1.0, 0.1, -0.1)}
    assert finer(known, 2.0, central, known[2.0]) == pytest.approx([2.0, 0.2])  # a tenth of the curvature
    assert finer(dict.fromkeys(known), 2.0, central, known[2.0]) is known[2.0]
