"""Verdicts where the best fit lies on a bound, has a rival, or may slide along a ridge: the right answer is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from samples import GRIP_SLIP, TWO_MASS, drop_table, linear_problem, problem_of
from scipy.integrate import quad
from scipy.stats import norm

from fitball.data.table import Measurement
from fitball.inference.calibrate import run
from fitball.inference.effort import Effort
from fitball.inference.identifiability import profile as profile_module
from fitball.inference.identifiability.profile import DROP_95, profile_contraction, profiles
from fitball.inference.identifiability.profile_walk import Point
from fitball.inference.identifiability.verdict import Marginal, Numbers, judge
from fitball.inference.point.surface import Surface
from fitball.inference.problem.build import Choices, build_problem
from fitball.inference.results import sentences
from fitball.inference.results.evidence import End, Evidence, Profile
from fitball.inference.results.results import Verdict

IDENTIFIED, ONE_SIDED, DOMINATED = Verdict.IDENTIFIED, Verdict.ONE_SIDED, Verdict.PRIOR_DOMINATED


# --- simulated tables


def simulated(truth, seed, **choices):
    """Wang's incident states under a model that is true, with noise."""
    problem = problem_of("wang_all.csv", **choices, without=("mu",))
    rebound = problem.rebound(np.array([[truth[name] for name in problem.free_names]]))
    made = []
    for observable in problem.observables:
        error = truth[observable.noise] * np.random.default_rng([seed, len(made)]).standard_normal(21)
        made.append(Measurement(observable.name, observable.predict(rebound)[0] + error))
    return build_problem(
        replace(problem.table, measurements=tuple(made), redundant=()), problem.scene, Choices(**choices)
    )


def only(profile):
    """A profile, and nothing else."""
    return Evidence(profile, None, None, None, None, None)


def judged(problem, truth, names):
    """Profiles of some parameters, searched from the truth, and what is said of each without a posterior."""
    found = profiles(problem, [truth], names=names).by_name
    said = {
        item.name: judge(Numbers(problem, item, only(found[item.name])))
        for item in problem.free
        if item.name in names
    }
    return found, said


def leaning(found):
    return {name for item in found.values() for side in item.leans_on for name in side}


TABLE = {"closures": {"inertia": "table"}}


def test_a_best_mass_ratio_of_one_leaves_the_others_identified():
    """It is bounded from below only, and others rest on it where their profiles close."""
    truth = {**TWO_MASS, "inertia_split": 0.75, "mass_ratio": 0.98, "spin_sd": 10.0}
    found, said = judged(simulated(truth, 3, **TABLE), truth, ["mass_ratio", "mu", "v_x_sd", "spin_sd"])
    assert found["mass_ratio"].best > 0.99 and leaning(found) == {"mass_ratio"}
    ratio = said.pop("mass_ratio")
    assert ratio.verdict is ONE_SIDED
    assert ratio.reason.endswith(sentences.POSSIBLE.format(limit="1"))
    assert {item.verdict for item in said.values()} == {IDENTIFIED}
    assert sentences.AT_BOUND.format(names="mass_ratio", at=sentences.ITS_BOUND) in said["mu"].reason
    # A word on the bound stands beside the interval; that interval stays.
    assert None not in found["mu"].interval_95


def test_a_best_mass_ratio_at_the_restitution_is_identified():
    """The wall mass_ratio = COR moves with the restitution, which the table knows: both are closed."""
    truth = {**TWO_MASS, "mass_ratio": 0.853, "spin_sd": 10.0}
    problem = simulated(truth, 2)
    found, said = judged(problem, truth, ["mass_ratio", "cor_10", "cor_slope"])
    slowest = problem.impacts.v_y1.min()
    restitution = found["cor_10"].best + found["cor_slope"].best * (slowest - 10.0)
    assert found["mass_ratio"].best == pytest.approx(restitution, abs=2e-3)
    assert {item.verdict for item in said.values()} == {IDENTIFIED}
    low, high = found["mass_ratio"].interval_95
    assert low < 0.853 < high


def test_a_best_friction_of_zero_is_bounded_from_above_and_what_it_never_moves_is_open():
    flat = {"model": "grip-slip", "priors": {"mu": "uniform(0, 2)"}}
    truth = {**GRIP_SLIP, "mu": 0.0, "v_x_sd": 0.1, "v_y_sd": 0.1, "spin_sd": 4.0}
    problem = simulated(truth, 1, **flat)
    found, said = judged(problem, truth, problem.free_names)
    assert leaning(found) == {"mu"}
    friction, restitution = said.pop("mu"), said.pop("e_x")
    assert friction.verdict is ONE_SIDED
    assert sentences.POSSIBLE.format(limit="0") in friction.reason
    # No ball grips: the restitution along the court plays no part.
    assert restitution.verdict is DOMINATED
    assert {item.verdict for item in said.values()} == {IDENTIFIED}


SPLIT = {**TWO_MASS, "k_theta": 30.0, "spin_sd": 10.0}


