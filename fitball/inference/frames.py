"""The frames of a fit: all numbers that its page, figures and files show, laid out once.
`report.fit_page` says what each column is.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from fitball.base.columns import STATE
from fitball.base.selection import evenly_spread
from fitball.base.values import DataFrame, Impacts
from fitball.data.balances import balances as balances_of
from fitball.inference import predictive
from fitball.inference.curves import series
from fitball.inference.effort import PREDICTED
from fitball.inference.forward import Draws
from fitball.inference.predictive import Asked, predict
from fitball.inference.problem.problem import Problem
from fitball.inference.schema import Alternative, Constant, Diagnostics, Estimate, Profile, Summary

# Kinds in the order of the page.
_ORDER = ("model", "level", "derived", "noise", "ball", "camera")
# Columns of `variants`.
_VARIANT_COLUMNS = [
    "choice",
    "instead_of",
    "rests_on",
    "low",
    "high",
    "score",
    "error",
    "as_good",
    "reason",
    "quantity",
    "median",
    "q025",
    "q975",
    "moved",
    "reach",
]
# Draws of which shares are taken: the error of a share is 0.025 at most.
_REGIMES = 400


def summary(
    estimates: Sequence[Estimate],
    profiles: Mapping[str, Profile],
    found: Diagnostics | None,
    tried: DataFrame,
) -> DataFrame:
    """A row a parameter and derived quantity."""
    import pandas as pd

    rows = {}
    # Of several choices instead of one the farthest, among those that fit equally well.
    moves = (
        tried[tried["as_good"].astype(bool)]
        .groupby(["rests_on", "quantity"])["reach"]
        .max()
        .to_dict()
    )
    for one in sorted(estimates, key=lambda one: _ORDER.index(one.kind)):
        profile = profiles.get(one.name)
        ends = (np.nan, np.nan) if profile is None else profile.interval_95
        moved = {given: float(moves.get((given, one.name), np.nan)) for given in one.given}
        order = sorted(
            moved,
            key=lambda given: -moved[given] if np.isfinite(moved[given]) else np.inf,
        )
        rows[one.name] = {
            "kind": one.kind,
            "unit": one.unit,
            "meaning": one.meaning,
            **{name: getattr(one, name) for name in Summary.__struct_fields__},
            "prior": one.prior,
            "contraction": one.contraction,
            "profile_low": -np.inf if ends[0] is None else ends[0],
            "profile_high": np.inf if ends[1] is None else ends[1],
            "ess": np.nan
            if found is None
            else min(_of(found.ess_bulk, one), _of(found.ess_tail, one)),
            "r_hat": np.nan if found is None or found.r_hat is None else _of(found.r_hat, one),
            "verdict": one.verdict,
            "reason": one.reason,
            "given": "; ".join(order),
            "moved": moved[order[0]] if order else np.nan,
        }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("name")


def _of(known: Mapping[str, float], one: Estimate) -> float:
    return known.get(one.name, np.nan)


def predictions(problem: Problem, draws: Draws, rng: np.random.Generator) -> DataFrame:
    """A row an impact and measured column."""
    found = predict(problem.forward, draws, _asked(problem), rng)
    return laid_out(found, problem.table.labels, problem.rows.states, series=series(problem)[1])


def _asked(problem: Problem) -> Asked:
    """The rows of the fit's own table."""
    rows = problem.rows
    columns = tuple(item.column.name for item in problem.observables)
    return Asked(rows.states, rows.index, columns, rows.errors, problem.camera, rows.y, rows.sd)


