"""Many tables, each fitted by itself: named, scheduled, kept, gone on with, and set side by side."""

from __future__ import annotations

import csv
import json
import os
import shutil
import signal
import time
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from samples import HANG

import fitball
from fitball.batch.many import Plan, fit_one, run_tasks
from fitball.batch.tables import OWN_NAMES, fault_of, tasks_of
from fitball.cli.main import main
from fitball.errors import FitballError
from fitball.inference.effort import Effort
from fitball.inference.problem.problem import Choices
from fitball.report.batch.document import centre_rows, summarised
from fitball.report.batch.figure import batch_figure
from fitball.report.batch.rows import HEAD, NAME, read_rows, row_of
from fitball.report.batch.series import all_series, things_along
from fitball.report.form.files import csv_text

FILES = ("batch.csv", "batch.html", "batch.parquet")


@pytest.fixture(scope="module")
def courts(tmp_path_factory):
    """Five tables of a day each, the fourth of them no table at all."""
    folder = tmp_path_factory.mktemp("season") / "courts"
    folder.mkdir()
    frame = fitball.load_table("wang_zero_spin").to_frame()
    rng = np.random.default_rng(3)
    for k in range(5):
        day = frame.copy()
        day["v_x2 [m/s]"] += 0.1 * rng.standard_normal(len(day))
        day["date"] = f"2026-05-{k + 1:02d}"
        day.to_csv(folder / f"court_{k}.csv")
    (folder / "court_3.csv").write_text("id,v_1 [m/s]\na,hello\n")
    (folder / "court_0.toml").write_text("[measurement]\nvelocity_sd = 0.2\n")
    return folder


def quick(folder, **others):
    """A plan of fits that take a moment."""
    return Plan(folder, Choices(model="grip-slip"), Effort(cores=1, point_only=True), **others)


class Here:
    """An engine that works in this process, where a test may look on."""

    def unordered(self, make, items, here=None, lost=None):
        return map(make, items)


@pytest.fixture(scope="module")
def alone(courts, tmp_path_factory):
    """The folder of a batch that one process did, and its rows."""
    folder = tmp_path_factory.mktemp("alone") / "out"
    batch = fitball.calibrate_many(courts, "grip-slip", out=folder, point_only=True, cores=1)
    return folder, batch


def contents(folder):
    """Every file below a folder by its path."""
    return {
        place.relative_to(folder).as_posix(): place.read_bytes() for place in folder.rglob("*") if place.is_file()
    }


@pytest.mark.parametrize("given", ["", "/", "/*", "/*.csv", "/court_?.csv"])
def test_folders_and_patterns_name_their_tables(courts, given):
    found = tasks_of(f"{courts}{given}")
    assert [task.name for task in found] == [f"court_{k}" for k in range(5)]


def test_files_are_named_by_their_path_below_what_they_have_in_common(tmp_path):
    for place in ("a/x.csv", "a/y.csv", "b/x.csv", "b/x.tsv"):
        (tmp_path / place).parent.mkdir(exist_ok=True)
        (tmp_path / place).touch()
    assert [task.name for task in tasks_of(f"{tmp_path}/**/*")] == ["a/x", "a/y", "b/x.csv", "b/x.tsv"]
    assert [task.name for task in tasks_of([f"{tmp_path}/a/x.csv", f"{tmp_path}/./a/x.csv"])] == ["x"]


def test_what_an_earlier_run_wrote_is_no_table(tmp_path):
    for place in ("x.csv", "fits/batch/batch.csv", "fits/batch/x/summary.csv"):
        (tmp_path / place).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / place).touch()
    assert [task.name for task in tasks_of(f"{tmp_path}/**/*.csv", tmp_path / "fits" / "batch")] == ["x"]


