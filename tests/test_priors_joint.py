"""Priors together, noises, what a problem is made of: against scipy and against numbers written
down here.
"""

from dataclasses import replace

import numpy as np
import pytest
from made_tables import impact_table
from numpy.testing import assert_allclose, assert_array_equal
from scipy import integrate, stats
from support.density import REBOUND, TIMED, log_prior, near, problem_of, scene_of, table_of

from fitball.base.errors import FitError, ModelError, ParameterError
from fitball.data.scene import BallSection, Scene, ValueWithSd
from fitball.inference.effort import Effort
from fitball.inference.noise import noise_kind
from fitball.inference.problem.build import build_problem
from fitball.inference.problem.problem import Choices
from fitball.inference.problem.row_errors import row_errors
from fitball.inference.summary import bands, summarise
from fitball.models.registry import model

PRIORS = {
    "mu": "uniform(0.2, 0.9)",
    "e_x": "normal(0, 0.5)",
    "offset": "half-t(0.003, 4)",
    "cor_10": "half-normal(0.7)",
    "cor_slope": "normal(0.2, 0.05)",
    "v_x_sd": "loguniform(0.01, 3)",
}


SHAPED = {
    "mu": "gamma(9, 0.07)",
    "e_x": "beta(2, 8)",
    "cor_10": "beta(30, 10)",
    "degrees_of_freedom": "gamma(2, 4)",
    "v_x_sd": "gamma(0.5, 30)",
}


@pytest.mark.parametrize("priors", [PRIORS, SHAPED])
def test_the_joint_prior_is_the_sum_of_priors_by_scipy(priors):
    # The bounds cut off most of a prior far above them.
    problem = problem_of(table_of(REBOUND, "sd"), scene_of(), prior=priors, noise="student-t")
    q = problem.prior.draw(np.random.default_rng(1), 40)
    values = problem.prior.value(q)
    free = [parameter for parameter in problem.parameters if parameter.fixed is None]
    exact = [
        sum(
            log_prior(parameter.spec, parameter.prior.text, value)
            for parameter, value in zip(free, row, strict=True)
        )
        for row in values
    ]
    assert_allclose(problem.prior.log_density(q), exact, rtol=1e-9, atol=1e-9)
    assert_allclose(problem.prior.coordinate(values), q, rtol=1e-13, atol=1e-13)
    named = dict(zip(problem.free, values[0], strict=True))
    assert_array_equal(problem.coordinates(named), problem.prior.coordinate(values)[0])
    for name in priors:
        k = problem.free.index(name)
        wide = q.copy()
        wide[:, k] = 0.9 * q[:, k] + 0.1 * q[::-1, k]
        if problem.prior.flat[k]:
            continue
        assert np.abs(problem.prior.log_density(wide) - exact).max() > 0.01, name


@pytest.mark.parametrize("priors", [PRIORS, SHAPED])
def test_gradients_of_priors_together_are_slopes_of_their_density(priors):
    problem = problem_of(table_of(REBOUND, "sd"), scene_of(), prior=priors, noise="student-t")
    q = problem.prior.draw(np.random.default_rng(1), 5)
    gradient, curvature = problem.prior.pull(q)
    for k, width in enumerate(problem.prior.width):
        step = 1e-5 * width * np.eye(q.shape[1])[k]
        ends = [problem.prior.log_density(q + side) for side in (-step, step)]
        inside = np.isfinite(ends).all(axis=0)
        slope = (ends[0] - ends[1])[inside] / (2e-5 * width)
        assert_allclose(gradient[inside, k] * width, slope * width, rtol=1e-5, atol=1e-5)
        bends = [problem.prior.pull(q + side)[0][:, k] for side in (-step, step)]
        # Of half-t the curvature is that of a normal density that touches it.
        if "half-t" not in problem.prior.parameters[k].prior.text:
            bend = (bends[1] - bends[0]) * width / 2e-5
            assert_allclose(curvature[:, k, k] * width**2, bend, rtol=1e-4, atol=1e-4)


def test_evidence_is_the_priors_of_what_the_scene_measured_alone():
    prior = {"ball_mass": "gamma(33000, 1.75e-6)", "e_x": "beta(2, 8)"}
    problem = problem_of(table_of(REBOUND), scene_of(ball=True), prior=prior)
    q = problem.prior.draw(np.random.default_rng(1), 6)
    k = problem.free.index("ball_mass")
    others = [problem.free.index(name) for name in ("mu", "e_x", "cor_10")]
    law = stats.gamma(33000, scale=1.75e-6)
    mass = np.exp(q[:, k])
    spec = problem.prior.parameters[problem.free.index("inertia_ratio")]
    ratio = stats.norm(0.56, 0.01).logpdf(q[:, problem.free.index("inertia_ratio")])
    assert spec.measured
    exact = law.logpdf(mass) + np.log(mass) + ratio
    got = problem.prior.evidence.log_density(q)
    assert_allclose(got - got[0], exact - exact[0], rtol=1e-8, atol=1e-8)
    gradient, _ = problem.prior.evidence.pull(q)
    assert_array_equal(gradient[:, others], 0.0)
    assert np.all(gradient[:, k] != 0.0)


