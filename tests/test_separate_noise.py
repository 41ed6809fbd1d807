"""A noise for each measured column: which ones a problem gets, what they mean, and what tying them costs."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from samples import GRIP_SLIP, POLAR, search_briefly
from scipy import stats

import fitball
from fitball.api.reading import choices_of
from fitball.cli.main import main
from fitball.data.balances import scene_balances
from fitball.data.read import load_table
from fitball.data.scene import Scene, load_scene
from fitball.data.table import Measurement
from fitball.errors import ParameterError
from fitball.inference.comparison.candidates import build_candidates
from fitball.inference.identifiability.profile import profiles
from fitball.inference.likelihood.posterior import log_likelihood
from fitball.inference.prediction.new_impacts import observed_observables, predict_new, scores
from fitball.inference.problem.build import Choices, build_problem
from fitball.inference.problem.observables import (
    FACTOR,
    FREEDOM,
    SPENT,
    Derived,
    Observable,
    derived,
    noise_by_column,
    noise_in,
)
from fitball.inference.problem.parameters import NOISE_SPECS, SD_SPECS
from fitball.inference.results.fitted_model import FittedModel
from fitball.models.types import Rebound
from fitball.observables import NOISE_OF, OBSERVABLES, SHARED_SD
from fitball.report.form.numbers import handy, output_scale

WANG = load_table("wang_all.csv")
TRUTH = {**GRIP_SLIP, "v_x_sd": 0.6, "v_y_sd": 0.1}


def first_rows(count, table=WANG):
    given = table.impacts
    return replace(
        table,
        impacts=type(given)(given.v_x1[:count], given.v_y1[:count], given.omega_1[:count]),
        measurements=tuple(replace(item, values=item.values[:count]) for item in table.measurements),
        ids=table.ids[:count],
        labels={name: column[:count] for name, column in table.labels.items()},
        redundant=(),
    )


def noises(table, scene=None, **choices):
    """Noise parameter by column, all noise parameters with their fixed value, and the notes."""
    problem = build_problem(table, scene or Scene(), Choices(model="grip-slip", **choices))
    named = {item.name: item.fixed for item in problem.parameters if item.name in NOISE_SPECS}
    return {observable.name: observable.noise for observable in problem.observables}, named, problem.notes


def made(count, seed, noise=TRUTH):
    """A table of a grip-slip ball with errors of 0.6 m/s along the court and 0.1 m/s towards it."""
    rng = np.random.default_rng(seed)
    speed, angle = rng.uniform(9.0, 22.0, count), np.radians(rng.uniform(15.0, 60.0, count))
    impacts = fitball.impacts(speed * np.cos(angle), speed * np.sin(angle), rng.uniform(-150.0, 150.0, count))
    chosen = fitball.model("grip-slip")
    found = chosen.rebound({name: noise[name] for name in chosen.parameter_names}, impacts)
    measured = tuple(
        Measurement(name, getattr(found, name) + noise[NOISE_OF[name]] * rng.standard_normal(count))
        for name in ("v_x2", "v_y2", "omega_2")
    )
    return replace(
        WANG, impacts=impacts, measurements=measured, redundant=(), labels={}, ids=tuple(map(str, range(count)))
    )


def test_every_column_has_a_noise_with_its_unit():
    assert set(SD_SPECS) == {SHARED_SD, *NOISE_OF.values()}
    for name, item in OBSERVABLES.items():
        assert SD_SPECS[item.noise.name].unit == item.unit
        assert handy(item.noise.name, item.unit) == output_scale(name)
    assert handy("angle_sd", "rad").unit == "deg"


def test_the_threshold_is_where_a_factor_of_two_is_no_chance():
    """The least freedom at which two sds of equal noises differ by less than FACTOR in 95 % of all tables."""

    def reach(nu):
        return np.sqrt(stats.f.ppf(0.975, nu, nu))

    assert reach(FREEDOM) <= FACTOR < reach(FREEDOM - 1)
    rng = np.random.default_rng(3)
    ratio = np.sqrt(rng.chisquare(FREEDOM, 40_000) / rng.chisquare(FREEDOM, 40_000))
    assert 0.955 < np.mean((ratio < FACTOR) & (ratio > 1.0 / FACTOR)) < 0.975


def test_short_tables_share_one_noise_and_say_so():
    enough = FREEDOM + SPENT
    for table, tied in ((load_table("wang_zero_spin.csv"), True), (first_rows(enough - 1), True),
                        (first_rows(enough), False), (WANG, False)):  # fmt: skip
        columns, named, notes = noises(table)
        told = [note for note in notes if "share one noise" in note]
        assert (columns["v_x2"], columns["v_y2"]) == (("velocity_sd",) * 2 if tied else ("v_x_sd", "v_y_sd"))
        assert set(named) == ({"velocity_sd"} if tied else {"v_x_sd", "v_y_sd"}) | {"spin_sd"}
        assert len(told) == tied
        if tied:
            assert f"{len(table)} rows" in told[0]
            assert f"{enough} could" in told[0] and "'separate'" in told[0]
    # Three biases a column leave three rows less.
    labels = {"group": tuple("abc"[k % 3] for k in range(enough + 2))}
    short = replace(first_rows(enough + 2), labels=labels)
    assert noises(short)[0]["v_x2"] == "v_x_sd"
    assert noises(short, offsets="group")[0]["v_x2"] == "velocity_sd"


def test_one_column_has_nothing_to_share_with():
    drop = replace(WANG, measurements=tuple(item for item in WANG.measurements if item.name != "v_x2"))
    assert noises(drop)[0] == {"v_y2": "velocity_sd", "omega_2": "spin_sd"}
    assert not any("share" in note for note in noises(drop)[2])
    stated = replace(
        WANG,
        measurements=tuple(
            replace(item, sd=np.full(21, 0.2)) if item.name == "v_x2" else item for item in WANG.measurements
        ),
    )
    assert noises(stated)[0] == {"v_x2": "v_x_sd", "v_y2": "velocity_sd", "omega_2": "spin_sd"}


SHORT = load_table("wang_zero_spin.csv")
ONE = {"velocity_sd": 0.3, "spin_sd": None}
NAMED = {
    "a fixed one holds for both": (WANG, {}, {"fix": {"velocity_sd": 0.3}}, ONE),
    "a known one holds for both": (WANG, {"velocity_sd": 0.3}, {}, ONE),
    "so does a prior": (WANG, {}, {"priors": {"velocity_sd": "lognormal(0.3, 0.2)"}}, {**ONE, "velocity_sd": None}),
    "in the scene too": (WANG, {"priors": {"velocity_sd": "lognormal(0.3, 0.2)"}}, {}, {**ONE, "velocity_sd": None}),
    "one component named": (SHORT, {}, {"fix": {"v_x_sd": 0.6}}, {"v_x_sd": 0.6, "v_y_sd": None, "spin_sd": None}),
    "one component known": (SHORT, {"v_y_sd": 0.1}, {}, {"v_x_sd": None, "v_y_sd": 0.1, "spin_sd": None}),
    "a component beside all": (WANG, {"velocity_sd": 0.3}, {"fix": {"v_x_sd": 0.6}}, {"v_x_sd": 0.6, **ONE}),
    "asked for": (SHORT, {}, {"velocity_noise": "separate"}, {"v_x_sd": None, "v_y_sd": None, "spin_sd": None}),
    "by the scene": (WANG, {"velocity_noise": "tied"}, {}, {"velocity_sd": None, "spin_sd": None}),
    "the user wins": (WANG, {"velocity_noise": "separate"}, {"velocity_noise": "tied"}, {**ONE, "velocity_sd": None}),
}  # fmt: skip


@pytest.mark.parametrize("kind", NAMED)
def test_what_is_named_decides(kind):
    table, scene, choices, expected = NAMED[kind]
    _, named, notes = noises(table, Scene(**scene), **choices)
    assert named == expected
    told = any("share one noise, velocity_sd: a value or prior of it is given" in note for note in notes)
    assert told == ("velocity_sd" in expected and len(expected) == 2 and "velocity_noise" not in {*scene, *choices})


@pytest.mark.parametrize(
    ("given", "kind", "structure"),
    [
        (None, None, None), ("student-t", "student-t", None), ("separate", None, "separate"),
        ("tied, normal", "normal", "tied"), (["student-t", "separate"], "student-t", "separate"),
        ("tied,tied", None, "tied"),
    ],
)  # fmt: skip
def test_one_option_takes_kind_and_structure(given, kind, structure):
    chosen = choices_of(None, {"noise": given})
    assert (chosen.noise, chosen.velocity_noise) == (kind, structure)


def test_the_older_option_of_python_is_taken_with_a_note():
    with pytest.warns(FutureWarning, match="noise='separate'"):
        chosen = choices_of(None, {"noise": "student-t", "velocity_noise": "separate"})
    assert (chosen.noise, chosen.velocity_noise) == ("student-t", "separate")
    with pytest.raises(ParameterError, match="tied and separate"):
        choices_of(None, {"noise": "tied", "velocity_noise": "separate"})


def test_contradictions_name_what_to_write(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    words = ["calibrate", "wang_all.csv", "--model", "grip-slip", "--point-only", "--out", "a"]
    for more, expected in (
        (
            ["--noise", "separate", "--prior", "velocity_sd=lognormal(0.2, 0.5)"],
            "expected v_x_sd and v_y_sd",
        ),
        (["--noise", "tied", "--fix", "v_x_sd=0.3"], "expected velocity_sd"),
        (["--noise", "seperate"], "separate"),
        (["--noise", "tied", "--noise", "student-t,separate"], "tied and separate"),
        (["--fix", "velocity_sd=0.3", "--fix", "v_x_sd=0.3", "--fix", "v_y_sd=0.3"], "unknown parameter"),
    ):
        assert main([*words, *more]) == 2
        assert expected in capsys.readouterr().err


def test_the_scene_says_what_is_known_of_each(tmp_path):
    # No contact is known to 60 ms.
    sizes = {name: 0.01 * (k + 1) for k, name in enumerate(NOISE_OF.values())}
    sizes |= {"contact_time_sd": 0.001, "gap_time_sd": 0.001, "gap_path_sd": 0.01}
    known = "\n".join(f"{name} = {size}" for name, size in sizes.items())
    place = tmp_path / "scene.toml"
    place.write_text(f'[measurement]\nvelocity_noise = "separate"\n{known}\n', encoding="utf-8")
    scene = load_scene("wang_zero_spin.csv", place)
    assert scene.velocity_noise == "separate"
    assert {name: getattr(scene, name) for name in NOISE_OF.values()} == sizes
    assert not any("noise of the" in text for text in build_problem(SHORT, scene, Choices(model="brody")).notes)
    assert noises(SHORT, scene)[1] == {"v_x_sd": 0.01, "v_y_sd": 0.02, "spin_sd": 0.05}


def test_the_command_line_and_what_reads_its_files(tmp_path, monkeypatch, capsys, brief):
    """Exports know from fit.json alone which noise a column has."""
    monkeypatch.chdir(tmp_path)
    words = ["calibrate", "wang_zero_spin.csv", "--model", "grip-slip", "--point-only", "--quiet", "--out", "a"]
    assert main([*words, "--noise", "separate"]) == 0
    fit = json.loads((tmp_path / "a" / "fit.json").read_text("utf-8"))
    noise = {name for name in fit["parameters"] if name.endswith("_sd")}
    assert noise == {"v_x_sd", "v_y_sd", "spin_sd"}
    assert main(["export", "a", "--to", "json", "--out", "a.json"]) == 0
    exported = json.loads((tmp_path / "a.json").read_text("utf-8"))["parameters"]
    assert {name for name, item in exported.items() if item["role"] == "noise"} == noise
    capsys.readouterr()


def test_all_candidates_of_a_comparison_have_the_same_noise():
    names = ("brody", "grip-slip", "thesis-exact", "two-mass", "two-mass+cor=measured")
    for table, noise in ((WANG, "v_x_sd"), (SHORT, "velocity_sd")):
        found = build_candidates(table, load_scene(table.source), names).candidates
        assert {candidate.problem.observables[0].noise for candidate in found} == {noise}


def test_speed_and_angle_have_noises_of_their_own(tmp_path):
    """The likelihood written out: an angle's own noise is in radians, a shared one in m/s turns a fast ball less."""
    (tmp_path / "polar.csv").write_text(POLAR, encoding="utf-8")
    table = load_table(tmp_path / "polar.csv")
    values = {**GRIP_SLIP, "speed_sd": 0.3, "angle_sd": 0.02}
    for wanted in ("tied", "separate"):
        problem = build_problem(table, Scene(), Choices(model="grip-slip", velocity_noise=wanted))
        at = np.array([[values[name] for name in problem.free_names]])
        rebound = problem.rebound(at)
        speed = np.hypot(rebound.v_x2, rebound.v_y2)[0]
        angle = np.arctan2(rebound.v_y2, rebound.v_x2)[0]
        sds = (0.25, 0.25 / speed) if wanted == "tied" else (0.3, 0.02)
        expected = sum(
            stats.norm.logpdf(table.measurement(name).values, centre, sd).sum()
            for name, centre, sd in zip(
                ("v_2", "theta_2", "omega_2"), (speed, angle, rebound.omega_2[0]), (*sds, 10.0), strict=True
            )
        )
        assert log_likelihood(problem, at, rebound)[0] == pytest.approx(expected, rel=1e-12)
    expected_angle = next(item.prior for item in problem.parameters if item.name == "angle_sd")
    assert expected_angle.quantile(np.array([0.5]))[0] == pytest.approx(0.25 / 16.7, rel=0.02)
    with pytest.raises(ParameterError, match="expected speed_sd and angle_sd there"):
        noise_by_column(table, "separate", {"velocity_sd"}, 0, [])