@pytest.mark.parametrize(
    ("name", "why"),
    [
        *((name, "itself") for name in ("batch.csv", "Batch.CSV", "day/fit.json", "corner.png")),
        *((name, "a device") for name in ("CON", "aux.csv", "a/nul", "com1", "LPT\u00b9.x", "Con .txt")),
        *((name, "removes") for name in ("a.", "a /b", "b.a ")),
        *((name, "not every file system") for name in ("a:b", "a\\b", 'a"b', "a*", "a?", "a|b", "<a", "a>")),
        *((name, "invisible") for name in ("a\nb", "a\x1b[2J", "a\u200b", "a\udcff", "\u202eb")),
        (".a", "a dot at its beginning"), ("a" * 241, "240 bytes"), ("\U0001f3be" * 61, "240 bytes"),
        *((name, "") for name in ("a", "court 3", "console", "comb1", "a.b", "a/x.csv", "\u00e9t\u00e9", "a" * 240)),
    ],
)  # fmt: skip
def test_names_that_no_folder_can_have_on_some_system(name, why):
    assert (why in fault_of(name)) if why else (fault_of(name) == "")


def test_files_whose_names_collide_are_failed_rows_and_the_others_go_on(courts, tmp_path):
    names = ("good", "batch.csv", "Day", "day", "CON", b"b\xff", "e\u0301", "\u00e9")
    (tmp_path / "tables").mkdir()
    for name in names:
        shutil.copy(courts / "court_1.csv", tmp_path / "tables" / f"{os.fsdecode(name)}.csv")
    rows = run_tasks(tasks_of(tmp_path / "tables"), quick(tmp_path / "out"), Here())
    assert len(rows) == len(names)
    assert [row[NAME] for row in rows if row["outcome"] == "done"] == ["good"]
    reasons = {row[NAME]: row["reason"] for row in rows}
    assert "a device" in reasons["CON"] and "invisible" in reasons["b\\udcff"]
    assert "differs only in case" in reasons["day.csv"]
    assert sorted(place.name for place in (tmp_path / "out").iterdir()) == ["batch.json", "good"]


def test_names_are_longer_where_two_would_be_one_and_again_where_that_is_a_third(tmp_path):
    for name in ("x.csv", "x.tsv", "x.csv.csv", "A.txt", "a.csv"):
        (tmp_path / name).touch()
    named = {task.name: task.fault for task in tasks_of(tmp_path)}
    assert named == dict.fromkeys(("x.csv", "x.tsv", "x.csv.csv", "A.txt", "a.csv"), "")


def test_no_table_has_the_name_of_a_file_that_fitball_writes(alone):
    written = {place.name for place in alone[0].rglob("*") if place.is_file()}
    assert written <= OWN_NAMES and {"batch.csv", "row.json", "fit.json"} <= written


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("nothing/*.csv", "no file matches"), ([], "no table"), ({}, "no table"), ([{"v_1": [1.0]}], "mapping"),
        (pd.DataFrame({"v_1": [1.0]}), "mapping"),
        *(({name: "x.csv"}, "can have") for name in ("../up", "/etc", "a/", "a//b", "./a", ".", " ", "", 3)),
        ({"e\u0301": "x.csv", "\u00c9": "x.csv"}, "differs only in case"),
    ],
)  # fmt: skip
def test_what_is_no_list_of_tables_is_refused(given, said):
    with pytest.raises(FitballError, match=said):
        tasks_of(given)


def test_each_table_is_fitted_as_calibrate_does(courts, alone):
    folder, batch = alone
    fit = fitball.calibrate(courts / "court_1.csv", "grip-slip", point_only=True, cores=1)
    assert batch["court_1"].parameters["mu"].point == fit.parameters["mu"].point
    frame = batch.to_frame()
    assert frame.loc["court_1", "mu"] == fit.parameters["mu"].point
    assert frame.loc["court_1", "label:date"] == "2026-05-02"
    assert list(batch) == ["court_0", "court_1", "court_2", "court_4"]
    assert repr(batch) == f"<Batch of 5 tables, 1 failed, in {folder}>"
    assert "court_4" in batch._repr_html_()


def test_a_table_that_fails_says_why_and_stops_no_other(alone):
    folder, batch = alone
    assert batch.to_frame()["outcome"].tolist() == ["done"] * 3 + ["failed", "done"]
    assert "hello" in batch.failed["court_3"]
    with pytest.raises(KeyError, match="hello"):
        batch["court_3"]
    with pytest.raises(KeyError, match="did you mean 'court_1'"):
        batch["cuort_1"]
    page = (folder / "batch.html").read_text("utf-8")
    assert "4 of 5 tables fitted; 1 failed" in page
    assert "hello" in page
    # Point fits have no intervals, but values all the same.
    assert f"<td>{batch.rows[0]['mu']:.4g}</td>" in page
    assert (folder / "parameters.png").is_file()


