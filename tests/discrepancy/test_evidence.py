"""Explanations are compared by the evidence of the data: closed forms, invariance, and a planted effect."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.stats import multivariate_normal
from scipy.stats import t as student
from threadpoolctl import threadpool_limits

from looping_pendulum.discrepancy.evidence import prior
from looping_pendulum.discrepancy.evidence.explain import Explanations
from looping_pendulum.discrepancy.evidence.explanation import (
    NOTHING,
    Addition,
    Explanation,
    Parts,
    checked,
    explained,
    fit_addition,
    fit_without,
    raw,
    with_best_prior,
)
from looping_pendulum.discrepancy.evidence.laws import (
    COORDINATES_OF,
    Closure,
    factors_of,
    laws_beside,
    log_share,
    prior_root,
    weighed,
    with_law,
)
from looping_pendulum.discrepancy.evidence.marginal import SETTINGS, Marginal, NoiseGrid, sigma_of
from looping_pendulum.discrepancy.evidence.prior import LENGTHS, RIDGES, VISIBLE
from looping_pendulum.discrepancy.evidence.search import Search, posterior
from looping_pendulum.discrepancy.evidence.templates import (
    _independent_share,
    _standardised,
    _value_of_size,
    columns,
    smallest_visible,
    templates,
)
from looping_pendulum.discrepancy.fit.calibration import MAX_DECREASE, Fit, calibrate, minimise
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.discrepancy.fit.residual_noise import refit_with_estimated_noise
from looping_pendulum.discrepancy.inputs import read_inputs
from looping_pendulum.discrepancy.result import Verdict
from looping_pendulum.discrepancy.verdict import verdict_by_evidence
from looping_pendulum.measured.free_parameter import FreeParameter
from looping_pendulum.measured.study_io import load
from tests.blind.cases import CASES
from tests.discrepancy.blind_sample import BlindStudy, write_files
from tests.discrepancy.blind_study import fit_declared, write_study

DRAG = "light_linear_drag"
OTHERS = ("wind_speed", "side_force", "friction_per_speed", "scale", "clock_offset", "wrong_light_mass")


def read(folder, case, trials=("ten_a", "six")):
    return read_inputs(load(write_study(folder, CASES[case], 3, trials=list(trials))))


@pytest.fixture(scope="module", autouse=True)
def one_thread():
    """As in `identify`: sums by two threads differ in their last digits."""
    with threadpool_limits(1, user_api="blas"):
        yield


def declared(inputs):
    return refit_with_estimated_noise(calibrate(Problem(inputs.study, inputs.training, inputs.free_parameters)))


def predict_all(problem, x):
    return np.concatenate([problem.predict(x, k) for k in range(len(problem.data))])


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


def test_the_evidence_of_a_law_is_that_of_its_weights(base, monkeypatch):
    """Oracle: the model that is linear in the weights, with derivatives by the law itself in place of pulses."""
    monkeypatch.setattr(Fit, "at_bounds", ())  # the closed form is of a fit that may move every parameter
    grid = NoiseGrid(base.problem.data)
    n = grid.count
    m = Marginal(grid, raw(base), settings=[0])
    known = laws_beside(base, grid, 0, raw(base))
    for target, name in (("light mass", "time"), ("heavy mass", "hanging_length"), ("string on rod", "wrap_angle")):
        law = known.law(known.runs.closure(target, name))
        problem = with_law(base.problem, law.closure, law.prior)
        at_null = np.append(base.x, np.zeros(len(law.weights)))
        fit = Fit(problem=problem, x=at_null, residuals=problem.residuals(at_null), final_jacobian=problem.jacobian(at_null))
        np.testing.assert_allclose(
            fit.jacobian[n:], block_diag(base.problem.prior_weights, prior_root(law.closure, law.prior)), atol=1e-9
        )
        whole = Marginal(grid, raw(fit), settings=[0])
        # With its whole step, of which the evidence of a fit believes but a little
        left = whole.gram[0, 0, 0] - MAX_DECREASE - whole.complement[0, 0, 0]
        oracle = whole.log_z_of_settings[0] + 0.5 * max(left, 0.0) - m.log_z_of_settings[0]
        rows = np.column_stack([fit.residuals, fit.jacobian])
        weighing = weighed(fit, law.closure, law.prior, rows.T @ rows)
        by_prior = weighing.log_bayes_factors[LENGTHS.index(law.prior[1]), RIDGES.tolist().index(law.prior[0])]
        assert by_prior == pytest.approx(oracle, abs=0.02 * abs(oracle) + 0.02)
        all_priors = np.logaddexp.reduce(weighing.log_bayes_factors, axis=None) - math.log(weighing.log_bayes_factors.size)
        # pulses are some ms wide
        assert law.log_bayes_factor == pytest.approx(all_priors, abs=0.25 * abs(all_priors) + 0.3), law.closure


def test_a_fitted_law_has_the_same_evidence_wherever_its_prior_began(base):
    """The linear model that begins a fit may be far off in how large and how smooth a law is."""
    grid = NoiseGrid(base.problem.data)
    known = laws_beside(base, grid, 0, raw(base))
    law = max(known.all(), key=lambda law: law.log_bayes_factor)
    parent = explained(grid, base, Parts(), 7, [0])
    found = []
    far = float(RIDGES[min(RIDGES.tolist().index(law.prior[0]) + 12, len(RIDGES) - 1)])
    for prior_of_weights in (law.prior, (far, 0.0)):
        a = Addition(
            parent=parent, templates=(), amounts=(), law=dataclasses.replace(law, prior=prior_of_weights), step=law.step,
            gain=law.log_bayes_factor, decrease=law.decrease, library=7,
        )  # fmt: skip
        found.append(explained(grid, *with_best_prior(fit_addition(a), a.parts), 7, [0]))
    assert found[0].log_z > parent.log_z + 3
    assert found[1].log_z == pytest.approx(found[0].log_z, abs=0.3)


def test_an_effect_beside_a_law_has_the_same_evidence_by_whatever_prior_the_law_was_fitted(base, library):
    """The law kept the prior that it had alone: the right explanation of a study lost 14 nats by that, and was not named."""
    search = Search(base, library)
    known = laws_beside(base, search.grid, 0, raw(base))
    law = known.law(known.runs.closure("light mass", "time"))
    found = []
    far = float(RIDGES[min(RIDGES.tolist().index(law.prior[0]) + 12, len(RIDGES) - 1)])
    for prior_of_weights in (law.prior, (far, 0.0)):
        own = Addition(
            parent=search.fitted[NOTHING], law=dataclasses.replace(law, prior=prior_of_weights), step=law.step,
            gain=law.log_bayes_factor, decrease=law.decrease, library=len(library),
        )  # fmt: skip
        parent = explained(search.grid, fit_addition(own), own.parts, len(library), [0])
        (template,) = templates(parent.fit, [c for c in library if c.name == DRAG], {})
        a = Addition(
            parent=parent, templates=(template,), amounts=(0.1,), step=np.zeros(len(parent.fit.x)), gain=0.0, decrease=0.0,
            library=len(library),
        )  # fmt: skip
        search._add(fit_addition(a), a.parts)
        found.append(search.fitted.pop(a.key))
    assert found[0].parts.prior == found[1].parts.prior
    assert found[1].log_z == pytest.approx(found[0].log_z, abs=0.3)


def test_a_wrong_value_is_less_plausible_the_more_of_its_stated_errors_it_is_off():
    z, log_of = 20.0, math.log(1000.0)
    five, many = (float(prior.log_density(np.array(z), at / z)) for at in (5.0, 28.0))
    # Student's t with 3 degrees of freedom, per standard error of the fit
    assert math.exp(five) == pytest.approx(student(3).pdf(5.0) * 5 / z)
    assert math.exp(many) == pytest.approx(student(3).pdf(28.0) * 28 / z)
    assert float(prior.log_density(np.array(z))) == pytest.approx(-math.log(2 * log_of * z))


class Linear:
    """A problem whose residuals are linear in two parameters and one effect, as `checked` takes it."""

    def __init__(self, distance, low):
        rng = np.random.default_rng(3)
        self.matrix = rng.normal(size=(60, 3))
        self.names = ("mass", "length", DRAG)
        self.free_parameters = [
            FreeParameter(name=n, parameter=n, trials=("one",), init_value=0.0, scale=1.0) for n in self.names
        ]
        covariance = np.linalg.inv(self.matrix.T @ self.matrix)
        self.sigma = math.sqrt(covariance[2, 2])
        self.best = np.array([1.0, -2.0, distance * self.sigma])
        basis = np.linalg.qr(self.matrix)[0]
        noise = rng.normal(size=60)
        self.rest = noise - basis @ (basis.T @ noise)
        self.low, self.high = np.array([-np.inf, -np.inf, low * self.sigma]), np.full(3, np.inf)

    def residuals(self, x):
        return self.rest + self.matrix @ (self.best - x)

    def fit(self):
        return Fit(problem=self, x=self.best, residuals=self.rest, final_jacobian=self.matrix)


@pytest.mark.parametrize(("distance", "low"), [(6.0, -np.inf), (1.2, -np.inf), (1.2, 0.0), (0.0, 0.0)])
@pytest.mark.parametrize("stated", [math.nan, 2.0])
def test_sampling_gives_the_evidence_of_a_prior_and_a_bound(library, distance, low, stated):
    """Oracle: the integral over the effect's value, as the model is linear in all else."""
    problem = Linear(distance, low)
    candidate = dataclasses.replace(library[0], stated_error=stated)
    e = Explanation(parts=Parts(effects=(candidate,)), fit=problem.fit(), log_z=0.0, setting=0, log_prior=0.0)
    found = checked(e, e.fit)
    assert found.checked
    z = np.linspace(max(low, distance - 9), distance + 9, 20001)
    error = problem.sigma / stated

    def log_density(z):
        return np.minimum(prior.log_density(z, error), -0.5 * math.log(2 * math.pi))

    weights = np.exp(-0.5 * (z - distance) ** 2 + log_density(z) - log_density(np.array(distance))) / math.sqrt(2 * math.pi)
    assert found.log_z == pytest.approx(math.log(np.trapezoid(weights, z)), abs=0.12)


