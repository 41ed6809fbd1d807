"""What a planned impact would tell: closed forms, identities of mutual information, and two estimators."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import nested_monte_carlo
import numpy as np
import pytest
from nested_monte_carlo import Planned, nested_gain

from fitball.data.lines import Range
from fitball.data.read import load_table
from fitball.data.scene import Camera, Quantity, Scene
from fitball.errors import ParameterError
from fitball.inference.design.asked import PlannedColumn, Sensor, as_before
from fitball.inference.design.knowledge import Knowledge, plate_rows, with_height, with_plate
from fitball.inference.design.make_plan import Asked, make_plan
from fitball.inference.design.search import information_rows, nothing_measured, over_draws, read
from fitball.inference.design.targets import of_parameters
from fitball.inference.problem.build import Choices, build_problem
from fitball.inference.problem.camera import View
from fitball.inference.problem.noise import StudentNoise
from fitball.inference.problem.observables import Observable
from fitball.inference.results.results import Posterior
from fitball.report.plan.document import render as plan_text
from fitball.tracks.film_text import parse_film
from fitball.tracks.precision import nine_covariance
from fitball.values import Impacts

ROOT = Path(__file__).resolve().parent.parent
RNG = np.random.default_rng(11)


def entropy_gain(prior, target, rows):
    """ln det of a normal target before and after, over two, by the covariance itself: nothing of `gain`."""
    after = np.linalg.inv(np.linalg.inv(prior) + rows.T @ rows)
    dets = [np.linalg.slogdet(target @ covariance @ target.T)[1] for covariance in (prior, after)]
    return 0.5 * (dets[0] - dets[1])


@pytest.mark.parametrize("parts", [1, 2, 5])
def test_gain_is_that_of_normal_posteriors(parts):
    """Rows in directions in which the posterior has variance one, as the design has them."""
    rows, towards = RNG.normal(size=(3, 4, 6, 5)), RNG.normal(size=(3, parts, 5))
    left = nothing_measured(towards)
    found = left.gains(rows)
    for d in range(3):
        for k in range(4):
            assert found[d, k] == pytest.approx(entropy_gain(np.eye(5), towards[d], rows[d, k]), rel=1e-9)
            after = left.after(rows[:, k]).sds[d]
            covariance = np.linalg.inv(np.eye(5) + rows[d, k].T @ rows[d, k])
            assert after == pytest.approx(np.sqrt(np.diag(towards[d] @ covariance @ towards[d].T)), rel=1e-9)


def test_gains_add_up_whatever_the_order_and_fall_for_the_whole():
    """The chain rule; and what is told of all parameters is told less and less (submodular)."""
    a, b = RNG.normal(size=(2, 2, 3, 4))
    for towards in (RNG.normal(size=(2, 1, 4)), np.broadcast_to(np.eye(4), (2, 4, 4))):
        left = nothing_measured(towards)
        first, second = (left.gains(one[:, None])[:, 0] for one in (a, b))
        then = left.after(a).gains(b[:, None])[:, 0]
        both = left.gains(np.concatenate([a, b], axis=1)[:, None])[:, 0]
        assert first + then == pytest.approx(both, rel=1e-9)
        assert second + left.after(b).gains(a[:, None])[:, 0] == pytest.approx(both, rel=1e-9)
        if towards.shape[1] == 4:
            assert np.all(then < second)


def test_parts_that_follow_from_others_add_nothing():
    towards = RNG.normal(size=(1, 2, 4))
    dependent = np.concatenate([towards, towards.sum(axis=1, keepdims=True), 0.0 * towards[:, :1]], axis=1)
    rows = RNG.normal(size=(1, 1, 3, 4))
    assert nothing_measured(dependent).gains(rows) == pytest.approx(nothing_measured(towards).gains(rows), rel=1e-6)


def test_a_mean_is_over_the_draws_that_can_be_evaluated():
    gains, known = np.array([[1.0, 2.0], [3.0, 9.0]]), np.array([[True, False], [True, False]])
    assert over_draws(gains, known)[0] == 2.0 and np.isnan(over_draws(gains, known)[1])


# --- a drop test with a known noise: v_y2 = v_y1 (cor_10 + cor_slope (v_y1 - 10)), which is linear

SIGMA = 0.1
COVARIANCE = np.array([[4e-4, 2e-5], [2e-5, 9e-6]])


def drop_table(noise=SIGMA, **more):
    frame = {"v_y1": [4.0, 6.0, 8.0, 10.0], "v_y2": [3.2, 4.7, 6.1, 7.5]}
    return {**frame, **({"v_y2_sd": [noise] * 4} if noise else {}), **more}


@pytest.fixture(scope="module")
def linear():
    """What is known of a linear model after a normal posterior."""
    problem = build_problem(
        load_table(drop_table(), name="drop"), Scene(), Choices(model="brody", velocity_noise="stated")
    )
    assert problem.free_names == ("cor_10", "cor_slope")
    draws = np.random.default_rng(3).multivariate_normal([0.75, -0.012], COVARIANCE, 4000)
    return Knowledge(problem, draws)


def first_order(known, planned, target, sensor, draws, together=False):
    """Gains (draws, impacts) of the impacts `planned` by derivatives, or of all of them (draws, 1)."""
    rows = information_rows(planned, *read(planned, draws, [sensor]), known.roots(draws))
    rows = rows.reshape(len(draws), 1, -1, rows.shape[-1]) if together else rows
    return nothing_measured(target.gradients(draws) @ known.root).gains(rows)


def dropped(known, *speeds):
    speed = np.array(speeds)
    return known.at(Impacts(0.0 * speed, speed, 0.0 * speed), np.zeros(speed.size, dtype=np.int64))


@pytest.mark.parametrize(
    ("names", "speeds"), [(("cor_slope",), (15.0,)), (("cor_10",), (4.0, 15.0)), (None, (3.0, 12.0))]
)
def test_both_estimators_find_the_closed_form(linear, names, speeds):
    target = of_parameters(linear.problem, names or linear.problem.free_names)
    design = np.array([[speed, speed * (speed - 10.0)] for speed in speeds]) / SIGMA
    exact = entropy_gain(
        np.cov(linear.coordinates, rowvar=False), target.gradients(linear.coordinates[:1])[0], design
    )
    planned, sensor = dropped(linear, *speeds), as_before(linear.problem)
    assert first_order(linear, planned, target, sensor, linear.some(3), together=True) == pytest.approx(
        exact, rel=1e-6
    )
    checked = nested_gain(linear, [Planned(planned, sensor)], target, np.random.default_rng(5))
    assert exact > 0.3 and checked.se < 0.06 and checked.settled
    assert checked.nats == pytest.approx(exact, abs=4.0 * checked.se)


def test_draws_are_moved_onto_the_target(linear, monkeypatch):
    """With half of all draws around each target nothing but their being moved onto it makes this exact."""
    monkeypatch.setattr(nested_monte_carlo, "OUTER", 400)
    monkeypatch.setattr(nested_monte_carlo, "NEAR", 2000)
    target, planned = of_parameters(linear.problem, ("cor_slope",)), dropped(linear, 4.0, 15.0, 16.0)
    design = np.array([[speed, speed * (speed - 10.0)] for speed in (4.0, 15.0, 16.0)]) / SIGMA
    exact = entropy_gain(np.cov(linear.coordinates, rowvar=False), np.array([[0.0, 1.0]]), design)
    checked = nested_gain(linear, [Planned(planned, as_before(linear.problem))], target, np.random.default_rng(5))
    assert exact > 0.6 and checked.nats == pytest.approx(exact, abs=3.0 * checked.se)


def test_what_cannot_tell_is_worth_nothing(linear):
    """A drop at the speed at which the line is anchored says nothing of its slope; the noise is far too large."""
    free = Knowledge(
        linear.problem, np.random.default_rng(4).multivariate_normal([0.75, -0.012], np.diag([4e-4, 9e-6]), 4000)
    )
    target, planned = of_parameters(free.problem, ("cor_slope",)), dropped(free, 10.0)
    for sensor in (as_before(free.problem), Sensor("blind", "", (PlannedColumn("v_y2", sd=np.array(1e4)),))):
        gain = first_order(free, planned, target, sensor, free.some(3))
        checked = nested_gain(free, [Planned(planned, sensor)], target, np.random.default_rng(5))
        assert np.all(gain < 2e-3) and abs(checked.nats) < 4.0 * checked.se + 2e-3


def test_repeats_are_impacts_made_again(linear):
    once, again = (
        make_plan(linear.problem, posterior_of(linear), Asked(speed=Range(8.0, 8.0), sensors=["none"], **asked))
        for asked in ({"impacts": 3}, {"impacts": 1, "repeats": 3})
    )
    assert again.gain == pytest.approx(once.gain, rel=1e-9)
    assert again.chosen[0].sds == pytest.approx(once.chosen[-1].sds, rel=1e-9)


def posterior_of(known):
    return posterior_from(known.problem, known.problem.to_values(known.coordinates))


def posterior_from(problem, draws):
    return Posterior(problem.free_names, draws[None, :, None, :], np.zeros((1, len(draws), 1)), draws)


def test_the_batch_is_that_of_the_optimum_for_a_line(linear):
    """About a slope alone the speeds at both ends are best, the faster first: Elfving's design for a line."""
    asked = Asked(target="cor_slope", speed=Range(4.0, 16.0, 7), impacts=4, sensors=["none"])
    plan = make_plan(linear.problem, posterior_of(linear), asked)
    speeds = [one.setting.speed for one in plan.chosen]
    assert set(speeds) <= {16.0, 8.0, 6.0, 4.0} and speeds[0] == 16.0
    assert plan.gain > plan.again > 0.0
    planned = [Planned(dropped(linear, *speeds), as_before(linear.problem))]
    checked = nested_gain(linear, planned, of_parameters(linear.problem, ("cor_slope",)), np.random.default_rng(5))
    assert plan.gain == pytest.approx(checked.nats, abs=4.0 * checked.se + 0.02)


