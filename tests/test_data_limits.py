"""Numbers, texts and names beyond all limits: refused before anything is computed with them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from written import only

from fitball.data.lines import parse_grid, parse_impact
from fitball.data.numbers import beyond_limit
from fitball.data.read import load_table
from fitball.errors import ParameterError


@pytest.mark.parametrize(
    ("header", "value", "expected"),
    [
        ("v_1 [mph],theta_1 [deg]", "1e308,20", "not finite in SI units"),
        ("v_1,theta_1", "17,1e-9", "at least 0.006 deg"),
        ("v_1,theta_1", "0e400,20", "expected a number"),
        ("v_1,theta_1", "1e-99999999999999999999,20", "expected a number"),
        ("v_1,theta_1", "9" * 330 + ",20", "which is not finite"),
    ],
)
def test_numbers_that_arithmetic_does_not_hold(tmp_path: Path, header: str, value: str, expected: str) -> None:
    fault = only(tmp_path, f"{header},v_2,theta_2\n38,20,12,24\n{value},12,24\n")
    assert fault.row == 2
    assert expected in fault.message


def test_the_flattest_incidence_is_a_ten_thousandth_of_a_radian() -> None:
    flat = np.array([0.99e-4, 1.01e-4, 0.0, np.pi])
    # Zero is told by the check of ranges.
    assert beyond_limit("theta_1", flat).tolist() == [True, False, False, False]
    assert not beyond_limit("theta_2", flat).any()


def test_limits_themselves_are_allowed(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text(
        "v_x1,v_y1,omega_1,v_y2,contact_time [ms]\n1000,0.001,1e5,0.001,0.1\n-1000,1000,-1e5,1,100\n"
    )
    assert len(load_table(tmp_path / "t.csv")) == 2


def test_a_label_is_a_name(tmp_path: Path) -> None:
    fault = only(tmp_path, f"surface,v_y1,v_y2\nclay,5,4\n{'a' * 100_000},5,4\n")
    assert (fault.row, fault.column) == (2, "surface")
    assert "read a text of 100000 characters; expected a name of at most 200" in fault.message


@pytest.mark.parametrize(
    "text", ["v=1e308 mph, theta=18", "v=17, theta=18, spin=2e5", "v=17±1e300, theta=18", "v=17, theta=1e-9"]
)
def test_options_have_the_limits_of_tables(text: str) -> None:
    with pytest.raises(ParameterError, match=r"expected .* check the unit"):
        parse_impact(text)


@pytest.mark.parametrize("text", ["v_y=10..1e308 mph:3", "v_y=1e-9", "v_y=5, spin=-2e5..0:3"])
def test_grids_have_the_limits_of_tables(text: str) -> None:
    with pytest.raises(ParameterError, match=r"expected .* check the unit"):
        parse_grid(text)


@pytest.mark.parametrize("count", ["99999999", "9" * 400])
def test_a_grid_of_too_many_points_is_refused_before_it_is_made(count: str) -> None:
    with pytest.raises(ParameterError, match="expected 1000000 at most"):
        parse_grid(f"v_y=5..10:{count}")
