"""The verbs that begin from a fit, as functions: a fit, or the folder of one, goes in."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Mapping
from functools import wraps
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, TypeVar

from fitball.api.calibrating import load_fit
from fitball.api.fit import Fit
from fitball.api.simulating import Course, course_of_model
from fitball.errors import ParameterError
from fitball.kinds import checked
from fitball.values import Impacts

if TYPE_CHECKING:
    from fitball.report.figures.canvas import Figure

FitOrFolder = Fit | str | os.PathLike[str]
P = ParamSpec("P")
T = TypeVar("T")


def fit_of(fit: FitOrFolder) -> Fit:
    """A fit, read from its folder where a path was given. Raises ResultFolderError."""
    return fit if isinstance(fit, Fit) else load_fit(fit)


def _of_fit(method: Callable[Concatenate[Fit, P], T]) -> Callable[Concatenate[FitOrFolder, P], T]:
    """A method of fits as a function, documented as that is, of a fit or the folder of one."""

    @wraps(method)
    def verb(fit: FitOrFolder, *args: P.args, **named: P.kwargs) -> T:
        return method(fit_of(fit), *args, **named)

    own = inspect.signature(method)
    fit, *others = own.parameters.values()
    first = fit.replace(name="fit", annotation="FitOrFolder")
    verb.__signature__ = own.replace(parameters=[first, *others])  # type: ignore[attr-defined]
    # More than the type says: the fit may be given by name too.
    return verb  # type: ignore[return-value]


predict = _of_fit(Fit.predict)
plan = _of_fit(Fit.plan)
export = _of_fit(Fit.export)


@checked
def plot(fit: FitOrFolder, kind: str) -> Figure:
    """A figure of a fit by name, as the verb `plot` draws it: a matplotlib Figure, its panels in `axes`.

    Kinds are `predictive`, `residuals`, `corner` and what `dir(fit.plot)` lists. Raises ParameterError for an unknown
    one, ResultFolderError where the fit has not what it shows.

    >>> len(fitball.plot(fit, "residuals").axes) > 0
    True
    """
    return fit_of(fit).plot(kind)


@checked
def simulate(
    impact: Impacts | str,
    *,
    fit: FitOrFolder | None = None,
    model: str | None = None,
    values: Mapping[str, Any] | None = None,
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
