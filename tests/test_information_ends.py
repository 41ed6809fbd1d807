"""Where the model ends there is no derivative: evidence and profiles say so, no error of linear algebra shows."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from samples import TWO_MASS, coordinates_of, hard_sphere, problem_of, synthetic

from fitball.inference import calibrate
from fitball.inference.calibrate import run
from fitball.inference.effort import Effort
from fitball.inference.identifiability.information import (
    eigendirections,
    fisher_information,
    information_evidence,
    inverse,
    standard_errors,
)
from fitball.inference.identifiability.profile_walk import best_top
from fitball.inference.point.gauss_newton import Reached
from fitball.inference.point.least_squares import least_squares
from fitball.inference.point.point_fit import maximum_posterior
from fitball.inference.point.surface import Surface
from fitball.inference.results.evidence import Profiles
from fitball.inference.results.results import Verdict
from fitball.report.fit.document import render
from fitball.report.fit.rows import diagnosis_lines

SLOWEST = 1.9488
# Restitution is all but 1 at the slowest impact, the mass ratio between it and 1: a step down makes it smaller than
# the restitution, a step up leaves a shell of negative mass.
END = {
    "mass_ratio": 1.0 - 1e-7, "k_y": 17414.0, "k_theta": 40.33, "mu": 1.067, "eps_10": -8.2e-5, "eps_slope": -4e-6,
    "cor_10": 0.912, "cor_slope": (1.0 - 1e-6 - 0.912) / (SLOWEST - 10.0), "velocity_sd": 0.06, "spin_sd": 4.58,
}  # fmt: skip


@pytest.fixture
def at_end(tmp_path):
    problem = hard_sphere(tmp_path, "two-mass")
    return problem, coordinates_of(problem, END)


def test_the_information_is_that_of_the_parameters_with_a_derivative(at_end):
    problem, at = at_end
    found = fisher_information(problem, at, scene=True)
    lost = problem.free_names.index("mass_ratio")
    assert np.all(np.isnan(found[lost])) and np.all(np.isnan(found[:, lost]))
    kept = [k for k in range(problem.dimension) if k != lost]
    assert np.all(np.isfinite(found[np.ix_(kept, kept)]))
    errors = standard_errors(found)
    assert np.isnan(errors[lost]) and np.all(errors[kept] > 0.0)
    assert set(problem.free_names) - information_evidence(problem, at).keys() == {"mass_ratio"}
    seen = eigendirections(problem, at)
    assert all("mass_ratio" not in item.components for item in seen.directions)
    assert len(seen.directions) == len(seen.directions_without_scene) == 7
    assert seen.held == ("mass_ratio",)


def test_a_point_where_the_model_ends_is_reported_and_not_a_crash(at_end, monkeypatch, tmp_path):
    problem, _ = at_end
    with monkeypatch.context() as patched:
        stay(patched)
        squares = least_squares(problem, problem.free_rows([END]))
        point = maximum_posterior(problem, problem.free_rows([END]))
    assert point.values["mass_ratio"] == pytest.approx(1.0 - 1e-7, abs=1e-8)
    assert all(np.isfinite(value) for value in squares.stderr.values() if value is not None)
    monkeypatch.setattr(calibrate, "point_fit", lambda *_: (squares, point))
    none = Profiles(point.log_likelihood, False, {}, "they are not what is tested here")
    monkeypatch.setattr(calibrate, "profile_all", lambda *_: (none, none))
    fit = run(problem, Effort(point_only=True, cores=1))
    evidence = fit.identifiability.evidence["mass_ratio"]
    assert evidence.information is None
    assert fit.parameters["mass_ratio"].verdict is Verdict.NOT_JUDGED
    assert "The best value of mass_ratio is at the edge of the model" in " ".join(render(fit, tmp_path).split())
    assert diagnosis_lines(fit)


def test_a_profile_begins_with_finite_steps_where_there_is_no_derivative(at_end):
    problem, _ = at_end
    objective = Surface(problem)
    top, _ = best_top(objective, objective.from_values(problem.free_rows([END])))
    assert np.all(top.errors > 0.0) and np.all(np.isfinite(top.errors))


def test_no_standard_error_comes_from_a_step_out_of_the_model(tmp_path, monkeypatch):
    """Beside a restitution of 1 every residual jumps at once: a slope of that is no knowledge of the line."""
    problem = hard_sphere(tmp_path, "grip-slip")
    wall = {"mu": 0.092, "e_x": 0.38, "offset": 0.0, "velocity_sd": 0.25, "spin_sd": 10.0}
    wall |= {"cor_10": 0.95, "cor_slope": (1.0 - 1e-9 - 0.95) / (SLOWEST - 10.0)}
    stay(monkeypatch)
    found = least_squares(problem, problem.free_rows([wall]))
    for name in ("cor_10", "cor_slope"):
        assert found.stderr[name] is None
        assert found.missing[name].startswith("the model ends next to the best value")
    assert found.stderr["mu"] > 0.01
    inside = least_squares(problem, problem.free_rows([wall | {"cor_slope": -0.005}]))
    assert inside.stderr["cor_10"] > 0.01


def stay(patch):
    """Searches stay where they begin: the fit is that at the end of the model."""
    patch.setattr("fitball.inference.point.least_squares.lmfit.Minimizer", Unmoved)
    for module in ("least_squares", "point_fit"):
        patch.setattr(f"fitball.inference.point.{module}.descend", unmoved)


class Unmoved:
    def __init__(self, residual, parameters, **_):
        self.residual, self.parameters = residual, parameters

    def least_squares(self, **options):
        rows, slopes = self.residual(self.parameters), options["Dfun"](self.parameters)
        return SimpleNamespace(params=self.parameters, chisqr=np.sum(rows**2), nfev=1, jac=slopes)


def unmoved(surface, searches, **_):
    return Reached(searches.x, surface.cost(searches.x, searches.given), np.ones(len(searches.x), dtype=bool))


def test_inverse_of_what_is_blind_or_missing():
    rng = np.random.default_rng(3)
    rows = rng.standard_normal((3, 5))
    blind = rows.T @ rows
    np.testing.assert_allclose(inverse(blind, 0.5), np.linalg.inv(blind + 0.5 * np.eye(5)), rtol=1e-10)
    # Rounding has made this one indefinite by more than the ridge.
    indefinite = 1e12 * blind - 1e-3 * np.eye(5)
    assert np.all(np.diag(inverse(indefinite, 1e-8)) > 0.0)
    missing = blind.copy()
    missing[2] = missing[:, 2] = np.nan
    kept = [0, 1, 3, 4]
    found = inverse(missing, 0.5)
    np.testing.assert_allclose(found[np.ix_(kept, kept)], inverse(blind[np.ix_(kept, kept)], 0.5))
    assert np.all(np.isnan(found[2])) and np.all(np.isnan(found[:, 2]))
    assert np.all(np.isnan(inverse(np.full((2, 2), np.nan), 1.0)))


def test_where_all_derivatives_exist_nothing_is_said_of_ends():
    problem = synthetic(problem_of("wang_zero_spin.csv"), TWO_MASS)
    assert eigendirections(problem, coordinates_of(problem, TWO_MASS)).held == ()