def test_the_priors_add_to_one(library):
    count = len(library)
    effects = sum(math.comb(count, k) * math.exp(prior.log_prior(k, count)) for k in range(4))
    closures = [
        Closure(coordinate=name, factor=factor, target=target, first_centre=0.0, spacing=1.0)
        for target, names in COORDINATES_OF.items()
        for name in names
        for factor in factors_of(target)
    ]
    laws = sum(math.comb(count, k) * math.exp(prior.log_prior(k, count, log_share(c))) for c in closures for k in (0, 1))
    assert effects + laws == pytest.approx(1.0, abs=1e-9)


def test_laws_beside_a_fit_from_which_a_law_was_dropped_are_those_beside_any_fit(base):
    """What placed the dropped law placed their pulses, too: none had any evidence, and the right one was never fitted."""
    grid = NoiseGrid(base.problem.data)
    known = laws_beside(base, grid, 0, raw(base))
    law = known.law(known.runs.closure("light mass", "wrap_angle", "across_speed"))
    parent = explained(grid, base, Parts(), 7, [0])
    a = Addition(parent=parent, law=law, step=law.step, gain=law.log_bayes_factor, decrease=law.decrease, library=7)
    dropped = fit_without(explained(grid, fit_addition(a), a.parts, 7, [0]), law.closure.name)
    of_base = Problem(base.problem.study, dropped.problem.data, dropped.problem.free_parameters)
    known = laws_beside(dataclasses.replace(dropped, problem=of_base), grid, 0, raw(dropped))
    left = laws_beside(dropped, grid, 0, raw(dropped))
    for one, other in zip(known.all(), left.all(), strict=True):
        assert one.closure == other.closure
        assert one.log_bayes_factor == pytest.approx(other.log_bayes_factor, abs=1e-6)