def regimes(problem: Problem, draws: Draws) -> DataFrame:
    """A row an impact and sequence of slip and grip, with its share of _REGIMES draws that have an
    answer (without draws of the best fit); of a long table PREDICTED impacts, evenly spread.
    """
    rows = evenly_spread(len(problem.table), PREDICTED)
    some = {
        name: column[:: max(1, len(column) // _REGIMES)] for name, column in draws.values.items()
    }
    found = predictive.regimes(
        problem.forward,
        draws._replace(values=some),
        _asked(problem).part(rows),
    )
    found["row"] = rows[found["row"]]
    found.insert(1, "id", np.asarray(problem.table.labels["id"])[found["row"]])
    return found


def balances(problem: Problem, draws: Draws) -> DataFrame:
    """A row an impact: what conservation laws say of it without a model, with errors as stated or
    as fitted.
    """
    noise = {
        item.column.name: float(
            np.ravel(problem.forward.column_sd(item.column.name, draws.best))[0]
        )
        for item in problem.observables
    }
    return balances_of(problem.table, problem.scene.ball_value(), noise)


def laid_out(
    found: DataFrame, labels: Mapping[str, Sequence[str]], states: Impacts, **more: Any
) -> DataFrame:
    """What `predict` found with id, labels, incident state and `more` of each impact (impacts,)
    before it; a label does not replace a column.
    """
    import pandas as pd

    speed, angle = states.polar()
    shared: dict[str, Any] = {"id": labels["id"], **labels, "v_1": speed, "theta_1": angle}
    shared |= {**{name: getattr(states, name) for name in STATE}, **more}
    places = found.pop("row").to_numpy()
    lead = {
        name: np.asarray(column)[places]
        for name, column in shared.items()
        if name not in ("row", *found.columns)
    }
    return pd.concat([pd.DataFrame({"row": places} | lead), found], axis=1)


def variants(
    estimates: Sequence[Estimate],
    tried: Sequence[Alternative],
    held: Sequence[Constant],
) -> DataFrame:
    """A row a choice (or held constant) and quantity; `rests_on` is what a value is given that
    rests on it.
    """
    import pandas as pd

    here = {estimate.name: estimate for estimate in estimates}
    rows = [row for choice in tried for row in _rows_of_choice(here, choice)]
    rows += [row for constant in held for row in _rows_of_constant(here, constant)]
    return pd.DataFrame(rows, columns=_VARIANT_COLUMNS)


def _rows_of_choice(here: Mapping[str, Estimate], choice: Alternative) -> Iterator[dict[str, Any]]:
    """A row a quantity, or one with the reason why the choice was not tried."""
    shared = {
        "choice": choice.choice,
        "instead_of": choice.instead_of,
        "rests_on": choice.instead_of,
        "low": np.nan,
        "high": np.nan,
        "score": np.nan if choice.score is None else choice.score,
        "error": np.nan if choice.score is None else choice.error,
        "as_good": choice.as_good,
        "reason": choice.reason,
    }
    if choice.reason:
        yield {**shared, "quantity": ""}
        return
    for name, there in choice.summaries.items():
        moved = np.nan
        reach = np.nan
        if name in here and here[name].half > 0.0:
            before = here[name]
            moved = abs(there.median - before.median) / before.half
            reach = max(
                moved,
                (before.q025 - there.q025) / before.half,
                (there.q975 - before.q975) / before.half,
            )
        yield {
            **shared,
            "quantity": name,
            "median": there.median,
            "q025": there.q025,
            "q975": there.q975,
            "moved": moved,
            "reach": reach,
        }


def _rows_of_constant(here: Mapping[str, Estimate], constant: Constant) -> Iterator[dict[str, Any]]:
    """A row a quantity: by how much it moves over the range of a constant that was held."""
    for name, moved in constant.moves.items():
        before = here[name]
        yield {
            "choice": constant.name,
            "instead_of": "",
            "rests_on": constant.name,
            "low": constant.low,
            "high": constant.high,
            "score": np.nan,
            "error": np.nan,
            "as_good": True,
            "reason": "",
            "quantity": name,
            "median": np.nan,
            "q025": before.median - abs(moved) * before.half,
            "q975": before.median + abs(moved) * before.half,
            "moved": abs(moved),
            "reach": abs(moved),
        }
