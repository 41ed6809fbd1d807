"""Values at levels: their prior against integrals over the spread, what is fitted to each, rebounds
by level.
"""

import itertools
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
    LeveledParameter,
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
    LeveledParameter("mu", "surface", ("a", "b", "c")),
    slice(0, 3),
    CENTRE,
    WIDTH,
    SPREADS,
    True,
    "",
)
PLACES = np.array(
    [
        [-0.6, -0.3, -0.75],
        [0.4, 0.35, 0.5],
        [-2.0, -0.5, 1.0],
        [-0.5, -0.5, -0.5001],
    ]
)


def quantiles_of_spread(count):
    """Middle quantiles of so many equal shares."""
    shares = (np.arange(count) + 0.5) / count
    return HALF.ppf(0.5 + 0.5 * shares)


def over_spreads(q, weight=lambda _tau: 1.0):
    """The integral of the density of q, times a weight, over the spread."""
    centre = np.full(len(q), CENTRE)

    def integrand(tau):
        covariance = tau**2 * np.eye(len(q)) + WIDTH**2
        density = stats.multivariate_normal(centre, covariance).pdf(q)
        return 2.0 * HALF.pdf(tau) * density * weight(tau)

    return integrate.quad(integrand, 0.0, np.inf, epsabs=0.0, limit=400)[0]


def test_the_spread_is_integrated_out():
    exact = np.log([over_spreads(q) for q in PLACES[:3]])
    # Far apart the last of 64 quantiles stands for all larger ones.
    assert_allclose(PRIOR.log_density(PLACES[:3]), exact, atol=0.04)
    assert_allclose(PRIOR.log_density(PLACES[:2]), exact[:2], atol=1e-3)
    # Of far more quantiles the sum is the integral; of a tenth of them it is not.
    many = PRIOR._replace(spreads=quantiles_of_spread(20_000))
    few = PRIOR._replace(spreads=quantiles_of_spread(6))
    assert_allclose(many.log_density(PLACES[:3]), exact, atol=2e-4)
    errors = few.log_density(PLACES[:3]) - exact
    assert np.abs(errors).max() > 0.05


def test_levels_that_nearly_agree_have_a_finite_density():
    q = CENTRE + np.array([[0.0, 0.0, 0.0], [40.0, -40.0, 3.0]])
    _, curvature = PRIOR.pull(q)
    assert np.isfinite(PRIOR.log_density(q)).all()
    assert np.isfinite(curvature).all()


def test_the_pull_is_the_gradient():
    gradient, curvature = PRIOR.pull(PLACES)
    for k in range(3):
        step = 1e-6 * np.eye(3)[k]
        before = PRIOR.log_density(PLACES - step)
        after = PRIOR.log_density(PLACES + step)
        exact = (before - after) / 2e-6
        assert_allclose(gradient[:, k], exact, rtol=1e-6, atol=1e-6)
    assert np.linalg.eigvalsh(curvature).min() > 0.0
    # Of one spread it is the precision of that normal density.
    normal = PRIOR._replace(spreads=np.array([0.2]))
    _, curvature = normal.pull(PLACES)
    precision = np.linalg.inv(0.04 * np.eye(3) + WIDTH**2)
    assert_allclose(curvature[0], precision, rtol=1e-12)


def test_draws_of_the_prior():
    drawn = PRIOR.draw(np.random.default_rng(1), 40_000)
    spread = np.mean(SPREADS**2)
    assert_allclose(drawn.mean(axis=0), CENTRE, atol=0.02)
    assert_allclose(np.cov(drawn.T), spread * np.eye(3) + WIDTH**2, atol=0.02)


