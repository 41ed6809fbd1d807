"""What a batch keeps of one fit: its row, and its quantities as groups of a hierarchy."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from fitball.base import itf
from fitball.base.display_units import CM, PLAIN
from fitball.base.errors import FitballError, ParameterError
from fitball.base.numbers import Unit
from fitball.base.priors import ParameterSpec, Prior, parse_prior
from fitball.base.values import DataFrame
from fitball.inference.effort import Effort
from fitball.inference.fitted import Fitted
from fitball.inference.problem.levels import FREEDOM, usual_spread
from fitball.uses.hierarchy import (
    LEAST,
    Group,
    Hierarchy,
    group_of,
    hierarchy,
    is_log,
    measured,
    spread_prior,
)
from fitball.uses.lab import drop_test, measured_pace

DONE = "done"
FAILED = "failed"
HEAD = ("table", "outcome", "code", "reason", "impacts", "model", "status", "adequacy")
# Kinds of quantities that are compared over tables, and sds of a 95 % interval.
_KINDS = ("model", "level", "derived")
_WIDE = 3.92
ENDS = ("", "_q025", "_q975")


class Quantity(NamedTuple):
    """A quantity of one table: its `group`, the prior of its `spread` between tables, whether its
    coordinate is the logarithm; its `unit` in SI and as people read it, and what it is.
    """

    group: Group
    spread: Prior
    log: bool
    unit: str
    display_unit: Unit
    meaning: str


class Kept(NamedTuple):
    """Of a table: its row, and its quantities by name."""

    row: dict[str, Any]
    quantities: dict[str, Quantity]


def failed(name: str, error: FitballError) -> Kept:
    """Of a table that could not be fitted."""
    reason = str(error)
    for broken, joined in (
        ("faults\n  - ", "faults: "),
        (":\n  - ", ": "),
        ("\n  - ", "; "),
        ("\n", ". "),
    ):
        reason = reason.replace(broken, joined)
    return Kept(
        {"table": name, "outcome": FAILED, "code": error.code, "reason": " ".join(reason.split())},
        {},
    )


def kept(name: str, fit: Fitted) -> Kept:
    """Of a fit: outcome, adequacy, labels that all its impacts share, every quantity in SI,
    laboratory tests.
    """
    model = fit.problem.forward.model.text
    said = name, DONE, "", "", len(fit.run.table), model, fit.status, fit.adequacy.answer
    row: dict[str, Any] = dict(zip(HEAD, said, strict=True))
    for column, cells in fit.run.table.labels.items():
        if column != "id" and len({*cells}) == 1:
            row[f"label:{column}"] = cells[0]
    found = dict[str, Quantity]()
    for one in fit.reported:
        value = one.median if np.isfinite(one.median) else one.point
        row |= _cells(one.name, one.unit, value, one.q025, one.q975) | {f"{one.name}_sd": one.sd}
        row[f"{one.name}_verdict"] = one.verdict
        if one.kind in _KINDS and (group := group_of(fit, one.name)) is not None:
            spec = fit.quantity(one.name).spec
            display_unit = spec.display_unit
            short = one.meaning.partition(",")[0]
            found[one.name] = Quantity(
                group,
                spread_prior(fit, one.name),
                is_log(spec),
                spec.unit,
                display_unit,
                short,
            )
    for tested, display_unit, meaning, (value, low, high) in _tested(fit, row):
        unit = "m" if display_unit.name else ""
        row |= _cells(tested, unit, value, low, high)
        if high > low:
            group = measured(value, (high - low) / _WIDE)
            size = usual_spread(value, 0.0, log=False)
            spec = ParameterSpec(tested, "", 0.0, np.inf, f"half-t({size:.6g}, {FREEDOM})", "", "")
            found[tested] = Quantity(group, parse_prior(spec), False, unit, display_unit, meaning)
    return Kept(row, found)


def _cells(name: str, unit: str, value: float, low: float, high: float) -> dict[str, float]:
    return {f"{name} [{unit}]" if unit else name: value, f"{name}_q025": low, f"{name}_q975": high}


def _tested(
    fit: Fitted,
    row: dict[str, Any],
) -> Iterator[tuple[str, Unit, str, tuple[float, float, float]]]:
    """Name, unit, meaning, value and interval of what was measured in laboratory tests; into the
    `row` go the category and the chances to pass.
    """
    given = fit.run.table, fit.run.scene, fit.run.choices.prior
    for one in measured_pace(*given).to_dict("records"):
        if not one["place"]:
            name = _at("pace_measured", one["surface"])
            yield (
                name,
                PLAIN,
                "court pace rating, as measured",
                (one["rating"], one["q025"], one["q975"]),
            )
            row[f"{name}_category"] = max(itf.PACE_CATEGORIES, key=lambda category: one[category])
    for one in drop_test(*given).to_dict("records"):
        if one["kind"] in ("mean", "another") and np.isfinite(one["passes"]):
            row[_at(f"{one['kind']}_passes", one["surface"])] = one["passes"]
        if one["kind"] == "mean":
            for name, unit, meaning in (
                ("cor", PLAIN, "COR of drops"),
                ("rebound", CM, "rebound"),
            ):
                if np.isfinite(one[name]):
                    ends = one[name], one[f"{name}_q025"], one[f"{name}_q975"]
                    yield (
                        _at(f"{name}_measured", one["surface"]),
                        unit,
                        f"{meaning}, as measured",
                        ends,
                    )


def _at(name: str, surface: str) -> str:
    return f"{name}[{surface}]" if surface else name


def over_tables(name: str, found: Sequence[Quantity]) -> Hierarchy:
    """Centre, spread and a new table of a quantity that three tables determine: in SI, but the
    spread of a logarithm, which is relative. Raises ParameterError (`too-few-tables`).
    """
    if len(found) < LEAST:
        text = f"{name}: the data of {len(found)} tables determine it; expected at least {LEAST}"
        raise ParameterError(text, "too-few-tables")
    made = hierarchy(
        [one.group for one in found],
        found[0].spread,
        Effort().stream(f"population of {name}"),
    )
    if not found[0].log:
        return made
    return made._replace(centre=np.exp(made.centre), new=np.exp(made.new), each=np.exp(made.each))


def populations(quantities: Mapping[str, Sequence[Quantity]]) -> DataFrame:
    """A row a quantity that three tables determine, index `quantity`: `unit` in SI, `meaning`,
    `tables`; `mean`, `spread` and a table that is `new`, each median with ends of 95 %; whether the
    spread is `relative`; the largest Pareto k.
    """
    import pandas as pd

    rows = {}
    for name, found in quantities.items():
        if len(found) < LEAST:
            continue
        made = over_tables(name, found)
        first = found[0]
        row: dict[str, Any] = {"unit": first.unit, "meaning": first.meaning, "tables": len(found)}
        for head, drawn in (("mean", made.centre), ("spread", made.spread), ("new", made.new)):
            values = np.quantile(drawn, (0.5, 0.025, 0.975)).tolist()
            row |= {f"{head}{end}": value for end, value in zip(ENDS, values, strict=True)}
        rows[name] = row | {"relative": first.log, "pareto_k": float(made.pareto_k.max())}
    heads = [
        "unit",
        "meaning",
        "tables",
        *(f"{head}{end}" for head in ("mean", "spread", "new") for end in ENDS),
    ]
    return pd.DataFrame.from_dict(
        rows,
        orient="index",
        columns=[*heads, "relative", "pareto_k"],
    ).rename_axis("quantity")
