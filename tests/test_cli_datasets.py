"""The verb `datasets`: what it prints, its exit codes, and what it does not import."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from fitball.cli.main import make_parser
from fitball.errors import SceneError, TableError

BAD = "v_x1,v_y1,v_x2,v_y2\n15,5,fast,4\n15,5,10,6\n"


def call(*words: str) -> int:
    args = make_parser().parse_args(["datasets", *words])
    return args.run(args)


def test_list_names_every_table(capsys: pytest.CaptureFixture[str]) -> None:
    assert call("list") == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == [
        "synthetic_court.csv",
        "synthetic_drop.csv",
        "synthetic_gaps.csv",
        "wang_all.csv",
        "wang_backspin.csv",
        "wang_topspin.csv",
        "wang_zero_spin.csv",
    ]
    assert "topspin" in lines[5]


def test_list_for_machines(capsys: pytest.CaptureFixture[str]) -> None:
    assert call("list", "--json") == 0
    items = json.loads(capsys.readouterr().out)
    assert all(Path(item["path"]).is_file() and item["description"] for item in items)


def test_show_prints_table_scene_and_notices(capsys: pytest.CaptureFixture[str]) -> None:
    assert call("show", "wang_zero_spin") == 0
    out = capsys.readouterr().out
    for words in (
        "v_x1 [m/s]",
        "omega_2 [rad/s]",
        "313.2",
        "theta_2 [deg]",
        "32.39",
        "Wang",
        "57.6 g",
        "0.55 ± 0.05",
        "5 ± 0.5 ms",
        "11.87 m/s",
    ):
        assert words in out
    assert "assumed" not in out


def test_show_for_machines(capsys: pytest.CaptureFixture[str]) -> None:
    assert call("show", "wang_all.csv", "--json") == 0
    shown = json.loads(capsys.readouterr().out)
    assert shown["columns"]["v_x1 [m/s]"][0] == 15.62
    assert shown["measurements"] == ["v_x2", "v_y2", "omega_2"]
    assert len(shown["ids"]) == len(shown["labels"]["group"]) == 21
    assert {notice["row"] for notice in shown["notices"]} == {1, 2}


def test_show_says_what_is_assumed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "t.csv").write_text("v_y1,v_y2\n4,3\n5,4\n")
    assert call("show", str(tmp_path / "t.csv")) == 0
    assert "no scene file" in capsys.readouterr().out


def test_check_of_a_good_table(capsys: pytest.CaptureFixture[str]) -> None:
    assert call("check", "wang_zero_spin.csv") == 0
    out = capsys.readouterr().out
    assert "7 impacts, no fault" in out and "row 1: v_2" in out
    assert call("check", "wang_zero_spin.csv", "--quiet") == 0
    assert capsys.readouterr().out == ""


def test_check_lists_every_fault_of_table_and_scene(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "t.csv").write_text(BAD)
    (tmp_path / "t.toml").write_text("[ball]\nmas = 1\n")
    assert call("check", str(tmp_path / "t.csv")) == 2
    out = capsys.readouterr().out
    assert "row 1 (line 2), column 'v_x2': read 'fast'" in out
    assert "row 2 (line 3), column 'v_y2': coefficient of restitution above 1: 1.2" in out
    assert "did you mean 'mass'" in out


def test_check_for_machines(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "t.csv").write_text(BAD)
    assert call("check", str(tmp_path / "t.csv"), "--json") == 2
    result = json.loads(capsys.readouterr().out)
    assert result["ok"] is False
    assert [(fault["row"], fault["line"], fault["column"]) for fault in result["faults"]] == [
        (1, 2, "v_x2"),
        (2, 3, "v_y2"),
    ]


def test_check_with_another_scene(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "s.toml").write_text("[surface]\nmu = -1\n")
    assert call("check", "wang_all", "--scene", str(tmp_path / "s.toml")) == 2
    assert "surface.mu = -1" in capsys.readouterr().out


def test_many_columns_that_nobody_asked_for_take_one_short_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    extra = ",".join(f"extra_{k}" for k in range(5000))
    (tmp_path / "wide.csv").write_text(f"v_y1,v_y2,{extra}\n" + f"5,4,{extra}\n" * 3)
    assert call("check", str(tmp_path / "wide.csv")) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line for line in lines if "extra_0, extra_1," in line and line.endswith(" and 4,988 more")]
    assert max(map(len, lines)) < 400


def test_check_of_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    assert call("check", "absent.csv") == 2
    assert capsys.readouterr().out.count("no such file") == 1


def test_show_leaves_faults_to_the_caller(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text(BAD)
    with pytest.raises(TableError):
        call("show", str(tmp_path / "t.csv"))
    (tmp_path / "t.csv").write_text("v_y1,v_y2\n4,3\n5,4\n")
    (tmp_path / "t.toml").write_text("x = 1")
    with pytest.raises(SceneError):
        call("show", str(tmp_path / "t.csv"))


@pytest.mark.parametrize("words", [["--help"], ["list", "--help"], ["show", "--help"], ["check", "--help"]])
def test_help_shows_an_example(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        call(*words)
    assert caught.value.code == 0
    assert "  fitball datasets " in capsys.readouterr().out


def test_parser_imports_nothing_heavy() -> None:
    code = (
        "import sys; from fitball.cli.main import make_parser; make_parser();"
        "print(sorted({'numba', 'scipy', 'pandas', 'matplotlib'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_reading_a_csv_does_not_import_pandas() -> None:
    code = (
        "import sys; from fitball.data.read import load_table; load_table('wang_all');print('pandas' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
