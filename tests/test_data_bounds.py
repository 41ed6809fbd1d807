"""What a table may say beyond the bounds of physics: noise is a notice, nonsense a fault, the ball is the scene's."""

import json
from pathlib import Path

import numpy as np
import pytest

import fitball
from fitball.cli.main import main
from fitball.data.checks import gyration
from fitball.data.read import load_table
from fitball.data.scene import Scene, load_scene
from fitball.data.table import Notice, summed_up
from fitball.errors import FitError, TableError
from fitball.inference.problem.build import Choices, build_problem
from fitball.values import Ball

HEAD = "v_x1,v_y1,omega_1,v_x2,v_y2,omega_2"
# Kharaz, Gorham and Salman (2001), 5 mm alumina spheres on glass: measured, as printed.
KHARAZ = """0.6434,3.8466,0,0.4327,3.8081,225.8
1.3346,3.6645,0,0.7967,3.6279,540.0
1.9575,3.3732,0,1.3459,3.3394,609.2
2.4745,3.0144,0,1.9090,2.9843,592.5
2.9741,2.5228,0,2.5209,2.4976,461.5
3.3782,1.9488,0,3.0452,1.9293,384.3"""
ALUMINA = "[ball]\nmass = 2.618e-4\nradius = 2.5e-3\ninertia_ratio = 0.4\n"
PING_PONG = "[ball]\nmass = 2.7e-3\nradius = 0.02\ninertia_ratio = 0.6666\n"


def written(folder: Path, rows: str, scene: str = "", head: str = HEAD) -> Path:
    place = folder / "t.csv"
    place.write_text(f"{head}\n{rows}\n", encoding="utf-8")
    if scene:
        place.with_suffix(".toml").write_text(scene, encoding="utf-8")
    return place


@pytest.mark.parametrize(
    ("rows", "scene"),
    [(KHARAZ, ALUMINA), ("8,3,0,2.56,2.5,408\n8,3,0,2.56,2.5,408", PING_PONG)],
    ids=["alumina", "ping-pong"],
)
def test_balls_that_are_no_tennis_balls(tmp_path: Path, rows: str, scene: str) -> None:
    table = load_table(written(tmp_path, rows, scene))
    assert table.notices == ()
    tennis = tmp_path / "tennis"
    tennis.mkdir()
    with pytest.raises(TableError, match=r"more energy.*for a ball of radius 33.02 mm.*\[ball\]"):
        load_table(written(tennis, rows))


def test_the_verbs_take_the_scene_they_are_given(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], brief: None
) -> None:
    table, scene = written(tmp_path, KHARAZ), tmp_path / "other.toml"
    scene.write_text(ALUMINA, encoding="utf-8")
    assert main(["datasets", "check", str(table)]) == 2
    assert "6 faults" in capsys.readouterr().out
    assert main(["datasets", "check", str(table), "--scene", str(scene)]) == 0
    assert "no fault" in capsys.readouterr().out
    out = str(tmp_path / "fit")
    words = ["calibrate", str(table), "--model", "brody", "--point-only", "--out", out, "--quiet"]
    assert main(words) == 2
    assert main([*words, "--scene", str(scene)]) == 0
    # The run knows its ball and noise: it is repeated without that file.
    assert main(["repeat", out, "--quiet"]) == 0


def test_the_gyration_is_that_of_the_scenes_ball(tmp_path: Path) -> None:
    scene = Scene(ball=Ball(0.05, 0.03, 0.5 * 0.05 * 0.03**2), ball_sd={"inertia_ratio": 0.01, "radius": 1e-4})
    assert gyration(scene) == pytest.approx((0.45 * 0.0295**2, 0.55 * 0.0305**2))
    # 20 m/s and nothing else before; the spin after is what decides.
    for ratio, allowed in ((0.4, True), (0.66, False)):
        ball = f"[ball]\nradius = 0.033\ninertia_ratio = {ratio}\n[measurement]\nvelocity_sd = 0.05\nspin_sd = 1\n"
        rows = "10,17.3,0,8,14,505\n10,17.3,0,8,14,505"
        if allowed:
            assert load_table(written(tmp_path, rows, ball)).notices == ()
        else:
            with pytest.raises(TableError, match="more energy"):
                load_table(written(tmp_path, rows, ball))


def test_a_restitution_above_one_within_its_noise_is_a_notice(tmp_path: Path) -> None:
    head = "v_y1,v_y1_sd,v_y2,v_y2_sd"
    rows = "0.80,0.05,0.82,0.05\n5,0.05,4,0.05\n6,0.05,4.7,0.05"
    (notice,) = load_table(written(tmp_path, rows, head=head)).notices
    assert (notice.row, notice.columns) == (1, ("v_y2",))
    assert "coefficient of restitution above 1, within its noise: 1.025" in str(notice)
    # The same numbers, known ten times as well, are none.
    with pytest.raises(TableError, match=r"row 1.*above 1: 1\.025"):
        load_table(written(tmp_path, rows.replace("0.05", "0.003"), head=head))


def test_expected_noise_counts_where_none_is_stated(tmp_path: Path) -> None:
    rows = "4,3\n5,5.5\n8,6"
    assert len(load_table(written(tmp_path, rows, head="v_y1,v_y2")).notices) == 1
    # Noise of the one column or of all velocities: the column's own is what counts.
    for known in ("velocity_sd = 0.02", "v_y_sd = 0.02", "velocity_sd = 0.5\nv_y_sd = 0.02"):
        with pytest.raises(TableError, match=r"row 2 .*25 times the sd.*\[measurement\]"):
            load_table(written(tmp_path, rows, f"[measurement]\n{known}\n", head="v_y1,v_y2"))


