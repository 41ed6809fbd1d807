"""Values at levels: their prior against integrals over the spread, what is fitted to each, rebounds
by level.
"""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import integrate, stats
from support.density import REBOUND, problem_of, table_of

from fitball.base.errors import ParameterError
from fitball.base.values import Impacts
from fitball.data.scene import BallSection, Scene
from fitball.inference.forward import (
    NEW_LEVEL,
    CalibratedRange,
    ForwardModel,
    Levels,
    hull_distances,
)
from fitball.inference.noise import noise_kind
from fitball.inference.problem.levels import LevelPrior
from fitball.models.registry import model

# Of the logarithm of a friction on three surfaces, spread half-t(0.2, 4).
HALF = stats.t(4.0, 0.0, 0.2)
CENTRE = -0.5
WIDTH = 0.4
SPREADS = HALF.ppf(0.5 + 0.5 * (np.arange(64) + 0.5) / 64)
PRIOR = LevelPrior(
    Levels("mu", "surface", ("a", "b", "c")),
    slice(0, 3),
    CENTRE,
    WIDTH,
    SPREADS,
    True,
    "",
)
PLACES = np.array([[-0.6, -0.3, -0.75], [0.4, 0.35, 0.5], [-2.0, -0.5, 1.0], [-0.5, -0.5, -0.5001]])


def over_spreads(q, weight=lambda _tau: 1.0):
    """The integral of the density of q, times a weight, over the spread."""

    def at(tau):
        whole = tau**2 * np.eye(len(q)) + WIDTH**2
        return (
            2.0
            * HALF.pdf(tau)
            * stats.multivariate_normal(np.full(len(q), CENTRE), whole).pdf(q)
            * weight(tau)
        )

    return integrate.quad(at, 0.0, np.inf, epsabs=0.0, limit=400)[0]


def test_the_spread_is_integrated_out():
    exact = np.log([over_spreads(q) for q in PLACES[:3]])
    # Far apart the last of 64 quantiles stands for all larger ones.
    assert_allclose(PRIOR.log_density(PLACES[:3]), exact, atol=0.04)
    assert_allclose(PRIOR.log_density(PLACES[:2]), exact[:2], atol=1e-3)
    # Of far more quantiles the sum is the integral; of a tenth of them it is not.
    many, few = (HALF.ppf(0.5 + 0.5 * (np.arange(n) + 0.5) / n) for n in (20_000, 6))
    assert_allclose(
        PRIOR._replace(spreads=many).log_density(PLACES[:3]),
        exact,
        atol=2e-4,
    )
    assert np.abs(PRIOR._replace(spreads=few).log_density(PLACES[:3]) - exact).max() > 0.05


def test_levels_that_nearly_agree_have_a_finite_density():
    q = CENTRE + np.array([[0.0, 0.0, 0.0], [40.0, -40.0, 3.0]])
    assert np.isfinite(PRIOR.log_density(q)).all()
    assert np.isfinite(PRIOR.pull(q)[1]).all()


def test_the_pull_is_the_gradient():
    gradient, curvature = PRIOR.pull(PLACES)
    for k in range(3):
        step = 1e-6 * np.eye(3)[k]
        exact = (PRIOR.log_density(PLACES - step) - PRIOR.log_density(PLACES + step)) / 2e-6
        assert_allclose(gradient[:, k], exact, rtol=1e-6, atol=1e-6)
    assert np.linalg.eigvalsh(curvature).min() > 0.0
    # Of one spread it is the precision of that normal density.
    one = PRIOR._replace(spreads=np.array([0.2])).pull(PLACES)[1][0]
    assert_allclose(one, np.linalg.inv(0.04 * np.eye(3) + WIDTH**2), rtol=1e-12)


def test_draws_of_the_prior():
    drawn = PRIOR.draw(np.random.default_rng(1), 40_000)
    spread = np.mean(SPREADS**2)
    assert_allclose(drawn.mean(axis=0), CENTRE, atol=0.02)
    assert_allclose(np.cov(drawn.T), spread * np.eye(3) + WIDTH**2, atol=0.02)


