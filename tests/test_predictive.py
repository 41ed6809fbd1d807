"""Predictions of a linear toy against normal quantiles, and of errors against Monte Carlo written
out.
"""

import numpy as np
import pandas as pd
import pytest
from made_tables import impact_table
from numpy.testing import assert_allclose
from scipy import stats

import fitball
from fitball.inference import predictive
from fitball.inference.forward import Draws, ForwardModel
from fitball.inference.noise import NOISE_KINDS
from fitball.inference.predictive import PredictionRequest, predict_impacts, regime_shares
from fitball.inference.problem.row_errors import row_errors
from fitball.models.own import model_from

COUNT = 20_000
SHARES = {
    "q025": 0.025,
    "q16": 0.16,
    "median": 0.5,
    "q84": 0.84,
    "q975": 0.975,
}
AT = fitball.impacts([10.0, 14.0, 18.0], [8.0, 6.0, 5.0], [0.0, 100.0, -50.0])
SCATTER = {"v_x_sd": 0.4, "v_y_sd": 0.2, "spin_sd": 9.0}
# Of a quantile at 2.5 % of so many normal numbers: four standard errors, in sds.
NEAR = 4.0 * np.sqrt(0.025 * 0.975 / COUNT) / stats.norm.pdf(1.96)


def toy(v_x1, v_y1, omega_1, ball, a="normal(0, 1)", c="normal(0, 9)"):
    product = v_x1 * v_y1
    return product / 10.0 + a, 0.8 * v_y1 + 0.02 * product, omega_1 + c


# What the model gives for v_x2 at AT, without a.
V_X2 = AT.v_x1 * AT.v_y1 / 10.0


def draws(sampled=True):
    """Evenly spread quantiles of a normal a, sd 0.3, and c, sd 5, in random order; the point lies
    elsewhere.
    """
    rng = np.random.default_rng(5)
    even = stats.norm.ppf((np.arange(COUNT) + 0.5) / COUNT)
    point = {"a": 1.1, "c": -2.0, **SCATTER}
    values = {
        "a": 1.0 + 0.3 * rng.permutation(even),
        "c": 5.0 * rng.permutation(even),
    }
    for name, sd in SCATTER.items():
        values[name] = np.full(COUNT, sd)
    if not sampled:
        values = {name: draws[:0] for name, draws in values.items()}
    best = {name: np.array([value]) for name, value in point.items()}
    return Draws(point, values, best)


def predicted(columns, values=None, **choices):
    """Predictions of the toy at AT: a frame for each column."""
    forward = ForwardModel(model_from(toy), NOISE_KINDS["normal"])
    rng = np.random.default_rng(1)
    frame = predict_impacts(
        forward, values or draws(), PredictionRequest(AT, None, columns, **choices), rng
    )
    assert frame["column"].tolist() == np.repeat(columns, len(AT)).tolist()
    assert frame["row"].tolist() == [0, 1, 2] * len(columns)
    frames = {}
    for name, rows in frame.groupby("column"):
        frames[name] = rows.reset_index(drop=True)
    return frames


@pytest.mark.parametrize("stated", [None, 0.3])
def test_quantiles_of_rebounds_and_of_new_measurements(stated):
    seen = np.array([[9.5, 20.0], [8.0, 90.0], [np.nan, -60.0]])
    sds = None
    if stated is not None:
        sds = np.tile([stated, np.nan], (3, 1))
    frame = predicted(("v_x2", "omega_2"), observed=seen, stated=sds)["v_x2"]
    middle = V_X2 + 1.0
    for name, share in SHARES.items():
        wanted = stats.norm.ppf(share, middle, 0.3)
        assert_allclose(frame[name], wanted, atol=1e-3)
    assert_allclose(frame["sd"], 0.3, rtol=1e-3)
    assert_allclose(frame["point"], middle + 0.1, rtol=1e-14)
    noise = np.hypot(0.4, stated or 0.0)
    assert_allclose(frame["noise"], noise, rtol=1e-12)
    assert_allclose(frame["z"], (seen[:, 0] - middle) / noise, atol=1e-3)
    sd = np.hypot(0.3, noise)
    low, high = stats.norm.interval(0.95, middle, sd)
    assert_allclose(frame["new_q025"], low, atol=NEAR * sd)
    assert_allclose(frame["new_q975"], high, atol=NEAR * sd)
    assert frame["solved"].tolist() == [1.0] * 3
    assert frame["reason"].tolist() == [""] * 3