@pytest.fixture(scope="module")
def fits():
    table = made(120, 5)
    with pytest.MonkeyPatch.context() as patch:
        search_briefly(patch)
        return {
            kind: fitball.calibrate(table, "grip-slip", scene=Scene(), noise=kind, seed=1, cores=1, max_steps=300)
            for kind in (None, "tied")
        }


def test_both_noises_are_recovered(fits):
    found = fits[None].parameters
    for name in ("v_x_sd", "v_y_sd", "spin_sd"):
        # The logarithm of an sd is known to 1/sqrt(2 nu), here to 0.065.
        assert abs(np.log(found[name].median / TRUTH[name])) < 3.5 * 0.065
        assert found[name].sd / found[name].median == pytest.approx(0.065, rel=0.25)
    assert fits["tied"].parameters["velocity_sd"].median == pytest.approx(np.sqrt((0.6**2 + 0.1**2) / 2.0), rel=0.16)


def test_intervals_cover_as_promised_and_those_of_one_noise_do_not(fits):
    new = made(400, 6)
    held = {}
    for kind, fit in fits.items():
        observables, _ = observed_observables(fit.fitted, new)
        found = scores(fit.predict_interval(new.impacts, observables))
        held[kind] = {item.output: (item.within_68, item.within_95) for item in found}
    # Three and a half sds of 400 counts and of a noise known to 6.5 %.
    for name in ("v_x2", "v_y2", "omega_2"):
        assert held[None][name] == (pytest.approx(0.68, abs=0.14), pytest.approx(0.95, abs=0.065))
    assert held["tied"]["v_x2"][0] < 0.62 and held["tied"]["v_x2"][1] < 0.90
    assert held["tied"]["v_y2"][0] > 0.98


