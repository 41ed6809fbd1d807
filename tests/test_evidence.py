"""Information, power-scaling, action and verdicts, each against something that is not theirs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from samples import GRIP_SLIP, TWO_MASS, coordinates_of, polar_problem, problem_of, synthetic
from scipy.differentiate import hessian
from scipy.stats import norm

from fitball.inference.calibrate import run
from fitball.inference.effort import Effort
from fitball.inference.identifiability.examine import active_impacts, examine, profile_all
from fitball.inference.identifiability.information import (
    combination,
    eigendirections,
    fisher_information,
    information_evidence,
    product,
    relative,
)
from fitball.inference.identifiability.verdict import CONFLICT, Marginal, Numbers, contraction_alone, judge
from fitball.inference.likelihood.posterior import log_likelihood, log_scene_density
from fitball.inference.problem.parameters import parse_prior
from fitball.inference.results import sentences
from fitball.inference.results.evidence import (
    LEFT_OUT,
    End,
    Evidence,
    InformationEvidence,
    PowerEvidence,
    Profile,
    Profiles,
)
from fitball.inference.results.results import Verdict


def numerical_hessian(problem, coordinates):
    """Of the negative log likelihood with the scene's contact time, in sds of the priors, by scipy."""

    def cost(z):
        points = coordinates[:, None] + problem.prior.width[:, None] * z.reshape(coordinates.size, -1)
        values = problem.to_values(points.T)
        rebound = problem.rebound(values)
        total = log_likelihood(problem, values, rebound) + log_scene_density(problem, rebound)
        return -total.reshape(z.shape[1:])

    scale = np.array([1.0 if item.prior.bell else 12.0**-0.5 for item in problem.free])
    found = hessian(cost, np.zeros(coordinates.size), initial_step=1e-2, maxiter=6)
    return found.ddf * np.outer(scale, scale)


@pytest.mark.parametrize(("model", "truth"), [("grip-slip", GRIP_SLIP), ("two-mass", TWO_MASS)])
def test_information_is_the_hessian_where_there_is_no_residual(model, truth):
    problem = synthetic(problem_of("wang_zero_spin.csv", model), truth)
    at = coordinates_of(problem, truth)
    if problem.contact_time is not None:
        time = float(problem.rebound(problem.to_values(at[None, :])).contact_time.mean())
        problem = replace(problem, contact_time=(time, 0.5e-3))
    moving = [k for k, name in enumerate(problem.free_names) if not name.endswith("_sd")]
    found = fisher_information(problem, at, scene=True)[np.ix_(moving, moving)]
    expected = numerical_hessian(problem, at)[np.ix_(moving, moving)]
    np.testing.assert_allclose(found, expected, rtol=2e-3, atol=2e-3 * np.max(np.abs(expected)) ** 0.5)


def test_information_is_the_covariance_of_the_score(tmp_path):
    """With angles, whose spread depends on the parameters, and fitted noise: twenty thousand simulated tables."""
    problem = polar_problem(tmp_path)
    truth = GRIP_SLIP | {"velocity_sd": 1.5}
    at = coordinates_of(problem, truth)
    steps = 1e-4 * np.diag(problem.prior.width)
    values = problem.to_values(np.concatenate([at[None, :], at + steps, at - steps]))
    rebound, columns = problem.rebound(values), problem.all_values(values)
    rng = np.random.default_rng(3)
    scores = np.zeros((20000, at.size))
    for observable in problem.observables:
        predicted, spread = (
            observable.predict(rebound),
            observable.sds(columns, rebound),
        )
        spread = np.broadcast_to(spread, predicted.shape)
        made = predicted[0] + spread[0] * rng.standard_normal((20000, predicted.shape[1]))
        for k in range(at.size):
            up, down = (norm.logpdf(made, predicted[j], spread[j]).sum(axis=1) for j in (1 + k, 1 + at.size + k))
            scores[:, k] += (up - down) / 2e-4
    expected = np.cov(scores, rowvar=False)
    found = fisher_information(problem, at, scene=False)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(found / scale, expected / scale, atol=0.05)


