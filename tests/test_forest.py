"""The forest plot: what each panel and row shows is what the fit found under its model variants."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fitball.inference.results.assumptions import MOVED
from fitball.report.figures.assumptions import LEAST, MOST, forest_panels, forest_words, row_names
from fitball.report.figures.registry import FIGURES, draw


def test_rows_are_this_fit_its_variants_and_constants(grip_slip_fit):
    found = grip_slip_fit.assumptions
    names, panels = row_names(found), forest_panels(grip_slip_fit)
    assert names[0] == "this fit"
    assert names[1 : len(found.as_good) + 1] == [item.name for item in found.as_good]
    assert LEAST <= len(panels) <= MOST
    for panel in panels:
        assert len(panel.rows) == len(names)
        if panel.name in found.parameters:
            span = found.parameters[panel.name]
            factor = panel.axis.factor
            own = panel.rows[0]
            assert (own.median, own.low, own.high) == pytest.approx(
                (factor * span.own.median, factor * span.own.q025, factor * span.own.q975)
            )
            medians = [row.median for row in panel.rows if row.median is not None]
            assert (min(medians), max(medians)) == pytest.approx((factor * span.low, factor * span.high))
            moved = any(row.moved for row in panel.rows[: len(found.as_good) + 1])
            assert moved == bool(span.given)
        for constant, row in zip(found.constants, panel.rows[len(found.as_good) + 1 :], strict=True):
            assert row.median is None
            assert np.isfinite(row.low) == (panel.name in constant.parameters or panel.name in constant.court_pace)


def test_the_quantities_that_shift_most_have_panels_and_words(grip_slip_fit):
    found = grip_slip_fit.assumptions
    name = max(found.parameters, key=lambda name: found.parameters[name].shift)
    text = forest_words(grip_slip_fit)
    assert name in {panel.name for panel in forest_panels(grip_slip_fit)}
    assert f"{found.parameters[name].shift:.1f} sd" in text and MOVED == 2.0
    assert len(draw("forest", grip_slip_fit).axes) >= len(forest_panels(grip_slip_fit))


def test_without_variants_there_is_none_and_a_reason(grip_slip_fit):
    fit = grip_slip_fit
    kind = FIGURES["forest"]
    assert kind.without(fit) == ""
    assert "not examined" in kind.without(replace(fit, assumptions=None))
    assert "too slow" in kind.without(replace(fit, assumptions=replace(fit.assumptions, missing="too slow")))
    assert "no model variant" in kind.without(replace(fit, assumptions=replace(fit.assumptions, alternatives=())))
