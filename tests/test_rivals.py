"""Models of another kind that predict as well, and new measurements of balls that are not ours."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import fitball
from fitball.data.read import load_table
from fitball.data.scene import Scene
from fitball.inference.judgement.rivals import rivals
from fitball.inference.problem.build import build_problem
from fitball.inference.problem.problem import Choices
from fitball.inference.search.best_fit import best_fit

DATA = Path(__file__).parent / "data"


def impacts_of(e_x, count, seed=5, noise=0.2):
    """A table of a rigid ball with this tangential restitution."""
    rng = np.random.default_rng(seed)
    speed = rng.uniform(12.0, 28.0, count)
    angle = np.radians(rng.uniform(20.0, 70.0, count))
    spin = rng.uniform(-200.0, 200.0, count)
    states = fitball.impacts(speed * np.cos(angle), speed * np.sin(angle), spin)
    truth = {"mu": 0.6, "e_x": e_x, "offset": 0.0, "cor_10": 0.76, "cor_slope": -0.012}
    after = fitball.model("grip-slip").rebound(truth, states)
    columns = {"v_x1": states.v_x1, "v_y1": states.v_y1, "omega_1": states.omega_1}
    for name, sd in (("v_x2", noise), ("v_y2", noise), ("omega_2", 40.0 * noise)):
        columns[name] = getattr(after, name) + sd * rng.standard_normal(count)
    return pd.DataFrame(columns)


def names_of_rivals(frame, model):
    problem = build_problem(load_table(frame), Scene(), Choices(model))
    rng = np.random.default_rng(2)
    found = rivals(problem, best_fit(problem, rng), rng)
    for rival in found:
        assert rival.score is None or rival.score > -20.0
        assert rival.values["cor_10"][0] == pytest.approx(0.76, abs=0.05)
    return {rival.forward.model.name for rival in found}


def test_rivals_are_models_that_the_data_do_not_exclude():
    # A ball that rolls is all models' ball; one whose slip is reversed by half is not Brody's.
    assert "brody" in names_of_rivals(impacts_of(0.0, 12), "grip-slip")
    reversed_slip = names_of_rivals(impacts_of(0.5, 40), "grip-slip")
    assert "brody" not in reversed_slip
    assert "grip-slip" not in reversed_slip


def test_a_function_of_the_user_has_no_rivals():
    def ball(v_x1, v_y1, omega_1, ball, cor_10="normal(0.75, 0.1)"):
        return v_x1, cor_10 * v_y1, omega_1

    model = fitball.model_from(ball)
    problem = build_problem(
        load_table(impacts_of(0.1, 8)),
        Scene(),
        Choices(model.text),
        model,
    )
    rng = np.random.default_rng(2)
    assert rivals(problem, best_fit(problem, rng), rng) == ()


def test_models_without_a_time_axis_are_no_rivals_where_times_were_measured():
    frame = impacts_of(0.1, 10).assign(contact_time=0.005)
    frame["contact_time"] += 1e-4 * np.sin(np.arange(10))
    assert not {"grip-slip", "brody"} & names_of_rivals(frame, "two-mass")


def test_new_measurements_of_a_soft_ball_are_as_uncertain_as_intervals_say():
    """20 impacts of a Hunt-Crossley ball with a tangential spring, which the two-mass ball
    describes with less than their errors of 0.4 m/s and 15 rad/s, and 200 new ones. By the two-mass
    ball alone 95 % intervals of spins hold 62 %.
    """
    fit = fitball.calibrate(DATA / "hunt_crossley.csv", cores=1)
    frame = fit.predict(DATA / "hunt_crossley_new.csv").frames["predictions"]
    inside = frame[frame["observed"].notna() & ~frame["outside"].astype(bool)]
    holds = inside["observed"].between(inside["new_q025"], inside["new_q975"])
    shares = holds.groupby(inside["column"]).mean()
    assert 0.9 <= holds.mean() <= 0.98
    assert shares["omega_2"] >= 0.9
    assert shares.min() >= 0.85
    assert "thesis-exact" in {rival.forward.model.name for rival in fit.rivals}
