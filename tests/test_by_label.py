"""Which parameters differ between groups, to first order: against a fit to each, and in tables of known truth."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from samples import problem_of

import fitball
from fitball.data.read import load_table
from fitball.inference.adequacy.by_label import Block, differences, score_of
from fitball.inference.identifiability.derived import derived
from fitball.inference.identifiability.derived import differences as fitted_differences
from fitball.inference.point.point_fit import follow_maximum, maximum_posterior, starting_points
from fitball.inference.point.surface import surface_of

NAMES = ("mu", "e_x", "offset", "cor_10", "cor_slope")
TRUE = {"mu": 0.45, "e_x": 0.1, "offset": 0.0, "cor_10": 0.77, "cor_slope": -0.015}
LABELS = tuple("ab"[k % 2] for k in range(21))


def table(seed: int, biased: float = 0.0, **second: float):
    """Wang's incidences with rebounds of grip-slip, other parameters or a bias of `v_y2` in the second group."""
    chosen, base = fitball.model("grip-slip"), load_table("wang_all.csv")
    rng, at = np.random.default_rng(seed), np.arange(21)
    inside = np.array(LABELS) == "b"
    rows = np.array([[second.get(name, TRUE[name]) if there else TRUE[name] for name in chosen.parameter_names]
                     for there in inside])  # fmt: skip
    made = chosen.evaluate(chosen.parameter_names, rows, base.impacts)
    columns = {
        "v_x2": made.v_x2[at, at] + 0.1 * rng.standard_normal(21),
        "v_y2": made.v_y2[at, at] + 0.1 * rng.standard_normal(21) + biased * inside,
        "omega_2": made.omega_2[at, at] + 4.0 * rng.standard_normal(21),
    }
    measured = tuple(replace(item, values=columns[item.name]) for item in base.measurements)
    return replace(base, measurements=measured, redundant=(), labels={"group": LABELS}, notices=())


def scored(made, chosen="grip-slip"):
    problem = problem_of(made, chosen)
    point = maximum_posterior(problem, starting_points(problem, np.random.default_rng(1), 6))
    return problem, point, {item.parameter: item for item in differences(problem, point)}


@pytest.fixture(scope="module")
def bouncy():
    return scored(table(3, cor_10=0.70))


def test_the_parameter_that_differs_is_found_and_no_other(bouncy):
    _problem, _point, found = bouncy
    assert {name for name, item in found.items() if item.found} == {"cor_10"}
    cor = found["cor_10"]
    assert (cor.low, cor.high, cor.column, cor.fitted) == ("b", "a", "group", False)
    assert cor.q025 < 0.07 < cor.q975 and cor.q025 > 0.0
    assert cor.values["a"] - cor.values["b"] == pytest.approx(0.07, abs=0.03)


def test_the_score_is_the_difference_that_a_fit_with_a_value_for_each_finds(bouncy):
    """Oracle: the maximum with a parameter of its own for the second group, whose prior hardly holds it."""
    problem, _point, found = bouncy
    wide = {"cor_10_spread": "normal(1, 0.001)"}
    each = problem_of(problem.table, "grip-slip", pool={"cor_10": "group"}, priors=wide)
    best = follow_maximum(each, starting_points(each, np.random.default_rng(2), 8))
    place = {label: best.values[f"cor_10_place[{label}]"] * best.values["cor_10_spread"] for label in "ab"}
    assert found["cor_10"].size == pytest.approx(place["a"] - place["b"], rel=0.2)


def test_a_table_without_differences_finds_none():
    for seed in (4, 5):
        assert not any(item.found for item in scored(table(seed))[2].values())


def test_a_bias_of_one_column_is_no_parameter():
    """The same in all rows of a group, whatever their speed: a restitution that grows with speed fits worse."""
    _problem, _point, found = scored(table(6, biased=0.5))
    assert found["cor_10"].p < 0.01
    assert not any(item.found for item in found.values())


def test_what_is_fitted_to_each_level_is_not_scored_again(bouncy):
    problem, _point, _found = bouncy
    pooled = problem_of(problem.table, "grip-slip", pool={"cor_10": "group"})
    point = maximum_posterior(pooled, starting_points(pooled, np.random.default_rng(1), 6))
    found = {item.parameter: item for item in differences(pooled, point)}
    assert "cor_10" not in found and not any(item.found for item in found.values())
    assert differences(replace(problem, table=replace(problem.table, labels={})), point) == ()


