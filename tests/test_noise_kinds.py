"""Kinds of noise: each against scipy, and a new one that is registered here and goes all the way through a fit."""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace
from importlib.resources import files

import numpy as np
import pytest
from samples import restored
from scipy import integrate, stats
from scipy.special import gamma, gammaln

import fitball
from fitball.cli.main import main
from fitball.data.read import load_table
from fitball.data.scene import Scene
from fitball.errors import ParameterError
from fitball.inference.identifiability.information import fisher_information, information_evidence
from fitball.inference.likelihood.cells import prediction_slopes
from fitball.inference.likelihood.posterior import log_likelihood, log_posterior
from fitball.inference.likelihood.residuals import Weighting, default_noise, residuals
from fitball.inference.prediction.new_impacts import predict_new
from fitball.inference.prediction.posterior_predictive import with_noise
from fitball.inference.problem import noise, parameters
from fitball.inference.problem.build import Choices, build_problem
from fitball.inference.problem.noise import KINDS, NORMAL, NoiseKind, noise_with
from fitball.models.specs import ParameterSpec
from fitball.report.fit.folder import prepare_folder, write_all
from fitball.report.saved.fit_file import read_fit

STUDENT = KINDS["student-t"]
EXPONENT = "noise_exponent"


class ExponentialPower(NoiseKind):
    """exp(-|z|^b) but for a constant: b = 1 is Laplace's distribution."""

    name = "exponential-power"
    parameters = (ParameterSpec(EXPONENT, "", 0.6, 4.0, "lognormal(1, 0.3)", "exponent of the noise", r"$b$"),)

    def log_density(self, z, sizes):
        b = np.asarray(sizes[EXPONENT])[..., None]
        return np.log(0.5 * b) - gammaln(1.0 / b) - np.abs(z) ** b

    def draw(self, rng, shape, sizes):
        b = np.broadcast_to(np.asarray(sizes[EXPONENT])[..., None], shape)
        return rng.choice([-1.0, 1.0], shape) * rng.gamma(1.0 / b) ** (1.0 / b)

    def information(self, sizes):
        b = np.asarray(sizes[EXPONENT])
        return b**2 * gamma(2.0 - 1.0 / b) / gamma(1.0 / b)


TOY = ExponentialPower()
CASES = {
    "normal": (NORMAL, {}, stats.norm()),
    "Student": (STUDENT, {"degrees_of_freedom": 3.0}, stats.t(3.0)),
    "Laplace": (TOY, {EXPONENT: 1.0}, stats.laplace()),
    "between": (TOY, {EXPONENT: 1.5}, stats.gennorm(1.5)),
}


@pytest.mark.parametrize("case", CASES)
def test_every_kind_is_scipys(case):
    kind, sizes, expected = CASES[case]
    z = np.linspace(-9.0, 9.0, 41)
    np.testing.assert_allclose(kind.log_density(z, sizes), expected.logpdf(z), rtol=1e-12)
    squares = -2.0 * (expected.logpdf(z) - expected.logpdf(0.0))
    np.testing.assert_allclose(kind.residual(z, sizes) ** 2, squares, rtol=1e-10, atol=1e-12)
    assert (np.sign(kind.residual(z, sizes)) == np.sign(z)).all()
    drawn = kind.draw(np.random.default_rng(1), (1, 20_000), sizes)[0]
    assert stats.kstest(drawn, expected.cdf).pvalue > 0.01

    def score(x):
        step = 1e-5
        slope = (expected.logpdf(x + step) - expected.logpdf(x - step)) / (2.0 * step)
        return slope**2 * expected.pdf(x)

    known = 2.0 * integrate.quad(score, 1e-4, 40.0, limit=400, points=[1.0, 5.0])[0]
    assert kind.information(sizes) == pytest.approx(known, rel=1e-3)


@pytest.mark.parametrize("case", ["normal", "Student", "between"])
def test_a_deviation_tells_of_scale_and_shape_what_its_density_says(case):
    """The covariance of the slopes of the log density, by quadrature."""
    kind, sizes, expected = CASES[case]
    step = 1e-4
    grid = np.sinh(np.linspace(-14.0, 14.0, 40_001))[None]
    moved = [{name: np.array([value + side * step]) for name, value in sizes.items()} for side in (1.0, -1.0)]
    known = {name: np.array([value]) for name, value in sizes.items()}
    ends = [[kind.log_density(grid * np.exp(-side * step), known)[0] - side * step for side in (1.0, -1.0)]]
    ends += [[kind.log_density(grid, one)[0] for one in moved]] if sizes else []
    slopes = np.array([(up - down) / (2.0 * step) for up, down in ends])
    exact = np.trapezoid(slopes[:, None] * slopes * expected.pdf(grid[0]), grid[0])
    np.testing.assert_allclose(kind.shape_information(sizes), exact, rtol=0.06 if kind is TOY else 1e-4)


def test_heavy_tails_tell_of_scale_and_shape_in_a_table():
    """What a table says of noise is what its deviations say, in widths of the priors: it is not left to the prior."""
    problem = build_problem(load_table("wang_zero_spin.csv"), Scene(), Choices(model="grip-slip", noise="student-t"))
    names = ["velocity_sd", "spin_sd", "degrees_of_freedom"]
    sizes = {**default_noise(problem), "degrees_of_freedom": 3.0}
    values = np.array([[sizes.get(item.name, item.prior.quantile(np.array([0.5]))[0]) for item in problem.free]])
    places = [problem.free_names.index(name) for name in names]
    found = fisher_information(problem, problem.to_coordinates(values)[0], scene=False)[np.ix_(places, places)]
    # Seven impacts of three columns, two of which share a noise; of nu the logarithm is fitted.
    told = STUDENT.shape_information({"degrees_of_freedom": 3.0})
    rates = [np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 3.0]]), np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 3.0]])]
    expected = sum(count * rate.T @ told @ rate for count, rate in zip((14, 7), rates, strict=True))
    width = problem.prior.width[places]
    np.testing.assert_allclose(found, expected * np.outer(width, width), rtol=1e-9, atol=1e-12)
    assert information_evidence(problem, problem.to_coordinates(values)[0])["degrees_of_freedom"].contraction > 0.5