def test_at_levels_a_normal_prior_of_values_replaces_one_in_the_logit():
    table = table_of(REBOUND, labels=("surface",), count=12)
    prior = {"cor_10": "beta(30, 10)", "mu": "gamma(9, 0.07)"}
    pool = {"cor_10": "surface", "mu": "surface"}
    problem = problem_of(table, prior=prior, pool=pool)
    assert [note.code for note in problem.notes].count("normal-common-value") == 2
    assert problem.prior_texts["cor_10"] == "beta(30, 10)"
    ours = {prior.leveled.parameter: prior for prior in problem.prior.level_priors}
    law = stats.beta(30, 10)
    assert not ours["cor_10"].log
    assert ours["cor_10"].centre == pytest.approx(law.mean(), rel=1e-3)
    assert ours["cor_10"].width == pytest.approx(law.std(), rel=1e-2)
    log = stats.loggamma(9, np.log(0.07))
    assert ours["mu"].log
    assert ours["mu"].centre == pytest.approx(log.mean(), rel=1e-3)
    assert ours["mu"].width == pytest.approx(log.std(), rel=1e-2)
    values = problem.prior.value(problem.prior.draw(np.random.default_rng(1), 500))
    drawn = values[:, problem.free.index("cor_10[a]")]
    assert np.all((drawn >= 0.0) & (drawn <= 1.0))
    assert drawn.mean() == pytest.approx(law.mean(), abs=0.02)
    # The inertia of the ball, which is held, is a number there.
    priors = {name: text for name, text in problem.prior_texts.items() if name != "inertia_ratio"}
    again = problem_of(table, prior=priors, pool=pool)
    q = problem.prior.draw(np.random.default_rng(2), 5)
    assert_array_equal(again.prior.log_density(q), problem.prior.log_density(q))


def test_draws_follow_the_priors():
    prior = PRIORS | {"cor_10": "beta(3, 1)", "v_y_sd": "gamma(2, 0.1)"}
    problem = problem_of(table_of(REBOUND), prior=prior)
    values = problem.prior.value(problem.prior.draw(np.random.default_rng(2), 3000))
    exact = {
        "mu": stats.uniform(0.2, 0.7),
        "e_x": stats.truncnorm(-2, 2, 0, 0.5),
        "v_x_sd": stats.loguniform(0.01, 3),
        "cor_10": stats.beta(3, 1),
        "v_y_sd": stats.gamma(2, scale=0.1),
    }
    for name, law in exact.items():
        drawn = values[:, problem.free.index(name)]
        assert stats.kstest(drawn, law.cdf).pvalue > 1e-3
        assert stats.kstest(drawn * 1.25, law.cdf).pvalue < 1e-3


def test_widths_are_sds():
    prior = {
        "mu": "uniform(0.2, 0.9)",
        "e_x": "normal(0, 0.1)",
        "cor_10": "beta(3, 2)",
        "v_y_sd": "gamma(3, 0.1)",
    }
    problem = problem_of(table_of(REBOUND), prior=prior)
    drawn = problem.prior.draw(np.random.default_rng(3), 20_000).std(axis=0)
    for name in (*prior, "v_x_sd"):
        k = problem.free.index(name)
        assert problem.prior.width[k] == pytest.approx(drawn[k], rel=0.02)


