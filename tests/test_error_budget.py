"""The numerical error beside the others: measured, not assumed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import fitball
from fitball.inference.assemble import error_budget
from fitball.report.fit.rows import budget_sentence


@pytest.fixture
def fit(point_fit):
    return point_fit


def budget_of(fit, golden):
    return error_budget(fit.problem, fit.fitted, fit.point, None, golden)


def test_arithmetic_is_far_below_the_measurement(fit):
    budget = fit.error_budget
    assert budget.impacts == 12
    assert 0.0 < budget.share < 1e-11
    assert budget.lines["v_x2"].measurement == pytest.approx(fit.point.values["velocity_sd"])
    assert budget.lines["omega_2"].measurement == pytest.approx(fit.point.values["spin_sd"])
    assert f"{budget.share:.0e}" in budget_sentence(budget)


def test_an_error_of_the_kernel_is_seen(fit):
    """A rebound off by a thousandth of a metre per second is found to be, in the column where it is."""
    wrong = fit.golden.rebound.v_x2.copy()
    wrong[3] += 1e-3
    golden = replace(fit.golden, rebound=replace(fit.golden.rebound, v_x2=wrong))
    budget = budget_of(fit, golden)
    assert budget.lines["v_x2"].numerical == pytest.approx(1e-3, rel=1e-6)
    assert budget.lines["omega_2"].numerical < 1e-10
    assert budget.share == pytest.approx(1e-3 / fit.point.values["velocity_sd"], rel=1e-6)


def test_algebraic_models_are_judged_by_rounding(brief):
    fit = fitball.calibrate("wang_all.csv", model="grip-slip", seed=1, point_only=True)
    budget = fit.error_budget
    assert "rounded" in budget.reference
    for line in budget.lines.values():
        assert 0.0 < line.numerical < 1e-11
    assert np.isfinite(budget.share)


def test_a_ball_too_stiff_to_be_integrated_is_judged_by_rounding(fit):
    """With next to no shell the joint is so fast that the independent integration would take a thousand million
    steps an impact.
    """
    values = {**fit.point.values, "mass_ratio": 1.0 - 1e-9}
    names = fit.fitted.names
    stiff = replace(fit.fitted, point=np.array([values[name] for name in names]))
    golden = replace(fit.golden, parameters=values, rebound=stiff.rebound(fit.golden.impacts))
    assert not np.any(golden.rebound.status)
    budget = error_budget(fit.problem, stiff, fit.point, None, golden)
    assert "too fast for an independent integration" in budget.reference
    assert all(0.0 <= line.numerical < 1e-3 for line in budget.lines.values())