def test_profiles_take_each_noise_at_its_best():
    table = made(40, 8)
    problem = build_problem(table, Scene(), Choices(model="grip-slip"))
    found = profiles(problem, [{**TRUTH}], names=["v_x_sd", "v_y_sd"]).by_name
    for name in ("v_x_sd", "v_y_sd"):
        low, high = found[name].interval_95
        assert low < found[name].best < high
        assert abs(np.log(found[name].best / TRUTH[name])) < 4.0 / np.sqrt(2.0 * 35.0)


VELOCITY = {
    "v_x2": lambda v_x, _v_y: v_x,
    "v_y2": lambda _v_x, v_y: v_y,
    "v_2": np.hypot,
    "theta_2": lambda v_x, v_y: np.arctan2(v_y, v_x),
}


@pytest.mark.parametrize(
    ("of", "back"),
    [
        (("v_x2", "v_y2"), lambda a, b: (a, b)),
        (("v_2", "theta_2"), lambda a, b: (a * np.cos(b), a * np.sin(b))),
        (("v_x2", "theta_2"), lambda a, b: (a, a * np.tan(b))),
    ],
)
def test_the_noise_of_what_was_not_measured_follows(of, back):
    """Against errors drawn and carried through: what is predicted beside the columns that were calibrated on."""
    v_x, v_y = np.array([9.0, 4.0]), np.array([3.0, 7.0])
    zero = np.zeros((1, 2))
    rebound = Rebound(v_x[None], v_y[None], *[zero] * 5, zero.astype(int), zero.astype(int))
    sizes = {NOISE_OF[name]: size for name, size in zip(of, (4e-3, 1e-3), strict=True)}
    rng = np.random.default_rng(4)
    first, second = (
        VELOCITY[name](v_x, v_y) + sizes[NOISE_OF[name]] * rng.standard_normal((40_000, 2)) for name in of
    )
    drawn = back(first, second)
    for name, column in VELOCITY.items():
        observable = derived(Observable(name, v_x, None, NOISE_OF[name]), sizes)
        assert isinstance(observable, Derived) == (name not in of)
        assert observable.known(sizes)
        sd = np.broadcast_to(observable.sds(sizes, rebound), (1, 2))[0]
        np.testing.assert_allclose(sd, np.std(column(*drawn), axis=0), rtol=0.02)