def test_the_spectrum_names_what_only_the_contact_time_tells():
    problem = synthetic(problem_of("wang_zero_spin.csv"), TWO_MASS)
    at = coordinates_of(problem, TWO_MASS)
    found = eigendirections(problem, at)
    # The error of mu from the pseudo-inverse of scipy's Hessian, without the scene.
    names = [name for name in problem.free_names if not name.endswith("_sd")]
    curvature = numerical_hessian(replace(problem, contact_time=None), at)[: len(names), : len(names)]
    error = np.sqrt(np.linalg.pinv(curvature, rcond=1e-7)[names.index("mu"), names.index("mu")])
    (known,) = (item.known_to for item in found.directions_without_scene if item.words == "mu")
    assert float(known) == pytest.approx(error * problem.prior.width[names.index("mu")], rel=0.1)
    assert found.directions_without_scene[-1].known_to == "unknown"
    assert found.directions_without_scene[-1].words == "k_y k_theta^0.5"
    evidence = information_evidence(problem, at)
    assert evidence["k_y"].error_without_scene is None
    assert evidence["k_y"].error == pytest.approx(0.2, abs=0.02)
    assert evidence["mu"].error == pytest.approx(evidence["mu"].error_without_scene, rel=1e-6)


def test_combinations_in_words():
    items = problem_of("wang_zero_spin.csv").free[1:4]
    assert [item.name for item in items] == ["k_y", "k_theta", "mu"]
    logs = [items[0], items[1]]
    assert product(logs, np.array([-1.0, 1.0])) == "k_theta/k_y"
    assert product(logs, np.array([0.5, 1.0])) == "k_y^0.5 k_theta"
    assert product(logs, np.array([-1.0, -2.0])) == "1/(k_y k_theta^2)"
    sds = np.array([1.0, 1.5])
    vector = np.array([-1.0, 1.5]) / np.hypot(1.0, 1.5)
    # A variance of 0.0064/3.25 along the vector, in sds of the priors, is 8 % of the ratio.
    covariance = np.outer(vector, vector) * 0.0064 / 3.25
    assert combination(logs, vector, sds, covariance) == ("k_theta/k_y", "8 %")
    assert relative(2.0) == "a factor of 7.4"


@pytest.mark.parametrize(("loss", "words"), [(1.2, "k_theta/k_y"), (1.3, "k_theta/k_y^0.5")])
def test_exponents_are_rounded_as_long_as_that_costs_a_quarter_at_most(loss, words):
    """A direction with exponents 1 and -0.6; whole numbers would stand for it at `loss` times its error."""
    items = problem_of("wang_zero_spin.csv").free[1:3]
    sds = np.array([1.0, 1.0])
    exact, rounded = np.array([-0.6, 1.0]), np.array([-1.0, 1.0])
    vector = exact / np.linalg.norm(exact)
    # Variance along the vector, and across it as much as makes the rounded combination worse by the loss asked for.
    across = np.array([vector[1], -vector[0]])
    along = (rounded @ vector) ** 2 / (rounded @ rounded)
    variance = (loss**2 - along) / (1.0 - along)
    covariance = 1e-4 * (np.outer(vector, vector) + variance * np.outer(across, across))
    assert combination(items, vector, sds, covariance)[0] == words


def test_when_every_ball_grips_friction_acts_nowhere_and_is_bounded_from_below():
    truth = GRIP_SLIP | {"mu": 1.5, "velocity_sd": 0.05, "spin_sd": 2.0}
    problem = synthetic(problem_of("wang_zero_spin.csv", "grip-slip", without=("mu",)), truth, 8)
    for point_only in (True, False):
        fit = run(problem, Effort(seed=2, cores=1, point_only=point_only))
        mu, evidence = fit.parameters["mu"], fit.identifiability.evidence["mu"]
        assert mu.verdict is Verdict.ONE_SIDED
        assert "only a lower bound" in mu.reason
        assert evidence.profile.ends == (End.CLOSED, End.BOUND)
        assert fit.parameters["e_x"].verdict is Verdict.IDENTIFIED
        assert len(fit.identifiability.evidence["e_x"].active_impacts.impacts) >= 6
        for item in problem.free:
            narrowed = fit.identifiability.evidence[item.name].contraction
            assert (narrowed is None) == point_only
            if narrowed is not None:
                draws, before = (
                    item.prior.coordinate(kept[:, problem.free_names.index(item.name)])
                    for kept in (fit.posterior.draws, fit.posterior.prior_draws)
                )
                assert narrowed.contraction == pytest.approx(1.0 - draws.var() / before.var(), abs=1e-9)
    # The maximum lies at the edge of grip, where the prior draws it; over the posterior friction acts nowhere.
    assert evidence.active_impacts.impacts == ()
    assert sentences.ACTS_NOWHERE.format(impacts=7, regimes=" (grip)") in mu.reason


