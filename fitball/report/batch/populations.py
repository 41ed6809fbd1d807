"""Populations over the tables of a batch, from the draws that each table's `fit.json` holds, and their files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fitball.errors import ParameterError
from fitball.inference.population.hyper import Known, TableDraws
from fitball.inference.population.levels import Level, Population, population, population_over
from fitball.inference.population.quantity import Quantity, known, prior_of, quantity
from fitball.inference.population.trend import LEAST_TABLES
from fitball.inference.problem.parameters import Prior
from fitball.inference.results.results import Fit, Verdict
from fitball.report.batch.rows import DONE, NAME, Row
from fitball.report.batch.series import Grouping, Over, Series, grouped
from fitball.report.figures.quantities import axis_label
from fitball.report.form.files import json_text, remove, write_csv, write_text
from fitball.report.form.numbers import Scale, handy
from fitball.report.saved.fit_file import read_fit
from fitball.report.saved.structure import damaged
from fitball.values import FloatArray


@dataclass(frozen=True)
class Populated:
    """A quantity over tables: its `population` in the coordinate, and `own`, the value of each table alone, by name;
    `left_out` are tables that have no draws of it, with the reason; `over` is the label of its levels, empty without
    levels, and `remarks` are on them.
    """

    quantity: Quantity
    population: Population
    own: Mapping[str, Known]
    own_sds: Mapping[str, float]
    left_out: Mapping[str, str]
    over: str = ""
    remarks: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Its name beside others."""
        return self.quantity.name

    @property
    def scale(self) -> Scale:
        """The handy unit of it."""
        return handy(self.quantity.name, self.quantity.unit)

    @property
    def head(self) -> str:
        """Its name with that unit."""
        return axis_label(self.name, self.scale.unit)

    def ends(self, known: Known) -> tuple[float, float, float]:
        """Median, low and high end of a value in the coordinate, in SI."""
        value = self.quantity.value
        return value(known.median), value(known.low), value(known.high)

    def sizes(self, spread: Known) -> tuple[float, float, float]:
        """The same of a spread: standard deviations of the quantity itself, in SI, about the median of the centre."""
        if not self.quantity.log:
            return spread.median, spread.low, spread.high
        middle = self.quantity.value(self.population.centre.median)
        # The sd of a lognormal value.
        median, low, high = (
            middle * float(np.exp(0.5 * s * s) * np.sqrt(np.expm1(s * s)))
            for s in (spread.median, spread.low, spread.high)
        )
        return median, low, high


@dataclass
class _Gathered:
    """The draws of a quantity, table by table."""

    quantity: Quantity
    tables: list[tuple[str, FloatArray, dict[str, Prior | float], float]] = field(default_factory=list)
    left_out: dict[str, str] = field(default_factory=dict)


def default_names(series: Sequence[Series]) -> tuple[str, ...]:
    """The parameters that the data of enough tables determine."""
    return tuple(
        one.quantity for one in series if known(one.quantity) and one.drawn and sum(one.determined) >= LEAST_TABLES
    )


def populations(rows: Sequence[Row], folder: Path, names: Sequence[str], over: Over = None) -> tuple[Populated, ...]:
    """The populations of quantities over the tables whose fits lie below the folder, on levels where `over` says so.

    Raises ParameterError for what is no quantity, or one that too few tables have draws of, and as `grouped` does;
    ResultFolderError for a fit that cannot be read.
    """
    asked = [_Gathered(quantity(name)) for name in dict.fromkeys(names)]
    grouping = grouped(rows, over)
    if not asked:
        return ()
    for row in rows:
        name = str(row[NAME])
        if row["outcome"] != DONE:
            continue
        if grouping.levels and name not in grouping.levels:
            for one in asked:
                one.left_out[name] = f"it has no one {grouping.over}"
            continue
        saved = read_fit(folder / name)
        for one in asked:
            _gather(one, name, saved)
    return tuple(_populated(one, grouping) for one in asked)