def test_heavy_tails_and_uncertain_noise_are_worth_less(linear):
    planned, sensor, draws = dropped(linear, 12.0), as_before(linear.problem), linear.some(2)
    rows = information_rows(planned, *read(planned, draws, [sensor]), linear.roots(draws))

    class Five(StudentNoise):
        def _freedom(self, sizes):
            return np.full(2, 5.0)

    tailed = replace(planned, noise=Five())
    heavy = information_rows(tailed, *read(tailed, draws, [sensor]), linear.roots(draws))
    assert (heavy**2).sum() == pytest.approx(0.75 * (rows**2).sum(), rel=1e-9)


def test_student_scale_information_is_that_of_its_density():
    """By the variance of the slope of the log density with respect to the logarithm of the scale."""
    kind, sizes, step = StudentNoise(), {"degrees_of_freedom": np.array([6.0])}, 1e-5
    grid = np.linspace(-400.0, 400.0, 200_001)[None]
    shorter, longer = (kind.log_density(grid * np.exp(move), sizes) for move in (-step, step))
    slope = (shorter - longer) / (2.0 * step) - 1.0
    found = np.trapezoid(np.exp(kind.log_density(grid, sizes)) * slope**2, grid)[0]
    assert float(kind.scale_information(sizes)[0]) == pytest.approx(found, rel=1e-3)


