"""The registry of columns: complete, consistent, and its formulas are those of the velocity."""

import numpy as np

from fitball.columns import COLUMNS, HEIGHTS, INCIDENT, REBOUND, STATE


def test_every_column_has_one_row_in_order():
    assert tuple(COLUMNS) == (*INCIDENT, *REBOUND, *HEIGHTS) and INCIDENT[:3] == STATE
    assert [name for name, column in COLUMNS.items() if column.noise] == list(REBOUND)
    assert len({column.noise.name for column in COLUMNS.values() if column.noise}) == len(REBOUND)
    assert len({column.symbol for column in COLUMNS.values()}) == len(COLUMNS)


def test_units_and_noises_agree():
    factors = {"deg": np.degrees(1.0), "ms": 1e3, "mm": 1e3}
    for column in COLUMNS.values():
        assert column.unit in ("m/s", "rad/s", "rad", "s", "m")
        if column.handy:
            np.testing.assert_allclose(column.handy.factor, factors[column.handy.name], rtol=1e-15)
        if column.noise:
            assert (column.noise.unit, column.noise.handy) == (column.unit, column.handy)
            assert column.noise.lower > 0.0 and column.noise.upper < np.inf


def test_limits_leave_room_for_wang_and_none_for_what_has_no_bounce():
    # An impact of Wang's table, and a drop from 254 cm with its rebound, contact and gaps.
    wang = {
        "v_x1": 16.1, "v_y1": 5.1, "omega_1": 0.0, "v_1": 17.0, "theta_1": 0.31, "v_x2": 11.3, "v_y2": 4.4,
        "v_2": 12.1, "theta_2": 0.37, "omega_2": 250.0, "contact_time": 5e-3, "gap_time": 5e-3, "gap_path": 0.08,
        "gap_turn": 0.6, "drop_height": 2.54, "rebound_height": 1.4,
    }  # fmt: skip
    for name, value in wang.items():
        low, high = COLUMNS[name].limits
        assert low < value < high
        assert (low < -value < high) == (name in ("v_x1", "omega_1", "v_x2", "omega_2", "gap_path", "gap_turn"))
    # A contact in ms or a speed in mm/s, read as SI, are noticed.
    assert COLUMNS["contact_time"].limits[1] < 5.0 and COLUMNS["v_1"].limits[1] < 17_000.0


def test_formulas_are_the_polar_form_of_the_velocity():
    angle = np.linspace(0.01, np.pi - 0.01, 9)
    v_x, v_y = 7.0 * np.cos(angle), 7.0 * np.sin(angle)
    np.testing.assert_allclose(COLUMNS["v_2"].formula(v_x, v_y), 7.0)
    np.testing.assert_allclose(COLUMNS["theta_2"].formula(v_x, v_y), angle)
    assert [name for name in REBOUND if COLUMNS[name].formula] == ["v_2", "theta_2"]