def _gather(one: _Gathered, name: str, saved: Fit) -> None:
    priors: dict[str, Prior | float] = {}
    sizes = []
    for part in one.quantity.parts:
        if part.name not in saved.parameters:
            one.left_out[name] = f"its model has no {part.name}"
            return
        estimate = saved.parameters[part.name]
        fixed = estimate.verdict is Verdict.FIXED
        priors[part.name] = estimate.point if fixed else prior_of(part, estimate.prior)
        if not fixed:
            sizes.append(np.inf if estimate.ess_bulk is None else estimate.ess_bulk)
    count = len(saved.fitted.draws)
    if not sizes or not count:
        one.left_out[name] = "a point fit has no draws" if sizes else f"{one.quantity.name} is fixed there"
        return
    columns = dict(zip(saved.fitted.names, saved.fitted.draws.T, strict=True))
    with np.errstate(divide="ignore", invalid="ignore"):
        places = one.quantity.coordinates(columns)
    if not np.all(np.isfinite(places)):
        assert saved.place is not None
        raise damaged(saved.place, f"fitted.draws of {one.quantity.name}: one without a logarithm")
    one.tables.append((name, places, priors, min(1.0, min(sizes) / count)))


def _populated(one: _Gathered, grouping: Grouping) -> Populated:
    asked = one.quantity
    if len(one.tables) < LEAST_TABLES:
        raise ParameterError(
            f"population of {asked.name}: {len(one.tables)} tables have draws of it, expected at least {LEAST_TABLES}"
            + "".join(f"; {name}: {why}" for name, why in list(one.left_out.items())[:3])
        )
    # Values that the prior of any table excludes are left out: the population is that of what all priors allow.
    sides = np.array([asked.ends(priors) for _name, _draws, priors, _efficiency in one.tables])
    ends = float(sides[:, 0].max()), float(sides[:, 1].min())
    tables = []
    for name, draws, priors, efficiency in one.tables:
        inside = draws[(draws >= ends[0]) & (draws <= ends[1])]
        if np.ptp(inside) <= 0.0 if len(inside) else True:
            raise ParameterError(
                f"population of {asked.name}: priors of the tables exclude one another's values: no draw of {name} "
                "is possible in all others"
            )
        tables.append(TableDraws.drawn(name, inside, asked.log_prior(priors), efficiency * len(inside) / len(draws)))
    own = {}
    for name, draws, _priors, _efficiency in one.tables:
        low, median, high = (float(end) for end in np.quantile(draws, (0.025, 0.5, 0.975)))
        own[name] = Known(median, low, high)
    sds = {name: float(draws.std()) for name, draws, _priors, _efficiency in one.tables}
    levels: dict[str, list[TableDraws]] = {}
    for table in tables:
        levels.setdefault(grouping.levels.get(table.name, table.name), []).append(table)
    if len(levels) < 2:
        raise ParameterError(
            f"population of {asked.name} over {grouping.over}: all tables that have draws of it have the same "
            f"{grouping.over}, {', '.join(levels)}; expected at least two levels"
        )
    before = asked.before(ends, grouping.over)
    found = population_over(levels, before) if grouping.levels else population(tables, before)
    return Populated(asked, found, own, sds, one.left_out, grouping.over, grouping.remarks)


POPULATION_JSON, POPULATION_CSV = "population.json", "population.csv"
KIND = "fitball population"


def write_populations(populated: Sequence[Populated], folder: Path) -> None:
    """Write both files, or remove those of an earlier run where there is no population."""
    if not populated:
        for name in (POPULATION_JSON, POPULATION_CSV):
            remove(folder / name)
        return
    write_csv(folder / POPULATION_CSV, (row for one in populated for row in population_rows(one)))
    write_text(folder / POPULATION_JSON, json_text(content(populated)))


# Kinds of rows of a population.
MEAN, SPREAD, WITHIN, LEVEL_ROW, TABLE_ROW = "mean", "spread", "spread within levels", "level", "table"
NEW_LEVEL, NEW_TABLE = "new level", "new table"
ALONE = ("median", "q025", "q975")