@pytest.mark.parametrize("kind", ["normal", "student-t"])
def test_noise_against_scipy_and_quadrature(kind):
    noise = noise_kind(kind)
    nu = np.array([2.0, 5.0, 90.0])
    values = {"degrees_of_freedom": nu}
    z = np.linspace(-30.0, 30.0, 121) * np.ones((3, 1))
    laws = [stats.norm if kind == "normal" else stats.t(freedom) for freedom in nu]
    exact = np.array([law.logpdf(row) for law, row in zip(laws, z, strict=True)])
    assert_allclose(noise.log_density(z, values), exact, rtol=1e-10)
    assert_allclose(
        noise.log_density(z[:, :, None, None], values)[..., 0, 0],
        exact,
        rtol=1e-10,
    )
    residual, rate = noise.residual(z, values)
    middle = np.array([[law.logpdf(0.0)] for law in laws])
    assert_allclose(residual**2, 2.0 * (middle - exact), rtol=1e-9, atol=1e-12)
    above, below = (noise.residual(z + step, values)[0] for step in (1e-6, -1e-6))
    assert_allclose(rate, (above - below) / 2e-6, rtol=1e-7)
    centre, scale = (np.broadcast_to(share, 3) for share in noise.information(values))
    for k, law in enumerate(laws):

        def score(x, law=law):
            return (law.logpdf(x + 1e-5) - law.logpdf(x - 1e-5)) / 2e-5

        def on_centre_at(x, law=law, score=score):
            return law.pdf(x) * score(x) ** 2

        def on_scale_at(x, law=law, score=score):
            return law.pdf(x) * (1.0 + x * score(x)) ** 2

        on_centre, _ = integrate.quad(on_centre_at, -np.inf, np.inf)
        on_scale, _ = integrate.quad(on_scale_at, -np.inf, np.inf)
        assert (centre[k], scale[k]) == pytest.approx((on_centre, on_scale), rel=1e-4)
    drawn = noise.draw(np.random.default_rng(4), (3, 4000), values)
    assert all(
        stats.kstest(row, law.cdf).pvalue > 1e-3 for row, law in zip(drawn, laws, strict=True)
    )
    with pytest.raises(ParameterError) as caught:
        noise_kind("students")
    assert caught.value.code == "noise"


def test_priors_that_nobody_chose():
    table = table_of(TIMED, "sd", gaps=True)
    speed = np.median(np.hypot(table.values["v_x1"], table.values["v_y1"]))
    angle = f"{np.arctan2(0.25, speed):.2g}"
    stated = problem_of(table, text="two-mass").prior_texts
    assert {n: stated[n] for n in stated if n.endswith("_sd")} == {
        "v_x_sd": "half-t(0.25, 4)",
        "v_y_sd": "half-t(0.25, 4)",
        "spin_sd": "half-t(10, 4)",
        "contact_time_sd": "half-t(2e-4, 4)",
        "gap_time_sd": "half-t(1e-4, 4)",
        "gap_path_sd": "half-t(1e-3, 4)",
        "gap_turn_sd": f"half-t({angle}, 4)",
    }
    scene = Scene(
        ball=BallSection(mass=ValueWithSd(0.0577, 1e-4), inertia=ValueWithSd(3.5e-5, 7e-7)),
        surface={"mu": ValueWithSd(0.55, 0.05)},
        measurement={
            "nominal_velocity_sd": 0.4,
            "spin_sd": 7.0,
            "nominal_v_y_sd": 0.1,
            "noise": "student-t",
        },
    )
    problem = build_problem(replace(table, sd={}), scene, Choices("grip-slip"))
    square = 0.0577 * 0.03302**2
    assert problem.prior_texts == {
        "mu": "normal(0.55, 0.05)",
        "e_x": "normal(0, 0.5)",
        "offset": "normal(0, 0.005)",
        "cor_10": "normal(0.75, 0.15)",
        "cor_slope": "normal(0, 0.02)",
        "degrees_of_freedom": "lognormal(8, 0.8)",
        "v_x_sd": "lognormal(0.4, 0.7)",
        "v_y_sd": "lognormal(0.1, 0.7)",
        "spin_sd": "7.0",
        "ball_mass": "normal(0.0577, 0.0001)",
        "inertia_ratio": f"normal({3.5e-5 / square:.10g}, {7e-7 / square:.10g})",
    }
    measured = {parameter.spec.name for parameter in problem.parameters if parameter.measured}
    assert measured == {"ball_mass", "inertia_ratio"}
    assert {note.code for note in problem.notes} >= {"unused-column", "assumed-ball"}
    held = problem_of(
        table_of(REBOUND),
        Scene(surface={"mu": 0.6}, measurement={"velocity_sd": 0.1}),
    )
    fixed = {
        parameter.spec.name: parameter.fixed
        for parameter in held.parameters
        if parameter.fixed is not None
    }
    assert fixed == {"mu": 0.6, "v_x_sd": 0.1, "v_y_sd": 0.1}


