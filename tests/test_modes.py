"""Modes of a posterior: planted ones, and shapes that have one mode alone."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from support.fits import at, drops_of, line

import fitball
from fitball.inference.forward import Draws
from fitball.inference.modes import differing, doubts_of, modes_of, notes_of, with_mass_first
from fitball.inference.sampling.parts import ONE_PART, centrality, parts_of
from fitball.inference.schema import Diagnostics, Mode, PointFit, Posterior, Summary
from fitball.inference.search.objective import Objective, descend

DATA = Path(__file__).parent / "data"
# Ensembles, steps and walkers of chains by hand, and their effective draws.
SHAPE = (4, 100, 20)
COUNT = 8000
EFFECTIVE = 1000.0
SIZE = 8


def mixed(rng, share, distance, size=SIZE):
    """Chains of two normal distributions so many sds apart, in coordinates with random scales and
    correlations; which draws are of the second; and the two centres.
    """
    turn = rng.standard_normal((size, size)) * np.exp(rng.uniform(-3.0, 3.0, size))
    direction = rng.standard_normal(size)
    apart = distance * direction / np.linalg.norm(direction)
    second = rng.uniform(size=COUNT) < share
    z = rng.standard_normal((COUNT, size)) + second[:, None] * apart
    centres = np.stack([np.zeros(size), apart]) @ turn
    return (z @ turn).reshape(*SHAPE, size), second, centres


def parts_and_labels(chains, maxima, effective=EFFECTIVE):
    parts = parts_of(chains, maxima, effective)
    return parts, parts.of(chains.reshape(-1, chains.shape[-1]))


@pytest.mark.parametrize("seed", range(20))
def test_two_planted_modes_are_named_with_their_shares(seed):
    rng = np.random.default_rng(seed)
    share = rng.uniform(0.06, 0.5)
    chains, second, centres = mixed(rng, share, rng.uniform(5.0, 12.0))
    # Half of the searches saw the highest maximum alone.
    parts, labels = parts_and_labels(chains, centres if seed % 2 else centres[:1])
    assert len(parts.ranks) == 2
    smaller = second if second.mean() < 0.5 else ~second
    assert_allclose(np.mean(labels == 1), smaller.mean(), atol=0.01)
    assert np.mean((labels == 1) == smaller) > 0.98
    assert sorted(parts.of(centres).tolist()) == [0, 1]


def test_humps_that_overlap_in_every_coordinate_are_seen_along_their_line():
    rng = np.random.default_rng(1)
    chains, second, centres = mixed(rng, 0.5, 4.0)
    parts, labels = parts_and_labels(chains, centres)
    assert len(parts.ranks) == 2
    assert max(np.mean(labels == second), np.mean(labels != second)) > 0.95
    # Two equal humps at two sds have one peak (Behboodian 1970).
    chains, _, centres = mixed(rng, 0.5, 1.9)
    assert not parts_of(chains, centres, EFFECTIVE).splits


def test_three_modes_are_three():
    rng = np.random.default_rng(2)
    x = rng.standard_normal((COUNT, 3))
    which = rng.choice(3, COUNT, p=[0.2, 0.5, 0.3])
    x[:, 0] += np.array([-9.0, 0.0, 0.0])[which]
    x[:, 2] += np.array([0.0, 0.0, 7.0])[which]
    _, labels = parts_and_labels(x.reshape(*SHAPE, 3), np.zeros((1, 3)))
    for rank, planted in enumerate((1, 2, 0)):
        assert np.mean((labels == rank) == (which == planted)) > 0.99


def shapes(rng):
    """Draws of distributions with one mode."""
    z = rng.standard_normal((COUNT, 4))
    yield z
    yield np.column_stack([z[:, 0], z[:, 1] + 2.0 * z[:, 0] ** 2, z[:, 2:]])
    yield z / np.sqrt(rng.chisquare(3.0, (COUNT, 1)) / 3.0)
    yield rng.exponential(size=(COUNT, 4))
    yield rng.uniform(size=(COUNT, 4))
    yield np.exp(1.5 * z)
    yield np.column_stack([-(rng.exponential(size=COUNT) ** 3), z])
    yield np.column_stack([z, z[:, :1], np.ones(COUNT)])
    yield np.zeros((COUNT, 2))


@pytest.mark.parametrize("seed", range(12))
def test_shapes_with_one_mode_have_one(seed):
    rng = np.random.default_rng(100 + seed)
    for x in shapes(rng):
        # Chains of few effective draws: each is repeated.
        x = np.repeat(x[: COUNT // 8], 8, axis=0)
        chains = x.reshape(*SHAPE, x.shape[1])
        maxima = x[rng.choice(COUNT, 4)]
        assert not parts_of(chains, maxima, EFFECTIVE).splits


def test_a_bump_of_one_ensemble_is_no_mode():
    """Walkers that are stuck make one."""
    rng = np.random.default_rng(3)
    chains = rng.standard_normal((*SHAPE, 3))
    chains[1, :, :10, 0] = 8.0 + 0.1 * chains[1, :, :10, 0]
    assert not parts_of(chains, np.zeros((1, 3)), EFFECTIVE).splits
    both = chains.copy()
    both[2:, :, :10, 0] = 8.0 + 0.1 * both[2:, :, :10, 0]
    assert len(parts_of(both, np.zeros((1, 3)), EFFECTIVE).splits) == 1


def test_a_hundredth_of_the_draws_is_no_mode():
    chains, _, centres = mixed(np.random.default_rng(4), 0.01, 12.0)
    assert not parts_of(chains, centres, EFFECTIVE).splits


def test_the_middle_is_where_few_draws_are_nearer():
    draws = np.random.default_rng(5).standard_normal((4000, 2)) * [1.0, 100.0] + 7.0
    # Of a normal distribution in the plane 1 - e^(-r^2/2) lies within r sds.
    places = np.array([[7.0, 7.0], [8.0, 7.0], [7.0, 207.0]])
    expected = 1.0 - np.exp(-0.5 * np.array([0.0, 1.0, 4.0]))
    assert_allclose(centrality(draws, places), expected, atol=0.03)


SPEEDS = np.linspace(5.0, 17.0, 9)
REBOUNDS = 0.7 * SPEEDS + 0.05 * np.random.default_rng(1).standard_normal(9)


def drops():
    """A problem of drops, its maximum (a, b), and draws about that."""
    problem = drops_of(line, SPEEDS, REBOUNDS, fix={"v_y_sd": 0.05})
    (best,), _, _ = descend(Objective(problem), np.array([[0.7, 0.0]]), 1e-10)
    draws = best + 1e-3 * np.random.default_rng(2).standard_normal((COUNT, 2))
    return problem, best, draws


def mixed_well(effective):
    """Diagnostics of chains of which so many draws are effective."""
    sizes = {"a": 2.0 * effective, "b": effective}
    return Diagnostics(0, 100, (), sizes, sizes, {}, None, True, ())


def posterior_of(problem, draws):
    values = problem.prior.value(draws).reshape(*SHAPE, draws.shape[1])
    return Posterior(problem.free, values, np.zeros(SHAPE))


def test_a_high_peak_beside_the_mass_gives_way_to_the_maximum_in_it():
    problem, best, draws = drops()
    far = at(problem, best + 0.5).optima[0]
    near = at(problem, best).optima[0]
    posterior = posterior_of(problem, draws)
    both = PointFit((far, near), (5.0, 3.0), 0.0, {})
    known = with_mass_first(problem, both, posterior, ONE_PART)
    assert known.optima == (near, far)
    assert known.log_posterior == (3.0, 5.0)
    residual = REBOUNDS - near["a"] * SPEEDS - near["b"] * (SPEEDS - 10.0)
    assert known.rms["v_y2"] == pytest.approx(np.sqrt(np.mean(residual**2)))
    # What no search has reached so far is searched for from the middle.
    alone = with_mass_first(problem, PointFit((far,), (5.0,), 0.0, {}), posterior, ONE_PART)
    assert alone.optima[0]["a"] == pytest.approx(near["a"], abs=1e-4)
    assert alone.optima[1] == far
    first = PointFit((near, far), (5.0, 3.0), 0.0, {})
    assert with_mass_first(problem, first, posterior, ONE_PART) is first


def test_modes_say_what_their_draws_do():
    problem, best, draws = drops()
    second = np.random.default_rng(3).uniform(size=COUNT) < 0.25
    draws = draws + second[:, None] * np.array([0.5, 0.0])
    posterior = posterior_of(problem, draws)
    parts = parts_of(draws.reshape(*SHAPE, 2), best[None], EFFECTIVE)
    values = dict(zip(problem.free, draws.T, strict=True)) | {"v_y_sd": np.full(COUNT, 0.05)}
    of_draws = Draws({}, values, {})
    modes = modes_of(problem, at(problem, best), posterior, mixed_well(COUNT), of_draws, parts)
    assert [mode.share for mode in modes] == [1.0 - second.mean(), second.mean()]
    # That of a share of independent draws.
    assert modes[1].error == pytest.approx((0.25 * 0.75 / COUNT) ** 0.5, rel=0.15)
    for mode, beyond in zip(modes, (False, True), strict=True):
        median = np.median(draws[second == beyond, 0])
        assert mode.summaries["a"].median == pytest.approx(median)
    assert modes[0].summaries["a"].point == pytest.approx(best[0])
    assert np.isnan(modes[1].summaries["a"].point)
    assert "b" not in differing(modes)
    assert "a" in doubts_of(problem, modes)
    notes = [*notes_of(problem, modes)]
    assert len(notes) == 3
    assert f"{100.0 * modes[0].share:.0f} ±" in notes[1].text
    assert not [*notes_of(problem, ())]
    one_mode = modes_of(
        problem,
        at(problem, best),
        posterior,
        mixed_well(COUNT),
        of_draws,
        ONE_PART,
    )
    assert one_mode == ()


def test_draws_that_repeat_know_a_share_no_better_than_the_effective_ones():
    """Weighted draws that were drawn again lie in random order, as if they were independent."""
    problem, best, draws = drops()
    rng = np.random.default_rng(6)
    second = np.arange(COUNT) < COUNT // 4
    draws[second, 0] += 0.5
    repeated = rng.permutation(np.repeat(draws[::8], 8, axis=0))
    posterior = posterior_of(problem, repeated)
    parts = parts_of(repeated.reshape(*SHAPE, 2), best[None], EFFECTIVE)
    values = dict(zip(problem.free, repeated.T, strict=True)) | {"v_y_sd": np.full(COUNT, 0.05)}
    point = at(problem, best)
    diagnostics = mixed_well(COUNT / 8)
    modes = modes_of(problem, point, posterior, diagnostics, Draws({}, values, {}), parts)
    assert modes[1].share == 0.25
    assert modes[1].error == pytest.approx((0.25 * 0.75 / (COUNT / 8)) ** 0.5, rel=1e-9)


def summary(low, median, high):
    return Summary(median, median, 1.0, low, 0.5 * (low + median), 0.5 * (median + high), high)


def test_modes_differ_where_neither_has_its_median_in_the_other():
    one = {"a": summary(0.0, 1.0, 2.0), "b": summary(0.0, 1.0, 2.0), "c": summary(0.0, 1.0, 2.0)}
    other = {"a": summary(2.5, 3.0, 4.0), "b": summary(0.5, 3.0, 4.0), "c": summary(9.0, 9.5, 10.0)}
    modes = (Mode(0.6, 0.01, one), Mode(0.4, 0.01, other))
    assert differing(modes) == ["c", "a"]


# The ball with which both tables were judged.
SIMULATED_BALL = {"inertia_ratio": 0.56}


def test_a_table_with_several_solutions_names_them():
    """Of 30 impacts of a ball that no model here describes exactly, simulated with a friction of
    0.62 on one surface; 18 % of the draws of other samplers have 0.55 to 0.65 there, 0.6 % 0.65 to
    0.85, and the others more.
    """
    fit = fitball.calibrate(DATA / "two_solutions.csv", fix=SIMULATED_BALL, cores=1)
    at_truth = [mode for mode in fit.modes if 0.55 < mode.summaries["mu[hard]"].median < 0.65]
    assert len(at_truth) == 1
    assert at_truth[0].share == pytest.approx(0.18, abs=0.05)
    assert sum(mode.share for mode in fit.modes) == pytest.approx(1.0)
    screen = " ".join(fit.report().partition("Report:")[0].split())
    for k, mode in enumerate(fit.modes, 1):
        assert f"Solution {k}, {100.0 * mode.share:.0f} ±" in screen
    for name in ("mu[hard]", "mu[clay]"):
        assert fit.parameters[name].verdict == "conditional"
    assert fit.parameters["k_theta"].verdict == "prior-dominated"
    # What is first has the mass.
    largest = max(fit.modes, key=lambda mode: mode.share)
    middle = largest.summaries["mu[hard]"]
    assert middle.q025 < fit.point.optima[0]["mu[hard]"] < middle.q975


def test_a_solution_that_no_search_from_the_prior_reaches_is_named():
    """Of 30 impacts of a rigid ball on two surfaces, with a restitution of clay less hard of
    -0.030, which the smaller solution has.
    """
    fit = fitball.calibrate(DATA / "two_humps.csv", cores=1)
    larger, smaller = fit.modes
    assert smaller.share == pytest.approx(0.165, abs=0.03)
    assert smaller.share + larger.share == pytest.approx(1.0)
    medians = {name: there.median for name, there in smaller.summaries.items()}
    assert medians["cor_10[clay]"] - medians["cor_10[hard]"] == pytest.approx(-0.03, abs=0.01)
    for name in ("mass_ratio", "cor_10[clay]"):
        assert fit.parameters[name].verdict == "conditional"
    screen = " ".join(fit.report().partition("Report:")[0].split())
    assert f"Solution 2, {100.0 * smaller.share:.0f} ±" in screen


def test_a_far_peak_with_little_mass_decides_nothing():
    """Of 40 impacts of a Hunt-Crossley ball, with a friction of 0.45 and 0.65 in turn."""
    fit = fitball.calibrate(DATA / "far_peak.csv", fix=SIMULATED_BALL, cores=1)
    mu = fit.parameters["mu"]
    assert mu.point == pytest.approx(0.62, abs=0.03)
    assert mu.verdict == "conditional"
    low, high = fit.profiles["mu"].interval_95
    assert not low < mu.median < high
    for estimate in fit.reported:
        profile = fit.profiles.get(estimate.name)
        if estimate.verdict in ("identified", "given") and profile is not None:
            low, high = profile.interval_95
            assert low < estimate.median < high
    shares = [mode.share for mode in fit.modes]
    assert shares[0] > 0.9
    assert fit.modes[1].summaries["mu"].median == pytest.approx(2.5, abs=0.15)