def test_true_rebounds_are_as_uncertain_as_their_misfit_and_new_measurements_no_more():
    columns = ("v_x2", "v_2", "theta_2", "omega_2")
    plain = predicted(columns)
    missed = predicted(columns, misfit={"v_x2": 0.3})
    frame = missed["v_x2"]
    wanted = stats.norm.interval(0.95, V_X2 + 1.0, np.hypot(0.3, 0.3))
    # Of 2,000 pairs of normal numbers the ends are known to a twentieth of an sd.
    assert_allclose(frame["q025"], wanted[0], atol=NEAR * 0.43)
    assert_allclose(frame["q975"], wanted[1], atol=NEAR * 0.43)
    assert_allclose(frame["sd"], np.hypot(0.3, 0.3), rtol=0.05)
    for name in columns:
        for end in ("new_q025", "new_q975", "noise", "point"):
            assert missed[name][end].equals(plain[name][end]), name
    # Speed and angle follow from v_x2; the spin does not.
    for name in ("v_2", "theta_2"):
        assert np.all(missed[name]["sd"] > 1.2 * plain[name]["sd"])
    assert missed["omega_2"].equals(plain["omega_2"])


def test_a_stated_column_without_an_error_has_no_new_measurement():
    sds = np.array([[0.3], [np.nan], [0.3]])
    frame = predicted(("v_x2",), stated=sds)["v_x2"]
    missing = frame[["new_q025", "new_q975", "noise"]].isna()
    assert missing.all(axis=1).tolist() == [False, True, False]
    assert frame["median"].notna().all()


def test_a_point_fit_has_a_point_and_a_deviation():
    seen = np.full((3, 1), 9.0)
    frame = predicted(("v_x2",), draws(sampled=False), observed=seen)["v_x2"]
    for name in ("sd", *SHARES, "new_q025", "new_q975"):
        assert frame[name].isna().all(), name
    assert_allclose(frame["point"], V_X2 + 1.1, rtol=1e-14)
    assert_allclose(frame["z"], (9.0 - frame["point"]) / 0.4, rtol=1e-12)


def ends(numbers):
    """Ends of the interval of 95 %."""
    return np.quantile(numbers, [0.025, 0.975])


def test_errors_of_states_against_monte_carlo_of_their_covariance():
    """What is measured is the truth plus an error; errors of the state and of the rebound belong
    together.
    """
    sds = {
        "v_x1": 0.5,
        "v_y1": 0.4,
        "omega_1": 8.0,
        "v_x2": 0.6,
    }
    corr = {
        ("v_x1", "v_x2"): 0.7,
        ("v_y1", "v_x2"): 0.3,
    }
    columns = {
        "v_x1": AT.v_x1,
        "v_y1": AT.v_y1,
        "omega_1": AT.omega_1,
        "v_x2": [9.0, 9.0, 9.0],
    }
    table = impact_table(columns, sds, corr)
    frame = predicted(("v_x2",), errors=row_errors(table, ("v_x2",)))["v_x2"]
    correlation = np.eye(4)
    correlation[0, 3] = correlation[3, 0] = 0.7
    correlation[1, 3] = correlation[3, 1] = 0.3
    sizes = np.array([*sds.values()])
    covariance = correlation * np.outer(sizes, sizes)
    rng = np.random.default_rng(3)
    for k in range(3):
        errors = rng.multivariate_normal(np.zeros(4), covariance, 200_000)
        v_x1 = AT.v_x1[k] - errors[:, 0]
        v_y1 = AT.v_y1[k] - errors[:, 1]
        true = v_x1 * v_y1 / 10.0
        rebound = true + rng.normal(1.0, 0.3, len(true))
        scatter = rng.normal(0.0, 0.4, len(true))
        new = rebound + errors[:, 3] + scatter
        near = NEAR * new.std()
        assert_allclose(frame.loc[k, ["q025", "q975"]], ends(rebound), atol=near)
        assert_allclose(frame.loc[k, ["new_q025", "new_q975"]], ends(new), atol=near)
        # From 400 states: 4 % of itself, three times.
        noise = (true + errors[:, 3]).std()
        wanted = np.hypot(noise, 0.4)
        assert frame.loc[k, "noise"] == pytest.approx(wanted, rel=0.12)
        # Errors that were independent would give another interval.
        independent = np.hypot(true.std(), 0.6)
        assert abs(independent - noise) > 0.12 * noise