def test_each_kind_is_known_by_a_parameter_of_its_own_and_named_to_the_user(capsys):
    own = [spec.name for kind in KINDS.values() for spec in kind.parameters]
    assert len(set(own)) == len(own)
    assert [name for name, kind in KINDS.items() if not kind.parameters] == ["normal"]
    for name, kind in KINDS.items():
        assert kind.name == name
        assert noise_with(["mu", "v_x_sd", *(spec.name for spec in kind.parameters)]) is kind
    schema = json.loads((files("fitball.data") / "scene.schema.json").read_text("utf-8"))
    said = schema["properties"]["measurement"]["properties"]["distribution"]["description"]
    with pytest.raises(SystemExit):
        main(["calibrate", "--help"])
    helped = capsys.readouterr().out
    for name in KINDS:
        assert name in said
        assert name in helped
    with pytest.raises(ParameterError, match="student-t"):
        build_problem(load_table("wang_all.csv"), Scene(), Choices(noise="student"))


def test_everything_asks_the_problem_for_its_kind():
    """The same problem with its kind exchanged: residuals, sensitivities and draws are those of the kind."""
    choices = Choices(model="grip-slip", noise="student-t", fix={"degrees_of_freedom": 4.0})
    problem = build_problem(load_table("wang_zero_spin.csv"), Scene(), choices)
    plain = replace(problem, noise=NORMAL)
    values = np.array([[item.prior.quantile(np.array([0.5]))[0] for item in problem.free]])
    sizes = default_noise(problem)
    measured = sum(item.observed.size for item in problem.observables)
    for penalised, kind in ((True, STUDENT), (False, NORMAL)):
        z, found = (residuals(one, values, Weighting(sizes, penalised))[0, :measured] for one in (plain, problem))
        np.testing.assert_allclose(found, kind.residual(z, sizes), rtol=1e-12)
    at = problem.to_coordinates(values)
    worth = np.sqrt(5.0 / 7.0)
    np.testing.assert_allclose(prediction_slopes(problem, at), worth * prediction_slopes(plain, at), rtol=1e-12)
    observable, columns = problem.observables[0], problem.all_values(values)
    rebound = problem.rebound(values)
    centre, sd, data = with_noise(STUDENT, observable, columns, rebound, np.random.default_rng(2))
    drawn = STUDENT.draw(np.random.default_rng(2), centre.shape, columns)
    np.testing.assert_allclose((data - centre) / sd, drawn, rtol=1e-9)


@pytest.fixture
def registered(monkeypatch):
    monkeypatch.setitem(noise.KINDS, TOY.name, TOY)
    monkeypatch.setitem(parameters.NOISE_SPECS, EXPONENT, TOY.parameters[0])


@pytest.mark.usefixtures("registered")
def test_the_likelihood_of_a_new_kind_written_out():
    table = load_table("wang_all.csv")
    problem = build_problem(table, Scene(), Choices(model="grip-slip", noise=TOY.name))
    values = np.array([[item.prior.quantile(np.array([p]))[0] for item in problem.free] for p in (0.45, 0.5)])
    columns, rebound = problem.all_values(values), problem.rebound(values)
    expected = np.zeros(2)
    for name, size in (("v_x2", "v_x_sd"), ("v_y2", "v_y_sd"), ("omega_2", "spin_sd")):
        for k in range(2):
            law = stats.gennorm(columns[EXPONENT][k], getattr(rebound, name)[k], columns[size][k])
            expected[k] += law.logpdf(table.measurement(name).values).sum()
    np.testing.assert_allclose(log_likelihood(problem, values, rebound), expected, rtol=1e-10)


@pytest.mark.slow
@pytest.mark.usefixtures("registered")
def test_a_new_kind_goes_through_point_fit_sampling_prediction_and_files(tmp_path):
    fit = fitball.calibrate("wang_zero_spin.csv", "grip-slip", noise=TOY.name, seed=3, max_steps=150, cores=1)
    at = fit.problem.to_coordinates(np.array([[fit.point.values[name] for name in fit.problem.free_names]]))
    steps = np.concatenate([s * 0.03 * np.diag(fit.problem.prior.width) for s in (1.0, -1.0)])
    assert (log_posterior(fit.problem, at + steps) < log_posterior(fit.problem, at)).all()
    exponent = fit.parameters[EXPONENT]
    assert 0.6 <= exponent.q025 < exponent.q975 <= 4.0
    assert not fit.identifiability.profiles_missing
    assert fit.identifiability.evidence[EXPONENT].profile is not None
    prepare_folder(tmp_path / "fit", overwrite=False, resume=False)
    write_all(fit, tmp_path / "fit")
    run = tomllib.loads((tmp_path / "fit" / "run.toml").read_text("utf-8"))
    assert run["measurement"]["distribution"] == TOY.name
    saved = read_fit(tmp_path / "fit")
    assert saved.fitted.noise is TOY
    assert restored(tmp_path / "fit").problem.noise is TOY
    found = predict_new(saved.fitted, fitball.impacts([14.0], [6.0], [0.0])).output("v_x2")
    low, high = found.measured[0, 0], found.measured[4, 0]
    assert low < found.rebound[0, 0] < found.rebound[4, 0] < high