def population_rows(populated: Populated) -> list[dict[str, object]]:
    """A population in SI, a row each: mean, spread (over levels: between these, and within them), every level, a new
    level and a new table, and every table alone and given the others, with effective draws and Pareto k.

    Medians and ends of 95 % intervals are `pooled_`, those of a table alone are not. A spread is a standard deviation
    of the quantity itself, also where the population is one of logarithms.
    """
    found = populated.population
    rows = [
        _row(populated, MEAN, populated.ends(found.centre)), _row(populated, SPREAD, populated.sizes(found.spread))
    ]  # fmt: skip
    if found.within is not None:
        rows.append(_row(populated, WITHIN, populated.sizes(found.within)))
    for level in found.levels:
        rows.append(_row(populated, LEVEL_ROW, populated.ends(level.known), level=level.name))
        if level.new is not None:
            rows.append(_row(populated, NEW_TABLE, populated.ends(level.new), level=level.name))
    if found.new_level is not None:
        rows.append(_row(populated, NEW_LEVEL, populated.ends(found.new_level)))
    rows.append(_row(populated, NEW_TABLE, populated.ends(found.new)))
    levels = {name: level.name for level in found.levels for name in level.tables}
    for table in found.tables:
        own = dict(zip(ALONE, populated.ends(populated.own[table.name]), strict=True))
        weights = {
            "effective_draws": table.effective, "pareto_k": _finite(table.pareto_k), "trusted": table.trusted
        }  # fmt: skip
        ends = populated.ends(table.known)
        rows.append(_row(populated, TABLE_ROW, ends, table=table.name, level=levels.get(table.name)) | own | weights)
    return rows


def _row(
    populated: Populated, kind: str, ends: tuple[float, float, float], table: str = "", level: str | None = None
) -> dict[str, object]:
    return {
        "quantity": populated.name, "unit": populated.quantity.unit, "kind": kind, "table": table,
        **dict.fromkeys(ALONE), **{f"pooled_{name}": end for name, end in zip(ALONE, ends, strict=True)},
        "effective_draws": None, "pareto_k": None, "trusted": None, "level": level,
    }  # fmt: skip


def content(populated: Sequence[Populated]) -> Mapping[str, object]:
    """The content of `population.json`."""
    return {"kind": KIND, "quantities": {one.quantity.name: _quantity(one) for one in populated}}


def _quantity(one: Populated) -> Mapping[str, object]:
    found = one.population
    record: dict[str, object] = {
        "unit": one.quantity.unit,
        "logarithmic": one.quantity.log,
        "tables": len(found.tables),
        "centre": _ends(one, found.centre) | {"error": found.centre.error},
        "spread": _spread(found.spread),
        "new_table": _ends(one, found.new),
        "not_trusted": list(found.doubtful),
        "left_out": dict(one.left_out),
    }
    if found.levels:
        record |= {
            "over": one.over,
            "within": None if found.within is None else _spread(found.within),
            "new_level": None if found.new_level is None else _ends(one, found.new_level),
            "levels": {level.name: _level(one, level) for level in found.levels},
        }
    return record


def _level(one: Populated, level: Level) -> Mapping[str, object]:
    return {
        "tables": list(level.tables), **_ends(one, level.known), "error": level.known.error,
        "new_table": None if level.new is None else _ends(one, level.new),
    }  # fmt: skip


def _spread(spread: Known) -> Mapping[str, float]:
    return {"median": spread.median, "q025": spread.low, "q975": spread.high, "error": spread.error}


def _ends(populated: Populated, known: Known) -> dict[str, float]:
    return dict(zip(("median", "q025", "q975"), populated.ends(known), strict=True))


def _finite(k: float) -> float | None:
    """Infinite where weights have no tail, or are equal."""
    return float(k) if np.isfinite(k) else None