def test_assumptions_are_named_where_they_concern_a_free_parameter():
    def named(*of, **choices):
        every = {"no-friction", "no-contact-time", "no-velocity-noise", "no-spin-noise"}
        return {note.code for note in problem_of(*of, **choices).notes} & every

    table = table_of(REBOUND)
    timed = table_of(TIMED)
    assert named(table) == {"no-friction", "no-velocity-noise", "no-spin-noise"}
    assert named(table, text="two-mass") == {
        "no-friction",
        "no-contact-time",
        "no-velocity-noise",
        "no-spin-noise",
    }
    assert named(timed, text="two-mass") == {"no-friction", "no-velocity-noise", "no-spin-noise"}
    assert named(table, fix={"mu": 0.5, "spin_sd": 5.0, "v_x_sd": 0.1}) == {"no-velocity-noise"}
    assert "no-friction" in named(table_of(REBOUND, labels=("surface",)))
    # Who states a prior, here or in the scene, leaves nothing open; of a spread it says nothing.
    by_scene = Scene(prior={"mu": "beta(6, 4)", "v_x_sd": "half-normal(0.2)"})
    assert named(table, by_scene) == {"no-velocity-noise", "no-spin-noise"}
    priors = {"spin_sd": "half-normal(9)", "k_y": "lognormal(2e4, 0.5)"}
    assert named(table, prior=priors, text="two-mass") == {"no-friction", "no-velocity-noise"}
    several = table_of(REBOUND, labels=("surface",))
    assert "no-friction" in named(several, prior={"mu_spread": "half-normal(0.1)"})


def test_what_the_table_does_not_show_is_held():
    spinless = table_of(("v_x2", "v_y2"))
    spinless = replace(
        spinless,
        values={n: v for n, v in spinless.values.items() if n != "omega_1"},
    )
    named = {parameter.spec.name: parameter for parameter in problem_of(spinless).parameters}
    assert named["offset"].fixed == 0.0
    assert "no-spin" in {n.code for n in problem_of(spinless).notes}
    assert problem_of(spinless, text="").forward.model.text == "brody"
    drop = table_of(("v_y2",))
    drop = replace(drop, values={"v_y1": drop.values["v_y1"], "v_y2": drop.values["v_y2"]})
    fallen = problem_of(drop, text="")
    assert not fallen.forward.model.tangential
    assert fallen.free == ("cor_10", "cor_slope", "v_y_sd")
    stiffness = {parameter.spec.name: parameter for parameter in fallen.parameters}["k_y"]
    assert stiffness.fixed == 2e4
    assert "k_y" in problem_of(drop, Scene(contact_time=ValueWithSd(5e-3, 5e-4)), text="").free


def test_the_user_overrides_the_scene_and_a_stored_fit_the_defaults():
    table = table_of(REBOUND, labels=("surface",))
    priors = {"e_x": "normal(0.1, 0.1)", "k_theta": "lognormal(20, 1)"}
    scene = Scene(prior=priors, fix={"offset": 0.001}, pool={"mu": "none"})
    problem = problem_of(table, scene, prior={"offset": "normal(0, 0.001)"}, fix={"e_x": 0.05})
    assert problem.prior_texts["offset"] == "normal(0, 0.001)"
    assert problem.prior_texts["e_x"] == "0.05"
    assert problem.prior_texts["mu"] == "lognormal(0.6, 0.4)"
    assert "mu" in problem.free
    stored = problem.prior_texts | {
        "cor_slope": "normal(0, 0.5)",
        "cor_10_spread": "half-t(0.01, 3)",
        "v_x_sd": "0.3",
    }
    again = build_problem(table, scene, problem.choices, prior_texts=stored)
    assert again.prior_texts == stored
    assert again.free == tuple(n for n in problem.free if n != "v_x_sd")
    q = near(problem, 3)
    same = build_problem(table, scene, problem.choices, prior_texts=problem.prior_texts)
    assert same.parameters == problem.parameters
    assert same.notes == problem.notes
    assert_array_equal(same.prior.log_density(q), problem.prior.log_density(q))
    literature = problem_of(table, prior={"mu": "literature:clay"}, pool={"mu": "none"})
    assert literature.prior_texts["mu"].startswith("normal(0.73")
    assert "published-prior" in {note.code for note in literature.notes}


@pytest.mark.parametrize(
    ("choices", "code"),
    [
        ({"prior": {"nu": "normal(0, 1)"}}, "unknown-parameter"),
        ({"fix": {"mu_spread": 0.1}}, "unknown-parameter"),
        ({"fix": {"mu": -1.0}}, "out-of-bounds"),
        ({"fix": {"v_x_sd": 0.0}}, "out-of-bounds"),
        ({"prior": {"mu": "normal(0.5)"}}, "prior"),
        ({"noise": "cauchy"}, "noise"),
        ({"text": "golf"}, "unknown-model"),
        (
            {"fix": dict.fromkeys(("mu", "e_x", "offset", "cor_10", "cor_slope"), 0.0)},
            "nothing-to-fit",
        ),
    ],
)
def test_what_is_refused(choices, code):
    with pytest.raises((ParameterError, ModelError, FitError)) as caught:
        problem_of(table_of(REBOUND), **choices)
    assert caught.value.code == code


