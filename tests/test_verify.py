"""`fitball verify`: right ports pass, wrong ones fail."""

from __future__ import annotations

import json
import math
import shutil

import numpy as np
import pandas as pd
import pytest
from test_export_ports import fitted

import fitball
from fitball.cli.main import main
from fitball.inference.prediction.outputs import check_port, expected_outputs
from fitball.inference.prediction.outputs import golden as golden_of

OUTPUTS = ["v_x2 [m/s]", "v_y2 [m/s]", "omega_2 [rad/s]"]


@pytest.fixture
def golden(small_fit, tmp_path):
    """The golden table as a data frame."""
    assert main(["export", str(small_fit), "--to", "golden", "--out", str(tmp_path / "golden.csv")]) == 0
    frame = pd.read_csv(tmp_path / "golden.csv", dtype=str)
    return frame.assign(**{name: frame[name].map(float) for name in frame if "[" in name})


@pytest.fixture
def verify(small_fit, tmp_path, capsys):
    """Write a frame and verify it; returns exit code, stdout, stderr."""

    def run(frame, *options):
        frame.to_csv(tmp_path / "port.csv", index=False)
        code = main(["verify", str(tmp_path / "port.csv"), "--fit", str(small_fit), *options])
        return code, *capsys.readouterr()

    return run


def test_the_golden_table_holds_the_models_own_rebounds(small_fit, golden):
    saved = fitball.load_fit(small_fit)
    given = fitball.impacts(golden["v_x1 [m/s]"], golden["v_y1 [m/s]"], golden["omega_1 [rad/s]"])
    found = saved.fitted.rebound(given)
    for name, column in zip(("v_x2", "v_y2", "omega_2"), OUTPUTS, strict=True):
        np.testing.assert_array_equal(golden[column], getattr(found, name)[0])
    assert "contact_time [s]" not in golden
    assert set(golden["regime"]) <= {"slide", "slide back", "grip"}


def test_inputs_only_hides_the_answers(small_fit, capsys):
    assert main(["export", str(small_fit), "--to", "golden", "--inputs-only", "--out", "-"]) == 0
    assert capsys.readouterr().out.splitlines()[0] == "id,v_x1 [m/s],v_y1 [m/s],omega_1 [rad/s]"


def test_a_right_port_passes(golden, verify):
    code, out, _ = verify(golden)
    assert code == 0
    assert "passed (tolerance 1e-09 relative)" in out


def test_order_units_and_printed_digits_do_not_matter(golden, verify):
    port = pd.DataFrame(
        {
            "id": golden["id"],
            "omega_2 [rpm]": (golden["omega_2 [rad/s]"] * 30.0 / math.pi).map("{:.10g}".format),
            "v_2 [km/h]": (np.hypot(golden["v_x2 [m/s]"], golden["v_y2 [m/s]"]) * 3.6).map("{:.11g}".format),
            "theta_2": np.degrees(np.arctan2(golden["v_y2 [m/s]"], golden["v_x2 [m/s]"])).map("{:.11g}".format),
        }
    ).iloc[::-1]
    assert verify(port)[0] == 0
    assert verify(port, "--tolerance", "1e-14")[0] == 1
    # Without the names the order counts.
    assert verify(port.drop(columns="id"))[0] == 1


def test_a_small_error_fails_and_is_measured(golden, verify):
    golden.loc[3, "v_x2 [m/s]"] += 1e-6
    code, out, _ = verify(golden, "--json")
    found = json.loads(out)
    assert code == 1
    assert not found["passed"]
    assert found["outputs"]["v_x2"]["absolute"] == pytest.approx(1e-6, rel=1e-6)
    row = golden.loc[3]
    speed = math.sqrt(row["v_x1 [m/s]"] ** 2 + row["v_y1 [m/s]"] ** 2 + (0.03302 * row["omega_1 [rad/s]"]) ** 2)
    assert found["outputs"]["v_x2"]["relative"] == pytest.approx(1e-6 / speed, rel=1e-6)
    assert found["outputs"]["v_x2"]["impact"] == "golden-4"
    assert [item["passed"] for item in found["impacts"]] == [k != 3 for k in range(12)]
    assert verify(golden, "--tolerance", "1e-6")[0] == 0