def test_a_level_that_was_not_measured():
    q = PLACES[0]
    spread, new = PRIOR.beyond(
        np.repeat(q[None], 40_000, axis=0),
        np.random.default_rng(2),
        -np.inf,
        np.log(5.0),
    )
    mass = over_spreads(q)
    assert spread.mean() == pytest.approx(over_spreads(q, lambda tau: tau) / mass, rel=0.03)

    def mean_and_square(tau):
        known = len(q) / tau**2
        prior = WIDTH**-2.0
        mean = (prior * CENTRE + known * q.mean()) / (prior + known)
        return mean, mean**2 + 1.0 / (prior + known) + tau**2

    first, second = (
        over_spreads(q, lambda tau, k=k: mean_and_square(tau)[k]) / mass for k in (0, 1)
    )
    assert new.mean() == pytest.approx(first, abs=0.01)
    assert new.std() == pytest.approx(np.sqrt(second - first**2), rel=0.03)
    # Neither the levels measured nor their common value alone.
    assert abs(new.std() - q.std()) > 0.05
    # Far apart, of all its spreads the largest most of the time.
    wide = PRIOR.beyond(
        np.repeat(5.0 * PLACES[2:3], 4000, axis=0),
        np.random.default_rng(2),
        -np.inf,
        90.0,
    )[0]
    assert np.mean(wide == SPREADS[-1]) > 0.99
    low = PRIOR.beyond(np.repeat(q[None], 4000, axis=0), np.random.default_rng(2), -np.inf, -0.5)[1]
    assert low.max() <= -0.5
    assert abs(np.mean(low > -0.6) - np.mean(new[new < -0.5] > -0.6)) < 0.05


def test_what_is_fitted_to_each_surface_and_ball_unasked():
    def fitted(labels, count=10, text="grip-slip", columns=REBOUND, **choices):
        problem = problem_of(
            table_of(columns, labels=labels, count=count),
            Scene(),
            text,
            **choices,
        )
        return {level.parameter: level.column for level in problem.forward.levels}, {
            n.code for n in problem.notes
        }

    both = {"mu": "surface", "cor_10": "surface"}
    assert fitted(("surface",))[0] == both
    assert fitted(("ball", "surface"))[0] == both | {"offset": "ball"}
    assert fitted(("ball",), text="two-mass")[0] == {"cor_10": "ball", "eps_10": "ball"}
    timed = fitted(("ball",), text="two-mass", columns=(*REBOUND, "contact_time"))[0]
    assert timed == {"cor_10": "ball", "eps_10": "ball", "k_y": "ball"}
    assert fitted(("place",))[0] == {"mu": "place"}
    assert fitted(("team",))[0] == {}
    assert fitted(("surface",), count=8)[0] == {}
    assert "too-few-for-levels" in fitted(("surface",), count=8)[1]
    assert fitted(("surface",), fix={"mu": 0.5})[0] == {"cor_10": "surface"}
    assert fitted(("surface",), pool={"mu": "none"})[0] == {"cor_10": "surface"}
    assert fitted(("surface",), pool={"all": "none"})[0] == {}
    assert fitted(("team",), pool={"e_x": "Team"})[0] == {"e_x": "team"}


@pytest.mark.parametrize(
    ("pool", "code"),
    [
        ({"mu": "colour"}, "unknown-label-column"),
        ({"nu": "surface"}, "unknown-parameter"),
        ({"mu": "club"}, "one-level"),
    ],
)
def test_levels_that_cannot_be(pool, code):
    table = table_of(REBOUND, labels=("surface",))
    table = replace(table, labels={**table.labels, "club": ("x",) * 10})
    with pytest.raises(ParameterError) as caught:
        problem_of(table, pool=pool)
    assert caught.value.code == code
    holes = replace(table, labels={**table.labels, "surface": ("a", "") * 5})
    with pytest.raises(ParameterError) as caught:
        problem_of(holes, pool={"mu": "surface"})
    assert caught.value.code == "label-missing"


def test_spreads_are_published_for_tennis_balls_and_shares_for_others():
    table = table_of(REBOUND, labels=("surface",))
    light = Scene(ball=BallSection(mass=0.0027, radius=0.02))
    tennis = problem_of(table).known
    other = problem_of(table, light).known
    assert tennis["mu_spread"] == "half-t(0.2, 4)"
    assert tennis["cor_10_spread"] == "half-t(0.03, 4)"
    assert other["mu_spread"] == "half-t(0.3, 4)"
    scale = float(other["cor_10_spread"].partition("(")[2].partition(",")[0])
    assert scale == pytest.approx(0.3 * 0.75, rel=0.02)
    alike = problem_of(table_of(REBOUND, labels=("ball",)), light).known
    assert float(alike["offset_spread"].partition("(")[2].partition(",")[0]) == pytest.approx(
        0.005 / 3,
        rel=1e-5,
    )
    asked = problem_of(table, prior={"mu_spread": "half-t(0.1, 3)"})
    assert asked.known["mu_spread"] == "half-t(0.1, 3)"
    assert (
        problem_of(table, prior={"mu_spread": "literature:place"}).known["mu_spread"]
        == "half-t(0.04, 4)"
    )


