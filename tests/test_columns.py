"""What follows from the registry of columns, tried with one more column."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from fitball.base.columns import (
    COLUMNS,
    COMPONENTS,
    INCIDENT,
    MIRRORED,
    MIRRORED_DEVIATIONS,
    REBOUND,
    velocity_columns,
)

SCRIPT = Path(__file__).parent / "support" / "ratio_column.py"
STATE = ["v_x1", "v_y1"]


@pytest.fixture(scope="module")
def ratio():
    run = subprocess.run(
        [sys.executable, str(SCRIPT)],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout)


def test_a_column_that_follows_from_both_velocities_counts_once(ratio):
    assert ratio["beside components"] == [*STATE, "v_x2", "v_y2"]
    assert "sd-not-used" in ratio["notes"]
    assert ratio["beside polar"] == [*STATE, "v_2", "theta_2"]
    # Two numbers are a velocity, a third one follows.
    assert ratio["beside one of each"] == [*STATE, "v_x2", "v_2"]
    assert ratio["beside speed"] == [*STATE, "v_2", "ratio_2"]
    assert ratio["contradiction"] == ["contradiction"] * 16
    assert "rebound-columns-differ" in ratio["joined"]
    assert ratio["sensor"] == ["sensor"]


def test_a_column_without_a_dimension_is_read_fitted_and_written(ratio):
    assert [ratio[unit] for unit in ("%", "-", "1")] == pytest.approx([0.0] * 3, abs=1e-15)
    assert ratio["length"] == ["other-quantity"]
    assert ratio["same"]
    assert ratio["page"]
    assert ratio["parameters"] == ["v_2", "ratio_2"]
    # The scatter of v_x2/v_y2, some 5, where both scatter by 0.05 m/s and v_y2 is 4.5 m/s.
    assert ratio["noise"] == pytest.approx(0.05 / 4.5 * np.hypot(1.0, 5.0), rel=0.4)


def test_velocities_of_an_end_are_its_components_and_what_has_a_formula():
    for end, names in (("1", INCIDENT), ("2", REBOUND)):
        columns = velocity_columns(end)
        assert columns[:2] == (f"v_x{end}", f"v_y{end}")
        assert {f"v_{end}", f"theta_{end}"} <= {*columns[2:]} <= {*names}
        assert not {f"omega_{end}", "contact_time", "gap_path"} & {*columns}
        assert {*COMPONENTS[end]} <= {*names}
        v_x, v_y = 3.0 * np.cos(2.0), 3.0 * np.sin(2.0)
        assert COLUMNS[f"v_{end}"].formula(v_x, v_y) == pytest.approx(3.0)
        assert COLUMNS[f"theta_{end}"].formula(v_x, v_y) == pytest.approx(2.0)


@pytest.mark.parametrize("name", [name for name in COLUMNS if COLUMNS[name].formula])
def test_columns_that_the_mirror_image_turns_are_listed(name):
    formula = COLUMNS[name].formula
    v_x, v_y = np.array([3.0, 3.1]), np.array([2.0, 2.0])
    plain, mirrored = formula(v_x, v_y), formula(-v_x, v_y)
    assert (name in MIRRORED) == bool(np.allclose(mirrored, -plain))
    turned = bool(np.allclose(np.diff(mirrored), -np.diff(plain)))
    assert (name in MIRRORED_DEVIATIONS) == turned