def test_the_table_of_all_is_the_same_as_csv_and_parquet(alone):
    folder, batch = alone
    with (folder / "batch.csv").open() as file:
        rows = list(csv.DictReader(file))
    frame = pd.read_parquet(folder / "batch.parquet")
    assert [row[NAME] for row in rows] == frame[NAME].tolist() == [f"court_{k}" for k in range(5)]
    assert float(rows[0]["mu"]) == frame["mu"][0] == batch.rows[0]["mu"]


def test_a_process_that_does_not_see_the_folder_writes_nothing_elsewhere(courts, tmp_path):
    done = fit_one(quick(tmp_path / "there"), tasks_of(f"{courts}/court_0.csv")[0])
    assert "same path" in done.row["reason"]
    assert not (tmp_path / "there").exists()


def test_a_fault_of_ours_in_one_table_is_a_row_too(courts, tmp_path, monkeypatch):
    def broken(*_given):
        raise ZeroDivisionError("one over nothing")

    monkeypatch.setattr("fitball.batch.many.row_of", broken)
    rows = run_tasks(tasks_of(f"{courts}/court_[03].csv"), quick(tmp_path / "out"), Here())
    assert [row["outcome"] for row in rows] == ["failed", "failed"]
    assert "ZeroDivisionError: one over nothing" in rows[0]["reason"]


def test_a_cluster_gives_the_same_bytes_as_one_process(courts, alone, cluster, tmp_path, monkeypatch):
    # Fewer tasks ahead than there are: the others follow as these are done.
    monkeypatch.setattr("fitball.scheduling.engine.AHEAD", 1)
    fitball.calibrate_many(courts, "grip-slip", out=tmp_path / "two", point_only=True, scheduler=cluster)
    assert contents(tmp_path / "two") == contents(alone[0])


def test_what_is_finished_is_not_fitted_again_and_other_settings_are_refused(courts, alone, tmp_path, monkeypatch):
    folder = tmp_path / "out"
    shutil.copytree(alone[0], folder)
    (folder / "court_2" / "row.json").write_text('{"mark": "half')
    fitted = []

    def note(fit, place, full):
        # The table of all is gone before what it tells of is.
        assert not (folder / "batch.csv").exists()
        fitted.append(place.name)
        write(fit, place, full)

    from fitball.batch import many as one

    write = one._write
    monkeypatch.setattr(one, "_write", note)
    tasks = tasks_of(courts)
    # A damaged record is no finished table; but it may be of other settings, so it needs a word.
    assert "overwrite=True" in run_tasks(tasks, quick(folder), Here())[2]["reason"]
    assert (folder / "batch.csv").exists()
    run_tasks(tasks, quick(folder, overwrite=True), Here())
    assert fitted == ["court_2"]
    assert {name: text for name, text in contents(folder).items() if "/" in name} == {
        name: text for name, text in contents(alone[0]).items() if "/" in name
    }
    other = run_tasks(tasks, quick(folder, full=True), Here())
    assert all("other settings" in row["reason"] for row in other if row["table"] != "court_3"), other


def spoil_row(change):
    def spoil(folder):
        content = json.loads((folder / "row.json").read_text("utf-8"))
        change(content)
        (folder / "row.json").write_text(json.dumps(content), encoding="utf-8")

    return spoil