def test_a_common_value_with_another_prior_has_its_mean_and_sd():
    problem = problem_of(table_of(REBOUND, labels=("surface",)), prior={"mu": "uniform(0.2, 0.8)"})
    (own,) = (level for level in problem.prior.levels if level.levels.parameter == "mu")
    assert (own.centre, own.width) == pytest.approx((0.5, 0.6 / np.sqrt(12.0)), rel=1e-3)
    assert "normal-common-value" in {note.code for note in problem.notes}


def test_draws_of_a_problem_lie_within_the_bounds_and_have_new_levels():
    problem = problem_of(
        table_of(REBOUND, labels=("surface",)),
        prior={"cor_10_spread": "half-t(0.3, 4)"},
    )
    q = problem.prior.draw(np.random.default_rng(1), 2000)
    assert np.all((q >= problem.prior.low) & (q <= problem.prior.high))
    assert np.isfinite(problem.prior.log_density(q)).all()
    more = problem.prior.beyond(q, np.random.default_rng(1))
    assert set(more) == {"mu_spread", "mu[new]", "cor_10_spread", "cor_10[new]"}
    assert more["cor_10[new]"].min() > 0.0
    assert more["cor_10[new]"].max() <= 1.0
    made = problem.forward.rebound(
        {**problem.values(q), **more},
        Impacts(*np.array([[14.0], [8.0], [0.0]])),
        np.full((1, 2), NEW_LEVEL),
    )
    assert np.isfinite(made.v_y2[made.status == 0]).all()
    assert np.mean(made.status == 0) > 0.9


def test_labels_by_any_spelling_and_what_is_refused():
    forward = ForwardModel(
        model("grip-slip"),
        noise_kind("normal"),
        (Levels("mu", "surface", ("clay", "Hard")),),
    )
    index = forward.levels_of({"Surface": ("CLAY", "hard ", "new")}, 3)
    assert index.tolist() == [[0], [1], [NEW_LEVEL]]
    assert forward.levels_of({"surface": "hard"}, 2).tolist() == [[1], [1]]
    for labels, code in (
        ({"surface": ("clay", "gras")}, "unknown-label"),
        ({}, "label-missing"),
        ({"surface": ("", "clay")}, "label-missing"),
    ):
        with pytest.raises(ParameterError) as caught:
            forward.levels_of(labels, 2)
        assert caught.value.code == code


def test_the_distance_to_a_hull():
    rng = np.random.default_rng(4)
    points = rng.standard_normal((40, 3))
    inside = rng.dirichlet(np.ones(40), 5)
    assert_allclose(hull_distances(points, inside @ points), 0.0, atol=1e-7)
    cube = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
    places = np.array([[2.0, 0.5, 0.5], [2.0, 2.0, 0.5], [-1.0, -1.0, -1.0], [1e3, 0.0, 0.0]])
    assert_allclose(
        hull_distances(cube, places),
        [1.0, np.sqrt(2.0), np.sqrt(3.0), 999.0],
        rtol=1e-9,
    )
    # Flat data have a hull as well.
    assert_allclose(hull_distances(cube[:2], [[0.5, 0.0, 0.5]]), 0.5, rtol=1e-9)


def test_what_lies_outside_of_the_calibrated_impacts():
    rng = np.random.default_rng(5)
    count = 400
    speed = rng.uniform(10.0, 20.0, count)
    angle = np.radians(rng.uniform(20.0, 60.0, count))
    known = Impacts(speed * np.cos(angle), speed * np.sin(angle), rng.uniform(-100.0, 100.0, count))
    # The second surface was hit slowly only.
    index = (speed < 14.0).astype(np.int64)[:, None]
    calibrated = CalibratedRange(known, index, 0.033)
    new = Impacts(
        *np.array(
            [
                [14.0, 14.0, 14.0, 22.0, 12.0],
                [9.0, 9.0, 9.0, 12.0, 5.0],
                [0.0, 0.0, 300.0, 0.0, 0.0],
            ]
        )
    )
    flags, distance = calibrated.outside(new, np.array([[0], [1], [0], [0], [NEW_LEVEL]]))
    assert flags.tolist() == [False, True, True, True, False]
    assert distance[[0, 4]].max() < 1e-9
    assert distance[1] > 1.0
    assert distance[3] == pytest.approx(np.hypot(22.0, 12.0) - 20.0, abs=0.3)
    assert calibrated.outside(new.take(np.array([0])), np.array([[7]]))[1][0] == np.inf
    plain = CalibratedRange(known, np.empty((count, 0), np.int64), 0.033)
    assert plain.outside(new, np.empty((5, 0), np.int64))[0].tolist() == [
        False,
        False,
        True,
        True,
        False,
    ]
