"""Doors: a verb hands on every option to what computes, and binds its findings to its own page."""

from dataclasses import fields, replace
from importlib import import_module
from inspect import signature
from unittest.mock import Mock, sentinel

import pytest
from support.fit_by_hand import fit_by_hand, table_of

import fitball
from fitball import cli
from fitball.base.findings import Findings
from fitball.batches import many, rows
from fitball.inference.effort import Effort
from fitball.inference.problem.problem import Choices
from fitball.tracks.film import Filmed

NOTHING = Findings({})
READING = {"as_read": True, "columns": {"v_1": "v"}, "flip": "omega_1", "ignore": "omega_2"}
AS_READ = {"columns": {"v_1": "v"}, "flip": ["omega_1"], "ignore": ["omega_2"]}


@pytest.fixture(scope="module")
def fit():
    return fit_by_hand()


def replaced(monkeypatch, address, answer=NOTHING):
    """A function of the package that keeps what it is called with, and gives an answer."""
    module, _, name = address.rpartition(".")
    recorder = Mock(return_value=answer)
    monkeypatch.setattr(import_module(module), name, recorder)
    return recorder


def options_of(verb):
    """A value of its own for each option of a method of Fit."""
    names = [*signature(getattr(fitball.Fit, verb)).parameters][1:]
    return {name: getattr(sentinel, name) for name in names}


@pytest.mark.parametrize("verb", ["predict", "plan", "simulate"])
def test_a_verb_hands_on_every_option_to_the_fit(verb):
    fit = Mock()
    options = options_of(verb)
    result = getattr(fitball, verb)(fit, **options)
    method = getattr(fit, verb)
    assert result is method.return_value
    places, names = method.call_args
    called = signature(getattr(fitball.Fit, verb)).bind(fit, *places, **names).arguments
    assert called == {"self": fit, **options}


@pytest.mark.parametrize("verb", ["predict", "plan", "simulate", "plot", "export"])
def test_a_verb_reads_the_fit_of_a_folder_with_its_model(verb, monkeypatch):
    read = replaced(monkeypatch, "fitball.fit_verbs.load_fit", Mock())
    replaced(monkeypatch, "fitball.report.plotted.choose_figures")
    replaced(monkeypatch, "fitball.exports.export", {})
    needed = {"simulate": {"impact": "v_1=17"}, "export": {"to": "json"}}
    getattr(fitball, verb)("folder", model="mine.py:f", **needed.get(verb, {}))
    read.assert_called_once_with("folder", "mine.py:f")


def test_export_hands_on_every_option(fit, monkeypatch):
    room = replaced(monkeypatch, "fitball.exports.export", {"a.txt": "text"})
    usual = {"level": {}, "fix": {}, "at": "", "engine": "", "medians": False, "chosen": []}
    options = {"level": {"surface": "clay"}, "at": "v_1=17"}
    for exported in (fit.export(to="c", **options), fitball.export(fit, to="c", **options)):
        assert exported.contents == {"a.txt": "text"}
        room.assert_called_with(fit, "c", **usual | options)
    model = fitball.model("brody")
    fitball.export(model=model, to="c", fix={"mu": 0.5}, at="v_1=17")
    room.assert_called_with(model, "c", **usual | {"fix": {"mu": 0.5}, "at": "v_1=17"})
    fitball.export(fit, to="engine", engine="mujoco", medians=True)
    room.assert_called_with(fit, "engine", **usual | {"engine": "mujoco", "medians": True})
    fitball.export(fit, to="latex", parameters="mu,cor_10")
    room.assert_called_with(fit, "latex", **usual | {"chosen": ["mu", "cor_10"]})


def test_plot_hands_on_names_format_width_and_what_is_chosen(fit, monkeypatch):
    room = replaced(monkeypatch, "fitball.report.plotted.choose_figures")
    options = {"parameters": "mu,cor_10", "columns": "v_x2", "groups": "clay", "width": "127mm"}
    assert fitball.plot(fit, "curves,corner", format="svg", **options).plotted is NOTHING
    (of, names, kind, chosen, inches) = room.call_args[0]
    assert (of, names, kind) == (fit, ["curves", "corner"], "svg")
    assert chosen == (("mu", "cor_10"), ("v_x2",), ("clay",))
    assert inches == pytest.approx(5.0)