def pipe_at(folder, name="row.json"):
    (folder / name).unlink()
    os.mkfifo(folder / name)


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (spoil_row(lambda content: content["row"].update(mu=99.0)), "mu is 99.0, but its fit.json says 0."),
        (spoil_row(lambda content: content["row"].update(mu_sd="x")), "mu_sd is 'x', but its fit.json says None"),
        (spoil_row(lambda content: content["row"].update(mu_sd=[1.0])), "row.mu_sd: read [1.0], expected"),
        (spoil_row(lambda content: content["row"].update(table="court_1")), "fit.json beside it"),
        (spoil_row(lambda content: content["row"].update(more=1.0)), "more is 1.0, but"),
        (spoil_row(lambda content: content["row"].update({"label:date": "never"})), "fit.json beside it"),
        (spoil_row(lambda content: content.pop("mark")), "missing required field mark"),
        (lambda folder: (folder / "row.json").write_bytes(b"\xff"), "not readable as JSON"),
        (pipe_at, "row.json: not a file"),
        (lambda folder: pipe_at(folder, "fit.json"), "fit.json: not a file"),
        (lambda folder: os.truncate(folder / "row.json", 2**40), "more than 67,108,864 bytes"),
        (lambda folder: shutil.copy(folder.parent / "court_1" / "fit.json", folder), "but its fit.json says"),
    ],
)
def test_a_row_that_is_damaged_or_not_that_of_its_fit_is_not_believed(courts, alone, tmp_path, spoil, said):
    folder = tmp_path / "out"
    shutil.copytree(alone[0], folder)
    spoil(folder / "court_2")
    row = run_tasks(tasks_of(courts / "court_2.csv"), quick(folder), Here())[0]
    assert row["outcome"] == "failed"
    assert said in row["reason"] and "overwrite=True" in row["reason"]
    again = run_tasks(tasks_of(courts / "court_2.csv"), quick(folder, overwrite=True), Here())[0]
    if "not a file" in said:
        assert "is a pipe; only regular files are replaced" in again["reason"]
        return
    assert {head: cell for head, cell in again.items() if cell is not None} == {
        head: cell for head, cell in alone[1].rows[2].items() if cell is not None
    }


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda text: text.replace(",done,,", ",done,,,", 1), "cells under"),
        (lambda text: text.replace(",done,", ",ok,", 1), "column 'outcome': read 'ok'"),
        (lambda text: text.replace("court_1,", "court_0,", 1), "comes twice"),
        (lambda text: text.replace("court_0,", "../court_0,", 1), "can have"),
        (lambda text: text.replace(",7,", ",seven,", 1), "column 'impacts': read 'seven'"),
        (lambda text: text.replace("mu,", "e_x,", 1), "none of them twice"),
        (lambda text: text.replace(",7,", ',"7,', 1), "not the table of a batch"),
        (lambda text: "x" * 200_000, "not the table of a batch"),
        (lambda text: "", "not the table of a batch"),
    ],
)
def test_a_damaged_table_of_all_is_refused(alone, tmp_path, spoil, said):
    text = (alone[0] / "batch.csv").read_text("utf-8")
    assert spoil(text) != text
    (tmp_path / "batch.csv").write_text(spoil(text), encoding="utf-8")
    with pytest.raises(FitballError, match="not the table of a batch") as caught:
        fitball.load_batch(tmp_path)
    assert said in str(caught.value)


def test_another_scene_is_another_setting_wherever_its_file_lies(short_fit, tmp_path):
    """What is told of a fit rests on it beyond its parameters: court pace on the temperature of the ball, a label."""
    problem, plan = short_fit.problem, quick(tmp_path)

    def mark(**scene):
        return plan.mark(replace(problem, scene=replace(problem.scene, **scene)))

    assert len({mark(), mark(surface="grass"), mark(ball_temperature=31.0), mark(ball_type="2")}) == 4
    assert mark(source="elsewhere.toml") == mark()


def test_labels_of_whole_tables_are_read_back_as_they_were(short_fit):
    """With line breaks in them, as cells of workbooks have; an empty one is none."""
    result = short_fit
    count = len(result.problem.table)
    labels = {"note": ("",) * count, "court": ("one\nsouth\u2028side, old",) * count}
    table = replace(result.problem.table, labels=labels)
    row = row_of("a\x85b", short_fit, replace(result.problem, table=table))
    assert {key: cell for key, cell in row.items() if key.startswith(("label:c", "label:n"))} == {
        "label:court": labels["court"][0]
    }
    assert read_rows(csv_text([row])) == (row,)


