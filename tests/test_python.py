"""The Python interface: data frames in and out, one type of fit, messages that speak Python, nothing left behind."""

from __future__ import annotations

import ast
import json
import pickle
import re
from contextlib import suppress
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

import fitball
from fitball.cli.main import main
from fitball.errors import (
    Fault,
    FitballError,
    ParameterError,
    ReadingError,
    ResultFolderError,
    TableError,
)
from fitball.values import same
from fitball.wording import on_command_line, option, speaking_to_command_line, spoken

ROOT = Path(__file__).resolve().parent.parent
MPH = 0.44704


# ---------------------------------------------------------------------------------------------- tables


def test_a_data_frame_reads_as_the_file_that_holds_it(tmp_path):
    columns = {
        "v_1": [38.0, 36.5],
        "theta_1": [18, 25],
        "v_x2": [10.9, 9.5],
        "v_y2": [4.1, 5.0],
        "surface": ["a", "b"],
    }
    place = tmp_path / "DataFrame.csv"
    heads = {"v_1": "v_1 [mph]"}
    pd.DataFrame(columns).rename(columns=heads).to_csv(place, index=False)
    from_file = fitball.load_table(place)
    for given in (columns, pd.DataFrame(columns)):
        table = fitball.load_table(given, units={"v_1": "mph"})
        assert table.impacts == from_file.impacts and table.labels == from_file.labels
        assert same(table.measurements, from_file.measurements) and table.units == from_file.units
    np.testing.assert_allclose(np.hypot(table.impacts.v_x1, table.impacts.v_y1), np.array([38.0, 36.5]) * MPH)
    assert fitball.load_table(pd.DataFrame(columns | {"id": ["x", "y"]}), units={"v_1": "mph"}).ids == ("x", "y")
    assert fitball.load_table(place, units={"v_x2": "mph"}).measurement("v_x2").values[0] == pytest.approx(10.9 * MPH)


@pytest.mark.parametrize("name", ["wang_all", "wang_topspin"])
def test_a_table_as_a_data_frame_reads_back(name):
    table = fitball.load_table(name)
    again = fitball.load_table(table.to_frame(), name=name)
    assert again.impacts == table.impacts and again.ids == table.ids and again.labels == table.labels
    assert [item.name for item in again.measurements] == [item.name for item in table.measurements]
    for one, other in zip(again.measurements, table.measurements, strict=True):
        np.testing.assert_array_equal(one.values, other.values)
    assert table == fitball.load_table(name) != again and hash(table) != hash(again)
    assert len(repr(table)) < 200 and table.name in table._repr_html_()


def test_what_is_wrong_with_a_data_frame_is_told_by_row_and_column():
    frame = pd.DataFrame({"v_y1 [m/s]": [4.0, -6.0], "v_y2": [3.2, 4.7]})
    with pytest.raises(FitballError, match=r"DataFrame: 1 fault\n  - row 2, column 'v_y1': read -6"):
        fitball.load_table(frame)
    with pytest.raises(FitballError, match="in the header and"):
        fitball.load_table(frame, units={"v_y1": "mph"})
    with pytest.raises(ParameterError, match="are not a table"):
        fitball.load_table({"v_y1": [4.0, 6.0], "v_y2": [3.2]})


def test_a_fit_to_a_data_frame_is_the_fit_to_its_file(brief):
    table = fitball.load_table("wang_zero_spin")
    scene = fitball.load_scene("wang_zero_spin")
    asked = {"model": "brody", "point_only": True, "cores": 1, "scene": scene}
    one = fitball.calibrate(table.to_frame(), **asked)
    other = fitball.calibrate("wang_zero_spin", **asked)
    assert one.point.values == other.point.values
    assert one.table.name == "DataFrame" and one != other


def test_tables_of_all_kinds_are_fitted_together(tmp_path, brief):
    frame = fitball.load_table("wang_topspin").to_frame()
    tables = ["wang_zero_spin", fitball.load_table(frame, name="mine")]
    fit = fitball.calibrate(tables, model="brody", point_only=True, cores=1)
    assert sorted(set(fit.table.labels["table"])) == ["mine", "wang_zero_spin"] and len(fit.table) == 14
    fit.save(tmp_path / "f")
    assert fitball.load_fit(tmp_path / "f") == fit


