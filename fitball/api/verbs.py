"""The verbs that begin from a fit, as functions: a fit, or the folder of one, goes in."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fitball.api.calibrating import load_fit
from fitball.api.fit import Fit
from fitball.api.planning import Plan, Span
from fitball.api.simulating import Course, course_of_model
from fitball.errors import ParameterError
from fitball.values import Impacts

if TYPE_CHECKING:
    import pandas as pd

    from fitball.report.figures.shown import Figure

FitOrFolder = Fit | str | os.PathLike[str]


def fit_of(fit: FitOrFolder) -> Fit:
    """A fit, read from its folder where a path was given. Raises ResultFolderError."""
    return fit if isinstance(fit, Fit) else load_fit(fit)


def predict(
    fit: FitOrFolder,
    data: Any,
    *,
    units: Mapping[str, str] | None = None,
    flip: str | Sequence[str] = (),
    columns: Mapping[str, str] | None = None,
    exact_incidence: bool = False,
    seed: int = 1,
) -> pd.DataFrame:
    """Rebounds of new impacts with intervals, as the verb `predict` gives them; see `Fit.predict`.

    >>> fitball.predict(folder, {"v_1": [38.0], "theta_1": [18.0]}, units={"v_1": "mph"}).shape[0]
    1
    """
    return fit_of(fit).predict(
        data, units=units, flip=flip, columns=columns, exact_incidence=exact_incidence, seed=seed
    )


def plan(
    fit: FitOrFolder,
    target: str | Sequence[str] | None = None,
    *,
    speed: Span | None = None,
    angle: Span | None = None,
    spin: Span | None = None,
    impacts: int = 5,
    repeats: int = 1,
    sensors: str | Sequence[str] | None = None,
    cost: Mapping[str, float] | None = None,
    seed: int = 1,
) -> Plan:
    """What to measure next, as the verb `plan` says it; see `Fit.plan`.

    >>> fitball.plan(folder, "mu", speed="10:20:2", angle="20:60:3", spin=0.0, impacts=2, sensors="none")
    <Plan of 2 impacts about mu: ... nats>
    """
    return fit_of(fit).plan(
        target, speed=speed, angle=angle, spin=spin, impacts=impacts, repeats=repeats, sensors=sensors, cost=cost,
        seed=seed,
    )  # fmt: skip


def plot(fit: FitOrFolder, kind: str) -> Figure:
    """A figure of a fit by name, as the verb `plot` draws it: a matplotlib Figure, its panels in `axes`.

    Kinds are `predictive`, `residuals`, `corner` and what `dir(fit.plot)` lists. Raises ParameterError for an unknown
    one, ResultFolderError where the fit has not what it shows.

    >>> len(fitball.plot(fit, "residuals").axes) > 0
    True
    """
    return fit_of(fit).plot(kind)


def simulate(
    impact: Impacts | str,
    *,
    fit: FitOrFolder | None = None,
    model: str | None = None,
    values: Mapping[str, float] | None = None,
    draws: int = 200,
) -> Course:
    """One impact through time, as the verb `simulate` follows it: from a fit, with bands from `draws` of its
    posterior, or from a model at round defaults with some `values` [SI] set.

    `impact` is a text or `fitball.impacts(...)` of one impact. Raises ParameterError, ModelError.

    >>> fitball.simulate("v=17, theta=18, spin=100").to_frame().shape[0]
    401
    """
    if fit is None:
        return course_of_model(impact, model, values or {})
    if model is not None or values:
        raise ParameterError("a fit brings its own model and parameters: leave out model and values")
    return fit_of(fit).simulate(impact, draws=draws)


def export(
    fit: FitOrFolder,
    to: str,
    out: str | os.PathLike[str] | None = None,
    *,
    overwrite: bool = False,
    **options: Any,
) -> Mapping[str, str] | tuple[Path, ...]:
    """A fit in another form, as the verb `export` writes it: texts by the ending of their file, or with `out` (a file
    or a folder) the places that were written.

    Forms are `python`, `c`, `golden`, `lookup`, `engine`, `json`, `toml`, `csv`, `latex`, `markdown` and `netcdf`
    (a file only). Options: `prefix` (c), `inputs_only` (golden), `range` (lookup), `at` and `engine_inertia`
    (engine). Raises ParameterError, ResultFolderError.

    >>> print(fitball.export(fit, "csv")[".csv"].splitlines()[1])
    mu,model,,...
    """
    return fit_of(fit).export(to, out, overwrite=overwrite, **options)