def test_a_fitted_noise_is_learned_too(linear):
    """n normal measurements tell ln sigma as 2n does: half of ln(1 + 2 n var) nats."""
    problem = build_problem(load_table(drop_table(0.0), name="drop"), Scene(), Choices(model="brody"))
    name = problem.free_names[-1]
    assert name.endswith("_sd")
    rng = np.random.default_rng(6)
    draws = np.column_stack(
        [rng.multivariate_normal([0.75, -0.012], 1e-12 * COVARIANCE, 4000), rng.normal(np.log(0.1), 0.3, 4000)]
    )
    known = Knowledge(problem, draws)
    target, planned = of_parameters(problem, (name,)), dropped(known, 6.0, 6.0, 6.0)
    gain = first_order(known, planned, target, as_before(problem), known.some(2), together=True)
    exact = 0.5 * np.log(1.0 + 6.0 * draws[:, 2].var(ddof=1))
    assert gain == pytest.approx(exact, rel=1e-4)
    checked = nested_gain(known, [Planned(planned, as_before(problem))], target, np.random.default_rng(7))
    assert checked.nats == pytest.approx(exact, abs=0.1)


# --- a force plate


@pytest.fixture(scope="module")
def sprung():
    """What is known of a drop of the two-mass ball whose stiffness nobody measured."""
    scene = Scene(priors={"k_y": "lognormal(2.6e4, 1.0)"})
    problem = build_problem(
        load_table(drop_table(), name="drop"), scene, Choices(model="two-mass", velocity_noise="stated")
    )
    rng = np.random.default_rng(12)
    spread = {"k_y": (np.log(2.6e4), 0.3), "cor_10": (0.73, 2e-3), "cor_slope": (0.0, 5e-4)}
    draws = np.column_stack([rng.normal(*spread[name], 4000) for name in problem.free_names])
    return Knowledge(problem, draws)


