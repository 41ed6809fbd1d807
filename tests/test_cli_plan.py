"""`fitball plan`: words, files, exit codes, mistakes."""

from __future__ import annotations

import json

import numpy as np
import pytest

from fitball.cli.main import main
from fitball.data.read import load_table

WHERE = ["--speed", "10:30:3", "--angle", "15:75:4", "--spin", "-200:200:2", "--impacts", "3"]


@pytest.fixture(scope="module")
def planned(grip_slip_folder, tmp_path_factory):
    """The folder of a plan, and what was printed."""
    out = tmp_path_factory.mktemp("plan") / "out"
    assert main(["plan", str(grip_slip_folder), "--for", "mu", *WHERE, "--out", str(out)]) == 0
    return out


def test_the_folder_holds_page_table_map_and_record(planned):
    assert sorted(place.name for place in planned.iterdir()) == ["plan.csv", "plan.html", "plan.json", "plan.png"]
    record = json.loads((planned / "plan.json").read_text(encoding="utf-8"))
    grid = np.array(record["settings"]["gains"], dtype=float).reshape(1, 3, 4, 2)
    best = record["chosen"][0]
    where = np.unravel_index(np.nanargmax(grid), grid.shape)
    axes = [record["settings"][name] for name in ("speeds", "angles", "spins")]
    assert [best["v_1"], best["theta_1"], best["omega_1"]] == [
        axis[k] for axis, k in zip(axes, where[1:], strict=True)
    ]
    assert best["gain"] == pytest.approx(np.nanmax(grid)) and record["gain"] == pytest.approx(
        sum(one["gain"] for one in record["chosen"])
    )
    page = (planned / "plan.html").read_text(encoding="utf-8")
    assert "Measure next: " in page and "about mu" in page and "--for mu" in page


def test_the_table_can_be_filled_in_and_read(planned, tmp_path):
    lines = (planned / "plan.csv").read_text(encoding="utf-8").splitlines()
    heads = lines[0].split(",")
    assert heads[:4] == ["id", "v_1 [m/s]", "theta_1 [deg]", "omega_1 [rad/s]"]
    filled = [lines[0]]
    for line in lines[1:]:
        cells = line.split(",")
        for name, value in (("v_x2", "5"), ("v_y2", "4"), ("omega_2", "200")):
            cells[next(k for k, head in enumerate(heads) if head.startswith(name))] = value
        filled.append(",".join(cells))
    place = tmp_path / "filled.csv"
    place.write_text("\n".join(filled) + "\n", encoding="utf-8")
    table = load_table(place)
    record = json.loads((planned / "plan.json").read_text(encoding="utf-8"))
    assert np.hypot(table.impacts.v_x1, table.impacts.v_y1) == pytest.approx([one["v_1"] for one in record["chosen"]])
    assert {item.name for item in table.measurements} == {"v_x2", "v_y2", "omega_2"}


def test_the_same_seed_gives_the_same_bytes_and_an_older_plan_is_kept(planned, grip_slip_folder, tmp_path, capsys):
    words = ["plan", str(grip_slip_folder / "fit.json"), "--for", "mu", *WHERE, "--quiet"]
    assert main([*words, "--out", str(tmp_path / "again")]) == 0
    assert capsys.readouterr().out.strip() == str(tmp_path / "again")
    for name in ("plan.csv", "plan.json", "plan.png"):
        assert (tmp_path / "again" / name).read_bytes() == (planned / name).read_bytes(), name
    assert main([*words, "--out", str(planned)]) == 2
    assert "--overwrite" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--for", "k_theta"], "--for k_theta: 'k_theta' is no parameter of this fit"),
        (["--for", "impact=v=3"], "expected v and theta"),
        (["--spin", "-300:-400"], "spin '-300:-400'"),
        (["--sensor", "timer=3"], "--sensor timer=3: unknown column 'timer'"),
        (["--cost", "camera"], "--cost camera: expected NAME=C"),
        (["--cost", "camera=-1"], "--cost camera=-1: expected a number above 0"),
        (["--impacts", "0"], "expected a whole number, 1 or more"),
        (["--speed", "1:2:200", "--angle", "10:80:200"], "expected 20,000 at most"),
    ],
)  # fmt: skip
def test_mistakes_are_told_and_nothing_is_written(grip_slip_folder, tmp_path, capsys, words, said):
    try:
        code = main(["plan", str(grip_slip_folder), *words, "--out", str(tmp_path / "none")])
    except SystemExit as left:
        code = left.code
    assert code == 2 and not (tmp_path / "none").exists()
    assert said in capsys.readouterr().err


def test_a_better_way_of_measuring_is_said_before_the_impacts(grip_slip_folder, tmp_path, capsys):
    """Who asks for a sensor is told first what it adds."""
    words = ["--sensor", "camera=0.01", "--out", str(tmp_path / "p")]
    assert main(["plan", str(grip_slip_folder), "--for", "mu", *WHERE, *words]) == 0
    said = capsys.readouterr().out
    assert 0 < said.index("The best way of measuring these impacts is camera") < said.index("speed [m/s]")
    assert said.count("The best way of measuring") == 1


@pytest.mark.parametrize(
    ("text", "words"),
    [("fps=240, noise=1mm", "grip-slip has no time between the flights"), ("noise=1mm", "unknown column 'noise'")],
)
def test_a_camera_is_a_way_of_measuring_for_models_that_follow_the_contact(
    grip_slip_folder, tmp_path, capsys, text, words
):
    assert main(["plan", str(grip_slip_folder), *WHERE, "--camera", text, "--out", str(tmp_path / "p")]) == 2
    said = capsys.readouterr().err
    assert words in said and text in said
    assert f"--camera {text}" in said or not text.startswith("fps")
