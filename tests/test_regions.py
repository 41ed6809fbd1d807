"""Regions of a corner plot: draws are counted inside of the drawn paths."""

from types import MappingProxyType, SimpleNamespace

import numpy as np
import pytest
from matplotlib.contour import QuadContourSet
from matplotlib.figure import Figure
from support.fit_by_hand import fit_by_hand

from fitball.inference.schema import Mode
from fitball.inference.summary import summarise
from fitball.report.figures import FIGURES, parameters, regions
from fitball.report.style import SERIES_COLOURS, draw_styled

DRAWS = 4000


def panels(fit):
    """The axes of a corner plot below and on its diagonal by row and column, and its names."""
    drawn = draw_styled(FIGURES["corner"].draw, fit)
    names = parameters.corner_names(fit)
    by_place = zip(zip(*np.tril_indices(len(names)), strict=True), drawn.axes, strict=True)
    return {(names[k], names[j]): axes for (k, j), axes in by_place}


def with_draws(**draws):
    """A fit by hand with other draws of some parameters, in SI, and draws of the others drawn anew:
    the fits by hand have few.
    """
    fit = fit_by_hand(prior={"e_x": "uniform(-0.3, 0.5)"})
    rng = np.random.default_rng(4)
    values = {}
    for name, of_name in fit.draws.values.items():
        z = rng.standard_normal(DRAWS)
        values[name] = draws.get(name, np.mean(of_name) + np.std(of_name) * z)
    built = SimpleNamespace(problem=fit.problem, draws=fit.draws._replace(values=values))
    object.__setattr__(fit, "built", built)
    return fit


@pytest.fixture(scope="module")
def skewed():
    """Draws that are bent, that end at a hard bound with most of them near, and that have two
    humps.
    """
    rng = np.random.default_rng(7)
    z = rng.standard_normal((DRAWS, 4))
    second = rng.uniform(size=DRAWS) < 0.2
    return with_draws(
        mu=0.6 + 0.04 * z[:, 0],
        e_x=-0.3 + 0.03 * rng.exponential(size=DRAWS),
        offset=1e-3 * (z[:, 1] + 0.8 * z[:, 0] ** 2),
        cor_10=0.75 + 0.01 * z[:, 2] + 0.06 * second,
        cor_slope=-0.015 + 0.002 * z[:, 3],
    )


def shown(fit, name):
    return fit.draws.values[name] * fit.quantity(name).spec.display_unit.factor


def shares_inside(fit, axes, row, column):
    """The shares of the draws inside of each drawn line and area, the larger region first."""
    xy = np.column_stack([shown(fit, column), shown(fit, row)])
    sets = [drawn for drawn in axes.collections if isinstance(drawn, QuadContourSet)]
    area, lines = sorted(sets, key=lambda drawn: not drawn.filled)
    inside = [path.contains_points(xy) for path in area.get_paths()]
    of_areas = [inside[0] | inside[1], inside[1]]
    of_lines = [path.contains_points(xy) for path in lines.get_paths()]
    return np.mean(of_areas, axis=1), np.mean(of_lines, axis=1)


def test_regions_hold_what_they_say_of_any_shape(skewed):
    for (row, column), axes in panels(skewed).items():
        if row != column:
            for shares in shares_inside(skewed, axes, row, column):
                assert shares == pytest.approx([0.95, 0.68], abs=0.012), (row, column)


def test_nothing_is_drawn_beyond_a_hard_bound(skewed):
    factor = skewed.quantity("e_x").spec.display_unit.factor
    bound = -0.3 * factor
    for (row, column), axes in panels(skewed).items():
        for k, name in enumerate((column, row)):
            if name != "e_x" or (row == column and k == 1):
                continue
            ends = axes.get_xlim() if k == 0 else axes.get_ylim()
            assert ends[0] == pytest.approx(bound)
            paths = [path for drawn in axes.collections for path in drawn.get_paths()]
            reached = [path.vertices[:, k].min() for path in paths]
            # A region whose draws are mostly at the bound reaches it.
            assert all(least >= bound - 1e-9 for least in reached)
            assert not reached or min(reached) == pytest.approx(bound, abs=1e-3)


def test_draws_that_are_beyond_the_ends_or_all_the_same_have_no_region():
    axes = Figure().add_subplot()
    x = np.linspace(5.0, 6.0, 100)
    regions.draw_regions(axes, x, x, (-1.0, 1.0), (-1.0, 1.0))
    regions.draw_regions(axes, 0.0 * x, 0.0 * x, (-1.0, 1.0), (-1.0, 1.0))
    assert not axes.collections


def test_modes_are_marked_where_their_medians_are(skewed):
    values = skewed.draws.values
    second = values["cor_10"] > 0.78
    modes = []
    for inside in (~second, second):
        summaries = {name: summarise(column[inside], 0.0) for name, column in values.items()}
        modes.append(Mode(float(inside.mean()), 0.01, MappingProxyType(summaries)))
    fit = with_draws(**values)
    object.__setattr__(fit, "modes", tuple(modes))
    factor = {name: fit.quantity(name).spec.display_unit.factor for name in values}
    for (row, column), axes in panels(fit).items():
        for k, mode in enumerate(modes):
            marks = [line for line in axes.lines if line.get_color() == SERIES_COLOURS[k]]
            (mark,) = marks
            at = mode.summaries[column].median * factor[column]
            assert mark.get_xdata()[0] == pytest.approx(at)
            if row != column:
                assert mark.get_ydata()[0] == pytest.approx(
                    mode.summaries[row].median * factor[row]
                )
