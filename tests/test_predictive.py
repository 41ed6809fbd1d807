"""Predictions of a linear toy against normal quantiles, and of errors against Monte Carlo written
out.
"""

import numpy as np
import pandas as pd
import pytest
from made_tables import made
from numpy.testing import assert_allclose
from scipy import stats

import fitball
from fitball.inference import predictive
from fitball.inference.forward import Draws, ForwardModel
from fitball.inference.noise import KINDS
from fitball.inference.predictive import Asked, predict, regimes
from fitball.inference.problem.row_errors import row_errors
from fitball.models.own import model_from

COUNT = 20_000
SHARES = [0.025, 0.16, 0.5, 0.84, 0.975]
AT = fitball.impacts([10.0, 14.0, 18.0], [8.0, 6.0, 5.0], [0.0, 100.0, -50.0])
SCATTER = {"v_x_sd": 0.4, "v_y_sd": 0.2, "spin_sd": 9.0}
# Of a quantile at 2.5 % of so many normal numbers: four standard errors, in sds.
NEAR = 4.0 * np.sqrt(0.025 * 0.975 / COUNT) / stats.norm.pdf(1.96)


def toy(v_x1, v_y1, omega_1, ball, a="normal(0, 1)", c="normal(0, 9)"):
    return v_x1 * v_y1 / 10.0 + a, 0.8 * v_y1 + 0.02 * v_x1 * v_y1, omega_1 + c


def draws(sampled=True):
    """Evenly spread quantiles of a normal a, sd 0.3, and c, sd 5, in random order; the point lies
    elsewhere.
    """
    rng = np.random.default_rng(5)
    even = stats.norm.ppf((np.arange(COUNT) + 0.5) / COUNT)
    point = {"a": 1.1, "c": -2.0, **SCATTER}
    values = {"a": 1.0 + 0.3 * rng.permutation(even), "c": 5.0 * rng.permutation(even)}
    values |= {name: np.full(COUNT, sd) for name, sd in SCATTER.items()}
    best = {name: np.array([value]) for name, value in point.items()}
    return Draws(
        point,
        values if sampled else {name: value[:0] for name, value in values.items()},
        best,
    )


def predicted(columns, known=None, **asked):
    forward = ForwardModel(model_from(toy), KINDS["normal"])
    found = predict(
        forward,
        known or draws(),
        Asked(AT, None, columns, **asked),
        np.random.default_rng(1),
    )
    assert found["column"].tolist() == [name for name in columns for _ in range(len(AT))]
    assert found["row"].tolist() == [0, 1, 2] * len(columns)
    return {name: rows.reset_index(drop=True) for name, rows in found.groupby("column")}


@pytest.mark.parametrize("stated", [None, 0.3])
def test_quantiles_of_rebounds_and_of_new_measurements(stated):
    seen = np.array([[9.5, 20.0], [8.0, 90.0], [np.nan, -60.0]])
    sds = None if stated is None else np.column_stack([np.full(3, stated), np.full(3, np.nan)])
    found = predicted(("v_x2", "omega_2"), observed=seen, stated=sds)["v_x2"]
    middle = AT.v_x1 * AT.v_y1 / 10.0 + 1.0
    for name, share in zip(("q025", "q16", "median", "q84", "q975"), SHARES, strict=True):
        assert_allclose(found[name], stats.norm.ppf(share, middle, 0.3), atol=1e-3)
    assert_allclose(found["sd"], 0.3, rtol=1e-3)
    assert_allclose(found["point"], middle + 0.1, rtol=1e-14)
    noise = np.hypot(0.4, stated or 0.0)
    assert_allclose(found["noise"], noise, rtol=1e-12)
    assert_allclose(found["z"], (seen[:, 0] - middle) / noise, atol=1e-3)
    whole = np.hypot(0.3, noise)
    for name, share in (("new_q025", 0.025), ("new_q975", 0.975)):
        assert_allclose(
            found[name],
            stats.norm.ppf(share, middle, whole),
            atol=NEAR * whole,
        )
    assert found["solved"].tolist() == [1.0] * 3
    assert found["reason"].tolist() == [""] * 3


def test_a_stated_column_without_an_error_has_no_new_measurement():
    found = predicted(("v_x2",), stated=np.array([[0.3], [np.nan], [0.3]]))["v_x2"]
    assert found[["new_q025", "new_q975", "noise"]].isna().all(axis=1).tolist() == [
        False,
        True,
        False,
    ]
    assert found["median"].notna().all()


def test_a_point_fit_has_a_point_and_a_deviation():
    found = predicted(("v_x2",), draws(sampled=False), observed=np.full((3, 1), 9.0))["v_x2"]
    assert (
        found[["median", "sd", "q025", "q16", "q84", "q975", "new_q025", "new_q975"]]
        .isna()
        .all(axis=None)
    )
    assert_allclose(found["point"], AT.v_x1 * AT.v_y1 / 10.0 + 1.1, rtol=1e-14)
    assert_allclose(found["z"], (9.0 - found["point"]) / 0.4, rtol=1e-12)


