"""Tables without spins: incident spins are unknown, not zero, and what was measured is used."""

import numpy as np
import pandas as pd
import pytest

import fitball
from fitball.data.balances import impact_balances
from fitball.data.read import load_table
from fitball.data.scene import Scene
from fitball.data.table import UNKNOWN_SPIN_SD
from fitball.inference.problem.build import build_problem
from fitball.inference.problem.problem import Choices
from fitball.inference.search.best_fit import best_fit
from fitball.report import fit_page
from fitball.report.render import to_text

TRUTH = {"mu": 0.6, "e_x": 0.1, "offset": 0.0, "cor_10": 0.76, "cor_slope": -0.012}


def spinless(spin_sd, count=30, measured=("v_x2", "v_y2"), **more):
    """Impacts with spins of this sd [rad/s], which nobody measured, and errors of 0.2 m/s, or 5
    rad/s.
    """
    rng = np.random.default_rng(4)
    speed = rng.uniform(12.0, 28.0, count)
    angle = np.radians(rng.uniform(20.0, 65.0, count))
    states = fitball.impacts(
        speed * np.cos(angle),
        speed * np.sin(angle),
        spin_sd * rng.standard_normal(count),
    )
    after = fitball.model("grip-slip").rebound(TRUTH, states)
    columns = {"v_x1": states.v_x1, "v_y1": states.v_y1}
    for name in measured:
        size = 5.0 if name == "omega_2" else 0.2
        columns[name] = getattr(after, name) + size * rng.standard_normal(count)
    return pd.DataFrame({**columns, **more})


def problem_of(frame, model=""):
    return build_problem(load_table(frame), Scene(), Choices(model))


def scatter_of(frame):
    """The scatter [m/s] of v_x2 at the best fit of a rigid ball."""
    problem = problem_of(frame, "grip-slip")
    return best_fit(problem, np.random.default_rng(1)).optima[0]["v_x_sd"]


def test_unknown_spins_are_no_scatter_of_the_measurement():
    frame = spinless(UNKNOWN_SPIN_SD)
    assert scatter_of(frame) == pytest.approx(0.2, rel=0.6)
    # As if they were known to be zero they are: R omega a/(1 + a) is 1.2 m/s.
    assert scatter_of(frame.assign(omega_1=0.0)) > 0.7


def test_a_column_of_zeros_says_that_balls_had_no_spin():
    frame = spinless(0.0)
    unknown = problem_of(frame)
    known = problem_of(frame.assign(omega_1=0.0))
    assert known.rows.errors is None
    spins = unknown.rows.errors.axes[:, 2, :]
    assert np.linalg.norm(spins, axis=1) == pytest.approx(UNKNOWN_SPIN_SD)
    assert np.count_nonzero(unknown.rows.errors.axes) == len(frame)
    assert "no-spin" in {note.code for note in unknown.notes}
    assert "no-spin" not in {note.code for note in known.notes}
    # Drops have no spins to know.
    drops = {"v_y1": [7.0, 7.1, 7.0], "v_y2": [5.2, 5.25, 5.19]}
    assert problem_of(pd.DataFrame(drops)).rows.errors is None


def test_gaps_without_spins_are_fitted_by_a_model_with_a_time_axis():
    """The stiffness follows from the time of the contact, whatever the spin."""
    frame = spinless(50.0, gap_time=np.full(30, 0.0045))
    problem = problem_of(frame)
    assert problem.forward.model.name == "two-mass"
    columns = {observable.column.name for observable in problem.observables}
    assert columns == {"v_x2", "v_y2", "gap_time"}
    # The offset moves what a gripping ball does along the court, too.
    assert {"k_y", "k_theta", "eps_10"} <= {*problem.free}
    assert "unused-column" not in {note.code for note in problem.notes}
    # Without times nothing needs such a model.
    untimed = frame.drop(columns="gap_time")
    assert problem_of(untimed).forward.model.name == "brody"
    assert "eps_10" not in problem_of(untimed, "two-mass").free


@pytest.mark.parametrize("measured", [("v_x2", "v_y2"), ("v_x2", "v_y2", "omega_2")])
def test_predictions_of_a_fit_without_incident_spins_have_unknown_ones_too(measured):
    frame = spinless(UNKNOWN_SPIN_SD, measured=measured)
    fit = fitball.calibrate(frame, model="grip-slip", point_only=True)
    first_screen = " ".join(to_text(fit_page.report(fit), full=False).split())
    assert f"0 ± {UNKNOWN_SPIN_SD:.0f} rad/s" in first_screen
    steep = {"v_x1": [8.0], "v_y1": [18.0]}
    unknown = fit.predict(steep).frames["predictions"].set_index("column")
    known = fit.predict({**steep, "omega_1": [0.0]}).frames["predictions"].set_index("column")
    rolling = UNKNOWN_SPIN_SD * 0.03302 * 0.56 / 1.56
    assert unknown["noise"]["v_x2"] > 0.8 * rolling
    assert known["noise"]["v_x2"] < 0.5 * rolling


def test_incident_spins_are_unknown_beside_measured_rebound_spins_too():
    frame = spinless(UNKNOWN_SPIN_SD, measured=("v_x2", "v_y2", "omega_2"))
    unknown = problem_of(frame)
    spins = unknown.rows.errors.axes[:, 2, :]
    assert np.linalg.norm(spins, axis=1) == pytest.approx(UNKNOWN_SPIN_SD)
    assert "no-incident-spin" in {note.code for note in unknown.notes}
    # Measured rebound spins show what else none would.
    assert {"eps_10", "k_theta", "spin_sd"} <= {*unknown.free}
    known = problem_of(frame.assign(omega_1=0.0))
    assert known.rows.errors is None
    assert "no-incident-spin" not in {note.code for note in known.notes}
    assert scatter_of(frame) == pytest.approx(0.2, rel=0.6)
    assert scatter_of(frame.assign(omega_1=0.0)) > 0.7


def test_balances_have_the_error_of_an_unknown_incident_spin():
    """The offset by angular momentum contains I omega_1/(M (v_y1 + v_y2))."""
    frame = spinless(0.0, measured=("v_x2", "v_y2", "omega_2"))
    ball = Scene().ball_value()
    exact = dict.fromkeys(frame, 1e-9)
    unknown = impact_balances(load_table(frame), ball, exact)
    known = impact_balances(load_table(frame.assign(omega_1=0.0)), ball, exact)
    assert unknown["offset [m]"].to_numpy() == pytest.approx(known["offset [m]"].to_numpy())
    normal = frame["v_y1"] + frame["v_y2"]
    moved = ball.inertia_ratio * ball.radius**2 * UNKNOWN_SPIN_SD / normal
    assert unknown["offset_sd [m]"].to_numpy() == pytest.approx(moved.to_numpy(), rel=1e-4)
    assert known["offset_sd [m]"].max() < 1e-6
