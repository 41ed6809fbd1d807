"""Gaps between the flights as columns: units, whole turns, and questions about what speeds and spins contradict."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from fitball.data.between_flights import doubt_of_gaps
from fitball.data.misreading import doubt_of
from fitball.data.read import load_table
from fitball.data.scene import Scene
from fitball.data.tables import trusted_table
from fitball.errors import ReadingError, TableError
from fitball.models.registry import model
from fitball.values import Ball, Impacts

WITH = {
    "mass_ratio": 0.87, "k_y": 1.9e4, "k_theta": 15.0, "mu": 0.55, "eps_10": 2.5e-3, "eps_slope": 0.0,
    "cor_10": 0.775, "cor_slope": -0.0145,
}  # fmt: skip


@pytest.fixture(scope="module")
def bounced() -> pd.DataFrame:
    """Impacts of the two-mass model with topspin before, so that balls turn much during the contact; SI."""
    angles = np.radians([18.0, 22.0, 28.0, 34.0, 42.0, 50.0])
    impacts = Impacts(25.0 * np.cos(angles), 25.0 * np.sin(angles), np.array([150.0, 200, 100, 250, 180, 120]), None)
    after = model("two-mass").rebound(WITH, impacts)
    names = ("v_x2", "v_y2", "omega_2", "gap_time", "gap_path", "gap_turn")
    before = {"v_x1": impacts.v_x1, "v_y1": impacts.v_y1, "omega_1": impacts.omega_1}
    return pd.DataFrame(before | {name: np.asarray(getattr(after, name)) for name in names})


def headed(bounced: pd.DataFrame, **units: tuple[str, float]) -> pd.DataFrame:
    """The same with columns in units: symbol, and by how much numbers grow."""
    given = {"gap_turn": ("rad", 1.0), **units}
    made = bounced.copy()
    for name, (_symbol, factor) in given.items():
        made[name] = made[name] * factor
    return made.rename(columns={name: f"{name} [{symbol}]" for name, (symbol, _factor) in given.items()})


@pytest.mark.parametrize(
    ("time", "path", "turn"),
    [(("ms", 1e3), ("mm", 1e3), ("deg", 180 / np.pi)), (("us", 1e6), ("cm", 1e2), ("rad", 1.0)),
     (("s", 1.0), ("m", 1.0), ("mrad", 1e3)), (("Millisecond", 1e3), ("in", 1 / 0.0254), ("Degrees", 180 / np.pi))],
)  # fmt: skip
def test_gaps_are_read_in_their_units(bounced: pd.DataFrame, time: tuple, path: tuple, turn: tuple) -> None:
    frame = headed(bounced, gap_time=time, gap_path=path, gap_turn=turn)
    frame[f"gap_turn_sd [{turn[0]}]"] = 0.03 * turn[1]
    frame[f"gap_path_sd [{path[0]}]"] = 8e-4 * path[1]
    frame[f"Gap time SD [{time[0]}]"] = 5e-5 * time[1]
    table, notes = trusted_table([frame], Scene())
    for name, sd in (("gap_time", 5e-5), ("gap_path", 8e-4), ("gap_turn", 0.03)):
        item = table.measurement(name)
        assert item is not None and item.sd is not None
        assert item.values == pytest.approx(bounced[name].to_numpy(), rel=1e-12)
        assert item.sd == pytest.approx(sd)
    assert not any("gap" in note for note in notes)


def test_files_of_other_dialects_have_gaps_too(bounced: pd.DataFrame, tmp_path: Path) -> None:
    """Semicolons, decimal commas, deviations in cells, brackets, a row of units."""
    frame = headed(bounced, gap_time=("ms", 1e3), gap_path=("mm", 1e3), gap_turn=("deg", 180 / np.pi)).round(3)
    place = tmp_path / "t.csv"
    text = frame.to_csv(sep=";", decimal=",", index=False)
    place.write_text(text.replace("gap_path [mm]", "Gap_Path (mm)").replace("gap_time [ms]", "gap time, ms"))
    read = load_table(place)
    frame["gap_time [ms]"] = [f"{value} ± 0.05" for value in frame["gap_time [ms]"]]
    other = load_table(frame)
    for name in ("gap_time", "gap_path", "gap_turn"):
        one, two = read.measurement(name), other.measurement(name)
        assert one is not None and two is not None
        assert one.values == pytest.approx(two.values) and one.values == pytest.approx(bounced[name], rel=1e-2)
    stated = other.measurement("gap_time")
    assert stated is not None and stated.sd == pytest.approx(5e-5)


def test_whole_turns_are_kept(bounced: pd.DataFrame) -> None:
    """A turn is no direction."""
    frame = bounced.assign(omega_1=2000.0, omega_2=1900.0, gap_turn=np.degrees(8.6))
    item = load_table(frame, units={"gap_turn": "deg"}).measurement("gap_turn")
    assert item is not None and item.values == pytest.approx(8.6)


WRONG = {
    "gap_time": [
        (("s", 1e3), "beyond", "did you mean 'gap_time [ms]' in the header?"),
        (("ms", 1.0), "beyond", "did you mean 'gap_time [s]' in the header?"),
        (("ms", 0.2e3), "asked", "the flights of a tennis ball are 2 to 9 ms apart: check the height of the court"),
    ],
    "gap_path": [
        (("mm", 1.0), "asked", "did you mean 'gap_path [m]' in the header?"),
        (("cm", 1e3), "asked", "did you mean 'gap_path [mm]' in the header?"),
        (("mm", -1e3), "asked", "if the sign is the other one, pass flip='gap_path'"),
    ],
    "gap_turn": [
        (("rad", 180 / np.pi), "asked", "did you mean 'gap_turn [deg]' in the header?"),
        (("deg", 1.0), "asked", "did you mean 'gap_turn [rad]' in the header?"),
        (("deg", -180 / np.pi), "asked", "if the sign is the other one, pass flip='gap_turn'"),
    ],
}


@pytest.mark.parametrize(
    ("name", "unit", "kind", "words"), [(name, *case) for name, cases in WRONG.items() for case in cases]
)
def test_another_unit_or_sign_is_asked_about(
    bounced: pd.DataFrame, name: str, unit: tuple[str, float], kind: str, words: str
) -> None:
    """What cannot be is refused; what speeds and spins contradict is asked about, and `as_read` accepts it."""
    frame = headed(bounced, **{name: unit})
    with pytest.raises(TableError if kind == "beyond" else ReadingError) as caught:
        trusted_table([frame], Scene())
    assert words in str(caught.value)
    if kind == "asked":
        table, notes = trusted_table([frame], Scene(), as_read=True)
        assert table.measurement(name) is not None
        assert any("on request (as_read)" in note and words in note for note in notes)


def test_left_out_whole_turns_and_single_rows_are_asked_about(bounced: pd.DataFrame) -> None:
    fast = bounced.assign(omega_1=1500.0, omega_2=1400.0, gap_time=4.6e-3, gap_turn=6.6 - 2 * np.pi)
    (asked,) = doubt_of_gaps(load_table(headed(fast)), Scene())
    assert "whole turns belong to it, add them" in asked
    late = bounced.copy()
    late.loc[2, "gap_time"] = 0.0095
    with pytest.raises(ReadingError, match=r"gap_time is 9\.5 ms for '3', but the flights of a tennis ball"):
        trusted_table([headed(late)], Scene())


def test_other_balls_are_not_held_to_a_tennis_ball(bounced: pd.DataFrame) -> None:
    scene = Scene(ball=Ball(0.62, 0.12, 0.62 * 0.12**2 * 0.6))
    slow = bounced.assign(gap_time=0.012, gap_path=3.0 * bounced["gap_path"], gap_turn=0.5)
    slow = slow.drop(columns=["omega_1", "omega_2"])
    assert trusted_table([headed(slow)], scene)[0].measurement("gap_time") is not None
    with pytest.raises(ReadingError, match="gap_time is 12 ms"):
        trusted_table([headed(slow)], Scene())


def test_gaps_do_not_enter_doubts_about_signs_and_units(bounced: pd.DataFrame) -> None:
    """Angles in radians read as degrees are asked about alone, though a turn is an angle too."""
    before, after = ((bounced[f"v_x{end}"], bounced[f"v_y{end}"]) for end in ("1", "2"))
    columns = {
        "v_1": np.hypot(*before), "theta_1": np.radians(np.arctan2(before[1], before[0])),
        "omega_1": bounced["omega_1"],
        "v_2": np.hypot(*after), "theta_2": np.radians(np.arctan2(after[1], after[0])), "omega_2": bounced["omega_2"],
        "gap_turn": np.radians(bounced["gap_turn"]),
    }  # fmt: skip
    columns = {name: np.asarray(values) for name, values in columns.items()}
    units = {name: {"v": "m/s", "t": "deg", "g": "deg", "o": "rad/s"}[name[0]] for name in columns}
    doubt = doubt_of(columns, units, Ball())
    assert doubt is not None
    assert doubt.found[0].hypothesis.words == "with theta_1 and theta_2 in rad instead of deg"