def test_errors_of_states_against_monte_carlo_of_the_whole_covariance():
    """What is measured is the truth plus an error; errors of the state and of the rebound belong
    together.
    """
    sds = {
        "v_x1": 0.5,
        "v_y1": 0.4,
        "omega_1": 8.0,
        "v_x2": 0.6,
    }
    r = {("v_x1", "v_x2"): 0.7, ("v_y1", "v_x2"): 0.3}
    states = {name: getattr(AT, name) for name in ("v_x1", "v_y1", "omega_1")}
    table = made({**states, "v_x2": [9.0, 9.0, 9.0]}, sds, r)
    found = predicted(("v_x2",), errors=row_errors(table, ("v_x2",)))["v_x2"]
    names = [*sds]
    rng = np.random.default_rng(3)
    together = np.diag([sd**2 for sd in sds.values()])
    for (one, other), value in r.items():
        k = names.index(one)
        j = names.index(other)
        together[k, j] = together[j, k] = value * sds[one] * sds[other]
    for k in range(3):
        error = rng.multivariate_normal(np.zeros(4), together, 200_000)
        true = (AT.v_x1[k] - error[:, 0]) * (AT.v_y1[k] - error[:, 1]) / 10.0
        rebound = true + rng.normal(1.0, 0.3, len(true))
        new = rebound + error[:, 3] + rng.normal(0.0, 0.4, len(true))
        size = new.std()
        assert_allclose(
            found.loc[k, ["q025", "q975"]],
            np.quantile(rebound, [0.025, 0.975]),
            atol=NEAR * size,
        )
        assert_allclose(
            found.loc[k, ["new_q025", "new_q975"]],
            np.quantile(new, [0.025, 0.975]),
            atol=NEAR * size,
        )
        # From 400 states: 4 % of itself, three times.
        noise = (true + error[:, 3]).std()
        assert found.loc[k, "noise"] == pytest.approx(np.hypot(noise, 0.4), rel=0.12)
        # Errors that were independent would give another interval.
        assert abs(np.hypot(true.std(), 0.6) - noise) > 0.12 * noise


def test_a_column_without_a_scatter_of_its_own_follows_from_noisy_velocities():
    found = predicted(("v_2", "theta_2"))
    rng = np.random.default_rng(8)
    for k in range(3):
        v_x = AT.v_x1[k] * AT.v_y1[k] / 10.0 + rng.normal(1.0, 0.3, 200_000)
        v_y = 0.8 * AT.v_y1[k] + 0.02 * AT.v_x1[k] * AT.v_y1[k]
        noisy = v_x + rng.normal(0.0, 0.4, v_x.size), v_y + rng.normal(0.0, 0.2, v_x.size)
        for name, formula in (("v_2", np.hypot), ("theta_2", lambda x, y: np.arctan2(y, x))):
            wanted = np.quantile(formula(*noisy), [0.025, 0.975])
            sd = formula(*noisy).std()
            assert_allclose(
                found[name].loc[k, ["new_q025", "new_q975"]],
                wanted,
                atol=NEAR * sd,
            )
            about = (formula(*noisy) - formula(v_x, v_y)).std()
            # A step of one sd along either velocity, not the whole spread.
            assert found[name].loc[k, "noise"] == pytest.approx(about, rel=0.05)


def test_blocks_are_one_piece(monkeypatch):
    asked = {
        "errors": row_errors(made({"v_x1": AT.v_x1, "v_y1": AT.v_y1}, {"v_x1": 0.3}), ("v_x2",))
    }
    whole = predicted(("v_x2",), **asked)["v_x2"]
    monkeypatch.setattr(predictive, "_BLOCK", COUNT)
    # Sums over other shapes round differently.
    pd.testing.assert_frame_equal(predicted(("v_x2",), **asked)["v_x2"], whole, rtol=1e-12)


def test_shares_of_regimes_and_of_answers():
    """A ball slides while mu is less than what rolling takes: a/(1 + a) u/((1 + COR) v_y1)."""
    mu = np.linspace(0.0, 1.0, 4001)
    at = fitball.impacts(20.0, 8.0)
    values = {"mu": mu, "cor_10": np.where(mu > 0.9, 0.0, 0.75), "cor_slope": np.zeros(4001)}
    known = Draws({}, values, {name: value[1000:1001] for name, value in values.items()})
    forward = ForwardModel(fitball.model("brody"), KINDS["normal"])
    found = regimes(forward, known, Asked(at, None, ("v_x2",))).set_index("regime")["share"]
    least = 0.56 / 1.56 * 20.0 / (1.75 * 8.0)
    assert found["slide"] == pytest.approx(least / 0.9, abs=1e-3)
    assert found.sum() == pytest.approx(1.0)
    one = predict(forward, known, Asked(at, None, ("v_x2",)), np.random.default_rng(1)).iloc[0]
    assert one["solved"] == pytest.approx(0.9, abs=1e-3)
    assert "cor_10" in one["reason"]
    assert one["regime"] == "slide"
    # What follows from noisy velocities is that of draws with an answer.
    scatter = {"v_x_sd": np.full(4001, 0.4), "v_y_sd": np.full(4001, 0.2)}
    noises = []
    for kept in (np.arange(4001), np.flatnonzero(mu <= 0.9)):
        some = Draws(
            {},
            {name: value[kept] for name, value in (values | scatter).items()},
            known.best,
        )
        noises.append(
            predict(forward, some, Asked(at, None, ("theta_2",)), np.random.default_rng(1))[
                "noise"
            ][0]
        )
    assert noises[0] == pytest.approx(noises[1], rel=1e-12)
    assert 0.005 < noises[0] < 0.1