def test_predictions_know_the_noise_of_every_velocity_or_say_that_they_do_not():
    names = ("mu", "e_x", "offset", "cor_10", "cor_slope", "v_x_sd", "v_y_sd", "spin_sd")
    point = np.array([TRUTH[name] for name in names])
    impacts = fitball.impacts([14.0, 9.0], [6.0, 9.0], 0.0)
    fitted = FittedModel("grip-slip", {}, fitball.Ball(), True, names, point, np.tile(point, (4000, 1)), impacts)
    found = predict_new(fitted, impacts)
    rebound = fitted.rebound(impacts)
    cosine = (rebound.v_x2 / np.hypot(rebound.v_x2, rebound.v_y2))[0]
    assert found.output("v_x2").sd == pytest.approx(0.6, rel=0.06)
    assert found.output("v_y2").sd == pytest.approx(0.1, rel=0.06)
    np.testing.assert_allclose(
        found.output("v_2").sd, np.hypot(0.6 * cosine, 0.1 * np.sqrt(1 - cosine**2)), rtol=0.06
    )
    # Speeds and angles of a table that was measured another way are judged all the same.
    measured = (Measurement("v_2", found.output("v_2").point), Measurement("theta_2", found.output("theta_2").point))
    observables, _ = observed_observables(fitted, replace(first_rows(2), measurements=measured))
    assert all(item.within_95 == 1.0 for item in scores(predict_new(fitted, impacts, observables)))
    alone = replace(fitted, names=tuple("other_sd" if name == "v_y_sd" else name for name in names))
    known = {item.name: item.measured is not None for item in predict_new(alone, impacts).outputs}
    assert known == {"v_x2": True, "v_y2": False, "v_2": False, "theta_2": False, "omega_2": True}


def test_a_fit_read_back_has_the_noise_it_was_made_with():
    assert noise_in(["mu", "v_x_sd", "v_y_sd"]) == NOISE_OF
    shared = noise_in(["velocity_sd", "spin_sd"])
    assert {shared[name] for name in ("v_x2", "v_y2", "v_2", "theta_2")} == {"velocity_sd"}
    assert (shared["omega_2"], noise_in(["velocity_sd", "v_x_sd"])["v_x2"]) == ("spin_sd", "v_x_sd")


def test_balances_take_what_is_known_of_each_component():
    known = scene_balances(WANG, Scene(v_y_sd=0.1, spin_sd=4.0))
    np.testing.assert_allclose(known.cor.sd, 0.1 / WANG.impacts.v_y1, rtol=1e-12)
    radius = Scene().ball.radius
    slip = np.abs(WANG.impacts.v_x1 - radius * WANG.impacts.omega_1)
    np.testing.assert_allclose(known.e_x.sd, np.hypot(0.25, radius * 4.0) / slip, rtol=1e-12)
    plain = scene_balances(WANG, Scene())
    np.testing.assert_allclose(plain.cor.sd, 0.25 / WANG.impacts.v_y1, rtol=1e-12)
