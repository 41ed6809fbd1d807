"""Draws of variants: Monte Carlo errors against the spread over streams, moves at the limit, and a
learnt density that is no good.
"""

import numpy as np
import pytest
from made_tables import impact_table
from numpy.testing import assert_allclose
from scipy import stats

import fitball
from fitball.data.load import load_data
from fitball.data.scene import Scene
from fitball.inference.density import log_posterior
from fitball.inference.judgement import variants
from fitball.inference.judgement.laws import values_under
from fitball.inference.judgement.variant_draws import (
    Drawn,
    corrected,
    first_draws,
    more_draws,
    weighed,
)
from fitball.inference.judgement.variants import fit_variant
from fitball.inference.problem.build import build_problem
from fitball.inference.problem.problem import Choices
from fitball.inference.sampling.importance import effective_size
from fitball.inference.search.best_fit import best_fit


def draws_of_normal(rng, count):
    """Weighted draws of a standard normal quantity from one twice as wide."""
    values = 2.0 * rng.standard_normal(count)
    ratios = stats.norm.pdf(values) / stats.norm.pdf(values, scale=2.0)
    return values, ratios / ratios.sum()


def test_errors_are_the_spread_over_streams():
    rng = np.random.default_rng(1)
    found = [weighed(*draws_of_normal(rng, 2000), 0.0) for _ in range(300)]
    for name, end in (("median", 0.0), ("q025", -1.95996), ("q975", 1.95996)):
        over_streams = np.array([getattr(one.summary, name) for one in found])
        errors = np.array([getattr(one, name) for one in found])
        assert over_streams.mean() == pytest.approx(end, abs=0.02)
        assert errors.mean() == pytest.approx(over_streams.std(), rel=0.2)
    halves = np.array([one.summary.half for one in found])
    errors = np.array([one.half for one in found])
    assert halves.mean() == pytest.approx(0.99446, abs=0.01)
    # Its two ends are taken for independent.
    assert 0.7 < errors.mean() / halves.std() < 1.5
    sds = [one.summary.sd for one in found]
    assert np.mean(sds) == pytest.approx(1.0, abs=0.02)


def test_what_has_no_answer_is_left_out():
    values = np.append(np.arange(100.0), np.full(90, np.nan))
    answered = weighed(values, np.full(190, 1.0 / 190), 3.0).summary
    assert answered.median == pytest.approx(49.5)
    few = weighed(np.append(values, np.full(20, np.nan)), np.full(210, 1.0 / 210), 3.0)
    assert np.isnan(few.summary.median)
    assert few.summary.point == 3.0


def test_exact_weights_move_a_summary_and_add_little_error():
    rng = np.random.default_rng(2)
    off = []
    for _ in range(100):
        values = rng.standard_normal(20_000)
        of_learnt = weighed(values, np.full(values.size, 1.0 / values.size), 0.0)
        compared = values[:400]
        # By these weights the distribution is the same one, a tenth to the right.
        ratios = np.exp(0.1 * compared)
        weights = ratios / ratios.sum()
        moved = corrected(of_learnt, compared, weights).summary
        alone = weighed(compared, weights, 0.0).summary
        ends = np.array([[one.median, one.q975] for one in (moved, alone, of_learnt.summary)])
        off.append(ends - 0.1 - [0.0, 1.95996])
    of_moved, of_alone, of_learnt_alone = np.sqrt(np.mean(np.square(off), axis=0))
    assert np.all(of_moved < 0.5 * of_alone)
    assert np.all(of_moved < 0.5 * of_learnt_alone)


def straight(v_x1, v_y1, omega_1, ball, a="normal(0.7, 0.1)"):
    return a * v_x1, v_y1, omega_1


def bent(v_x1, v_y1, omega_1, ball, a="normal(0.7, 0.1)"):
    return 2.0 * np.abs(v_x1 - 10.0 * a), v_y1, omega_1


@pytest.mark.parametrize(("function", "is_learnt"), [(straight, True), (bent, False)])
def test_a_learnt_density_that_is_not_the_exact_one_is_not_used(function, is_learnt):
    rng = np.random.default_rng(4)
    v_x1 = np.array([6.8, 7.0, 7.3])
    # About the kink of the bent model: offsets of sigma points are not linear there.
    table = impact_table(
        {"v_x1": v_x1, "v_y1": 5.0, "omega_1": 0.0, "v_x2": 0.7 * v_x1 if is_learnt else 1.5},
        sd={"v_x1": 1.0},
    )
    choices = Choices(fix={"v_x_sd": 0.2})
    problem = build_problem(table, Scene(), choices, fitball.model_from(function))
    variant = fit_variant(problem, problem.prior.location[None] + 0.01, rng)
    assert variant.law is not problem
    drawn = first_draws(variant, rng, 500.0)
    assert drawn.law is (variant.law if is_learnt else problem)
    assert (len(drawn.compared) > 0) is is_learnt
    more = more_draws(variant, drawn, rng, 3000.0)
    assert effective_size(more.log_weights) > 2500.0
    means = [np.exp(each.log_weights) @ each.x[:, 0] for each in (drawn, more)]
    sd = np.sqrt(np.exp(more.log_weights) @ (more.x[:, 0] - means[1]) ** 2)
    assert_allclose(means[0], means[1], atol=0.3 * sd)


def test_a_search_along_a_wall_goes_on_until_it_gains_little(monkeypatch):
    """By the law of yielding bodies the slowest of Wang's impacts hardly has an answer: a search
    for its best values creeps along where it has none.
    """
    read, scene = load_data(["wang_all.csv"], None, False)[:2]
    problem, of_law = (
        build_problem(read, scene, Choices(model)) for model in ("two-mass", "two-mass+cor=root")
    )
    values = best_fit(problem, np.random.default_rng(1)).optima[0]
    start = of_law.coordinates(values_under("root", problem, values))[None]

    def highest():
        streams = [np.random.default_rng(seed) for seed in range(4)]
        best = [fit_variant(of_law, start, stream).best for stream in streams]
        return log_posterior(of_law, np.vstack(best))

    after_all = highest()
    monkeypatch.setattr(variants, "MOST_ROUNDS", 1)
    after_one = highest()
    assert np.all(after_all >= after_one)
    assert after_all.mean() > after_one.mean() + 0.5


def test_draws_are_reliable_by_k_and_their_number():
    def drawn(k, count):
        log_weights = np.full(count, -np.log(max(count, 1)))
        return Drawn(None, np.zeros((count, 1)), log_weights, k, np.zeros((0, 1)), np.zeros(0))

    cases = [(0.7, 50, True), (0.8, 400, True), (0.8, 200, False), (0.9, 4000, False)]
    for k, count, reliable in cases:
        assert drawn(k, count).reliable is reliable
    assert not drawn(np.inf, 0).reliable


def test_first_draws_say_that_their_errors_are_larger():
    values, weights = draws_of_normal(np.random.default_rng(3), 500)
    exact = weighed(values, weights, 0.0)
    assert weighed(values, weights, 0.0, 1.7).median == pytest.approx(1.7 * exact.median, rel=0.2)