def test_a_check_tells_every_fault(tmp_path, capsys):
    place = tmp_path / "bad.csv"
    place.write_text("v_y1,v_y2\n4,3\n-5,4\n6,x\n", encoding="utf-8")
    found = fitball.check(place)
    assert not found and [fault["row"] for fault in found.faults] == [2, 3]
    assert main(["datasets", "check", str(place), "--json"]) == 2
    assert json.loads(capsys.readouterr().out)["faults"] == found.faults
    assert found.to_frame()["column"].tolist() == ["v_y1", "v_y2"] and "row 3 (line 4)" in repr(found)
    good = fitball.check("wang_all")
    assert good.ok and good.table is not None and "no fault" in repr(good)
    with pytest.raises(ParameterError, match="a list of 2 tables, expected one"):
        fitball.check([place, "wang_all"])


def test_models_are_compared_as_by_the_verb(tmp_path, capsys):
    words = ["--models", "brody,grip-slip", "--quick", "--max-steps", "100", "--cores", "1", "--quiet"]
    assert main(["compare", "wang_zero_spin", *words, "--out", str(tmp_path / "verb")]) == 1
    found = fitball.compare("wang_zero_spin", ["brody", "grip-slip"], quick=True, max_steps=100, cores=1)
    saved = found.save(tmp_path / "python")
    assert capsys.readouterr().err == ""
    ways = (tmp_path / "verb", saved)
    assert {path.name for path in ways[0].iterdir()} == {path.name for path in ways[1].iterdir()}
    for name in ("compare.csv", "compare.png"):
        assert (ways[0] / name).read_bytes() == (ways[1] / name).read_bytes(), name
    assert found.summary().index.tolist()[:2] == list(found.names) and set(found.names) == {"brody", "grip-slip"}
    assert isinstance(found["brody"], fitball.Fit) and len(repr(found).splitlines()) == 4
    assert len(found.plot().axes) > 0 and plt.get_fignums() == [] and found == found
    with pytest.raises(ResultFolderError, match="overwrite=True"):
        found.save(saved)


# ---------------------------------------------------------------------------------------------- words


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"priors": {"mu": (0.6, 0.1)}}, r"'normal\(0.6, 0.1\)'}.* {'mu': 'uniform\(0.1, 0.6\)'}"),
        ({"priors": {"mu": 0.6}}, r"priors: mu = 0.6: expected a text, such as {'mu': 'normal\(0.55, 0.05\)'}"),
        ({"priors": "mu=normal(0, 1)"}, "priors: read .*, expected a dict"),
        ({"fix": {"mu": "0.6"}}, "fix: mu = '0.6': expected a number in SI"),
        ({"fix": {"mu": True}}, "fix: mu = True"),
        ({"closures": ["total"]}, "closures: read .*, expected a dict, such as {'cor'"),
        ({"pool": {"mu": 3}}, "pool: mu = 3: expected a text"),
        ({"noise": 3}, "noise: read 3"),
        ({"model": 3}, "model: read 3"),
        ({"pool": {"mu": "colour"}}, r"pool={'mu': 'colour'}"),
        ({"offsets": "colour"}, "offsets='colour'"),
        ({"seed": -1}, "seed = -1"),
        ({"seed": 1.0}, "seed = 1.0: expected a whole number"),
        ({"max_steps": "500"}, "max_steps = '500': expected a whole number"),
    ],
)
def test_a_mistake_in_python_is_told_in_python(asked, said):
    with pytest.raises(FitballError, match=said) as caught:
        fitball.calibrate("wang_zero_spin.csv", **({"model": "brody", "cores": 1} | asked))
    assert "--" not in str(caught.value)


@pytest.mark.parametrize("data", [3, [], [3], None, pd.Series({"v_1": 17.0})])
def test_what_is_no_table_is_refused(data):
    for read in (fitball.calibrate, fitball.load_table):
        with pytest.raises(ParameterError, match=r"(read a table of type|list of tables is empty)"):
            read(data)


def test_a_name_that_index_and_columns_share_is_told():
    frame = pd.DataFrame(
        {"v_y1": [5.0, 6.0], "v_y2": [4.0, 4.7], "id": ["a", "b"]}, index=pd.Index([1, 2], name="id")
    )
    with pytest.raises(TableError, match="column 'id'"):
        fitball.load_table(frame)