def bound(result, page):
    """Whether a result has the findings of the test and the page of a verb."""
    return result.findings is NOTHING and result.page is import_module(page).PAGE


def test_predict_reads_as_the_fit_did_and_has_its_page(fit, monkeypatch):
    room = replaced(monkeypatch, "fitball.uses.predict.predict")
    read = replaced(monkeypatch, "fitball.data.read.load_table", sentinel.table)
    reading = replaced(monkeypatch, "fitball.data.read.reading_of", {"flip": ["omega_1"]})
    assert bound(fit.predict("new.csv", level={"a": "b"}), "fitball.report.predict")
    reading.assert_called_once_with(fit.run.table)
    read.assert_called_once_with("new.csv", scene=fit.run.scene, rebound=False, flip=["omega_1"])
    room.assert_called_once_with(fit, sentinel.table, {"a": "b"})


def test_plan_hands_on_all_and_has_its_page(fit, monkeypatch):
    room = replaced(monkeypatch, "fitball.uses.plan.plan")
    names = ("measured_levels", "targets_of", "settings_of", "sensors_of")
    steps = {
        name: replaced(monkeypatch, f"fitball.uses.planned.{name}", getattr(sentinel, name))
        for name in names
    }
    level = {"surface": "clay"}
    ranges = {"speed": "1..2:2", "angle": "3..4:2", "spin": "5..6:2"}
    planned = fit.plan(target="mu,cor_10", level=level, count=7, sensor={"drop": "1 m"}, **ranges)
    assert bound(planned, "fitball.report.plan")
    steps["measured_levels"].assert_called_once_with(fit, level)
    steps["targets_of"].assert_called_once_with(fit, ["mu", "cor_10"], sentinel.measured_levels)
    steps["settings_of"].assert_called_once_with(fit, ranges, level)
    steps["sensors_of"].assert_called_once_with(fit, {"drop": "1 m"})
    arguments = (sentinel.targets_of, sentinel.settings_of, sentinel.sensors_of)
    room.assert_called_once_with(fit, *arguments, 7)


def test_simulate_hands_on_all_and_has_its_page(fit, monkeypatch):
    room = replaced(monkeypatch, "fitball.uses.simulate.simulate_fit")
    simulated = fit.simulate(impact="v_1=17", level={"surface": "clay"})
    assert bound(simulated, "fitball.report.simulate")
    room.assert_called_once_with(fit, "v_1=17", {"surface": "clay"})
    course = replaced(monkeypatch, "fitball.uses.simulate.simulate_point")
    assert bound(fitball.simulate(impact="v_1=17, theta_1=20"), "fitball.report.simulate")
    assert course.call_args[0][0].name == "two-mass"


def test_compare_of_a_fit_hands_on_all_and_has_its_page(monkeypatch):
    fit = fit_by_hand()
    seeded = replace(fit.run, effort=Effort(seed=7))
    fit = replace(fit, run=seeded)
    room = replaced(monkeypatch, "fitball.uses.compare.compare")
    problems = replaced(monkeypatch, "fitball.uses.compare.problems_of_fit", sentinel.problems)
    stages = []
    compared = fit.compare(models="brody,grip-slip", quick=True, cores=3, progress=stages.append)
    assert bound(compared, "fitball.report.compare")
    problems.assert_called_once_with(fit, ["brody", "grip-slip"], True)
    (posed, effort, _) = room.call_args[0]
    assert posed is sentinel.problems
    assert (effort.seed, effort.cores) == (7, 3)


def test_compare_hands_on_all_and_has_its_page(monkeypatch):
    room = replaced(monkeypatch, "fitball.uses.compare.compare")
    read = replaced(monkeypatch, "fitball.data.load.load_data", (sentinel.table, sentinel.scene))
    problems = replaced(monkeypatch, "fitball.uses.compare.problems_of", sentinel.problems)
    choices = {"fix": {"mu": 0.5}, "prior": {"e_x": "uniform(0, 1)"}, "pool": {"all": "none"}}
    compared = fitball.compare(
        "a.csv",
        models="brody,grip-slip",
        quick=True,
        scene="a.toml",
        noise="student-t",
        seed=7,
        cores=3,
        **READING,
        **choices,
    )
    assert bound(compared, "fitball.report.compare")
    read.assert_called_once_with("a.csv", "a.toml", True, **AS_READ)
    wanted = Choices("", **choices, noise="student-t")
    names = ["brody", "grip-slip"]
    problems.assert_called_once_with(sentinel.table, sentinel.scene, wanted, names, True)
    (posed, effort, _) = room.call_args[0]
    assert posed is sentinel.problems
    assert (effort.seed, effort.cores) == (7, 3)