def expected_sd(known, sd, misfit, name="k_y"):
    """Of the logarithm of a parameter after five records, those of the bundled drops."""
    plated = with_plate(known, sd, np.random.default_rng(1))
    draws = plated.some(20)
    draws[:, -1] = np.log(misfit)
    at = dropped(plated, 4.0, 6.0, 8.0, 10.0, 12.0)
    rows = plate_rows(at, draws, np.ones((20, 5), dtype=bool), plated.roots(draws))
    left = nothing_measured(of_parameters(plated.problem, (name,)).gradients(draws) @ plated.root)
    for k in range(5):
        left = left.after(rows[:, k])
    return float(np.median(left.sds))


def test_a_force_plate_tells_stiffness_as_records_did(sprung):
    """Noise and misfit as in the fit of the bundled records, whose k_y was known within 0.51 % (fits/readme)."""
    numbers = json.loads((ROOT / "fits" / "readme" / "numbers.json").read_text(encoding="utf-8"))["stiffness"]["drop"]
    assert expected_sd(sprung, 4.2, 0.02) == pytest.approx(numbers["sd"] / numbers["median"], rel=0.35)
    # The same fit knew its misfit within 13 %.
    assert expected_sd(sprung, 4.2, 0.02, "force_misfit") == pytest.approx(0.13, rel=0.35)
    assert expected_sd(sprung, 1e7, 0.02) == pytest.approx(0.3, rel=0.03)
    assert expected_sd(sprung, 4.2, 0.2) > 3.0 * expected_sd(sprung, 4.2, 0.02)


def test_a_plan_chooses_a_plate_that_tells_more(sprung):
    asked = Asked("k_y", Range(4.0, 12.0, 3), impacts=2, sensors=["force=4N"], cost={"force": 1.0})
    plan = make_plan(sprung.problem, posterior_of(sprung), asked)
    assert plan.chosen[0].sensor == "force"
    assert plan.chosen[-1].sds[0] < 0.05 < plan.worths[0].sds[0]
    assert plan.worths[1].batch == pytest.approx(plan.gain, rel=1e-6)


# --- a camera that sees the gaps

TRUTH = {"mass_ratio": (0.87, 0.01), "k_y": (2e4, 0.1), "k_theta": (20.0, 0.1), "mu": (0.56, 0.02),
         "eps_10": (2.4e-3, 2e-4), "eps_slope": (0.0, 5e-5), "cor_10": (0.776, 5e-3),
         "cor_slope": (-0.016, 5e-4)}  # fmt: skip
STATED = {"v_x2": 0.2, "v_y2": 0.2, "omega_2": 8.0}
SEEN = {"gap_time": 1e-4, "gap_path": 1e-3, "gap_turn": 0.04}


@pytest.fixture(scope="module")
def filmed():
    """What is known of a two-mass ball, `k_y` and `k_theta` to 1 %, by a table with stated errors."""
    columns = {name: [1.0, 2.0, 3.0] for name in ("v_x1", "v_y1", "v_x2", "v_y2", "omega_2")}
    columns |= {"v_x1": [16.0, 14.0, 12.0], "v_y1": [6.0, 9.0, 12.0], "v_x2": [12.0, 10.0, 8.0],
                "v_y2": [5.0, 7.0, 9.0], "omega_2": [250.0, 270.0, 260.0]}  # fmt: skip
    frame = columns | {f"{name}_sd": [sd] * 3 for name, sd in STATED.items()}
    problem = build_problem(
        load_table(frame, name="filmed"), Scene(), Choices(model="two-mass", velocity_noise="stated")
    )
    rng, logs = np.random.default_rng(21), [item.prior.log for item in problem.free]
    centre = problem.to_coordinates(np.array([[TRUTH[name][0] for name in problem.free_names]]))[0]
    spread = np.array([TRUTH[name][1] for name in problem.free_names])
    assert problem.free_names == tuple(TRUTH) and logs[1] and logs[2]
    # So narrow that the model is linear over the draws.
    return Knowledge(problem, centre + 0.1 * spread * rng.standard_normal((4000, spread.size)))


