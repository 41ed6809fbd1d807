"""Impacts in words: numbers in SI by exact factors, grids, errors, and what is refused."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from fitball.base.errors import ParameterError
from fitball.data.in_words import Span, impact_grid, spans

ALL = "value sd range count"
MPH = 0.44704
RPM = np.pi / 30.0
DEG = np.pi / 180.0


@pytest.mark.parametrize(
    ("text", "name", "wanted"),
    [
        ("v_1 = 38±1 mph", "v_1", Span(38 * MPH, 38 * MPH, MPH)),
        ("v_1=38 +/- 1mph", "v_1", Span(38 * MPH, 38 * MPH, MPH)),
        ("theta_1=10. .. 40. deg : 7", "theta_1", Span(10 * DEG, 40 * DEG, 0.0, 7)),
        ("omega_1=-300..3e2 rpm:2", "omega_1", Span(-300 * RPM, 300 * RPM, 0.0, 2)),
        ("v_x1=-.5..10", "v_x1", Span(-0.5, 10.0)),
        ("theta_1=0.2..0.3±0.01 rad:3", "theta_1", Span(0.2, 0.3, 0.01, 3)),
        ("contact_time=5 ms", "contact_time", Span(5e-3, 5e-3)),
    ],
)
def test_numbers_ranges_and_errors(text, name, wanted):
    (found,) = spans(text, ALL).items()
    assert found[0] == name
    assert found[1].count == wanted.count
    for part in ("low", "high", "sd"):
        assert getattr(found[1], part) == pytest.approx(getattr(wanted, part), rel=1e-15)


@pytest.mark.parametrize(
    ("text", "takes"),
    [
        ("", ALL),
        ("v_1", ALL),
        ("v_1=", ALL),
        ("v_1=17,5", ALL),
        ("v1=3", ALL),
        ("v_1=3, v_1=4", ALL),
        ("v_1=-3", ALL),
        ("v_1=1e400", ALL),
        ("v_1=nan", ALL),
        ("v_1=3 kg", ALL),
        ("v_1=5 deg", ALL),
        ("v_1=3±0", ALL),
        ("v_1=40..10:3", ALL),
        ("v_1=10..10:3", ALL),
        ("v_1=10..40:1", ALL),
        ("v_1=10:3", ALL),
        ("v_1=10..40", "value"),
        ("v_1=10±1", "value"),
        ("v_1=10..40:3", "value range"),
        ("v_1=10", "range count"),
        ("theta_1=190", ALL),
        ("omega_1=1 1/s", ALL),
        ("v_1=" + "1" * 5000, ALL),
        ("v_1=3\u202e", ALL),
    ],
)
def test_what_is_refused(text, takes):
    with pytest.raises(ParameterError) as caught:
        spans(text, takes)
    assert caught.value.code == "impact"
    assert len(str(caught.value)) < 1000
    assert "\u202e" not in str(caught.value)


def test_a_grid_of_impacts():
    impacts, covariance = impact_grid(
        spans("omega_1=-10..10:3, v_1=17, theta_1=10..40:2", ALL), 0.0
    )
    assert covariance is None
    assert len(impacts) == 6
    speed, angle = impacts.polar()
    assert_allclose(speed, 17.0, rtol=1e-15)
    assert_allclose(angle / DEG, [10, 10, 10, 40, 40, 40], rtol=1e-14)
    assert impacts.omega_1.tolist() == [-10.0, 0.0, 10.0] * 2
    drop, _ = impact_grid(spans("v_y1=2..4:3", ALL), 0.0)
    assert drop.v_y1.tolist() == [2.0, 3.0, 4.0]
    assert not drop.v_x1.any()
    assert not drop.omega_1.any()


def test_stated_errors_become_those_of_the_state():
    """The sum of the squares along and across the velocity, turned to its direction."""
    _, covariance = impact_grid(spans("v_1=17±0.3, theta_1=20..50±0.5:2, omega_1=100±5", ALL), 0.0)
    for found, angle in zip(covariance, np.radians([20.0, 50.0]), strict=True):
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        apart = turn.T @ found[:2, :2] @ turn
        assert_allclose(
            apart,
            np.diag([0.3**2, (17.0 * 0.5 * DEG) ** 2]),
            rtol=1e-13,
            atol=1e-16,
        )
    assert_array_equal(covariance[:, 2], [[0.0, 0.0, 25.0]] * 2)
    plain, by_parts = impact_grid(spans("v_x1=3±0.1, v_y1=4", ALL), 0.0)
    assert plain.v_x1.tolist() == [3.0]
    assert by_parts[0].tolist() == [
        [0.1**2, 0, 0],
        [0, 0, 0],
        [0, 0, 0],
    ]


@pytest.mark.parametrize(
    "text",
    [
        "v_1=3",
        "v_x1=3",
        "v_1=3, theta_1=20, v_y1=2",
        "v_y1=3, v_y2=2",
        "omega_1=3",
        "v_y1=2..4",
        "v_1=3..4:2000, theta_1=10..20:2000",
    ],
)
def test_what_makes_no_impact(text):
    with pytest.raises(ParameterError) as caught:
        impact_grid(spans(text, ALL), 0.0)
    assert caught.value.code == "impact"