def test_a_best_split_of_the_inertia_at_one_is_bounded_from_below():
    truth = {**SPLIT, "inertia_split": 0.9999}
    problem = simulated(truth, 0, **TABLE, priors={"inertia_split": "uniform(0.1, 1)"})
    found, said = judged(problem, truth, ["inertia_split", "mass_ratio", "mu"])
    assert leaning(found) == {"inertia_split"}
    assert said.pop("inertia_split").verdict is ONE_SIDED
    assert {item.verdict for item in said.values()} == {IDENTIFIED}


@pytest.mark.parametrize(("value", "verdict"), [(0.98, DOMINATED), (0.9905, IDENTIFIED)])
def test_a_range_that_keeps_the_best_fit_out_decides_and_not_the_table(value, verdict):
    """The split is 0.99: a prior that ends at 0.98 keeps it off by far, which is no finding of the table."""
    problem, seen = problem_of("wang_all.csv", **TABLE), (0.989, 0.99, 0.992)
    at = next(item for item in problem.free if item.name == "inertia_split")
    profile = Profile(
        at.name, np.array(seen), np.array([2.5, 0.0, 2.5]), 0.99, seen[::2], seen[::2], (End.CLOSED, End.CLOSED),
        ((), ()), 0,
    )  # fmt: skip
    middle = (value - 2e-3, value - 1e-3, value, value + 1e-3)
    seen = Numbers(problem, at, only(profile), Marginal(0.9, 0.9, (False, False), 30.0, middle), value)
    for posterior in (None, seen.marginal):
        assert judge(replace(seen, marginal=posterior)).verdict is verdict
    # A narrow peak that holds the best point, but hardly the posterior, is no work of priors.
    narrow = replace(seen, value=0.99, marginal=replace(seen.marginal, levels=(0.88, 0.90, 0.95, 0.97)))
    assert judge(narrow).verdict is IDENTIFIED
    opened = replace(profile, interval_95=(0.989, None), ends=(End.CLOSED, End.BOUND))
    assert judge(replace(narrow, evidence=only(opened))).verdict is IDENTIFIED
    said = judge(replace(seen, value=None)).reason
    assert (said == sentences.HELD_OFF.format(within="[0.989, 0.992]")) == (verdict is DOMINATED)


def test_a_noise_at_its_floor_leaves_no_profile_and_the_posterior_tells():
    """Drops far more exact than any noise may be: no maximum lies within bounds, the line is known all the same."""
    problem = linear_problem(drop_table(np.random.default_rng(1), noise=1e-6))
    fit = run(problem, Effort(seed=2, cores=1, max_steps=1500))
    assert "velocity_sd goes to its bound" in fit.identifiability.profiles_missing
    for name, value in (("cor_10", 0.76), ("cor_slope", -0.014)):
        assert fit.parameters[name].verdict is IDENTIFIED
        assert fit.parameters[name].median == pytest.approx(value, rel=0.01)
    # A point fit has nothing else to judge by, and says so.
    point = run(problem, Effort(seed=2, cores=1, point_only=True))
    assert {item.verdict for item in point.parameters.values()} == {Verdict.NOT_JUDGED}


# --- likelihoods written down


class Written(Surface):
    """Half the squared length of residuals that a test writes down, over cor_10 and cor_slope."""

    residuals = staticmethod(lambda _x: (None, None))

    def cost(self, x, given):
        return 0.5 * np.sum(self.residuals(x)[0] ** 2, axis=1)

    def linearised(self, x, given):
        z, slope = self.residuals(x)
        return np.einsum("bm,bmk->bk", z, slope), np.einsum("bmk,bml->bkl", slope, slope)


def one_speed():
    """A line at 7 m/s alone: no other speed bounds it."""
    table, speeds = drop_table(np.random.default_rng(1), count=3), np.full(3, 7.0)
    return linear_problem(
        replace(table, impacts=type(table.impacts)(0.0 * speeds, speeds, 0.0 * speeds)), velocity_sd=0.05
    )


def written(monkeypatch, residuals, *starts):
    """Profiles and verdicts of the coefficients of a line under written residuals; the noise is held."""
    problem = one_speed()
    kind = type("Here", (Written,), {"residuals": staticmethod(residuals)})
    monkeypatch.setattr(profile_module, "surface_of", kind)
    found = profiles(problem, [{"cor_10": a, "cor_slope": b} for a, b in starts]).by_name
    said = {item.name: judge(Numbers(problem, item, only(found[item.name]))).verdict for item in problem.free}
    return found, said


def slopes(*rows):
    return np.stack([np.stack(np.broadcast_arrays(*row), axis=-1) for row in rows], axis=1)


def wells(depth, walls=4.0):
    """Two optima at cor_10 = 0.4 and 0.6, the first less likely by `depth`; the slope known to 0.002."""

    def residuals(x):
        a, b = (x[:, 0] - 0.5) / 0.1, x[:, 1] / 0.002
        far = np.sqrt(2.0 * depth) * 0.5
        z = np.stack([walls * (a * a - 1.0), b, far * (1.0 - a)], axis=1)
        return z, slopes((20.0 * walls * a, 0.0 * a), (0.0 * a, 500.0 + 0.0 * a), (-10.0 * far + 0.0 * a, 0.0 * a))

    return residuals