def test_balls_of_a_drop_test_at_one_speed_differ_in_restitution(tmp_path):
    """Three balls by three drops, as a lab wrote them; the slope over speed would explain as much."""
    path = tmp_path / "drops.csv"
    drops = zip("111222333", (139.2, 140.0, 139.6, 141.5, 142.0, 141.1, 134.1, 134.8, 133.9), strict=True)
    lines = ["ball,drop_height [cm],rebound_height [cm]", *(f"{ball},254,{rise}" for ball, rise in drops)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    problem = problem_of(load_table(path), "brody")
    assert problem.pooling == ()
    found = scored(problem.table, "brody")[2]
    assert {name for name, item in found.items() if item.found} == {"cor_10"}
    assert (found["cor_10"].low, found["cor_10"].high) == ("3", "2")


def test_the_score_beside_others_is_the_fall_of_chi_square():
    """Oracle: least squares with the columns of all that is fitted, with and without those of one block."""
    rng = np.random.default_rng(8)
    fitted, taken, more = rng.standard_normal((40, 4)), rng.standard_normal((40, 2)), rng.standard_normal((40, 2))
    own, y = np.linalg.qr(fitted)[0], rng.standard_normal(40) + more[:, 0] + taken[:, 1]

    def chi_square(*columns):
        matrix = np.concatenate(columns, axis=1)
        return float(np.sum((y - matrix @ np.linalg.lstsq(matrix, y, rcond=None)[0]) ** 2))

    fit = SimpleNamespace(own=own, measured=y - own @ (own.T @ y))
    for others, without in (((), chi_square(fitted)), ((Block("b", taken),), chi_square(fitted, taken))):
        shifts, covariance, gain, rank = score_of(fit, Block("a", more), others)
        whole = [fitted, *(item.effect for item in others), more]
        assert gain == pytest.approx(without - chi_square(*whole), rel=1e-9) and rank == 2
        matrix = np.concatenate(whole, axis=1)
        np.testing.assert_allclose(shifts, np.linalg.lstsq(matrix, y, rcond=None)[0][-2:], rtol=1e-9)
        np.testing.assert_allclose(covariance, np.linalg.inv(matrix.T @ matrix)[-2:, -2:], rtol=1e-9)


def test_the_surest_difference_of_a_fit_to_each_level_goes_from_low_to_high(bouncy):
    problem, _point, _found = bouncy
    pooled = problem_of(problem.table, "grip-slip", pool={"cor_10": "group"})
    point = maximum_posterior(pooled, starting_points(pooled, np.random.default_rng(1), 6))
    (found,) = fitted_differences(pooled, derived(pooled, point, None, np.random.default_rng(2)))
    assert (found.low, found.high, found.fitted, found.found) == ("b", "a", True, True)
    assert 0.0 < found.q025 < 0.07 < found.q975 and found.sds > 3.0


def test_a_step_of_a_search_is_straight_in_the_levels(bouncy):
    """Value at a level, `q + tau z`, by its first order in all three; bounds are kept."""
    problem, _point, _found = bouncy
    surface = surface_of(problem_of(problem.table, "grip-slip", pool={"cor_10": "group"}), penalised=True)
    names = [item.name for item in surface.parameters]
    q, tau, z = (names.index(name) for name in ("cor_10", "cor_10_spread", "cor_10_place[b]"))
    x, step = np.zeros((1, len(names))), np.zeros((1, len(names)))
    x[0, [q, tau, z]], step[0, [q, tau, z]] = (0.75, 0.1, -0.5), (0.02, 0.05, 0.3)
    there = surface.moved(x, step)[0]
    straight = x[0, q] + x[0, tau] * x[0, z] + step[0, q] + x[0, tau] * step[0, z] + x[0, z] * step[0, tau]
    assert there[q] + there[tau] * there[z] == pytest.approx(straight, rel=1e-12)
    assert (there[q], there[tau]) == (0.77, pytest.approx(0.15))
    # Where the spread all but vanishes places stay within their bounds.
    step[0, tau] = -0.1 + 1e-9
    assert abs(surface.moved(x, step)[0, z]) <= 8.0