def test_long_tables_have_rows_further_out(tmp_path: Path) -> None:
    """4.3 sd above the bound is not noise among three rows, and is among twenty thousand."""
    odd = f"5,{5.0 + 4.3 * 0.25}\n"
    with pytest.raises(TableError, match=r"row 1 .*4\.3 times the sd"):
        load_table(written(tmp_path, odd + "5,4\n5,4", head="v_y1,v_y2"))
    (notice,) = load_table(written(tmp_path, odd + "5,4\n" * 20_000, head="v_y1,v_y2")).notices
    assert notice.row == 1


def simulated(rows: int, sd: float, seed: int = 5) -> np.ndarray:
    """A table that the rigid model itself made, with noise: (rows, 6)."""
    rng = np.random.default_rng(seed)
    speed, angle = rng.uniform(5.0, 35.0, rows), np.radians(rng.uniform(15.0, 70.0, rows))
    given = fitball.impacts(speed * np.cos(angle), speed * np.sin(angle), rng.uniform(-200.0, 300.0, rows))
    model = fitball.model("grip-slip")
    values = {"mu": 0.6, "e_x": 0.1, "offset": 2e-3, "cor_10": 0.78, "cor_slope": -0.012}
    made = model.rebound(values, given)
    noisy = [made.v_x2, made.v_y2, made.omega_2]
    scatter = (sd, sd, 10.0)
    noisy = [item + size * rng.standard_normal(rows) for item, size in zip(noisy, scatter, strict=True)]
    return np.stack([given.v_x1, given.v_y1, given.omega_1, *noisy], axis=1)


def test_thirty_thousand_rows_of_the_model_itself_are_read(tmp_path: Path) -> None:
    numbers = simulated(30_000, 0.3)
    # A speed that noise turns towards the court is refused by itself.
    numbers = numbers[numbers[:, 4] > 0.0]
    above = int(np.sum(numbers[:, 4] > numbers[:, 1]))
    assert above > 100
    place = tmp_path / "t.csv"
    np.savetxt(place, numbers, delimiter=",", header=HEAD, comments="", fmt="%.6g")
    table = load_table(place)
    assert sum(item.kind.startswith("coefficient") for item in table.notices) == above
    # Told in a sentence or two, however many.
    assert len(table.remarks) <= 2
    assert f"and {above - 3:,} more: coefficient of restitution above 1" in table.remarks[0]


@pytest.mark.parametrize("order", [[0, 4, 2, 3, 1, 5], [3, 4, 5, 0, 1, 2]], ids=["v_y swapped", "ends swapped"])
def test_swapped_columns_are_refused(tmp_path: Path, order: list[int]) -> None:
    numbers = simulated(40, 0.1)[:, order]
    np.savetxt(tmp_path / "t.csv", numbers, delimiter=",", header=HEAD, comments="", fmt="%.6g")
    with pytest.raises(TableError, match="swapped columns"):
        load_table(tmp_path / "t.csv")


def test_slow_impacts_swapped_are_found_together(tmp_path: Path) -> None:
    """Each is within the expected noise of 0.25 m/s, all together are not."""
    rows = "\n".join(f"{0.8 * v:.2f},{v:.2f}" for v in np.linspace(1.0, 4.0, 20))
    with pytest.raises(TableError) as caught:
        load_table(written(tmp_path, rows, head="v_y1,v_y2"))
    (fault,) = caught.value.faults
    assert fault.row is None and "in 20 of 20 rows" in fault.message


@pytest.mark.parametrize("column", [3, 5])
def test_wrong_units_are_refused(tmp_path: Path, column: int) -> None:
    numbers = simulated(40, 0.1)
    numbers[:, column] *= 3.6 if column == 3 else 60.0 / (2.0 * np.pi)
    np.savetxt(tmp_path / "t.csv", numbers, delimiter=",", header=HEAD, comments="", fmt="%.6g")
    with pytest.raises(TableError, match=r"more energy.*check the units"):
        load_table(tmp_path / "t.csv")


def test_what_comes_after_survives_such_rows(tmp_path: Path, capsys: pytest.CaptureFixture[str], brief: None) -> None:
    numbers = simulated(30, 0.05)
    numbers[4, 4] = 1.03 * numbers[4, 1]
    place = tmp_path / "t.csv"
    np.savetxt(place, numbers, delimiter=",", header=HEAD, comments="", fmt="%.6g")
    table, scene = load_table(place), load_scene(place)
    assert [item.row for item in table.notices] == [5]
    # A model that is told each impact's restitution cannot take one above 1: it says so, and which.
    with pytest.raises(FitError, match=r"(?i)cor = '?measured.*impact 5.*1\.03"):
        build_problem(table, scene, Choices(closures={"cor": "measured"}))
    words = ["calibrate", str(place), "--point-only", "--out", str(tmp_path / "fit")]
    assert main([*words, "--model", "grip-slip"]) == 0
    captured = capsys.readouterr()
    assert "row 5: coefficient of restitution above 1, within its noise" in captured.err
    notes = json.loads((tmp_path / "fit" / "fit.json").read_text(encoding="utf-8"))["notes"]
    assert any("row 5: coefficient of restitution above 1" in line for line in notes)
    assert main(["datasets", "show", str(place)]) == 0
    assert main(["predict", str(tmp_path / "fit"), str(place), "--quiet"]) == 0


def test_notices_of_one_kind_are_summed_up() -> None:
    many = [Notice(f"read {k}", k, ("v_2",), "v_2 is odd") for k in (3, 17, 42, *range(100, 612))]
    single = Notice("no column omega_1")
    assert summed_up([single, *many]) == (
        "no column omega_1",
        "rows 3, 17, 42 and 512 more: v_2 is odd; row 3: read 3",
    )
    assert summed_up(many[:3]) == ("row 3: read 3", "row 17: read 17", "row 42: read 42")