def test_a_level_that_was_not_measured():
    q = PLACES[0]

    def beyond(q, count, high):
        rng = np.random.default_rng(2)
        return PRIOR.draw_new_level(np.tile(q, (count, 1)), rng, -np.inf, high)

    spread, new = beyond(q, 40_000, np.log(5.0))
    mass = over_spreads(q)

    def expected(function):
        return over_spreads(q, function) / mass

    assert spread.mean() == pytest.approx(expected(lambda tau: tau), rel=0.03)

    def precision(tau):
        """Of the common value, given the levels and the spread."""
        return WIDTH**-2.0 + len(q) / tau**2

    def mean(tau):
        weighted = WIDTH**-2.0 * CENTRE + len(q) / tau**2 * q.mean()
        return weighted / precision(tau)

    def square(tau):
        return mean(tau) ** 2 + 1.0 / precision(tau) + tau**2

    first = expected(mean)
    second = expected(square)
    assert new.mean() == pytest.approx(first, abs=0.01)
    assert new.std() == pytest.approx(np.sqrt(second - first**2), rel=0.03)
    # Neither the levels measured nor their common value alone.
    assert abs(new.std() - q.std()) > 0.05
    # Far apart, of all its spreads the largest most of the time.
    wide, _ = beyond(5.0 * PLACES[2], 4000, 90.0)
    assert np.mean(wide == SPREADS[-1]) > 0.99
    _, low = beyond(q, 4000, -0.5)
    assert low.max() <= -0.5
    allowed = new[new < -0.5]
    assert abs(np.mean(low > -0.6) - np.mean(allowed > -0.6)) < 0.05


def test_what_is_fitted_to_each_surface_and_ball_unasked():
    def problem(*labels, count=10, text="grip-slip", columns=REBOUND, **choices):
        table = table_of(columns, labels=labels, count=count)
        return problem_of(table, Scene(), text, **choices)

    def fitted(*labels, **choices):
        levels = problem(*labels, **choices).forward.levels
        return {level.parameter: level.column for level in levels}

    both = {"mu": "surface", "cor_10": "surface"}
    assert fitted("surface") == both
    assert fitted("ball", "surface") == both | {"offset": "ball"}
    of_ball = {"cor_10": "ball", "eps_10": "ball"}
    assert fitted("ball", text="two-mass") == of_ball
    timed = (*REBOUND, "contact_time")
    assert fitted("ball", text="two-mass", columns=timed) == of_ball | {"k_y": "ball"}
    assert fitted("place") == {"mu": "place"}
    assert fitted("team") == {}
    assert fitted("surface", count=8) == {}
    notes = problem("surface", count=8).notes
    assert "too-few-for-levels" in {note.code for note in notes}
    assert fitted("surface", fix={"mu": 0.5}) == {"cor_10": "surface"}
    assert fitted("surface", pool={"mu": "none"}) == {"cor_10": "surface"}
    assert fitted("surface", pool={"all": "none"}) == {}
    assert fitted("team", pool={"e_x": "Team"}) == {"e_x": "team"}


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
    def scale(text):
        """The first number of a prior."""
        return float(text.partition("(")[2].partition(",")[0])

    table = table_of(REBOUND, labels=("surface",))
    light = Scene(ball=BallSection(mass=0.0027, radius=0.02))
    tennis = problem_of(table).prior_texts
    other = problem_of(table, light).prior_texts
    assert tennis["mu_spread"] == "half-t(0.2, 4)"
    assert tennis["cor_10_spread"] == "half-t(0.03, 4)"
    assert other["mu_spread"] == "half-t(0.3, 4)"
    assert scale(other["cor_10_spread"]) == pytest.approx(0.3 * 0.75, rel=0.02)
    by_ball = problem_of(table_of(REBOUND, labels=("ball",)), light).prior_texts
    assert scale(by_ball["offset_spread"]) == pytest.approx(0.005 / 3, rel=1e-5)
    stated = problem_of(table, prior={"mu_spread": "half-t(0.1, 3)"}).prior_texts
    assert stated["mu_spread"] == "half-t(0.1, 3)"
    published = problem_of(table, prior={"mu_spread": "literature:place"}).prior_texts
    assert published["mu_spread"] == "half-t(0.04, 4)"


