"""The frames of a fit: all numbers that its page, figures and files show, laid out once.

`report.fit_page` says what each column is.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from fitball.base.columns import STATE
from fitball.base.selection import evenly_spread
from fitball.base.values import BoolArray, DataFrame, FloatArray, Impacts, IntArray
from fitball.data.balances import impact_balances
from fitball.inference.curves import series
from fitball.inference.effort import PREDICTED_ROWS
from fitball.inference.forward import Draws
from fitball.inference.predictive import PredictionRequest, predict_impacts, regime_shares
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
    "better",
    "reason",
    "quantity",
    "median",
    "q025",
    "q975",
    "moved",
    "reach",
]
# Draws of which shares of regimes are taken: the standard error of a share is 0.025 at most.
_REGIME_DRAWS = 400


def summary_frame(
    estimates: Sequence[Estimate],
    profiles: Mapping[str, Profile],
    diagnostics: Diagnostics | None,
    tried: DataFrame,
) -> DataFrame:
    """The frame `summary`: a row for each parameter and derived quantity, by name. `tried` is the
    frame of variants, from which it has how far a value moves.
    """
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
        numbers = {field: getattr(estimate, field) for field in Summary.__struct_fields__}
        rows[name] = {
            "kind": estimate.kind,
            "unit": estimate.unit,
            "meaning": estimate.meaning,
            **numbers,
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
    """The effective sample size of a parameter, the smaller of bulk and tail, and its R-hat; NaN
    for a quantity that was not sampled.
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
        """Minus how far a choice moves the value; infinite where it was not tried."""
        return -moved[choice] if np.isfinite(moved[choice]) else np.inf

    return sorted(moved, key=nearness)


def predictions_frame(problem: Problem, draws: Draws, rng: np.random.Generator) -> DataFrame:
    """The frame `predictions`: a row for each impact and measured column of the fit's own table."""
    predicted = predict_impacts(problem.forward, draws, _fitted_rows(problem), rng)
    _, nearest = series(problem)
    return join_impacts(predicted, problem.table.labels, problem.rows.states, series=nearest)


def _fitted_rows(problem: Problem) -> PredictionRequest:
    """The request to predict the rows of the fit's own table."""
    rows = problem.rows
    columns = tuple(observable.column.name for observable in problem.observables)
    return PredictionRequest(
        rows.states,
        rows.index,
        columns,
        rows.errors,
        problem.camera,
        problem.fall,
        rows.y,
        rows.sd,
    )


def regimes_frame(problem: Problem, draws: Draws) -> DataFrame:
    """The frame `regimes`: a row for each impact and sequence of slip and grip.

    `share` is that among some _REGIME_DRAWS draws with an answer, or of the best fit where there
    are no draws. Of a long table it has PREDICTED_ROWS impacts, evenly spread.
    """
    rows = evenly_spread(len(problem.table), PREDICTED_ROWS)
    thinned = {}
    for name, column in draws.values.items():
        step = max(1, len(column) // _REGIME_DRAWS)
        thinned[name] = column[::step]
    frame = regime_shares(
        problem.forward,
        draws._replace(values=thinned),
        _fitted_rows(problem).take(rows),
    )
    frame["row"] = rows[frame["row"]]
    frame.insert(1, "id", np.asarray(problem.table.labels["id"])[frame["row"]])
    return frame


def balances_frame(problem: Problem, draws: Draws) -> DataFrame:
    """The frame `balances`: a row for each impact, with what follows from it by conservation laws
    without a model, and with errors as stated or as fitted.
    """
    noise = {}
    for observable in problem.observables:
        name = observable.column.name
        sd = problem.forward.column_sd(name, draws.best)
        noise[name] = float(sd.ravel()[0])
    return impact_balances(problem.table, problem.scene.ball_value(), noise)


def join_impacts(
    predicted: DataFrame,
    labels: Mapping[str, Sequence[str]],
    states: Impacts,
    **more: FloatArray | IntArray | BoolArray,
) -> DataFrame:
    """The frame of `predict_impacts` with id, labels, incident state and `more` of each impact
    (impacts,) before its own columns; a label does not replace a column.
    """
    import pandas as pd

    speed, angle = states.polar()
    of_impacts: dict[str, Sequence[str] | FloatArray | IntArray | BoolArray] = {"id": labels["id"]}
    of_impacts |= labels
    of_impacts |= {"v_1": speed, "theta_1": angle}
    of_impacts |= {name: getattr(states, name) for name in STATE}
    of_impacts |= more
    rows = predicted.pop("row").to_numpy()
    before = {"row": rows}
    for name, column in of_impacts.items():
        if name not in ("row", *predicted.columns):
            before[name] = np.asarray(column)[rows]
    return pd.concat([pd.DataFrame(before), predicted], axis=1)


def variants_frame(
    estimates: Sequence[Estimate],
    tried: Sequence[Alternative],
    held: Sequence[Constant],
) -> DataFrame:
    """The frame `variants`: a row for each choice, or held constant, and each quantity. `rests_on`
    names it as verdicts do, of values that rest on it.
    """
    import pandas as pd

    here = {estimate.name: estimate for estimate in estimates}
    rows = [row for choice in tried for row in _rows_of_choice(here, choice)]
    rows += [row for constant in held for row in _rows_of_constant(here, constant)]
    return pd.DataFrame(rows, columns=_VARIANT_COLUMNS)


def _rows_of_choice(
    here: Mapping[str, Estimate],
    choice: Alternative,
) -> Iterator[dict[str, object]]:
    """The rows of a choice: one for each quantity, or a single one where the choice was not tried,
    or is a law that fits surely worse.
    """
    shared: dict[str, object] = {
        "choice": choice.choice,
        "instead_of": choice.instead_of,
        "rests_on": choice.instead_of,
        "low": np.nan,
        "high": np.nan,
        "score": np.nan if choice.score is None else choice.score,
        "error": np.nan if choice.score is None else choice.error,
        "as_good": choice.as_good,
        "better": choice.better,
        "reason": choice.reason,
    }
    if choice.reason or not choice.summaries:
        yield {**shared, "quantity": ""}
        return
    for name, there in choice.summaries.items():
        moved = np.nan
        reach = np.nan
        if name in here and here[name].half > 0.0:
            before = here[name]
            moved = abs(there.median - before.median) / before.half
            below = (before.q025 - there.q025) / before.half
            above = (there.q975 - before.q975) / before.half
            reach = max(moved, below, above)
        yield {
            **shared,
            "quantity": name,
            "median": there.median,
            "q025": there.q025,
            "q975": there.q975,
            "moved": moved,
            "reach": reach,
        }


def _rows_of_constant(
    here: Mapping[str, Estimate],
    constant: Constant,
) -> Iterator[dict[str, object]]:
    """The rows of a held constant: for each quantity how far it moves over half of the range."""
    for name, moved in constant.moves.items():
        before = here[name]
        shift = abs(moved) * before.half
        yield {
            "choice": constant.name,
            "instead_of": "",
            "rests_on": constant.name,
            "low": constant.low,
            "high": constant.high,
            "score": np.nan,
            "error": np.nan,
            "as_good": True,
            "better": False,
            "reason": "",
            "quantity": name,
            "median": np.nan,
            "q025": before.median - shift,
            "q975": before.median + shift,
            "moved": abs(moved),
            "reach": abs(moved),
        }
