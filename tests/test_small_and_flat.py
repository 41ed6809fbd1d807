"""Tables that show little: two rows, a parameter that vanishes, optima met twice, no spin, a drop test."""

from __future__ import annotations

import json

import numpy as np
import pytest
from samples import problem_of

from fitball.cli.main import main
from fitball.data.read import load_table
from fitball.inference.calibrate import run
from fitball.inference.effort import Effort
from fitball.inference.point.gauss_newton import SAME_OPTIMUM
from fitball.inference.point.least_squares import least_squares
from fitball.inference.point.point_fit import Candidate, _best_of, maximum_posterior, starting_points
from fitball.inference.prediction.posterior_predictive import predictive
from fitball.inference.results.results import PointFit, Posterior
from fitball.report.saved.fit_file import fit_text

HEAD = "id,v_x1 [m/s],v_y1 [m/s],omega_1 [rpm],v_x2 [m/s],v_y2 [m/s],omega_2 [rpm]"
TWO = f"{HEAD}\na,16.0,5.0,0,11.5,4.1,2400\nb,15.0,7.5,50,8.9,6.0,2700\n"
NO_SPIN = """id,v_x1,v_y1,v_x2,v_y2
a,16.0,5.0,11.5,4.1
b,15.0,7.5,8.9,6.0
c,13.0,10.0,7.6,7.6
d,10.0,13.0,5.6,9.5
e,6.0,15.0,2.9,10.6
f,12.0,9.0,7.4,7.1
"""
DROP = "v_y1,v_y2\n3,2.5\n5,4.1\n7,5.4\n9,6.8\n11,8.0\n13,9.3\n"


