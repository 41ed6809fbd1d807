"""The thin thread from a table to a page: a point fit of a model by least squares. Gone as soon as `calibrate` is
whole. Imports: data, models, result, base.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from fitball.columns import COLUMNS
from fitball.data.table import ImpactTable
from fitball.errors import FitError, ModelError, Note
from fitball.models.model import Model
from fitball.models.registry import model as model_of
from fitball.progress import Progress
from fitball.result import Frames
from fitball.values import DataFrame, FloatArray

# Scatter is estimated anew from the residuals until it moves by less than this share.
SETTLED, ROUNDS = 1e-6, 100


def fit(table: ImpactTable, chosen: Model | str, progress: Progress) -> Frames:
    """Frames `summary` (a row a parameter) and `predictions` (a row an impact and column) of the best fit, each
    column with a scatter of its own. Raises FitError (`too-few-impacts`), ModelError.
    """
    from scipy.optimize import least_squares

    made = (
        chosen if isinstance(chosen, Model) else model_of(chosen or "grip-slip", tangential=table.shows("tangential"))
    )
    if made.timed:
        raise ModelError(f"{made.text}: this stage of the third edition fits grip-slip and brody alone", "not-yet")
    columns = [c for c in table.values if c in ("v_x2", "v_y2", "omega_2", "v_2", "theta_2")]
    measured = np.column_stack([table.values[c] for c in columns])
    names = [p.name for p in made.parameters]
    counts = np.isfinite(measured).sum(axis=0)
    if counts.sum() <= len(names) + len(columns):
        raise FitError(
            f"{table.name}: {counts.sum()} measured values are too few for {len(names)} parameters and the scatter "
            f"of {len(columns)} columns",
            "too-few-impacts",
        )
    # A scatter is no smaller than the bound of its parameter.
    least = np.array([spec.lower for c in columns if (spec := COLUMNS[c].noise) is not None])
    low = np.array([p.lower for p in made.parameters])
    high = np.array([p.upper for p in made.parameters])
    start = np.array([p.typical if p.typical is not None else 0.5 * (p.lower + p.upper) for p in made.parameters])
    size = np.where(start == 0.0, 1e-3 * np.minimum(high - low, 1.0), np.abs(start))

    def misfit(q: FloatArray) -> FloatArray:
        return np.where(np.isfinite(measured), _predicted(made, names, q * size, table, columns) - measured, 0.0)

    q, scatter = start / size, np.nanstd(measured, axis=0)
    for step in range(ROUNDS):
        progress("fitting", step / ROUNDS)
        scaled = partial(_scaled, misfit, scatter)
        found = least_squares(scaled, q, bounds=(low / size, high / size))
        q, before = found.x, scatter
        scatter = np.maximum(np.sqrt(np.sum(misfit(q) ** 2, axis=0) / counts), least)
        if np.all(np.abs(scatter - before) <= SETTLED * before):
            break
    jacobian = np.asarray(found.jac)
    errors = size * np.sqrt(np.diag(np.linalg.pinv(jacobian.T @ jacobian)))
    fitted = _predicted(made, names, q * size, table, columns)
    frames = {
        "summary": _summary(made, q * size, errors, columns, scatter),
        "predictions": _predictions(table, columns, fitted, measured, scatter),
    }
    note = Note("point-only", f"A point fit of {made.text}: the posterior is not computed at this stage.")
    return Frames("report.thin_page", frames, (*table.notices, note))


def _scaled(misfit: Callable[[FloatArray], FloatArray], scatter: FloatArray, q: FloatArray) -> FloatArray:
    """Residuals in units of the scatter, flat."""
    return (misfit(q) / scatter).ravel()


def _predicted(
    made: Model, names: Sequence[str], values: FloatArray, table: ImpactTable, columns: Sequence[str]
) -> FloatArray:
    """Rebounds (impacts, columns) at values (names,)."""
    rebound = made.evaluate(names, values[np.newaxis], table.impacts)
    return np.column_stack([rebound.column(c)[0] for c in columns])


def _summary(
    made: Model, values: FloatArray, errors: FloatArray, columns: Sequence[str], scatter: FloatArray
) -> DataFrame:
    """A row a parameter: kind, unit, meaning, point, standard error (NaN for a scatter)."""
    import pandas as pd

    rows = [
        {"name": p.name, "kind": "model", "unit": p.unit, "meaning": p.meaning, "point": v, "stderr": e}
        for p, v, e in zip(made.parameters, values, errors, strict=True)
    ]
    for column, sd in zip(columns, scatter, strict=True):
        about = COLUMNS[column]
        rows.append(
            {"name": f"{column}_sd", "kind": "noise", "unit": about.unit, "meaning": f"scatter of {about.title}",
             "point": sd, "stderr": np.nan}
        )  # fmt: skip
    return pd.DataFrame(rows).set_index("name")


def _predictions(
    table: ImpactTable, columns: Sequence[str], fitted: FloatArray, measured: FloatArray, scatter: FloatArray
) -> DataFrame:
    """A row an impact and measured column: id, prediction, what was measured, residual in units of the scatter."""
    import pandas as pd

    ids = table.labels["id"]
    frames = [
        pd.DataFrame(
            {"id": ids, "column": column, "point": fitted[:, k], "observed": measured[:, k],
             "z": (measured[:, k] - fitted[:, k]) / scatter[k]}
        )
        for k, column in enumerate(columns)
    ]  # fmt: skip
    found = pd.concat(frames, ignore_index=True)
    return found[found["observed"].notna()].reset_index(drop=True)
