"""Incidences that were measured again: how far measurements repeat, beside stated errors and residuals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from test_scatter import ERRORS, at, careful, posed

from fitball.inference.adequacy.describe import adequacy
from fitball.inference.adequacy.refit import refit
from fitball.inference.adequacy.repeats import repeats_of, same_incidence
from fitball.inference.point.point_fit import maximum_posterior
from fitball.values import Impacts


def measured_again(times, scatter, seed, misfit=0.0, count=9):
    """Each incidence so many times, of balls that scatter by `scatter` [m/s], and a `misfit` [m/s] of the model."""
    once, rng = careful(count, seed, scatter=0.0), np.random.default_rng(seed)
    rows = np.repeat(np.arange(count), times)
    wave = np.where(rows % 2 == 0, 1.0, -1.0)
    measured = tuple(
        replace(
            item,
            values=item.values[rows]
            + (0.0 if item.name == "omega_2" else misfit * wave)
            + (30.0 if item.name == "omega_2" else 1.0) * np.hypot(scatter, 0.02) * rng.standard_normal(rows.size),
            sd=item.sd[rows] * (30.0 * 0.02 if item.name == "omega_2" else 1.0),
        )
        for item in once.measurements
    )
    given = once.impacts
    impacts = Impacts(given.v_x1[rows], given.v_y1[rows], given.omega_1[rows])
    return replace(once, impacts=impacts, measurements=measured, ids=tuple(map(str, range(rows.size))))


def fitted(table, **choices):
    problem = posed(table, velocity_noise=choices.pop("velocity_noise", "separate"), **choices)
    return problem, maximum_posterior(problem, problem.to_values(at(problem)))


def test_pure_error_and_lack_of_fit_are_those_of_the_analysis_of_variance():
    problem, point = fitted(measured_again(4, 0.15, 1))
    count, found = repeats_of(problem, point, refit(problem, point))
    assert count == 9 and [item.column for item in found] == list(ERRORS)
    for item, one in zip(problem.observables, found, strict=True):
        groups = item.observed.reshape(9, 4)
        inside = groups.var(axis=1, ddof=1).mean()
        assert one.pure == pytest.approx(np.sqrt(inside), rel=1e-9)
        assert one.freedom == 27.0 and one.stated == pytest.approx(item.sd[0])
        assert one.scatter == pytest.approx(stats.chi2.sf(27 * inside / item.sd[0] ** 2, 27))
        gaps = groups.mean(axis=1) - item.predict(point.rebound)[0].reshape(9, 4)[:, 0]
        left = one.residual**2
        whole = np.sum((item.observed - item.predict(point.rebound)[0]) ** 2)
        rest = whole / left - 27.0
        assert one.misfit == pytest.approx(stats.f.sf(4.0 * np.sum(gaps**2) / rest / inside, rest, 27.0), rel=1e-6)


def said(table, **choices):
    problem, point = fitted(table, **choices)
    return " ".join(adequacy(problem, point, None, 1).repeats)


def test_balls_and_model_are_told_apart():
    balls, model = said(measured_again(4, 0.15, 2)), said(measured_again(4, 0.0, 3, misfit=0.15))
    assert balls.startswith("9 incidences were measured again (27 degrees of freedom). v_x2 repeats to 0.1")
    assert "Impacts scatter beyond the stated errors of v_x2, v_y2 and omega_2, whatever the model." in balls
    assert "misfit" not in balls
    assert "v_x2 repeats to 0.02" in model and "Impacts scatter" not in model
    assert "But residuals of v_x2 are" in model and "is misfit of the model" in model


def test_without_repeats_far_scatter_asks_for_them():
    assert said(careful(20, 4)).startswith("v_x2, v_y2 and omega_2 scatter far beyond their stated errors.")
    assert said(careful(20, 4, scatter=0.0)) == ""
    # Three degrees of freedom say nothing.
    few = measured_again(1, 0.0, 5, count=20)
    rows = np.concatenate([np.arange(20), np.arange(3)])
    given = few.impacts
    again = replace(
        few, impacts=Impacts(given.v_x1[rows], given.v_y1[rows], given.omega_1[rows]),
        measurements=tuple(replace(one, values=one.values[rows], sd=one.sd[rows]) for one in few.measurements),
        ids=tuple(map(str, range(23))),
    )  # fmt: skip
    assert said(again) == ""


def test_the_same_incidence_is_that_within_printed_digits_and_errors():
    table = careful(12, 6)
    given = table.impacts
    v_x = given.v_x1.copy()
    v_x[1], v_x[2] = v_x[0] + 0.004, v_x[0] + 0.011
    v_y, omega = (np.where(np.arange(12) < 3, column[0], column) for column in (given.v_y1, given.omega_1))
    moved = replace(table, impacts=Impacts(v_x, v_y, omega))
    assert np.unique(same_incidence(posed(moved))).size == 12
    printed = replace(moved, resolution={"v_x1": 0.005})
    number = same_incidence(posed(printed))
    assert number[0] == number[1] != number[2]
    errors = np.tile(np.diag([0.05**2, 0.0, 0.0]), (12, 1, 1))
    uncertain = replace(moved, incident_covariance=errors, incident_sd={"v_x1": np.full(12, 0.05)})
    number = same_incidence(posed(uncertain))
    assert number[0] == number[1] == number[2]
    assert np.unique(number).size == 10