def test_check_hands_on_all_and_has_its_page(monkeypatch):
    room = replaced(monkeypatch, "fitball.data.check.check")
    assert bound(fitball.check("a.csv", scene="a.toml", **READING), "fitball.report.check")
    room.assert_called_once_with("a.csv", "a.toml", True, **AS_READ)


def test_rederive_and_bench_have_their_pages(monkeypatch):
    room = replaced(monkeypatch, "fitball.thesis.rederive")
    assert bound(fitball.rederive(fix={"k_y": 2e4}), "fitball.thesis.page")
    assert room.call_args[0][0] == {"k_y": 2e4}
    replaced(monkeypatch, "fitball.speed.bench")
    assert bound(fitball.bench(), "fitball.speed.page")


def test_track_hands_on_all(monkeypatch):
    room = replaced(monkeypatch, "fitball.tracks.roads.track", Mock())
    scene_of = replaced(monkeypatch, "fitball.tracks.read.scene_of", sentinel.scene)
    camera = {"scene": "a.toml", "fps": 240.0, "mm_per_px": 0.8, "ball_diameter": "66mm"}
    choice = {"ball": "ball", "min_confidence": 0.3, "row_time": 5e-6}
    fitball.track("a.csv", columns={"x": "cx [px]"}, as_read=True, **camera, **choice)
    scene_of.assert_called_once_with(["a.csv"], *camera.values(), 0.3, 5e-6)
    assert room.call_args[0][:4] == (["a.csv"], sentinel.scene, {"x": "cx [px]"}, True)
    assert "ball" in (*room.call_args[0], *room.call_args[1].values())


@pytest.mark.parametrize(("all_files", "drawn"), [(True, False), (False, None)])
def test_batch_hands_on_all(all_files, drawn, monkeypatch, tmp_path):
    batch = Mock()
    room = replaced(monkeypatch, "fitball.batches.many.fit_many", batch)
    fitball.batch(
        "a.csv",
        out=tmp_path,
        overwrite=True,
        all_files=all_files,
        figures="none",
        scheduler="tcp://a",
        noise="student-t",
        seed=7,
        cores=3,
        point_only=True,
        xlsx=all_files,
    )
    (data, task, scheduler, _) = room.call_args[0]
    assert (data, scheduler) == ("a.csv", "tcp://a")
    assert (task.overwrite, task.figures) == (True, drawn)
    assert task.options["noise"] == "student-t"
    assert (task.effort.seed, task.effort.cores, task.effort.point_only) == (7, 3, True)
    batch.save.assert_called_once_with(task.folder, figures=False, xlsx=all_files)


def test_what_did_not_converge_has_exit_code_1():
    fit = fit_by_hand(table_of(12))
    assert fit.exit_code == 0
    assert replace(fit, status="not converged").exit_code == 1
    record = rows.record_of("a", fit, "2026-05-01")
    fits = {"a": fit}
    assert many.batch_of(None, [record], None, fits.get).exit_code == 0
    record.row["status"] = "not converged"
    assert many.batch_of(None, [record], None, fits.get).exit_code == 1


def test_a_result_of_what_was_computed_has_all_of_it(fit):
    computed = replace(fit, own=fitball.model("brody"))
    result = fitball.Fit.of(computed)
    assert type(result) is fitball.Fit
    assert vars(result) == vars(computed)
    filmed = Filmed(*(getattr(sentinel, field.name) for field in fields(Filmed)))
    film = fitball.Film.of(filmed)
    assert type(film) is fitball.Film
    assert vars(film) == vars(filmed)


def test_every_verb_is_tried_here_or_gives_a_fit():
    tried = {"predict", "plan", "simulate", "plot", "export", "compare", "check", "rederive"}
    tried |= {"bench", "track", "batch"}
    assert {*cli.VERBS} - tried == {"calibrate"}
