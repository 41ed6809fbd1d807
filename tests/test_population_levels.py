"""Populations over levels, held against the integrals of a normal hierarchy of two stages in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.special import ndtr

from fitball.errors import ParameterError
from fitball.inference.population.hyper import Before, TableDraws
from fitball.inference.population.levels import level_nodes, population, population_over
from fitball.inference.problem.parameters import parse_prior
from fitball.report.batch.rows import LABEL, NAME
from fitball.report.batch.series import grouped

WIDE = (-np.inf, np.inf)
CENTRE = stats.norm(0.0, 2.0)
# Scale and degrees of freedom of the half-t priors of both spreads.
BETWEEN, WITHIN = (0.9, 4.0), (0.15, 3.0)
BEFORE = Before(
    CENTRE.logpdf, *(parse_prior("spread", f"half-t{both}", 0.0, np.inf) for both in (BETWEEN, WITHIN)), WIDE
)
SD = 0.3
# Interim prior of each table, far from the population: mean, sd.
INTERIM = (-1.0, 0.6)


def tables_of(rng, measured, count=400):
    """Levels of tables with normal posteriors of what was `measured` under the interim prior, one list a level."""
    precision = 1.0 / SD**2 + 1.0 / INTERIM[1] ** 2
    levels = {}
    for j, level in enumerate(measured):
        levels[f"L{j}"] = []
        for k, y in enumerate(level):
            mean = (y / SD**2 + INTERIM[0] / INTERIM[1] ** 2) / precision
            # Normal scores in random order: as good as many draws.
            draws = mean + rng.permutation(stats.norm.ppf((np.arange(count) + 0.5) / count)) / np.sqrt(precision)
            levels[f"L{j}"].append(TableDraws.drawn(f"{j}{k}", draws, stats.norm(*INTERIM).logpdf))
    return levels


def exact(measured):
    """Quantiles (0.5, 0.025, 0.975) of everything by closed forms given both spreads, and a sum over these."""
    edges = np.linspace(0.0, np.arcsinh(20.0 * BETWEEN[0] / 0.1), 221)
    side = 0.1 * np.sinh((edges[1:] + edges[:-1]) / 2.0)
    between, within = np.meshgrid(side, side, indexing="ij")
    noise = SD**2 + within**2
    n = np.array([len(level) for level in measured])
    mean = np.array([np.mean(level) for level in measured])
    v = between[..., None] ** 2 + noise[..., None] / n
    precision = 1.0 / CENTRE.var() + np.sum(1.0 / v, axis=-1)
    m = np.sum(mean / v, axis=-1) / precision
    log = (
        np.log(np.hypot(between, 0.1) * np.hypot(within, 0.1))
        + stats.t(BETWEEN[1], 0.0, BETWEEN[0]).logpdf(between)
        + stats.t(WITHIN[1], 0.0, WITHIN[0]).logpdf(within)
        - 0.5 * np.sum(np.log(v), axis=-1)
        - 0.5 * np.log(precision)
    )
    log -= 0.5 * (np.sum(mean**2 / v, axis=-1) - m**2 * precision)
    for level in measured:
        log -= 0.5 * (len(level) - 1) * np.log(noise) + 0.5 * np.sum((level - np.mean(level)) ** 2) / noise
    mass = np.exp(log - log.max())
    mass /= mass.sum()

    kept = mass > 1e-6 * mass.max()

    def normal(mean, variance):
        places = np.linspace(-5.0, 6.0, 441)
        below = ndtr((places[:, None] - mean[kept]) / np.sqrt(variance[kept])) @ mass[kept]
        return np.interp((0.5, 0.025, 0.975), below / below[-1], places)

    def spread(shares):
        return 0.1 * np.sinh(np.interp((0.5, 0.025, 0.975), [0.0, *np.cumsum(shares)], edges))

    keep = between**2 / v[..., 0]
    level = keep * mean[0] + (1.0 - keep) * m, between**2 * (1.0 - keep) + (1.0 - keep) ** 2 / precision
    share = SD**2 / noise
    table = (1.0 - share) * measured[0][0] + share * level[0], share * within**2 + share**2 * level[1]
    return {
        "centre": normal(m, 1.0 / precision), "spread": spread(mass.sum(1)), "within": spread(mass.sum(0)),
        "level": normal(*level), "on level": normal(level[0], level[1] + within**2), "table": normal(*table),
        "new level": normal(m, 1.0 / precision + between**2),
        "new": normal(m, 1.0 / precision + between**2 + within**2),
    }  # fmt: skip


def found_of(found):
    level = found.levels[0]
    return {
        "centre": found.centre, "spread": found.spread, "within": found.within, "level": level.known,
        "on level": level.new, "table": found.tables[0].known, "new level": found.new_level, "new": found.new,
    }  # fmt: skip


def draw(rng, sizes, between, within):
    return [
        1.0 + between * rng.standard_normal() + np.hypot(within, SD) * rng.standard_normal(size) for size in sizes
    ]


# Several tables a level; different numbers, one of them one; many tables on two levels; levels alike, tables alike.
SETTINGS = [((4, 4, 4), 0.6, 0.3), ((1, 3, 2, 5), 0.4, 0.5), ((6, 6), 0.5, 0.2), ((3,) * 5, 0.0, 0.0)]


@pytest.mark.parametrize(("sizes", "between", "within"), SETTINGS)
def test_levels_and_spreads_are_those_of_the_hierarchy(sizes, between, within):
    rng = np.random.default_rng([len(sizes), sizes[0]])
    measured = draw(rng, sizes, between, within)
    found, wanted = found_of(population_over(tables_of(rng, measured), BEFORE)), exact(measured)
    for name, (median, low, high) in wanted.items():
        # Grids know the ends of what they tell but for the finite number of the tables' draws; ends of what is drawn
        # have errors of their own.
        share = {"centre": 0.02, "spread": 0.02, "within": 0.02, "table": 0.2}.get(name, 0.1)
        got = [found[name].median, found[name].low, found[name].high]
        assert got == pytest.approx([median, low, high], abs=5.0 * found[name].error + share * (high - low)), name


def test_one_table_a_level_is_the_population_without_levels():
    rng = np.random.default_rng(6)
    levels = tables_of(rng, draw(rng, (1,) * 6, 0.5, 0.0))
    plain = population([table for (table,) in levels.values()], BEFORE)
    over = population_over(levels, BEFORE)
    assert replace(over, levels=(), new_level=None) == plain
    assert over.within is None and over.new_level == plain.new
    assert [level.known for level in over.levels] == [table.known for table in plain.tables]
    assert all(level.new is None for level in over.levels)


def test_the_likelihood_of_a_level_is_the_product_of_those_of_its_tables():
    """Also where the spread of levels is far narrower than the distance of its nodes."""
    rng = np.random.default_rng(7)
    (tables,) = tables_of(rng, [np.array([0.6, 1.1, 1.3])]).values()
    nodes = level_nodes("", tables, 0.4, WIDE)
    variance = (SD**2 + 0.4**2) / 3
    assert nodes.mean == pytest.approx(1.0, abs=0.02)
    assert nodes.sd == pytest.approx(np.sqrt(variance), rel=0.02)


def test_the_error_of_few_draws_is_as_stated():
    rng = np.random.default_rng(8)
    measured = draw(rng, (2, 2, 2), 0.4, 0.3)
    found = []
    for _ in range(6):
        again = tables_of(rng, measured, count=100)
        # Draws at random instead of normal scores.
        again = {
            name: [replace(table, places=rng.choice(table.places, 100)) for table in tables]
            for name, tables in again.items()
        }
        found.append(found_of(population_over(again, BEFORE)))
    for name in ("centre", "spread", "within", "level"):
        scatter = np.std([one[name].median for one in found])
        assert 0.4 < np.mean([one[name].error for one in found]) / scatter < 2.5, name


def rows_of(cells, label="surface"):
    return [
        {NAME: name, "outcome": "done", **({} if cell is None else {f"{LABEL}{label}": cell})}
        for name, cell in cells.items()
    ]


SURFACES = {"clay/1": "clay", "clay/2": "clay", "hard/1": "hard", "hard/2": "hard", "grass/1": None}


def test_tables_are_grouped_by_label_folder_and_as_given():
    rows = rows_of(SURFACES)
    over = grouped(rows, "surface")
    assert over.levels == {name: cell for name, cell in SURFACES.items() if cell}
    remarks = " ".join(over.remarks)
    assert "2 levels of surface" in remarks and "grass/1" in remarks and "Two levels" in remarks
    assert grouped(rows, "folder").levels["grass/1"] == "grass"
    assert grouped(rows, {"clay/1": "a", "hard/1": "b", "hard/2": "b"}).levels == {
        "clay/1": "a", "hard/1": "b", "hard/2": "b",
    }  # fmt: skip
    assert grouped(rows, "table").levels == grouped(rows, None).levels == {}


def test_numbers_and_dates_of_which_each_table_has_its_own_are_no_levels():
    days = {f"t{k}": f"2026-05-{k + 1:02d}" for k in range(4)}
    own = grouped(rows_of(days, "date"), "date")
    assert own.levels == {} and "drift" in own.remarks[0]
    shared = grouped(rows_of({**days, "t4": "2026-05-04"}, "date"), "date")
    assert len(set(shared.levels.values())) == 4 and any("drift" in sentence for sentence in shared.remarks)


@pytest.mark.parametrize(
    ("over", "said"),
    [("suface", "expected a label that tables have, or their folder: folder, surface"),
     ({"clay/3": "a"}, "no table is called 'clay/3': did you mean"), ({"clay/1": "a", "clay/2": "a"}, "two levels")],
)  # fmt: skip
def test_levels_that_cannot_be_are_refused(over, said):
    with pytest.raises(ParameterError, match=said):
        grouped(rows_of(SURFACES), over)