def test_a_wrong_regime_fails(golden, verify):
    golden.loc[0, "regime"] = "grip" if golden.loc[0, "regime"] == "slide" else "slide"
    code, out, _ = verify(golden)
    assert code == 1
    assert "the port has another" in out


@pytest.mark.parametrize(
    ("column", "factor"),
    [
        ("v_y2 [m/s]", -1.0), ("omega_2 [rad/s]", -1.0), ("omega_2 [rad/s]", 30.0 / math.pi), ("v_x2 [m/s]", 1.01),
        ("v_x2 [m/s]", 1.0 + 1e-7),
    ],
)  # fmt: skip
def test_a_wrong_sign_unit_or_precision_fails_in_its_column_alone(golden, verify, column, factor):
    golden[column] *= factor
    code, out, _ = verify(golden, "--json")
    wrong = {name for name, found in json.loads(out)["outputs"].items() if found["relative"] > 1e-9}
    assert code == 1 and wrong == {column.partition(" ")[0]}


def test_gaps_are_compared_by_what_the_ball_goes_between_its_flights():
    """A path or a turn may be zero; a model without gaps expects none."""
    ball = fitted("two-mass")
    exact = golden_of(ball, ball.impacts)
    expected = expected_outputs(ball, exact)
    assert {"gap_time", "gap_path", "gap_turn"} <= set(expected)
    assert check_port(ball, exact, expected, None, 1e-15).passed
    given, between = exact.impacts, exact.rebound.gap_time
    speed = np.sqrt(given.v_x1**2 + given.v_y1**2 + (ball.ball.radius * given.omega_1) ** 2)
    for name, scale in (("gap_time", between), ("gap_path", speed * between),
                        ("gap_turn", speed * between / ball.ball.radius)):  # fmt: skip
        check = check_port(ball, exact, {name: expected[name] + 1e-6 * scale}, None, 1e-7)
        np.testing.assert_allclose(check.relative, 1e-6, rtol=1e-6)
    rigid = fitted("grip-slip")
    assert not any(name.startswith("gap") for name in expected_outputs(rigid, golden_of(rigid, rigid.impacts)))


def test_bad_files_are_explained(golden, verify):
    cases = [
        (golden.drop(columns=[*OUTPUTS, "regime"]), "no rebound column"),
        (golden.iloc[:5].drop(columns="id"), "read 5 rows; expected 12"),
        (golden.iloc[:5], "no row 'golden-6'"),
        (golden.assign(id=["golden-1"] * 12), "repeated"),
        (golden.assign(contact_time=0.005), "has no contact time"),
        (golden.assign(gap_path=0.05), "has no path between the flights"),
        (
            golden.assign(**{"v_x2 [m/s]": ["fast"] * 12}),
            "12 rows (first: row 1, line 2), column 'v_x2': read 'fast'",
        ),
        (golden.assign(**{"omega_1 [rad/s]": -golden["omega_1 [rad/s]"]}), "not the golden impact"),
        (golden.rename(columns={"v_x2 [m/s]": "v_x2 [rpm]"}), "measures spin"),
        (golden.iloc[:0], "no rows"),
    ]
    for frame, words in cases:
        code, out, err = verify(frame)
        assert code == 2, words
        assert words in err
        assert not out
    assert "expected a positive number" in verify(golden, "--tolerance", "0")[2]


def test_a_column_without_values_is_no_column(golden, verify):
    assert verify(golden.assign(**{"contact_time [s]": "nan"}))[0] == 0


def test_the_fit_is_looked_for_beside_the_port(small_fit, golden, tmp_path, capsys):
    golden.to_csv(tmp_path / "port.csv", index=False)
    assert main(["verify", str(tmp_path / "port.csv")]) == 2
    assert "--fit FIT" in capsys.readouterr().err
    shutil.copy(small_fit / "fit.json", tmp_path / "fit.json")
    assert main(["verify", str(tmp_path / "port.csv"), "--quiet"]) == 0
    assert capsys.readouterr().out == "passed (tolerance 1e-09 relative)\n"