def test_a_law_has_no_evidence_that_its_fit_has_not_kept(base):
    """Beside other weights the linear model promised 34 nats: a clean film had a law with probability 1, its fit no better."""
    grid = NoiseGrid(base.problem.data)
    known = laws_beside(base, grid, 0, raw(base))
    law = known.law(known.runs.closure("light mass", "time"))
    too_small = float(RIDGES[0]), law.prior[1]
    problem = with_law(base.problem, law.closure, too_small)
    at_null = np.append(base.x, np.zeros(len(law.weights)))
    fit = Fit(problem=problem, x=at_null, residuals=problem.residuals(at_null), final_jacobian=problem.jacobian(at_null))
    assert law.log_bayes_factor > 10
    whole = explained(grid, fit, Parts(law=law.closure, prior=too_small), 40, settings=[0])
    assert whole.log_z <= Marginal(grid, raw(fit), settings=[0]).log_z + 1e-9


def test_a_planted_effect_is_recovered(search, inputs):
    ranked = posterior(search.fitted)
    assert ranked[0][0] == {DRAG}
    assert ranked[0][1] > prior.CREDIBLE
    assert search.passes(search.best)
    assert sum(p for _, p in ranked) == pytest.approx(1.0)
    value, error = (search.best.fit.values[DRAG], search.best.fit.errors[DRAG])
    assert abs(value - dict(CASES["linear_drag"].effects)["linear_drag"]) < 3 * error


def predicted(monkeypatch, search, inputs, log_odds_of_a_part):
    """What is explained where each part makes the held-out trial so much more probable [log]."""
    inputs = dataclasses.replace(inputs, held_out=((inputs.training[0], ()),))
    monkeypatch.setattr(Explanations, "_log_prediction", lambda self, e: log_odds_of_a_part * len(e.key))
    return Explanations(search, inputs, interrupted=False)