def test_a_batch_that_was_killed_goes_on_with_two_processes_to_the_same_bytes(courts, alone, tmp_path, start):
    words = ("-m", "fitball", "batch", str(courts), "--model", "grip-slip", "--point-only")
    process = start(*words, "--cores", "1", cwd=tmp_path)
    begun = time.monotonic()
    while not list(tmp_path.glob("fits/batch/*/row.json")) and process.poll() is None:
        assert time.monotonic() - begun < HANG
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait(HANG)
    kept = {place: place.stat().st_mtime_ns for place in tmp_path.glob("fits/batch/*/row.json")}
    assert kept
    again = start(*words, "--cores", "2", cwd=tmp_path)
    again.communicate(timeout=HANG)
    assert again.returncode == 1
    assert {place: place.stat().st_mtime_ns for place in kept} == kept
    found, expected = contents(tmp_path / "fits/batch"), contents(alone[0])
    # The page says which line made it, and run.toml where the table lies.
    differ = {name.rpartition("/")[2] for name in found if found[name] != expected.get(name)}
    assert differ <= {"batch.html", "run.toml"}
    assert set(found) == set(expected)


class Deadly:
    """A table that ends whoever receives it."""

    def __reduce__(self):
        return os.abort, ()


def test_a_table_that_kills_its_process_is_a_failed_row_and_the_others_go_on(courts, alone, tmp_path):
    """In a batch that was run before, too: what is done is kept, and the rest is done."""
    folder = tmp_path / "out"
    shutil.copytree(alone[0], folder)
    shutil.rmtree(folder / "court_2")
    tables = {"court_1": courts / "court_1.csv", "killer": Deadly(), "court_2": courts / "court_2.csv"}
    batch = fitball.calibrate_many(tables, "grip-slip", out=folder, point_only=True, cores=1)
    assert list(batch) == ["court_1", "court_2"]
    assert "ended with signal SIGABRT" in batch.failed["killer"]


def test_a_folder_of_other_things_is_left_alone(courts, tmp_path, capsys):
    (tmp_path / "mine.txt").write_text("mine")
    assert main(["batch", str(courts), "--out", str(tmp_path)]) == 2
    assert "name another folder" in capsys.readouterr().err
    assert contents(tmp_path) == {"mine.txt": b"mine"}


@pytest.mark.parametrize(("given", "said"), [("localhost", "tcp://"), ("tcp://127.0.0.1:1", "no Dask scheduler")])
def test_a_scheduler_that_is_none_is_refused(courts, tmp_path, capsys, monkeypatch, given, said):
    pytest.importorskip("distributed")
    monkeypatch.setattr("fitball.scheduling.engine.PATIENCE", 0.5)
    assert main(["batch", str(courts), "--out", str(tmp_path / "out"), "--scheduler", given]) == 2
    assert said in capsys.readouterr().err


def made_rows(values, column="date", cells=None):
    """Rows as of tables that tell mu and spin_sd, with a label each."""
    rows = []
    for k, value in enumerate(values):
        row = dict.fromkeys(HEAD) | {NAME: f"t{k}", "outcome": "done", "status": "converged", "adequacy": "describes"}
        row |= {
            "mu": value,
            "mu_sd": 0.01,
            "mu_q025": value - 0.02,
            "mu_q975": value + 0.02,
            "mu_verdict": "identified",
        }
        size = 10.0 * np.exp(0.1 * (-1) ** k)
        row |= {"spin_sd [rad/s]": size, "spin_sd_sd": 2.0, "spin_sd_q025": size / 1.5, "spin_sd_q975": size * 1.5}
        row["spin_sd_verdict"] = "identified"
        row[f"label:{column}"] = f"2026-05-{k + 1:02d}" if cells is None else cells[k]
        rows.append(row)
    return rows