def test_what_is_no_number_is_refused():
    """What is masked was not measured: it is no number either."""
    for given, said in (("fast", "v_x1: read 'fast', expected a number"), ({}, "v_x1: read {}")):
        with pytest.raises(ParameterError, match=said):
            fitball.impacts(given, 5.0)
    with pytest.raises(ParameterError, match=r"v_x1\[1\] = nan: expected finite"):
        fitball.impacts(np.ma.array([15.0, 99.0], mask=[False, True]), 5.0)
    ball = {"mu": "rough", "cor_10": 0.75, "cor_slope": 0.0}
    with pytest.raises(ParameterError, match="mu: read 'rough'"):
        fitball.model("brody").rebound(ball, fitball.impacts(15.0, 5.0))
    with pytest.raises(ParameterError, match="read impacts of type tuple"):
        fitball.model("brody").rebound({**ball, "mu": 0.5}, (15.0, 5.0))
    with pytest.raises(ParameterError, match=r"mu = \[0.5, 0.6\]: expected one number"):
        fitball.simulate("v=17, theta=18", values={"mu": [0.5, 0.6]})
    with pytest.raises(ParameterError, match="ball mass = '57 g': expected a number"):
        fitball.Ball("57 g")
    with pytest.raises(ParameterError, match="model: read a value of type GripSlipModel, expected a text"):
        fitball.simulate("v=17, theta=18", model=fitball.model("brody"))


@pytest.mark.parametrize(
    "error", [TableError("a.csv", [Fault("read x", row=1, column="v_1")], ["--flip"]), ReadingError("a.csv", ["rpm"])]
)
def test_errors_come_from_other_processes(error):
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), str(again), vars(again)) == (type(error), str(error), vars(error))


def test_messages_speak_to_who_listens(short_fit, small_fit, capsys):
    with pytest.raises(ResultFolderError, match=r"use overwrite=True to replace it, or name another folder"):
        short_fit.save(small_fit)
    assert main(["calibrate", "wang_zero_spin", "--model", "brody", "--point-only", "--out", str(small_fit)]) == 2
    assert "--overwrite to replace it, or --out" in capsys.readouterr().err
    assert not on_command_line()
    assert (option("as_read"), option("flip", "a", "b"), spoken("c", "p")) == ("as_read=True", "flip=['a', 'b']", "p")
    with speaking_to_command_line():
        assert (option("as_read"), option("flip", "a", "b"), spoken("c", "p")) == ("--as-read", "--flip a,b", "c")


def _is_wording(node):
    return isinstance(node, ast.Call) and getattr(node.func, "id", "") == "spoken"


def test_flags_stand_in_no_message_but_by_the_wording():
    """Options by their flags: in the command line, in rooms which have no other face, and in the one module."""
    flag = re.compile(r"(?<![\w-])--[a-z]{2}")
    for file in sorted((ROOT / "fitball").rglob("*.py")):
        parts = file.relative_to(ROOT / "fitball").parts
        if parts[0] in ("cli", "bench", "repeat.py", "thesis", "wording.py"):
            continue
        tree = ast.parse(file.read_text(encoding="utf-8"))
        documented = {
            id(node.body[0].value)
            for node in ast.walk(tree)
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node) is not None
        }
        worded = {id(item) for node in ast.walk(tree) if _is_wording(node) for item in ast.walk(node.args[0])}
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in documented | worded:
                # What a generated program or page says of its own options is no message of ours.
                assert not flag.search(node.value) or parts[0] in ("exports", "export"), (file, node.value)


def test_types_of_all_public_names_are_known_to_a_checker():
    tree = ast.parse((ROOT / "fitball" / "__init__.py").read_text(encoding="utf-8"))
    guarded = next(node for node in tree.body if isinstance(node, ast.If))
    seen = {alias.name for node in guarded.body for alias in node.names}
    assert seen | {"__version__"} == set(fitball.__all__)
    assert (ROOT / "fitball" / "py.typed").exists()


# ---------------------------------------------------------------------------------------------- progress


def test_progress_is_silent_where_nobody_looks_on(capsys):
    asked = {"model": "brody", "cores": 1, "max_steps": 100}
    fitball.calibrate("wang_zero_spin", **asked)
    assert "".join(capsys.readouterr()) == ""
    told = []
    fitball.calibrate("wang_zero_spin", **asked, progress=lambda stage, progress: told.append((stage, progress)))
    stages = [stage for stage, _ in told]
    assert "sampling" in stages and stages[-1] == "assumptions"
    assert max(progress.step for _, progress in told if progress is not None) == 100
    fitball.calibrate("wang_zero_spin", **asked, progress=True)
    out, err = capsys.readouterr()
    assert out == "" and "sampling: step 100" in err


def test_an_interrupt_ends_a_loop_over_tables():
    def impatient(stage, progress):
        if progress is not None:
            raise KeyboardInterrupt

    seen = []

    def loop():
        for name in ("wang_zero_spin", "wang_topspin"):
            seen.append(name)
            with suppress(Exception):
                fitball.calibrate(name, model="brody", cores=1, max_steps=100, progress=impatient)

    with pytest.raises(KeyboardInterrupt):
        loop()
    assert seen == ["wang_zero_spin"]
