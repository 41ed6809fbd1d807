"""What an export of bounces is of: a fit, on each of its surfaces and with each of its balls, or a model at given
parameters (`unfitted`). Ports, lookup tables and engine settings are made from it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from fitball.inference.prediction.outputs import golden
from fitball.inference.prediction.reach import spanning_impacts
from fitball.inference.problem.level_names import checked_label, columns_of
from fitball.inference.problem.pooling import Levels, Pooling
from fitball.inference.results.fitted_model import FittedModel
from fitball.inference.results.results import Fit, Golden
from fitball.models.types import Rebound
from fitball.report.saved.fit_file import complete
from fitball.values import Impacts


@dataclass(frozen=True)
class Case:
    """The model on one surface and with one ball: `labels` by column, empty where no parameter differs.

    `fitted` has no levels; its impacts are those measured in this case, or all if none was (`measured` is their
    number, None where it is not known).
    """

    labels: Mapping[str, str]
    fitted: FittedModel
    golden: Golden
    measured: int | None = None

    @property
    def words(self) -> str:
        """The labels, such as `surface clay, ball A`; of a case without any, nothing."""
        return ", ".join(f"{column} {label}" for column, label in self.labels.items())


@dataclass(frozen=True)
class Bounces:
    """The `cases` of an export: one for each combination of the labels of `columns`, the last column fastest, or a
    single one without columns.

    `origin` says where the parameters are from, in a phrase without end, `name` and `table` what was fitted; both are
    empty where nothing was (`measured` is false then). `sources` are sentences on the parameters, or on ranges that
    are not those of single cases.
    """

    origin: str
    columns: Mapping[str, tuple[str, ...]]
    cases: tuple[Case, ...]
    measured: bool = True
    name: str = ""
    table: str = ""
    sources: tuple[str, ...] = ()


def _origin(saved: Fit, labels: Mapping[str, str]) -> str:
    """Which fit an export is of, in a line; with `labels` by column, on which surface and with which ball."""
    table = saved.source
    origin = f"table {table.file} ({table.impacts} impacts), point estimate, fit {saved.status}"
    fitted = saved.fitted.labels
    named = [
        f"{column} {label}"
        if label in fitted[column]
        else f"a {column} of which nothing was measured (the median of such)"
        for column, label in labels.items()
    ]
    pooled = [item for item in saved.fitted.levels if item.column not in labels]
    by_column = {
        column: [item.parameter for item in pooled if item.column == column]
        for column in dict.fromkeys(item.column for item in pooled)
    }
    by = [f"{' and '.join(names)} of each {column}" for column, names in by_column.items()]
    return ", ".join([origin, *by, *named])


def bounces_of(saved: Fit, levels: Mapping[str, str] | None = None) -> Bounces:
    """The cases of a fit; `levels` (column -> label) leaves those of one surface or ball.

    Raises ParameterError for a column over which no parameter differs, for a label that was not fitted, and for a new
    one of a point fit.
    """
    fitted = saved.fitted
    named = columns_of(fitted.levels, levels or {})
    chosen = {column: checked_label(fitted.levels, column, label) for column, label in named.items()}
    columns = {column: labels for column, labels in fitted.labels.items() if column not in chosen}
    if not fitted.levels:
        cases: tuple[Case, ...] = (Case({}, fitted, saved.golden),)
    else:
        # Which impacts are of which level is in a file beside `fit.json`.
        pooling = saved.problem.pooling if complete(saved) else ()
        combinations = (dict(zip(columns, labels, strict=True)) for labels in product(*columns.values()))
        cases = tuple(_case(saved, {**chosen, **one}, pooling) for one in combinations)
    return Bounces(
        _origin(saved, chosen), columns, cases, name=saved.source.name, table=saved.source.file,
        sources=_remarks(cases) if fitted.levels else (),
    )  # fmt: skip


def _remarks(cases: Sequence[Case]) -> tuple[str, ...]:
    """Sentences on ranges that are not those of single cases."""
    if any(case.measured is None for case in cases):
        return ("The measurements are not beside fit.json: each calibrated range is that of all impacts.",)
    return tuple(
        f"No measured impact is of {case.words}: its calibrated range is that of all impacts."
        for case in cases
        if case.measured == 0
    )


def _case(saved: Fit, labels: Mapping[str, str], pooling: Sequence[Pooling]) -> Case:
    """The model at `labels`, with the impacts that were measured there as far as `pooling` says which they are."""
    everything, fitted = saved.impacts if pooling else saved.fitted.impacts, saved.fitted
    mine, measured = np.arange(len(everything)), None
    if pooling:
        there = [item.index == place_of(item.labels, labels[item.column]) for item in pooling]
        rows = np.flatnonzero(np.logical_and.reduce(there))
        mine, measured = rows if rows.size else mine, int(rows.size)
    impacts = spanning_impacts(everything.take(mine), fitted.ball.radius)
    there_alone, others = fitted.at(labels), spread_names(fitted.levels)
    kept = [k for k, name in enumerate(fitted.names) if name not in others]
    own = replace(
        there_alone,
        names=tuple(fitted.names[k] for k in kept),
        point=there_alone.point[kept],
        draws=there_alone.draws[:, kept],
        impacts=impacts,
    )
    return Case(labels, own, golden(own, impacts), measured)


def spread_names(levels: Sequence[Levels]) -> set[str]:
    """Names of the parameters that say how far levels are apart, and where each is."""
    places = {item.place_name(label) for item in levels for label in item.labels}
    return places | {item.spread_name for item in levels}


def place_of(labels: Sequence[str], label: str) -> int:
    """The place of a label, -1 of one that was not fitted."""
    return labels.index(label) if label in labels else -1


def joined(bounces: Bounces) -> tuple[Golden, dict[str, tuple[str, ...]]]:
    """The golden impacts of all cases, one after the other, and the label of each by column."""
    parts = [case.golden for case in bounces.cases]
    if len(parts) == 1:
        return parts[0], {}
    given = [part.impacts for part in parts]
    columns = ("v_x1", "v_y1", "omega_1", *(["cor"] if given[0].cor is not None else []))
    impacts = Impacts(*(np.concatenate([getattr(one, name) for one in given]) for name in columns))
    labels = {
        column: tuple(case.labels[column] for case in bounces.cases for _ in range(len(case.golden.impacts)))
        for column in bounces.columns
    }
    return Golden({}, impacts, Rebound.joined([part.rebound for part in parts], 0)), labels