def test_two_impacts_are_fitted_and_mostly_the_priors_speak(tmp_path, monkeypatch):
    """Six measurements, eight parameters of the ball: the priors make it regular."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "two.csv").write_text(TWO, encoding="utf-8")
    problem = problem_of("two.csv")
    squares = least_squares(problem, starting_points(problem, np.random.default_rng(1), 2))
    assert squares.degrees_of_freedom < 0
    assert squares.stderr["mu"] is None
    assert "cannot determine" in squares.missing["mu"]
    point = maximum_posterior(problem, starting_points(problem, np.random.default_rng(1), 4))
    assert np.isfinite(point.log_posterior)
    # Too short to converge: walkers sit, and their draws are tied.
    found = run(problem, Effort(max_steps=500, walkers=22, ensembles=2, cores=1))
    assert len(np.unique(found.posterior.draws, axis=0)) < len(found.posterior.draws) / 4
    # Its JSON has no room for what is not a number.
    powers = [item["power"] for item in json.loads(fit_text(found))["identifiability"]["evidence"].values()]
    assert all(item["likelihood"] > 0.0 for item in powers)
    # How far draws that are tied contract is chance, but far it is not.
    contraction = {item.name: item.contraction for item in found.estimates}
    assert all(contraction[name] < 0.5 for name in ("k_y", "k_theta", "velocity_sd", "spin_sd"))


def test_one_impact_is_refused_in_words(tmp_path, capsys):
    (tmp_path / "one.csv").write_text("\n".join(TWO.splitlines()[:2]), encoding="utf-8")
    assert main(["calibrate", str(tmp_path / "one.csv")]) == 2
    assert "at least 2 impacts" in capsys.readouterr().err


def test_a_vanishing_parameter_keeps_a_logarithm():
    """Sliding balls whose slip gains nothing from damping: least squares sends it to zero."""
    problem = problem_of("wang_backspin.csv", closures={"torsion": "free"})
    starts = starting_points(problem, np.random.default_rng(2), 1)
    column = problem.free_names.index("zeta_theta")
    starts[:, column] = 5e-324
    found = least_squares(problem, starts)
    values = np.array([[item[name] for name in problem.free_names] for item in found.optima])
    assert np.all(np.isfinite(problem.to_coordinates(values)))
    assert np.all(values[:, column] >= 0.99e-12 * 0.5)
    assert np.isfinite(maximum_posterior(problem, values[:1]).log_posterior)


@pytest.mark.parametrize("table", ["wang_topspin.csv", "wang_all.csv"])
def test_no_optimum_is_kept_twice(table):
    problem = problem_of(table)
    starts = starting_points(problem, np.random.default_rng(1), 6)
    found = maximum_posterior(problem, starts)
    values = np.array([[item[name] for name in problem.free_names] for item in found.optima])
    at = problem.to_coordinates(values) / problem.prior.width
    gaps = [np.max(np.abs(at[i] - at[j])) for i in range(len(at)) for j in range(i)]
    assert all(gap > SAME_OPTIMUM for gap in gaps)
    assert list(found.optima_log_posterior) == sorted(found.optima_log_posterior, reverse=True)


def test_vertical_motion_alone_has_no_contact_to_name():
    """Balls that come at an angle, of which v_y2 alone was measured: nothing is known of slip or grip."""
    table = load_table({"v_x1": [9.0, 7.0, 5.0], "v_y1": [5.0, 8.0, 11.0], "v_y2": [4.0, 6.0, 8.0]})
    problem = problem_of(table, "grip-slip")
    row = np.array([[0.75, -0.01, 0.1]])
    assert problem.free_names == ("cor_10", "cor_slope", "velocity_sd")
    values = dict(zip(problem.free_names, row[0].tolist(), strict=True))
    point = PointFit(values, 0.0, 0.0, {}, problem.rebound(row), (values,), (0.0,))
    posterior = Posterior(problem.free_names, np.repeat(row, 20, axis=0)[None, :, None], np.zeros((1, 20, 1)), row)
    assert predictive(problem, point, posterior, np.random.default_rng(1)).regimes == ({"": 1.0},) * 3


def test_distinct_optima_are_all_kept():
    problem = problem_of("wang_zero_spin.csv", model="grip-slip")
    best = maximum_posterior(problem, starting_points(problem, np.random.default_rng(1), 2))
    at = problem.to_coordinates(np.array([[best.values[name] for name in problem.free_names]]))[0]

    def candidate(move, below):
        moved = at.copy()
        moved[0] += move * problem.prior.width[0]
        return Candidate(best.log_posterior - below, moved, settled=True)

    items = [candidate(0.0, 0.0), candidate(1e-4, 0.1), candidate(0.1, 0.2), candidate(0.1005, 0.3)]
    found = _best_of(problem, items)
    mu = [item["mu"] for item in found.optima]
    assert mu == pytest.approx([best.values["mu"], best.values["mu"] + 0.1 * problem.prior.width[0]], rel=1e-4)


@pytest.mark.parametrize(
    ("text", "models", "left_out", "scored"),
    [
        (NO_SPIN, "brody,two-mass+cor=mean", "theta_2", ["v_x2", "v_y2"]),
        (DROP, "two-mass,two-mass+cor=mean", "v_y2", ["v_y2"]),
    ],
)
def test_compare_without_spin_and_of_a_drop_test(
    tmp_path, monkeypatch, capsys, brief, text, models, left_out, scored
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "table.csv").write_text(text, encoding="utf-8")
    words = ["compare", "table.csv", "--quick", "--cores", "1", "--max-steps", "100", "--models", models]
    # The chains are too short to converge: what is tested is that all is told.
    assert main(words) == 1
    out, err = capsys.readouterr()
    assert f"scored by {', '.join(scored)}" in out
    assert "Traceback" not in err
    content = json.loads((tmp_path / "fits/table/compare/compare.json").read_text(encoding="utf-8"))
    assert {item["name"] for item in content["models"]} == set(models.split(","))
    assert content["scored_columns"] == scored
    assert all(np.isfinite(item["elpd"]) for item in content["models"])
    assert left_out in content["models"][0]["left_out"][0]["rms"]
    best, other = content["models"]
    # Both tables have a restitution that falls with speed: one number for it predicts worse.
    assert "cor=mean" in other["name"]
    assert other["elpd"] < best["elpd"]
