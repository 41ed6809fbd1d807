"""What a batch has of each table: its row, and its quantities as groups of a hierarchy."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from fitball.base import itf
from fitball.base.display_units import CM, PLAIN
from fitball.base.errors import FitballError, ParameterError
from fitball.base.numbers import Unit
from fitball.base.prior_families import Prior
from fitball.base.priors import ParameterSpec, parse_prior
from fitball.base.text import column_head
from fitball.base.values import DataFrame
from fitball.batches.passing import DIFFER, RULE, VERDICT
from fitball.inference.effort import Effort
from fitball.inference.fitted import Fitted
from fitball.inference.problem.levels import SPREAD_FREEDOM, usual_spread
from fitball.inference.sampling.importance import RELIABLE_K
from fitball.inference.schema import Estimate
from fitball.uses.groups import (
    DETERMINED_VERDICTS,
    group_near,
    group_of,
    is_log,
    spread_prior,
)
from fitball.uses.hierarchy import LEAST_GROUPS, Group, Hierarchy, hierarchy, measured_group
from fitball.uses.measured import lab_tests, outcome, rule_of

# The column with the balls of a table that lie apart from the others.
OUTLYING = "outlying"
DONE = "done"
FAILED = "failed"
# Columns of a table that failed, too.
HEAD = (
    "table",
    "outcome",
    "code",
    "reason",
    "impacts",
    "model",
    "status",
    "adequacy",
    "sha256",
    "version",
    "seed",
    "fitted_on",
)
# Kinds of quantities that are compared over tables.
_KINDS = ("model", "level", "derived")
# Sds of a normal distribution in its 95 % interval.
_SDS_IN_INTERVAL = 3.92
# Restitutions, whatever they are called: all lie within these ends.
_RESTITUTIONS = ("cor_10", "cor_median", "cor_254cm", "cor_measured")
_RESTITUTION_ENDS = (0.0, 1.0)
# Times that tables far from the population are drawn anew at most: once is mostly enough.
_MOST_STEPS = 5
# What the columns of a quantity end with: its value, the ends of its 95 % interval.
ENDS = ("", "_q025", "_q975")
# How errors with faults are broken into lines, and joined in a cell of a table.
_LINE_BREAKS = (
    ("faults\n  - ", "faults: "),
    (":\n  - ", ": "),
    ("\n  - ", "; "),
    ("\n", ". "),
)


class TableQuantity(NamedTuple):
    """A quantity of one table: its `group`, whether its data determine it, the prior of its
    `spread` between tables, whether its coordinate is the logarithm (`log`); its `unit` in SI and
    as people read it, and what it is.
    """

    group: Group
    determined: bool
    spread: Prior
    log: bool
    unit: str
    display_unit: Unit
    meaning: str


class TableRecord(NamedTuple):
    """What a batch has of one table: its row, and its quantities by name."""

    row: dict[str, object]
    quantities: dict[str, TableQuantity]


class _Tested(NamedTuple):
    """What a laboratory test measured: `value` with the ends of its 95 % interval, in SI."""

    name: str
    display_unit: Unit
    meaning: str
    value: float
    low: float
    high: float


def record_of_failure(name: str, error: FitballError) -> TableRecord:
    """The record of a table that could not be fitted: code and reason of the error."""
    reason = str(error)
    for broken, joined in _LINE_BREAKS:
        reason = reason.replace(broken, joined)
    row: dict[str, object] = {
        "table": name,
        "outcome": FAILED,
        "code": error.code,
        "reason": " ".join(reason.split()),
    }
    return TableRecord(row, {})


def record_of(name: str, fit: Fitted, fitted_on: str) -> TableRecord:
    """The record of a fit: outcome, adequacy, what it was made from and on which day, labels that
    all its impacts share, every quantity in SI, laboratory tests.
    """
    row: dict[str, object] = {
        "table": name,
        "outcome": DONE,
        "code": "",
        "reason": "",
        "impacts": len(fit.run.table),
        "model": fit.problem.forward.model.text,
        "status": fit.status,
        "adequacy": fit.adequacy.answer,
        "sha256": " ".join(dict.fromkeys(read.get("sha256", "") for read in fit.run.table.read)),
        "version": fit.run.version,
        "seed": fit.run.effort.seed,
        "fitted_on": fitted_on,
    }
    for column, cells in fit.run.table.labels.items():
        if column != "id" and len({*cells}) == 1:
            row[f"label:{column}"] = cells[0]
    quantities = dict[str, TableQuantity]()
    for estimate in fit.reported:
        value = estimate.median if np.isfinite(estimate.median) else estimate.point
        row |= _value_columns(
            estimate.name,
            estimate.unit,
            value,
            estimate.q025,
            estimate.q975,
        )
        row[f"{estimate.name}_sd"] = estimate.sd
        row[f"{estimate.name}_verdict"] = estimate.verdict
        quantity = _fitted_quantity(fit, estimate)
        if quantity is not None:
            quantities[estimate.name] = quantity
    for tested in _tested(fit, row):
        unit = "m" if tested.display_unit.name else ""
        row |= _value_columns(tested.name, unit, tested.value, tested.low, tested.high)
        if tested.high > tested.low:
            quantities[tested.name] = _measured_quantity(tested, unit)
    return TableRecord(row, quantities)


def _fitted_quantity(fit: Fitted, estimate: Estimate) -> TableQuantity | None:
    """A parameter or derived quantity as one that is compared over tables; None for noises, what is
    fixed, and fits without a posterior.
    """
    group = group_of(fit, estimate.name) if estimate.kind in _KINDS else None
    if group is None:
        return None
    spec = fit.quantity(estimate.name).spec
    meaning, _, _ = estimate.meaning.partition(",")
    return TableQuantity(
        group=group,
        determined=estimate.verdict in DETERMINED_VERDICTS,
        spread=spread_prior(fit, estimate.name),
        log=is_log(spec),
        unit=spec.unit,
        display_unit=spec.display_unit,
        meaning=meaning,
    )


def _measured_quantity(tested: _Tested, unit: str) -> TableQuantity:
    """A laboratory test as a quantity that is compared over tables."""
    error = (tested.high - tested.low) / _SDS_IN_INTERVAL
    group = measured_group(tested.value, error)
    size = usual_spread(tested.value, 0.0, log=False)
    prior = f"half-t({size:.6g}, {SPREAD_FREEDOM})"
    spread = parse_prior(ParameterSpec(tested.name, "", 0.0, np.inf, prior, "", ""))
    return TableQuantity(group, True, spread, False, unit, tested.display_unit, tested.meaning)


def _value_columns(
    name: str,
    unit: str,
    value: float,
    low: float,
    high: float,
) -> dict[str, object]:
    """Columns of a quantity: its value, headed with the unit, and the ends of its interval."""
    head = column_head(name, unit)
    return {head: value, f"{name}_q025": low, f"{name}_q975": high}


def _tested(fit: Fitted, row: dict[str, object]) -> Iterator[_Tested]:
    """What was measured in laboratory tests; into the `row` go the category of a court, whether
    balls pass, and the names of balls that lie apart from the others of their lot.
    """
    tests = lab_tests(fit)
    apart = dict[str, list[str]]()
    for pace in tests.pace.to_dict("records"):
        if pace["place"]:
            continue
        name = _name_on("pace_measured", pace["surface"])
        meaning = "court pace rating, as measured"
        yield _Tested(name, PLAIN, meaning, pace["rating"], pace["q025"], pace["q975"])
        row[f"{name}_category"] = max(itf.PACE_CATEGORIES, key=lambda category: pace[category])
    for drop in tests.drops.to_dict("records"):
        surface = drop["surface"]
        if drop["kind"] in ("mean", "another") and np.isfinite(drop["passes"]):
            row[_name_on(f"{drop['kind']}_passes", surface)] = drop["passes"]
            if drop["kind"] == "mean":
                verdict = outcome(drop["passes"]) if drop["agree"] else DIFFER
                row[_name_on(VERDICT, surface)] = verdict
                row[_name_on(RULE, surface)] = rule_of(fit.run.scene)
        if drop["kind"] == "ball" and drop["outlying"]:
            apart.setdefault(_name_on(OUTLYING, surface), []).append(drop["label"])
        if drop["kind"] != "mean":
            continue
        for column, unit, meaning in (("cor", PLAIN, "COR of drops"), ("rebound", CM, "rebound")):
            if np.isfinite(drop[column]):
                yield _Tested(
                    _name_on(f"{column}_measured", surface),
                    unit,
                    f"{meaning}, as measured",
                    drop[column],
                    drop[f"{column}_q025"],
                    drop[f"{column}_q975"],
                )
    row |= {name: ", ".join(balls) for name, balls in apart.items()}


def _name_on(name: str, surface: str) -> str:
    """The name of a quantity on a surface; as it is where there is but one."""
    return f"{name}[{surface}]" if surface else name


def is_compared(quantities: Sequence[TableQuantity]) -> bool:
    """Whether enough tables determine a quantity for a mean over all tables that have it."""
    return sum(quantity.determined for quantity in quantities) >= LEAST_GROUPS


def over_tables(name: str, quantities: Sequence[TableQuantity]) -> Hierarchy:
    """Centre, spread and a new table of a quantity that three tables determine, by all tables that
    have it: in SI, but the spread of a logarithm, which is relative. Restitutions lie
    within 0 and 1.

    Raises:
        ParameterError: fewer than three tables determine it (`too-few-tables`).
    """
    if not is_compared(quantities):
        count = sum(quantity.determined for quantity in quantities)
        text = f"{name}: the data of {count} tables determine it; expected at least {LEAST_GROUPS}"
        raise ParameterError(text, "too-few-tables")
    population = _population(name, quantities)
    if name.partition("[")[0] in _RESTITUTIONS:
        stream = Effort().stream(f"restitutions of {name}")
        return population.within(*_RESTITUTION_ENDS, stream)
    if not quantities[0].log:
        return population
    return population._replace(
        centre=np.exp(population.centre),
        new=np.exp(population.new),
        each=np.exp(population.each),
    )


def _population(name: str, quantities: Sequence[TableQuantity]) -> Hierarchy:
    """The hierarchy of a quantity of several tables, in its coordinate."""
    groups = [quantity.group for quantity in quantities]
    stream = Effort().stream(f"population of {name}")
    return hierarchy(groups, quantities[0].spread, stream)


def with_reliable_weights(
    name: str,
    quantities: Mapping[str, TableQuantity],
    fit_of: Callable[[str], Fitted],
) -> dict[str, TableQuantity]:
    """A quantity by name of table; where the draws of a table hardly reach the population, its fit,
    which `fit_of` reads by the name of the table, is drawn anew there.
    """
    settled = dict(quantities)
    for step in range(_MOST_STEPS):
        population = _population(name, list(settled.values()))
        far = population.pareto_k > RELIABLE_K
        if not far.any():
            break
        rng = Effort().stream(f"tables near the population of {name}, {step}")
        for table, is_far in zip(quantities, far.tolist(), strict=True):
            group = group_near(fit_of(table), name, population, rng) if is_far else None
            if group is not None:
                settled[table] = settled[table]._replace(group=group)
    return settled


def populations(quantities: Mapping[str, Sequence[TableQuantity]]) -> DataFrame:
    """A row a quantity that three tables determine, index `quantity`: `unit` in SI, `meaning`,
    `tables` that take part, how many of them `determine` it; `mean`, `spread` and a table that is
    `new`, each median with ends of 95 %; whether the spread is `relative`; the largest Pareto k.
    """
    import pandas as pd

    rows = {}
    for name, of_tables in quantities.items():
        if not is_compared(of_tables):
            continue
        population = over_tables(name, of_tables)
        first = of_tables[0]
        row: dict[str, object] = {
            "unit": first.unit,
            "meaning": first.meaning,
            "tables": len(of_tables),
            "determine": sum(quantity.determined for quantity in of_tables),
        }
        draws = {"mean": population.centre, "spread": population.spread, "new": population.new}
        for head, values in draws.items():
            quantiles = np.quantile(values, (0.5, 0.025, 0.975)).tolist()
            for end, value in zip(ENDS, quantiles, strict=True):
                row[f"{head}{end}"] = value
        row["relative"] = first.log
        row["pareto_k"] = float(population.pareto_k.max())
        rows[name] = row
    heads = ["unit", "meaning", "tables", "determine"]
    heads += [f"{head}{end}" for head in ("mean", "spread", "new") for end in ENDS]
    heads += ["relative", "pareto_k"]
    frame = pd.DataFrame.from_dict(rows, orient="index", columns=heads)
    return frame.rename_axis("quantity")