def test_a_common_value_with_another_prior_has_its_mean_and_sd():
    table = table_of(REBOUND, labels=("surface",))
    problem = problem_of(table, prior={"mu": "uniform(0.2, 0.8)"})
    (prior,) = (prior for prior in problem.prior.level_priors if prior.leveled.parameter == "mu")
    assert prior.centre == pytest.approx(0.5, rel=1e-3)
    assert prior.width == pytest.approx(0.6 / np.sqrt(12.0), rel=1e-3)
    assert "normal-common-value" in {note.code for note in problem.notes}


def test_draws_of_a_problem_lie_within_the_bounds_and_have_new_levels():
    problem = problem_of(
        table_of(REBOUND, labels=("surface",)),
        prior={"cor_10_spread": "half-t(0.3, 4)"},
    )
    q = problem.prior.draw(np.random.default_rng(1), 2000)
    assert np.all(q >= problem.prior.low)
    assert np.all(q <= problem.prior.high)
    assert np.isfinite(problem.prior.log_density(q)).all()
    more = problem.prior.draw_new_levels(q, np.random.default_rng(1))
    assert set(more) == {"mu_spread", "mu[new]", "cor_10_spread", "cor_10[new]"}
    assert more["cor_10[new]"].min() > 0.0
    assert more["cor_10[new]"].max() <= 1.0
    impact = Impacts(np.array([14.0]), np.array([8.0]), np.array([0.0]))
    rebound = problem.forward.rebound(
        {**problem.values(q), **more},
        impact,
        np.full((1, 2), NEW_LEVEL),
    )
    solved = rebound.status == 0
    assert np.isfinite(rebound.v_y2[solved]).all()
    assert np.mean(solved) > 0.9


def test_labels_by_any_spelling_and_what_is_refused():
    forward = ForwardModel(
        model("grip-slip"),
        noise_kind("normal"),
        (LeveledParameter("mu", "surface", ("clay", "Hard")),),
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
    cube = np.array(list(itertools.product((0.0, 1.0), repeat=3)))
    places = np.array(
        [
            [2.0, 0.5, 0.5],
            [2.0, 2.0, 0.5],
            [-1.0, -1.0, -1.0],
            [1e3, 0.0, 0.0],
        ]
    )
    wanted = [1.0, np.sqrt(2.0), np.sqrt(3.0), 999.0]
    assert_allclose(hull_distances(cube, places), wanted, rtol=1e-9)
    # Flat data have a hull as well.
    assert_allclose(hull_distances(cube[:2], [[0.5, 0.0, 0.5]]), 0.5, rtol=1e-9)


def test_what_lies_outside_of_the_calibrated_impacts():
    rng = np.random.default_rng(5)
    count = 400
    speed = rng.uniform(10.0, 20.0, count)
    angle = np.radians(rng.uniform(20.0, 60.0, count))
    spin = rng.uniform(-100.0, 100.0, count)
    measured = Impacts(speed * np.cos(angle), speed * np.sin(angle), spin)
    # The second surface was hit slowly only.
    index = (speed < 14.0).astype(np.int64)[:, None]
    calibrated = CalibratedRange(measured, index, 0.033)
    new = Impacts(
        np.array([14.0, 14.0, 14.0, 22.0, 12.0]),
        np.array([9.0, 9.0, 9.0, 12.0, 5.0]),
        np.array([0.0, 0.0, 300.0, 0.0, 0.0]),
    )
    surfaces = np.array([[0], [1], [0], [0], [NEW_LEVEL]])
    flags, distance = calibrated.extrapolation(new, surfaces)
    assert flags.tolist() == [False, True, True, True, False]
    assert distance[[0, 4]].max() < 1e-9
    assert distance[1] > 1.0
    beyond = np.hypot(22.0, 12.0) - 20.0
    assert distance[3] == pytest.approx(beyond, abs=0.3)
    first = new.take(np.array([0]))
    _, distance = calibrated.extrapolation(first, np.array([[7]]))
    assert distance[0] == np.inf
    without_levels = CalibratedRange(measured, np.empty((count, 0), np.int64), 0.033)
    flags, _ = without_levels.extrapolation(new, np.empty((5, 0), np.int64))
    assert flags.tolist() == [False, False, True, True, False]