def seen_by(problem, impact, height):
    """Rebound and gaps of one impact by the model itself, (columns,), at coordinates and the height of the court."""

    def at(coordinates):
        values = dict(zip(problem.free_names, problem.to_values(coordinates[None])[0], strict=True))
        made = problem.model.rebound(values, impact)
        v_y1, v_x1, omega_1 = impact.v_y1[0], impact.v_x1[0], impact.omega_1[0]
        v_x2, v_y2, omega_2 = made.v_x2[0], made.v_y2[0], made.omega_2[0]
        # A court that is higher is reached earlier and left later.
        return np.array([
            v_x2, v_y2, omega_2, made.gap_time[0] - height * (1.0 / v_y1 + 1.0 / v_y2),
            made.gap_path[0] - height * (v_x1 / v_y1 + v_x2 / v_y2),
            made.gap_turn[0] - height * (omega_1 / v_y1 + omega_2 / v_y2),
        ])  # fmt: skip

    return at


@pytest.mark.parametrize("fps", [240, 1000])
def test_a_film_is_worth_what_its_frames_determine_errors_of_the_incident_state_included(filmed, fps):
    """By differences of the model itself, and by the whole covariance of the nine."""
    text = f"fps={fps}, noise=1mm"
    asked = Asked("k_y", Range(18.0, 18.0), Range(0.5, 0.5), Range(50.0, 50.0), impacts=1, sensors=[text])
    plan = make_plan(filmed.problem, posterior_of(filmed), asked)
    state = np.array([18.0 * np.cos(0.5), 18.0 * np.sin(0.5), 50.0])
    impact, centre = Impacts(*state[:, None]), filmed.coordinates.mean(axis=0)
    rows, seen = [], seen_by(filmed.problem, impact, 0.0)
    for k, size in enumerate(filmed.coordinates.std(axis=0)):
        step = 1e-3 * size * np.eye(centre.size)[k]
        rows.append((seen(centre + step) - seen(centre - step)) / (2e-3 * size))
    rows.append(
        (seen_by(filmed.problem, impact, 1e-3)(centre) - seen_by(filmed.problem, impact, -1e-3)(centre)) / 2e-3
    )
    slopes, moved = np.stack(rows, axis=1), []
    for k, step in enumerate((1e-3, 1e-3, 1e-2)):
        ends = [Impacts(*(state + sign * step * np.eye(3)[k])[:, None]) for sign in (1.0, -1.0)]
        more, less = (seen_by(filmed.problem, one, 0.0)(centre) for one in ends)
        moved.append((more - less) / (2.0 * step))
    values = dict(zip(filmed.problem.free_names, filmed.problem.to_values(centre[None])[0], strict=True))
    nine = nine_covariance(impact, filmed.problem.model.rebound(values, impact), parse_film(text), Scene().ball)[0]
    # What is measured less what the model makes of the measured incident state.
    residual = np.hstack([-np.stack(moved, axis=1), np.eye(6)])
    spread = residual @ nine @ residual.T
    prior = np.zeros((9, 9))
    prior[:8, :8], prior[8, 8] = np.cov(filmed.coordinates, rowvar=False), plan.height.sd**2
    after = np.linalg.inv(np.linalg.inv(prior) + slopes.T @ np.linalg.solve(spread, slopes))
    place = filmed.problem.free_names.index("k_y")
    assert plan.worths[1].sds[0] == pytest.approx(np.sqrt(after[place, place]), rel=2e-3)
    # Negative control: errors of landing and release belong together, and with those of the incident state.
    apart = np.linalg.inv(np.linalg.inv(prior) + slopes.T @ np.linalg.solve(np.diag(np.diag(spread)), slopes))
    assert apart[place, place] != pytest.approx(after[place, place], rel=2e-2)


def test_more_frames_and_a_mark_tell_more_and_too_few_tell_nothing(filmed):
    texts = ["fps=100,noise=1mm", "fps=240,noise=1mm", "fps=1000,noise=1mm", "fps=1000,noise=1mm,mark=none", "fps=15"]
    asked = Asked("k_theta", Range(18.0, 18.0), Range(0.5, 0.5), Range(50.0, 50.0), impacts=1, sensors=texts)
    slow, middle, fast, unmarked, none = make_plan(filmed.problem, posterior_of(filmed), asked).worths[1:]
    assert slow.gain < middle.gain < fast.gain
    assert unmarked.gain < 0.9 * fast.gain
    assert none.gain == pytest.approx(0.0, abs=1e-6)
    assert "1000 frames/s, noise 1 mm, view 0.8 m, no mark" in unmarked.words