def test_when_no_ball_grips_the_torsion_acts_nowhere():
    truth = TWO_MASS | {"mu": 0.1}
    problem = synthetic(problem_of("wang_zero_spin.csv", without=("mu",)), truth, 8)
    at = coordinates_of(problem, truth)
    rebound = problem.rebound(problem.to_values(at[None, :]))
    # Topspin has not come up in any impact: all slide from first to last but the steepest ones.
    sliding = [problem.table.ids[k] for k in np.flatnonzero(rebound.regime[0] == 1)]
    found = active_impacts(problem, at[None, :], [])
    assert found["k_theta"].impacts == tuple(name for name in problem.table.ids if name not in sliding)
    assert set(sliding) <= set(found["mu"].impacts)
    assert len(sliding) >= 4


def test_impacts_in_doubt_are_named_with_their_share():
    problem = problem_of("wang_zero_spin.csv")
    at = coordinates_of(problem, TWO_MASS)
    split = [{"slide": 1.0}, {"slide": 0.5, "slide-grip": 0.5}, *({"slide": 0.97, "grip": 0.03} for _ in range(5))]
    found = active_impacts(problem, at[None, :], split)
    assert found["mu"].doubtful == ("zero-2",)
    assert 0.0 < found["cor_10"].share_doubtful < 1.0 / 3.0
    certain = active_impacts(problem, at[None, :], [{"slide": 1.0}] * 7)
    assert certain["mu"].doubtful == ()
    assert certain["mu"].share_doubtful == 0.0
    everything = active_impacts(problem, at[None, :], [{"slide": 0.6, "grip": 0.4}] * 7)
    assert everything["mu"].share_doubtful == pytest.approx(1.0)
    evidence = replace(EVIDENCE, active_impacts=everything["mu"])
    judged = judge(Numbers(problem, problem.free[3], evidence))
    assert "100 %" in judged.reason and "(zero-1, zero-2, " in judged.reason


def profile(left=End.CLOSED, right=End.CLOSED, leans=((), ()), at=(0.5, 0.55, 0.6)):
    """A profile of mu, whose prior is normal(0.55, 0.05)."""
    interval = (at[0] if left is End.CLOSED else None, at[2] if right is End.CLOSED else None)
    drop = np.array([2.5 if left is End.CLOSED else 0.1, 0.0, 2.5 if right is End.CLOSED else 0.1])
    return Profile("mu", np.array(at), drop, at[1], interval, interval, (left, right), leans, 0)


EVIDENCE = Evidence(profile(), None, InformationEvidence(0.3, 0.3, 0.9, 0.9), None, None, None)
IDENTIFIED = Marginal(0.9, 0.9, (False, False), 30.0, (0.52, 0.53, 0.57, 0.58))
ONE_SIDED = replace(IDENTIFIED, narrowed=0.5, open_sides=(False, True))
DOMINATED = replace(IDENTIFIED, narrowed=0.1, open_sides=(True, True))
OPEN_RIGHT, OPEN = profile(right=End.BOUND), profile(End.BOUND, End.BOUND)
CASES = [
    # posterior, profile, profile without scene, verdict
    (IDENTIFIED, profile(), None, Verdict.IDENTIFIED),
    (IDENTIFIED, OPEN_RIGHT, None, Verdict.ONE_SIDED),
    (IDENTIFIED, OPEN, None, Verdict.PRIOR_DOMINATED),
    # A bound of physics that another parameter rests on is part of the model; the range of a search is not.
    (IDENTIFIED, profile(leans=(("mass_ratio",), ("mass_ratio",))), None, Verdict.IDENTIFIED),
    (IDENTIFIED, profile(End.RANGE, End.RANGE, (("k_y",), ("k_y",))), None, Verdict.PRIOR_DOMINATED),
    (IDENTIFIED, profile(right=End.RANGE, leans=((), ("k_y",))), None, Verdict.ONE_SIDED),
    (IDENTIFIED, profile(), OPEN, Verdict.IDENTIFIED),
    (ONE_SIDED, OPEN_RIGHT, None, Verdict.ONE_SIDED),
    (ONE_SIDED, profile(), None, Verdict.ONE_SIDED),
    (DOMINATED, OPEN, None, Verdict.PRIOR_DOMINATED),
    (DOMINATED, profile(), None, Verdict.PRIOR_DOMINATED),
    (DOMINATED, profile(), OPEN, Verdict.PRIOR_DOMINATED),
    (None, profile(), None, Verdict.IDENTIFIED),
    (None, OPEN_RIGHT, None, Verdict.ONE_SIDED),
    (None, OPEN, None, Verdict.PRIOR_DOMINATED),
    (None, None, None, Verdict.NOT_JUDGED),
]


@pytest.mark.parametrize(("base", "shape", "alone", "verdict"), CASES)
def test_the_evidence_adds_up_to_one_verdict(base, shape, alone, verdict):
    problem = problem_of("wang_zero_spin.csv")
    judged = judge(Numbers(problem, problem.free[3], replace(EVIDENCE, profile=shape, alone=alone), base))
    assert judged.verdict is verdict
    assert judged.reason


