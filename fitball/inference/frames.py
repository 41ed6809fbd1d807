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
from fitball.data.balances import impact_balances
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
    diagnostics: Diagnostics | None,
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
    for estimate in sorted(estimates, key=lambda estimate: _ORDER.index(estimate.kind)):
        name = estimate.name
        profile = profiles.get(name)
        ends = (np.nan, np.nan) if profile is None else profile.interval_95
        ess, r_hat = _mixing(diagnostics, name)
        moved = {choice: float(moves.get((choice, name), np.nan)) for choice in estimate.given}
        order = _farthest_first(moved)
        rows[name] = {
            "kind": estimate.kind,
            "unit": estimate.unit,
            "meaning": estimate.meaning,
            **{field: getattr(estimate, field) for field in Summary.__struct_fields__},
            "prior": estimate.prior,
            "contraction": estimate.contraction,
            "profile_low": -np.inf if ends[0] is None else ends[0],
            "profile_high": np.inf if ends[1] is None else ends[1],
            "ess": ess,
            "r_hat": r_hat,
            "verdict": estimate.verdict,
            "reason": estimate.reason,
            "given": "; ".join(order),
            "moved": moved[order[0]] if order else np.nan,
        }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("name")


def _mixing(diagnostics: Diagnostics | None, name: str) -> tuple[float, float]:
    """Effective size, the smaller of bulk and tail, and R-hat of a parameter; NaN of what has
    none.
    """
    if diagnostics is None:
        return np.nan, np.nan
    bulk = diagnostics.ess_bulk.get(name, np.nan)
    tail = diagnostics.ess_tail.get(name, np.nan)
    r_hat = np.nan
    if diagnostics.r_hat is not None:
        r_hat = diagnostics.r_hat.get(name, np.nan)
    return min(bulk, tail), r_hat


def _farthest_first(moved: Mapping[str, float]) -> list[str]:
    """Choices by how far each moves a value, farthest first; those not tried (NaN) last."""

    def nearness(choice: str) -> float:
        return -moved[choice] if np.isfinite(moved[choice]) else np.inf

    return sorted(moved, key=nearness)


def predictions(problem: Problem, draws: Draws, rng: np.random.Generator) -> DataFrame:
    """A row an impact and measured column."""
    predicted = predict(problem.forward, draws, _asked(problem), rng)
    _, nearest = series(problem)
    return laid_out(predicted, problem.table.labels, problem.rows.states, series=nearest)


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
    thinned = {}
    for name, column in draws.values.items():
        step = max(1, len(column) // _REGIMES)
        thinned[name] = column[::step]
    frame = predictive.regimes(
        problem.forward,
        draws._replace(values=thinned),
        _asked(problem).part(rows),
    )
    frame["row"] = rows[frame["row"]]
    frame.insert(1, "id", np.asarray(problem.table.labels["id"])[frame["row"]])
    return frame


def balances(problem: Problem, draws: Draws) -> DataFrame:
    """A row an impact: what conservation laws say of it without a model, with errors as stated or
    as fitted.
    """
    noise = {}
    for item in problem.observables:
        sd = problem.forward.column_sd(item.column.name, draws.best)
        noise[item.column.name] = float(sd.ravel()[0])
    return impact_balances(problem.table, problem.scene.ball_value(), noise)


def laid_out(
    predicted: DataFrame, labels: Mapping[str, Sequence[str]], states: Impacts, **more: Any
) -> DataFrame:
    """The frame `predicted` by `predict` with id, labels, incident state and `more` of each impact
    (impacts,) before it; a label does not replace a column.
    """
    import pandas as pd

    speed, angle = states.polar()
    shared: dict[str, Any] = {"id": labels["id"], **labels, "v_1": speed, "theta_1": angle}
    shared |= {**{name: getattr(states, name) for name in STATE}, **more}
    places = predicted.pop("row").to_numpy()
    lead = {
        name: np.asarray(column)[places]
        for name, column in shared.items()
        if name not in ("row", *predicted.columns)
    }
    return pd.concat([pd.DataFrame({"row": places} | lead), predicted], axis=1)


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