def with_what_does_nothing(search):
    """The best explanation with a further effect, by which no data change."""
    other = next(c for c in search.library if c not in search.best.parts.effects)
    parts = Parts(effects=(*search.best.parts.effects, other))
    return dataclasses.replace(search.best, parts=parts, log_prior=search.best.log_prior - 5.0)


def test_without_what_the_held_out_trial_refuses_the_declared_model_is_not_enough(search, inputs, monkeypatch):
    refused = predicted(monkeypatch, search, inputs, -1.1 * prior.DECISIVE)
    assert refused.credible == (NOTHING,)
    assert verdict_by_evidence(refused) is Verdict.UNEXPLAINED
    test = refused.contradiction
    words = "a drag on the light mass in proportion to its speed (light_linear_drag)"
    assert test.failure == f"the data ask for {words}, which the held-out trials contradict"
    assert not test.passes


def test_with_what_is_refused_goes_what_adds_nothing_that_shows_to_it(search, inputs, monkeypatch):
    """Beside a law, an effect that does nothing would otherwise be named in its place, with the law."""
    inputs = dataclasses.replace(inputs, held_out=((inputs.training[0], ()),))
    monkeypatch.setattr(Explanations, "_log_prediction", lambda self, e: -2 * prior.DECISIVE if e.key == {DRAG} else 0.0)
    whole = with_what_does_nothing(search)
    monkeypatch.setitem(search.fitted, whole.key, whole)
    found = Explanations(search, inputs, interrupted=False)
    assert found.contradicted.key == {DRAG}
    assert not any(DRAG in key for key in found.probabilities)


@pytest.mark.parametrize("log_odds", [-0.9 * prior.DECISIVE, 0.0, 5.0])
def test_what_the_held_out_trial_does_not_contradict_is_decided_by_all_trials(search, inputs, monkeypatch, log_odds):
    named = predicted(monkeypatch, search, inputs, log_odds)
    assert (verdict_by_evidence(named), named.contradiction) == (Verdict.IDENTIFIED, None)


def test_densities_of_the_same_data_say_themselves_how_sure_they_are():
    """That data favour the wrong one of two predictions by a factor k has at most the probability 1 / k: `prior.DECISIVE`."""
    rng = np.random.default_rng(5)
    for distance in (0.5, 1.0, math.sqrt(2 * prior.DECISIVE), 4.0, 8.0):  # of both means, in standard deviations
        log_odds = 0.5 * distance**2 + distance * rng.standard_normal(200_000)
        assert np.mean(log_odds < -prior.DECISIVE) < math.exp(-prior.DECISIVE)


def test_what_adds_too_little_to_be_seen_counts_as_a_part(search):
    whole = with_what_does_nothing(search)
    assert whole.log_posterior < search.best.log_posterior
    alone, ranked = dict(posterior(search.fitted)), dict(posterior(search.fitted | {whole.key: whole}))
    assert ranked.keys() == alone.keys()
    assert ranked[search.best.key] > alone[search.best.key]


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
    found = [t for t in templates(base, library[:3], {}) if not t.finite]
    assert {t.candidate.name for t in found} >= {DRAG, "wind_speed"}
    for t in found:
        problem = base.problem.with_parameters(t.candidate.free_parameter(1.0))
        here, ahead = (predict_all(problem, np.append(base.x, share * t.delta)) for share in (0.0, 0.01))
        used = np.isfinite(np.concatenate([d.sigma for d in problem.data]))
        difference = (ahead - here) / 0.01
        scale = float(np.abs(t.change).max())
        np.testing.assert_allclose(t.change[used], difference[used], atol=0.01 * scale)


def test_what_the_fitted_parameters_imitate_to_first_order_is_looked_at_by_finite_changes(base, inputs, monkeypatch):
    """In films with balls a friction that grows with the wrap angle was so, and never fitted, however large it was."""
    (candidate,) = (c for c in inputs.library if c.name == "friction_per_wrap")
    first_order = templates(base, [candidate], {})
    assert not any(t.finite for t in first_order)
    share = _independent_share(
        np.linalg.qr(base.jacobian)[0], _standardised(first_order[0].change, sigma_of(base.problem.data))
    )
    monkeypatch.setattr("looping_pendulum.discrepancy.evidence.templates.MIN_INDEPENDENT_SHARE", 1.001 * share)
    found = templates(base, [candidate], {})
    assert found
    assert all(t.finite for t in found)


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