@pytest.mark.parametrize(
    ("change", "verdict", "words"),
    [
        # Closed, and hardly narrower than before.
        (
            {"marginal": replace(IDENTIFIED, narrowed=0.15)},
            Verdict.PRIOR_DOMINATED,
            "(contraction 0.15)",
        ),
        # A rival fit opens the profile that agrees on it.
        ({"evidence": replace(EVIDENCE, profile=OPEN_RIGHT), "agreed": True}, Verdict.IDENTIFIED, "to 30 %"),
        ({"traded": ("k_y",)}, Verdict.PRIOR_DOMINATED, "with k_y: "),
        (
            {"marginal": replace(IDENTIFIED, rests=True), "alone": 0.7},
            Verdict.IDENTIFIED,
            sentences.PARTLY_SCENE.format(scene="the scene's contact time (5 ± 0.5 ms)", alone=0.7),
        ),
        ({"beyond": "at 10 m/s", "tied": "; tied to e_x"}, Verdict.EXTRAPOLATED, "at 10 m/s; the data reduce"),
    ],
)
def test_what_else_decides(change, verdict, words):
    problem = problem_of("wang_zero_spin.csv")
    judged = judge(replace(Numbers(problem, problem.free[3], EVIDENCE, IDENTIFIED), **change))
    assert judged.verdict is verdict and words in judged.reason
    assert judged.given == ()


def test_a_size_that_comes_from_the_scene_is_identified_given_the_scene():
    problem = problem_of("wang_zero_spin.csv")
    stiffness = (1e4, 2e4, 4e4)
    evidence = replace(
        EVIDENCE, profile=profile(at=stiffness), alone=profile(End.BOUND, End.BOUND, at=stiffness),
        information=InformationEvidence(0.2, None, 0.3, 0.3),
    )  # fmt: skip
    alone = contraction_alone(problem, problem.free[1], evidence.information, evidence.alone, False)
    judged = judge(Numbers(problem, problem.free[1], evidence, alone=alone))
    assert (judged.verdict, judged.given) == (Verdict.IDENTIFIED, ("contact_time",))
    assert sentences.FROM_SCENE.format(scene="the scene's contact time (5 ± 0.5 ms)") in judged.reason


@pytest.mark.parametrize(("own_prior", "given"), [(0.2, ("the prior of mu",)), (0.01, ())])
def test_a_prior_that_the_table_contradicts_is_what_a_value_is_given(own_prior, given):
    """The profile, 0.4 to 0.6, and the prior have no 95 % in common; by the priors of others nothing is given."""
    problem = problem_of("wang_zero_spin.csv")
    mu = replace(problem.free[3], prior=parse_prior("mu", "normal(0.9, 0.05)", 0.0, 5.0))
    pulled = replace(EVIDENCE, power=PowerEvidence(0.2, own_prior, None, 0.2, CONFLICT))
    judged = judge(Numbers(problem, mu, pulled, IDENTIFIED))
    assert (judged.verdict, judged.given) == (Verdict.IDENTIFIED, given)
    assert (sentences.CONTRADICTED.format(within="[0.5, 0.6]") in judged.reason) == bool(given)


def synthetic_rows(problem, rows):
    """The same problem with its impacts repeated."""
    take = np.arange(rows) % len(problem.impacts)
    given = problem.impacts
    return replace(problem, impacts=type(given)(given.v_x1[take], given.v_y1[take], given.omega_1[take]))


def test_without_profiles_a_point_fit_does_not_judge():
    problem = problem_of("wang_zero_spin.csv", "grip-slip")
    fit = run(problem, Effort(point_only=True, cores=1))
    nothing = Profiles(0.0, False, {}, "no maximum")
    identifiability, judgements = examine(problem, fit.point, (nothing, nothing), None, None, ())
    assert judgements["mu"].verdict is Verdict.NOT_JUDGED
    assert identifiability.profiles_missing == "no maximum"
    # A large table, whose profiles are left out, is judged by its information.
    left_out = Profiles(0.0, False, {}, LEFT_OUT)
    _, judgements = examine(problem, fit.point, (left_out, left_out), None, None, ())
    assert judgements["mu"].verdict is Verdict.IDENTIFIED
    assert "is 0.4 × the prior's sd" in judgements["mu"].reason
    assert profile_all(synthetic_rows(problem, 301), fit.point, fit.point.optima)[0].missing == LEFT_OUT
    # With them it does.
    assert fit.parameters["mu"].verdict is Verdict.IDENTIFIED
    assert "95 % interval [0.5" in fit.parameters["mu"].reason