def test_a_column_without_a_scatter_follows_from_noisy_velocities():
    frame = predicted(("v_2", "theta_2"))
    rng = np.random.default_rng(8)

    def angle(v_x, v_y):
        return np.arctan2(v_y, v_x)

    for k in range(3):
        v_x = V_X2[k] + rng.normal(1.0, 0.3, 200_000)
        v_y = 0.8 * AT.v_y1[k] + 0.2 * V_X2[k]
        noisy_x = v_x + rng.normal(0.0, 0.4, v_x.size)
        noisy_y = v_y + rng.normal(0.0, 0.2, v_x.size)
        for name, formula in (("v_2", np.hypot), ("theta_2", angle)):
            noisy = formula(noisy_x, noisy_y)
            row = frame[name].loc[k]
            near = NEAR * noisy.std()
            assert_allclose(row[["new_q025", "new_q975"]].astype(float), ends(noisy), atol=near)
            # A step of one sd along either velocity, not the whole spread.
            noise = (noisy - formula(v_x, v_y)).std()
            assert row["noise"] == pytest.approx(noise, rel=0.05)


def test_blocks_give_what_all_impacts_at_once_give(monkeypatch):
    table = impact_table({"v_x1": AT.v_x1, "v_y1": AT.v_y1}, {"v_x1": 0.3})
    errors = row_errors(table, ("v_x2",))
    at_once = predicted(("v_x2",), errors=errors)
    monkeypatch.setattr(predictive, "_BLOCK", COUNT)
    in_blocks = predicted(("v_x2",), errors=errors)
    # Sums over other shapes round differently.
    pd.testing.assert_frame_equal(in_blocks["v_x2"], at_once["v_x2"], rtol=1e-12)


def test_shares_of_regimes_and_of_answers():
    """A ball slides while mu is less than what rolling takes: a/(1 + a) u/((1 + COR) v_y1)."""
    mu = np.linspace(0.0, 1.0, 4001)
    at = fitball.impacts(20.0, 8.0)
    values = {
        "mu": mu,
        "cor_10": np.where(mu > 0.9, 0.0, 0.75),
        "cor_slope": np.zeros(4001),
    }
    best = {name: draws[1000:1001] for name, draws in values.items()}
    forward = ForwardModel(fitball.model("brody"), NOISE_KINDS["normal"])

    def first_row(values, column):
        rng = np.random.default_rng(1)
        frame = predict_impacts(
            forward, Draws({}, values, best), PredictionRequest(at, None, (column,)), rng
        )
        return frame.iloc[0]

    frame = regime_shares(forward, Draws({}, values, best), PredictionRequest(at, None, ("v_x2",)))
    shares = frame.set_index("regime")["share"]
    least = 0.56 / 1.56 * 20.0 / (1.75 * 8.0)
    assert shares["slide"] == pytest.approx(least / 0.9, abs=1e-3)
    assert shares.sum() == pytest.approx(1.0)
    row = first_row(values, "v_x2")
    assert row["solved"] == pytest.approx(0.9, abs=1e-3)
    assert "cor_10" in row["reason"]
    assert row["regime"] == "slide"
    # What follows from noisy velocities is that of draws with an answer.
    values["v_x_sd"] = np.full(4001, 0.4)
    values["v_y_sd"] = np.full(4001, 0.2)
    answered = {name: draws[mu <= 0.9] for name, draws in values.items()}
    noise_of_all = first_row(values, "theta_2")["noise"]
    noise_of_answered = first_row(answered, "theta_2")["noise"]
    assert noise_of_all == pytest.approx(noise_of_answered, rel=1e-12)
    assert 0.005 < noise_of_all < 0.1