def found(change, first, reach, size):
    """Look for a change of a size as templates do; return the value, and every one that was tried with its change."""
    tried = {}

    def made(value):
        size = change(value)
        return None if math.isinf(size) else np.array([size])

    return _value_of_size(made, reach, size, first, tried), {value: c if c is None else c[0] for value, c in tried.items()}


def visible(fit, chosen):
    """Return candidate's name -> its smallest visible size beside a fit."""
    found = templates(fit, chosen, {})
    grid = NoiseGrid(fit.problem.data)
    m = Marginal(grid, raw(fit), columns(found, grid.count), settings=[0])
    return {v.name: v for v in smallest_visible(fit, found, m.complement[0])}


@pytest.mark.parametrize("power", [0.5, 1.0, 2.0, 3.0])
@pytest.mark.parametrize("first", [1e-6, 4.0])
@pytest.mark.parametrize("size", [3.0, 12.0])
def test_sizes_are_met_in_few_steps(power, first, size):
    value, tried = found(lambda value: 40.0 * value**power, first, 5.0, size)
    assert 0.5 < tried[value] / size < 2
    assert len(tried) <= 10


def test_what_does_nothing_up_to_some_value_is_found_beyond_it():
    """A static friction holds a string only from some ratio on."""
    value, tried = found(lambda value: 50.0 * max(value - 0.3, 0.0), 1e-3, 9.0, 3.0)
    assert 1.5 < tried[value] < 6


@pytest.mark.parametrize("first", [1e-6, 1e-3])
def test_below_a_value_that_cannot_run_little_is_tried(first):
    """A string that stretches too little takes more steps than the integrator has: no smaller value would run."""
    value, tried = found(lambda value: 1e5 * value if value > 5e-2 else math.inf, first, 0.1, 3.0)
    assert value in (None, 0.1)  # 0.1: the smallest that was seen to run
    assert len(tried) <= 5
    value, _ = found(lambda value: 1e5 * value if value > 5e-6 else math.inf, 1e-6, 0.1, 3.0)
    assert value > 5e-6


def test_a_change_that_jumps_is_found_where_it_has_jumped():
    """A static friction that holds a string for good."""
    value, _ = found(lambda value: 200.0 if value > 0.07 else 0.0, 1e-3, 9.0, 3.0)
    assert 0.07 < value < 0.2


def test_a_value_that_is_too_large_to_run_does_not_hide_a_smaller_one():
    value, tried = found(lambda value: 50.0 * value if value < 0.2 else math.inf, 1e-6, 5.0, 3.0)
    assert 1.5 < tried[value] < 6


def test_what_is_no_more_probable_than_nothing_adds_to_it_no_more_than_its_own():
    """Many that are hardly less probable than the one before must not make the least of them the best in the end."""

    class Named:
        def __init__(self, log_posterior):
            self.log_posterior = log_posterior

    logs = {frozenset(): -8.0, frozenset({"best"}): 0.0} | {frozenset({str(i)}): -8.2 + 0.2 * i for i in range(20)}
    ranked = dict(posterior({key: Named(log) for key, log in logs.items()}))
    total = sum(math.exp(log) for log in logs.values())
    assert ranked[frozenset()] == pytest.approx((math.exp(-8.0) + math.exp(-8.2)) / total, rel=0.9)
    assert ranked[frozenset({"best"})] == pytest.approx(1 / total)


def test_the_reach_is_taken_if_something_changes_there():
    assert found(lambda value: 0.2 * value, 1e-3, 0.5, 3.0)[0] == 0.5
    assert found(lambda value: 0.01 * value, 1e-3, 0.5, 3.0)[0] is None


def test_a_push_out_of_the_plane_counts_by_its_square(tmp_path):
    inputs, fit = fit_declared(write_study(tmp_path, CASES["clean"], 0, trials=["ten_a"]))
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
    inputs, fit = fit_declared(write_study(tmp_path, CASES["clean"], 0, trials=["ten_a"]))
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
    inputs, fit = fit_declared(write_files(study, tmp_path))
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
    inputs, fit = fit_declared(write_study(tmp_path, CASES["clean"], 2))
    found = visible(fit, [c for c in inputs.library if c.name in CHOSEN])
    assert set(found) == set(CHOSEN)
    for candidate in (c for c in inputs.library if c.name in CHOSEN):
        name, v = candidate.name, found[candidate.name]
        own = dataclasses.replace(candidate.free_parameter(v.value), prior=1e3)  # the data alone say how large it is
        fitted = minimise(fit.problem.with_parameters(own), np.append(fit.x, 0.0))
        assert v.value == pytest.approx(VISIBLE * fitted.errors[name], rel=0.1), name