@pytest.mark.parametrize(
    ("text", "words"),
    [("fps=240,noise=3", "expected a unit of length"), ("fps=ten", "expected a number"), ("fps=240,drop=1m", "drop")],
)
def test_a_film_that_is_none_is_refused(filmed, text, words):
    with pytest.raises(ParameterError, match=words):
        make_plan(filmed.problem, posterior_of(filmed), Asked("k_y", sensors=[text]))


@pytest.mark.parametrize(("stated", "known_to"), [(None, 3e-3), (Camera(court_height=Quantity(0.0, 3e-4)), 3e-4)])
def test_gaps_tell_stiffness_as_far_as_the_height_of_the_court_is_known(filmed, stated, known_to):
    """By differences of the model itself, with the height as one more unknown."""
    share, problem = 0.1, replace(filmed.problem, scene=replace(filmed.problem.scene, camera=stated))
    asked = Asked("k_y", Range(18.0, 18.0), Range(0.5, 0.5), Range(50.0, 50.0), impacts=1, sensors=[f"gaps={share}"])
    plan = make_plan(problem, posterior_of(filmed), asked)
    assert plan.height is not None and plan.height.sd == pytest.approx(known_to, rel=0.05)
    impact = Impacts([18.0 * np.cos(0.5)], [18.0 * np.sin(0.5)], [50.0])
    centre = filmed.coordinates.mean(axis=0)
    rows = []
    for k, size in enumerate(filmed.coordinates.std(axis=0)):
        step = 1e-3 * size * np.eye(centre.size)[k]
        at = seen_by(problem, impact, 0.0)
        rows.append((at(centre + step) - at(centre - step)) / (2e-3 * size))
    rows.append((seen_by(problem, impact, 1e-3)(centre) - seen_by(problem, impact, -1e-3)(centre)) / 2e-3)
    sds = np.array([*STATED.values(), *(share * sd for sd in SEEN.values())])
    slopes = np.stack(rows, axis=1) / sds[:, None]
    prior = np.zeros((9, 9))
    prior[:8, :8] = np.cov(filmed.coordinates, rowvar=False)
    prior[8, 8] = plan.height.sd**2
    place = problem.free_names.index("k_y")
    after = np.linalg.inv(np.linalg.inv(prior) + slopes.T @ slopes)
    assert plan.worths[1].sds[0] == pytest.approx(np.sqrt(after[place, place]), rel=0.03)
    words = f"an error of 1 mm changes gap_time by {plan.height.gap_time:.2f} ms"
    # Not where gaps add nothing.
    assert (words in " ".join(plan_text(plan, problem).split())) == (known_to < 1e-3)
    assert plan.height.gap_time == pytest.approx(-rows[-1][3], rel=0.01)
    sure = np.linalg.inv(np.linalg.inv(prior[:8, :8]) + slopes[:, :8].T @ slopes[:, :8])
    assert np.sqrt(sure[place, place] / after[place, place]) < 0.9


def test_a_height_that_was_fitted_counts_as_the_fit_knows_it(filmed):
    """A fit with gaps took it as known, or has it as a parameter: nothing is added to either."""
    gap = Observable("gap_time", np.full(3, 5e-3), np.full(3, 1e-4), None)
    measured = replace(filmed.problem, observables=(*filmed.problem.observables, gap))
    for problem in (measured, replace(filmed.problem, camera=View(("court_height",), ("",), np.zeros(3, np.int64)))):
        known = replace(filmed, problem=problem)
        assert with_height(known, np.random.default_rng(1)) is known
    open_height = with_height(filmed, np.random.default_rng(1))
    assert open_height.problem.free_names == (*filmed.problem.free_names, "court_height")
    assert open_height.coordinates[:, -1].std() == pytest.approx(3e-3, rel=0.05)
    # Rebound velocities do not depend on it.
    rebound, slopes = dropped(open_height, 8.0).differentiated(open_height.some(3))
    assert not np.any(slopes["v_y2"][..., -1]) and np.all(slopes["gap_time"][..., -1] < -0.2)
    assert not np.any(rebound.status)