# The better optimum alone as a start, or both: the search meets the other where it is told of it.
@pytest.mark.parametrize(("depth", "both"), [(0.0, True), (1.0, True), (4.0, False)])
def test_an_interval_over_two_optima_holds_all_that_are_likely(monkeypatch, depth, both):
    found, said = written(monkeypatch, wells(depth), (0.42, 0.001), (0.58, -0.001))
    low, high = found["cor_10"].interval_95
    assert (low < 0.4) == both and 0.6 < high < 0.63
    assert found["cor_10"].drop.max() >= DROP_95
    assert set(said.values()) == {IDENTIFIED}
    between = (found["cor_10"].values > 0.4) & (found["cor_10"].values < 0.6)
    assert found["cor_10"].drop[between].max() > DROP_95


def test_a_better_maximum_that_is_met_on_the_way_begins_it_anew(monkeypatch):
    """A low wall to a likelier optimum, where no search began: the slope's profile is that of the better one too."""
    found, _said = written(monkeypatch, wells(2.0, 2.1), (0.4, 0.0))
    assert found["cor_10"].best == pytest.approx(0.6, abs=1e-3)
    assert found["cor_slope"].drop.min() == pytest.approx(0.0, abs=1e-6)


def ridge(x):
    """Only cor_10 - 3 cor_slope is known, to 0.001: the line at one speed, 7 m/s."""
    z = (x[:, :1] - 3.0 * x[:, 1:] - 0.8) / 0.001
    return z, slopes((1e3 + 0.0 * x[:, 0], -3e3 + 0.0 * x[:, 0]))


def test_a_flat_ridge_is_open_where_only_the_range_of_a_search_ends_it(monkeypatch):
    """cor_slope is searched to -0.1 and 0.1, for no reason of physics; a restitution ends at 1, for one."""
    found, said = written(monkeypatch, ridge, (0.8, 0.0))
    assert found["cor_10"].ends[0] is End.RANGE and found["cor_10"].leans_on[0] == ("cor_slope",)
    assert found["cor_10"].interval_95 == (None, None)
    assert said["cor_10"] is DOMINATED
    # Upwards the slope ends where the restitution is 1; downwards it is searched no further.
    assert found["cor_slope"].ends == (End.BOUND, End.CLOSED)
    assert found["cor_slope"].leans_on[1] == ("cor_10",)
    assert found["cor_slope"].interval_95[1] == pytest.approx(0.2 / 3.0, abs=2e-3)
    assert said["cor_slope"] is ONE_SIDED


def test_a_point_where_all_is_known_is_closed(monkeypatch):
    """The same ridge crossed by another: the negative control."""

    def crossed(x):
        z, slope = ridge(x)
        other = slopes((0.0 * x[:, 0], 1e3 + 0.0 * x[:, 0]))
        return np.concatenate([z, 1e3 * x[:, 1:]], axis=1), np.concatenate([slope, other], axis=1)

    found, said = written(monkeypatch, crossed, (0.8, 0.0))
    assert all(item.ends == (End.CLOSED, End.CLOSED) and item.leans_on == ((), ()) for item in found.values())
    assert set(said.values()) == {IDENTIFIED}


@pytest.mark.parametrize("error", [0.1, 1.0, 3.0])
def test_the_contraction_of_a_profile_is_that_of_prior_times_likelihood(monkeypatch, error):
    """A normal likelihood about the prior's centre, wide or narrow; the integral by quadrature."""
    sd = error * 12.0**-0.5

    def known(x):
        z = np.stack([(x[:, 0] - 0.5) / sd, x[:, 1] / 0.01], axis=1)
        return z, slopes((1.0 / sd + 0.0 * x[:, 0], 0.0 * x[:, 0]), (0.0 * x[:, 0], 100.0 + 0.0 * x[:, 0]))

    found, _ = written(monkeypatch, known, (0.5, 0.0))
    problem = one_speed()
    weight, square = (quad(lambda q, p=p: (q - 0.5) ** p * norm.pdf(q, 0.5, sd), 0.0, 1.0)[0] for p in (0, 2))
    expected = 1.0 - 12.0 * square / weight
    assert profile_contraction(found["cor_10"], problem.free[0].prior) == pytest.approx(expected, abs=0.01)


def test_values_of_a_profile_rise_where_two_paths_end_at_one_bound():
    """One path ends at the bound, another beside it within rounding: no two points have one value, or the file of the
    fit is refused when it is read.
    """
    x = np.zeros(3)
    places = ((0.5, 3.0, False), (0.8, 1.0, False), (np.nextafter(1.0, 0.0), 1.4, False), (1.0, 1.5, True))
    line = [Point(at, x, cost, True, bound) for at, cost, bound in places]
    kept = profile_module._distinct(line, lambda at: np.round(at, 12))
    assert [(point.at, point.cost, point.bound) for point in kept] == [*places[:2], (*places[2][:2], True)]
    assert profile_module._distinct(line[:2], np.exp) == line[:2]