def test_tables_that_cannot_be_fitted():
    for table, code in (
        (table_of(REBOUND).take(np.array([1])), "too-few-impacts"),
        (table_of(("contact_time",)), "nothing-to-fit"),
    ):
        with pytest.raises(FitError) as caught:
            problem_of(table)
        assert caught.value.code == code
    corr = table_of(REBOUND, "corr")
    tied = replace(corr, corr={"v_x2,omega_2": np.ones(10)})
    assert problem_of(tied).rows.errors is not None
    with pytest.raises(FitError) as caught:
        problem_of(tied, fix={"v_x_sd": 0.0, "spin_sd": 0.0})
    assert caught.value.code == "singular-errors"
    assert problem_of(corr, fix={"v_x_sd": 0.0, "spin_sd": 0.0}).prior_texts["spin_sd"] == "0.0"
    # Whichever side of nothing rounding leaves.
    for sd in np.linspace(0.05, 0.3, 12):
        exact_errors = impact_table(
            {"v_x1": [20.0, 21.0], "v_y1": 8.0, "v_x2": 15.0},
            {"v_x1": 0.13, "v_x2": sd},
            {("v_x1", "v_x2"): 1},
        )
        with pytest.raises(FitError):
            row_errors(exact_errors, ("v_x2",), ("v_x2",))
    values = {"v_y1": [8.0, 9.0], "contact_time": 0.005}
    sds = {"v_y1": 0.1, "contact_time": 5e-6}
    fine = impact_table(values, sds, {("v_y1", "contact_time"): 0.5})
    assert row_errors(fine, ("contact_time",), ("contact_time",)).note.code == "uncertain-states"
    exact = replace(corr, sd={"v_x2": np.full(10, 0.1), "omega_2": np.full(10, 5.0)})
    assert row_errors(exact, REBOUND).note.code == "correlated-errors"


def test_choices_for_another_model():
    fix = {"spin_sd": 5.0}
    pool = {"mu": "surface", "all": "none"}
    prior = {"mu_spread": "half-t(1, 4)", "tilt[a]": "normal(0, 1)"}
    choices = Choices(
        "two-mass",
        fix | {"k_y": 2e4},
        prior | {"eps_10": "normal(0, 1)"},
        pool | {"k_y": "ball"},
    )
    brody = choices.for_model("brody", [spec.name for spec in model("brody").parameters])
    assert brody == Choices("brody", fix, prior, pool)


def test_summaries_of_draws():
    rng = np.random.default_rng(6)
    draws = rng.standard_normal(20_000)
    summary = summarise(3.0 + 2.0 * draws, 2.9)
    exact = 3.0 + 2.0 * stats.norm.ppf([0.025, 0.16, 0.5, 0.84, 0.975])
    assert_allclose(
        [summary.q025, summary.q16, summary.median, summary.q84, summary.q975],
        exact,
        atol=0.08,
    )
    assert summary.point == 2.9
    assert summary.sd == pytest.approx(2.0, rel=0.02)
    with_gaps = np.column_stack(
        [draws, np.where(draws > 0.5, np.nan, draws), np.where(draws > -0.1, np.nan, draws)]
    )
    quantiles = bands(with_gaps)
    assert np.isfinite(quantiles[:, :2]).all()
    assert np.isnan(quantiles[:, 2]).all()
    assert_allclose(
        quantiles[:, 1],
        np.quantile(draws[draws <= 0.5], [0.025, 0.16, 0.5, 0.84, 0.975]),
    )
    assert np.isnan(summarise(np.empty(0), 1.0).median)
    assert summarise(np.empty(0), 1.0).point == 1.0


def test_streams_of_random_numbers_depend_on_seed_and_purpose_alone():
    effort = Effort(seed=3)
    first = effort.stream("search").random(4)
    effort.stream("chains").random(100)
    assert_array_equal(effort.stream("search").random(4), first)
    others = np.stack(
        [effort.stream("chains").random(4), Effort(seed=4).stream("search").random(4)]
    )
    assert np.all(np.abs(others - first) > 1e-6)
    for wrong in ({"seed": -1}, {"max_steps": 10}, {"cores": 0}, {"seed": 1.5}, {"seed": "one"}):
        with pytest.raises(ParameterError) as caught:
            Effort(**wrong)
        assert caught.value.code == "effort"
