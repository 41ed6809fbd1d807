"""Fits to tables with covariances and ignored columns: saved, read back, made again; refused where a file changed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from test_covariance_file import PAIRS, TABLE, rows_of, written

import fitball
from fitball.api.calibrating import pose
from fitball.cli.main import main
from fitball.data.read import load_table
from fitball.data.scene import Camera, Quantity
from fitball.errors import ResultFolderError
from fitball.inference.calibrate import fingerprint
from fitball.inference.effort import Effort
from fitball.inference.problem.build import Choices
from fitball.report.saved.run_file import camera_part, find_covariances, find_tables, read_run, record_problem


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a table, its covariances, and a fit in `fit`."""
    folder = tmp_path_factory.mktemp("made")
    timed = ["id,contact_time [ms],", "a,4.9,", "b,4.8,", "c,4.7,"]
    lines = [head + line.partition(",")[2] for head, line in zip(timed, TABLE.splitlines(), strict=True)]
    place = written(folder, rows_of(PAIRS), "\n".join(lines) + "\n")
    fit = fitball.calibrate(place, "grip-slip", point_only=True, ignore=["contact_time"])
    fit.save(folder / "fit")
    return folder


def test_a_saved_fit_keeps_covariances_and_what_was_ignored(made: Path) -> None:
    table = load_table(made / "t.csv", ignore=["contact_time"])
    saved = fitball.load_fit(made / "fit").problem.table
    assert saved.covariance is not None and table.covariance is not None
    assert saved.covariance.columns == table.covariance.columns
    assert np.array_equal(saved.covariance.values, table.covariance.values)
    assert saved.ignored == ("contact_time",)
    assert saved.covariance_files == table.covariance_files


def test_a_fit_is_made_again_from_its_files(made: Path) -> None:
    record = read_run(made / "fit")
    problem = record_problem(record, find_tables(record), None, find_covariances(record))
    table = load_table(made / "t.csv", ignore=["contact_time"])
    assert problem.table == table
    assert problem.table.digest == table.digest
    assert [item.name for item in problem.table.measurements] == ["v_x2", "v_y2", "omega_2"]


def test_a_changed_covariance_file_is_refused(made: Path, tmp_path: Path) -> None:
    record = read_run(made / "fit")
    file = made / "t_covariance.csv"
    kept = file.read_text()
    elsewhere = tmp_path / "kept.csv"
    elsewhere.write_text(kept)
    try:
        file.write_text(kept.replace("-0.006", "-0.005"))
        with pytest.raises(ResultFolderError, match=r"t_covariance\.csv: changed since the fit"):
            find_covariances(record)
        file.unlink()
        with pytest.raises(ResultFolderError, match=r"the covariance of this fit is missing; .*covariance"):
            find_covariances(record)
        assert find_covariances(record, [str(elsewhere)]) == (elsewhere,)
        with pytest.raises(ResultFolderError, match="covariances of 1 table, but 2 given"):
            find_covariances(record, [str(elsewhere)] * 2)
    finally:
        file.write_text(kept)


def test_covariances_given_in_python_cannot_be_read_again(tmp_path: Path) -> None:
    place = written(tmp_path, "")
    (tmp_path / "t_covariance.csv").unlink()
    fit = fitball.calibrate(place, "grip-slip", point_only=True, covariance=dict.fromkeys("abc", PAIRS))
    fit.save(tmp_path / "fit")
    assert fitball.load_fit(tmp_path / "fit").problem.table.covariance is not None
    with pytest.raises(ResultFolderError, match="covariances, which were given in Python"):
        find_covariances(read_run(tmp_path / "fit"))


def test_a_file_that_came_later_is_not_read(tmp_path: Path) -> None:
    place = written(tmp_path, rows_of(PAIRS))
    fit = fitball.calibrate(place, "grip-slip", point_only=True, covariance="none")
    fit.save(tmp_path / "fit")
    record = read_run(tmp_path / "fit")
    problem = record_problem(record, find_tables(record), None, find_covariances(record))
    assert problem.table.covariance is None


def test_chains_belong_to_covariances_and_ignored_columns(made: Path) -> None:
    """What a chain was made from goes on with the same only."""
    effort = Effort()
    marks = {
        fingerprint(pose(made / "t.csv", Choices(model="grip-slip"), **options), effort)  # type: ignore[arg-type]
        for options in ({}, {"covariance": "none"}, {"ignore": "contact_time"}, {"ignore": "omega_2"})
    }
    assert len(marks) == 4


def test_the_command_line_has_the_same(made: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = str(made / "t.csv")
    assert main(["datasets", "check", table]) == 0
    assert "covariances of 3 of 3 rows are read from" in capsys.readouterr().out
    assert main(["datasets", "check", table, "--covariance", "none", "--ignore", "contact_time,omega_2"]) == 0
    shown = capsys.readouterr().out
    assert "covariances" not in shown
    assert "contact_time is left out, on request" in shown and "omega_2 is left out, on request" in shown
    broken = made / "broken.csv"
    broken.write_text("id,column,column,value\na,v_x2,v_x2,-1\n")
    assert main(["datasets", "check", table, "--covariance", str(broken)]) == 2
    assert "broken.csv: 1 fault" in capsys.readouterr().out


def test_a_folder_of_tables_has_no_covariance_file_as_a_table(made: Path) -> None:
    from fitball.batch.tables import tasks_of

    (made / "broken.csv").unlink(missing_ok=True)
    assert [task.name for task in tasks_of(made)] == ["t"]
    assert [task.name for task in tasks_of(str(made / "*.csv"))] == ["t"]


def test_a_saved_fit_keeps_the_camera_of_its_scene(made: Path, tmp_path: Path) -> None:
    scene = tmp_path / "camera.toml"
    scene.write_text("[camera]\nfps = 240\nrow_time = 1e-5\n")
    fit = fitball.calibrate(made / "t.csv", "grip-slip", config=scene, point_only=True)
    fit.save(tmp_path / "fit")
    camera = fitball.load_scene(None, scene).camera
    assert camera is not None
    assert read_run(tmp_path / "fit").scene.camera == camera
    assert fitball.load_fit(tmp_path / "fit").problem.scene.camera == camera
    whole = Camera(
        Quantity(1.0, 0.01), Quantity(0.999), Quantity(0.0, 0.005), Quantity(-0.002, 0.003), 240.0, 0.8, 1e-5
    )
    record = read_run(tmp_path / "fit")
    again = replace(record, file=msgspec.structs.replace(record.file, camera=camera_part(whole)))
    assert again.scene.camera == whole
