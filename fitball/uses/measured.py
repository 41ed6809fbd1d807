"""What laboratory tests of a fit's table measured, as rows of its summary.

They are straight from the table, so that no verdict on parameters concerns them: `verdict` says
whether balls pass, by the rule in `reason`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from fitball.base import itf
from fitball.base.values import DataFrame
from fitball.data.scene import Scene
from fitball.data.table import ImpactTable
from fitball.inference.fitted import Fitted
from fitball.uses.drops import drop_test
from fitball.uses.pace import measured_pace

# The probability from which balls pass; below the rest of one they fail.
SURE = 0.95
# The kind of these rows in a summary.
KIND = "measured"
# Of each row of drops its quantities in the summary: column, name, unit, meaning.
_OF_KIND: Mapping[str, tuple[tuple[str, str, str, str], ...]] = {
    "mean": (
        ("rebound", "rebound_measured", "m", "mean rebound from 254 cm"),
        ("cor", "cor_measured", "", "mean COR of drops"),
        ("ratio", "rebound_ratio", "", "rebound over that on the reference surface"),
    ),
    "another": (("rebound", "rebound_another", "m", "rebound of another ball of the make"),),
    "ball": (
        ("rebound", "rebound_measured", "m", "rebound from 254 cm of a ball"),
        ("cor", "cor_measured", "", "COR of a ball"),
    ),
    "speed": (),
}


class LabTests(NamedTuple):
    """The frames of `uses.pace` and `uses.drops`; either is empty where that was not tested."""

    pace: DataFrame
    drops: DataFrame


class _Made(NamedTuple):
    """Tests that were made, with what they depend on besides the table."""

    scene: Scene
    priors: Mapping[str, str]
    tests: LabTests


# By table: several parts of a page ask for the same.
_MADE: WeakKeyDictionary[ImpactTable, _Made] = WeakKeyDictionary()


def lab_tests(fit: Fitted) -> LabTests:
    """The laboratory tests in the table of a fit, made once."""
    run = fit.run
    made = _MADE.get(run.table)
    if made is None or made.scene != run.scene or made.priors != run.choices.prior:
        asked = run.table, run.scene, run.choices.prior
        tests = LabTests(measured_pace(*asked), drop_test(*asked))
        made = _Made(run.scene, run.choices.prior, tests)
        _MADE[run.table] = made
    return made.tests


def outcome(passes: float) -> str:
    """Whether balls pass, by the probability that they do; "" where there is none."""
    if not np.isfinite(passes):
        return ""
    if passes >= SURE:
        return "passes"
    return "fails" if passes <= 1.0 - SURE else "undecided"


def rule_of(scene: Scene) -> str:
    """The rule by which balls pass, with their type, such as `type-2 (assumed), 135 to 147 cm by
    ITF TB 04/01`.
    """
    low, high = itf.BALL_TYPES[scene.ball_type()]
    assumed = "" if scene.ball.type else " (assumed)"
    limits = f"{100.0 * low:.0f} to {100.0 * high:.0f} cm"
    return f"{scene.ball_type()}{assumed}, {limits} by ITF TB 04/01"


def with_measured(fit: Fitted) -> DataFrame:
    """The summary of a fit below what laboratory tests of its table measured."""
    import pandas as pd

    rows = {str(row.pop("name")): row for row in _rows(fit)}
    if not rows:
        return fit.summary
    measured = pd.DataFrame.from_dict(rows, orient="index").rename_axis("name")
    return pd.concat([measured.reindex(columns=fit.summary.columns), fit.summary])


def _rows(fit: Fitted) -> Iterator[dict[str, object]]:
    """Rows of drops and of court pace, with their `name`."""
    tests = lab_tests(fit)
    for row in _records(tests.drops):
        if row["kind"] != "mean" or row["agree"]:
            yield from _rows_of_drops(row, rule_of(fit.run.scene))
        if row["kind"] == "mean":
            yield from _rows_of_mean(row)
    for row in _records(tests.pace):
        label = label_of(str(row["surface"]), str(row["place"]))
        meaning = "court pace rating by ITF CS 01/02, as measured"
        shares = {name: _number(row[name]) for name in itf.PACE_CATEGORIES}
        category = max(shares, key=shares.__getitem__)
        values = (_number(row["rating"]), _number(row["q025"]), _number(row["q975"]))
        yield _row(f"pace_measured{label}", "", meaning, values, category)
        variation = _number(row["variation"])
        if np.isfinite(variation):
            meaning = "largest difference of location means"
            yield _row(f"pace_variation{label}", "", meaning, (variation, np.nan, np.nan))


def _records(frame: DataFrame) -> list[dict[str, object]]:
    """The rows of a frame, cells by name of column."""
    return [{str(name): cell for name, cell in row.items()} for row in frame.to_dict("records")]


def _rows_of_drops(row: Mapping[str, object], rule: str) -> Iterator[dict[str, object]]:
    """Rows of what was measured of a row of drops: a ball has its rebound, else its COR."""
    label = label_of(str(row["surface"]), str(row["label"]))
    for column, name, unit, meaning in _OF_KIND[str(row["kind"])]:
        value = _number(row[column])
        known = np.isfinite(_number(row["rebound"]))
        if not np.isfinite(value) or (row["kind"] == "ball" and column == "cor" and known):
            continue
        values = (value, _number(row[f"{column}_q025"]), _number(row[f"{column}_q975"]))
        verdict = outcome(_number(row["passes"])) if column == "rebound" else ""
        apart = "outlying" if row["outlying"] else ""
        reason = "; ".join(filter(None, (rule if verdict else "", apart)))
        yield _row(f"{name}{label}", unit, meaning, values, verdict, reason)


def _rows_of_mean(row: Mapping[str, object]) -> Iterator[dict[str, object]]:
    """Rows of the variance components."""
    label = label_of(str(row["surface"]), "")
    lead, unit = ("rebound", "m") if np.isfinite(_number(row["rebound"])) else ("cor", "")
    for of in ("balls", "repeats"):
        name = f"sd_{of}"
        values = (_number(row[name]), _number(row[f"{name}_q025"]), _number(row[f"{name}_q975"]))
        if np.isfinite(values[0]):
            meaning = "sd between balls" if of == "balls" else "sd of repeats"
            yield _row(f"{lead}_{name}{label}", unit, meaning, values)


def _row(
    name: str,
    unit: str,
    meaning: str,
    values: tuple[float, float, float],
    verdict: str = "",
    reason: str = "",
) -> dict[str, object]:
    """A row: a value with the ends of its 95 % interval, in SI."""
    value, low, high = values
    return {
        "name": name,
        "kind": KIND,
        "unit": unit,
        "meaning": meaning,
        "point": value,
        "median": value,
        "q025": low,
        "q975": high,
        "prior": "",
        "verdict": verdict,
        "reason": reason,
        "given": "",
    }


def _number(cell: object) -> float:
    """A cell of a frame as a number."""
    assert isinstance(cell, int | float)
    return float(cell)


def label_of(*parts: str) -> str:
    """What a name ends with: the labels that are there, in brackets."""
    labels = ", ".join(filter(None, parts))
    return f"[{labels}]" if labels else ""