def test_a_drift_is_told_in_the_unit_of_what_it_is_along():
    wobble = 0.005 * (-1.0) ** np.arange(12)
    series = all_series(made_rows(0.5 + 0.01 * np.arange(12) + wobble))
    points = summarised(made_rows(np.zeros(12)), series).points
    assert any(point.startswith("mu drifts along date: 0.0098 [") and "per day" in point for point in points), points
    assert not any("spin_sd" in point for point in points)
    level = summarised(made_rows(np.zeros(12)), all_series(made_rows(0.5 + wobble))).points
    assert not any("drifts" in point for point in level)
    # Where the line is drawn a table far off that has no date is not, nor does it set the scale.
    rows = made_rows(
        [9.0, *(0.5 + 0.01 * np.arange(12) + wobble)], cells=["", *(f"2026-05-{k:02d}" for k in range(1, 13))]
    )
    rows[0]["label:date"] = None
    mu = all_series(rows)[0]
    (panel,) = batch_figure([mu], [str(row[NAME]) for row in rows], mu.drifts[0][0]).axes
    assert panel.get_ylim()[1] < 1.0


def test_tables_that_were_copied_or_exchanged_are_named():
    values = np.repeat([0.5, 0.6, 0.7], 4) + 0.003 * np.sin(np.arange(12))
    cells = np.repeat(["clay", "grass", "hard"], 4).tolist()

    def said(numbers):
        rows = made_rows(numbers, "surface", cells)
        return summarised(rows, all_series(rows)).answer[1:]

    assert not any("unlike" in sentence or "the same" in sentence for sentence in said(values))
    words = [sentence for sentence in said(values[[0, 6, 2, 3, 4, 5, 1, *range(7, 12)]]) if "unlike" in sentence]
    assert [sentence.partition(" is unlike other tables of surface ")[0] for sentence in words] == ["t1", "t6"]
    assert "like those of grass (0.597): check file and label" in words[0]
    # Far from its own level, and from all others.
    assert not any("unlike" in sentence for sentence in said([values[0], 0.65, *values[2:]]))
    assert "The data of t0 and t2 are the same: leave out the copies." in said([*values[:2], values[0], *values[3:]])


def test_an_outlier_is_named_and_values_that_the_prior_gave_are_not_counted():
    values = 0.5 + 0.01 * np.sin(np.arange(20))
    values[4] = 0.8
    rows = made_rows(values)
    assert any("Outliers of mu: t4" in point for point in summarised(rows, all_series(rows)).points)
    rows[4]["mu_verdict"] = "prior-dominated"
    assert not any("Outliers of mu" in point for point in summarised(rows, all_series(rows)).points)
    assert centre_rows(all_series(rows))[0][2] == "19 of 20"


def test_point_fits_count_as_their_verdicts_say_and_have_no_mean():
    rows = [{key: None if key.endswith(("_sd", "q025", "q975")) else cell for key, cell in row.items()}
            for row in made_rows(np.linspace(0.5, 0.6, 5))]  # fmt: skip
    rows[2]["mu_verdict"] = "prior-dominated"
    series = all_series(rows)
    assert [row[2:5] for row in centre_rows(series)] == [("4 of 5", "-", "-"), ("5 of 5", "-", "-")]
    said = summarised(rows, series).points
    assert said == ("Point fits have no uncertainty. For means and spreads fit without point_only=True.",)
    assert not any(
        "Point fits" in point for point in summarised(made_rows([0.5]), all_series(made_rows([0.5]))).points
    )


@pytest.mark.parametrize(
    ("cells", "found"),
    [
        (["1", "2", "3.5"], [0.0, 1.0, 2.5]), (["2026-01-01", "2026-01-02T12:00", "2026-02-01"], [0.0, 1.5, 31.0]),
        (["a", "b", "c"], None), (["1", "1", "1"], None),
        (["2026-01-01", "2026-01-02T12:00+02:00", "2026-02-01"], None),
        (["20260131", "20260201", "20260203"], [0.0, 1.0, 3.0]), (["1_1", "1_2", "2_1"], None),
    ],
)  # fmt: skip
def test_labels_that_are_numbers_or_dates_order_the_tables(cells, found):
    along = things_along(made_rows([0.5] * 3, "place", cells))
    assert (found is None) == (along == ())
    if found is not None:
        assert along[0].values - along[0].values[0] == pytest.approx(found)


def test_a_size_of_noise_is_centred_by_its_logarithm():
    row = centre_rows(all_series(made_rows(np.full(12, 0.5) + 0.001 * np.arange(12))))[1]
    assert row[:2] == ("spin_sd", "rad/s")
    assert float(row[3]) == pytest.approx(10.0, abs=0.1)
