"""Models of one's own: a Python function of the incident state that gives the rebound. `api.own_model` makes them.

A function is known by its name and a hash of its source. Both are kept in the options of the model, with its
parameters, so that a saved fit says what it was, and a model can be composed again: with its function where that is
known in this process, else without, and then it gives no rebound.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fitball.errors import ModelError
from fitball.models.model import (
    INPUT_COUNT,
    INPUTS,
    Bounced,
    LinearConstraint,
    States,
    SteppedModel,
    ball_columns,
)
from fitball.models.specs import BALL_PARAMETERS, SPECS, ParameterSpec
from fitball.models.types import OUTPUTS, Status
from fitball.values import Ball, FloatArray, Impacts, OwnImpacts
from fitball.visible import one_line
from fitball.wording import spoken

# Parameters of fitball that a function may have; they keep their unit, bounds and meaning.
SHARED = ("mu", "e_x", "offset", "cor_10", "cor_slope")
# Bounds of other priors than uniform ones: finite, so that figures have ends, and beyond any quantity in SI.
ANY, POSITIVE = (-1e12, 1e12), (0.0, 1e12)
# The options of a model of one's own.
SOURCE, PARAMETERS = "source", "parameters"
GIVES = ("v_x2", "v_y2", "omega_2")
# Share of a quantity's scale by which differences move it: the cube root of rounding, best for central differences.
SHARE = 6e-6
# Scales of the incident state [m/s, m/s, rad/s].
SCALES = (1.0, 1.0, 30.0)
UNPORTED = (
    "is a Python function of your own, which this format cannot carry. Formats that can: json, latex, markdown, "
    "golden, lookup, engine, netcdf, pdf"
)


class OwnBall(NamedTuple):
    """What a function gets of the ball: mass [kg], radius [m], moment of inertia [kg m^2], each (rows,)."""

    mass: NDArray[Any]
    radius: NDArray[Any]
    inertia: NDArray[Any]


@dataclass(frozen=True)
class OwnFunction:
    """A function with its `name`, the hash of its `source`, and what is known of its parameters.

    `priors` are texts by name, `widths` lengths along which a parameter moves. With `stepped` its derivatives are
    complex steps, else differences.
    """

    name: str
    source: str
    call: Callable[..., Any] = field(compare=False)
    priors: Mapping[str, str] = field(compare=False)
    widths: Mapping[str, float] = field(compare=False)
    stepped: bool = field(compare=False)

    def __reduce__(self) -> tuple[Any, ...]:
        """In another process the function is known too."""
        return _again, (vars(self),)

    def rows(self, columns: Mapping[str, NDArray[Any]], ball: OwnBall) -> NDArray[Any]:
        """Rebounds (3, rows) of `columns`, incident state and parameters, each (rows,), in their kind of number.

        Raises ModelError for a function that fails, or gives no three arrays of as many numbers.
        """
        count, kind = len(columns["v_x1"]), columns["v_x1"].dtype
        try:
            with np.errstate(all="ignore"):
                given = self.call(*(columns[name] for name in INPUTS), ball, **{k: columns[k] for k in self.priors})
        except Exception as error:
            arrays = "truth value of an array" in str(error)
            raise ModelError(
                f"model {self.name}: the function fails at {self._line(error)} with {type(error).__name__}: "
                f"{one_line(str(error))}" + ". The arguments are arrays: use np.where instead of if" * arrays
            ) from None
        wanted = f"expected three arrays {', '.join(GIVES)}, one number for each of the {count} rows"
        if not isinstance(given, tuple | list | np.ndarray) or len(given) != len(GIVES):
            size = f" of {len(given)}" if isinstance(given, tuple | list | np.ndarray) else ""
            raise ModelError(f"model {self.name}: the function returns a {type(given).__name__}{size}, {wanted}")
        out = np.empty((len(GIVES), count), dtype=kind)
        for k, (name, column) in enumerate(zip(GIVES, given, strict=True)):
            array = np.asarray(column)
            if array.shape != (count,):
                raise ModelError(f"model {self.name}: the function returns {name} of shape {array.shape}, {wanted}")
            if array.dtype.kind not in ("iufc" if kind.kind == "c" else "iuf"):
                raise ModelError(f"model {self.name}: the function returns {name} of type {array.dtype}, {wanted}")
            out[k] = array
        return out

    def _line(self, error: Exception) -> str:
        """Where the function failed: its own file and line, if the trace has one."""
        code = getattr(self.call, "py_func", self.call).__code__
        frames = traceback.extract_tb(error.__traceback__)
        lines = [frame.lineno for frame in frames if frame.filename == code.co_filename]
        return f"line {lines[-1] if lines else code.co_firstlineno} of {Path(code.co_filename).name}"


# Every function of this process by name and source, and the last of each name.
_KNOWN: dict[tuple[str, str], OwnFunction] = {}
_LAST: dict[str, OwnFunction] = {}
# Parameters of all functions that were composed, also of saved fits.
NAMED: set[str] = set()


def known(function: OwnFunction) -> OwnFunction:
    """The function, which this process knows from now on."""
    _KNOWN[function.name, function.source] = _LAST[function.name] = function
    return function


def _again(values: Mapping[str, Any]) -> OwnFunction:
    """The function of these `values`, sent by another process, unless this one knows it."""
    found = _KNOWN.get((values["name"], values["source"]))
    return known(OwnFunction(**values)) if found is None else found


def is_own(name: str, options: Mapping[str, str]) -> bool:
    """Whether this is a function of one's own: by what was saved of it, or because this process knows its name."""
    return SOURCE in options or name in _LAST


def last_of(name: str | None) -> OwnFunction | None:
    """The last function of this name, which other processes know once they are sent it."""
    return None if name is None else _LAST.get(name)


def own_spec(name: str, prior: str = "normal(0, 1)", bounds: tuple[float, float] = ANY) -> ParameterSpec:
    """A parameter that only a function of one's own has."""
    head, _, index = name.partition("_")
    label = rf"$\mathrm{{{head}}}" + (rf"_\mathrm{{{index.replace('_', ',')}}}$" if index else "$")
    return ParameterSpec(name, "", *bounds, prior, f"{name}, a parameter of your function", label)


def spec(name: str, prior: str) -> ParameterSpec:
    """A parameter with its prior; the bounds are those of the prior, or of the parameter of fitball of that name."""
    if name in SPECS:
        return replace(SPECS[name], prior=prior)
    family, _, numbers = prior.partition("(")
    bounds = ANY
    if "uniform" in family:
        low, high = (float(part) for part in numbers.rstrip(") ").split(","))
        bounds = low, high
    elif family.strip().startswith(("lognormal", "half")):
        bounds = POSITIVE
    return own_spec(name, prior, bounds)


def compose_own(name: str, ball: Ball, tangential: bool, options: Mapping[str, str]) -> OwnModel:
    """The model called `name` with the function of these `options`, or else with the last of that name."""
    if not options:
        function: OwnFunction | None = _LAST[name]
        priors, source = _LAST[name].priors, _LAST[name].source
    elif set(options) != {SOURCE, PARAMETERS}:
        raise ModelError(f"model {name} has no model variants (closures): read {', '.join(sorted(options))}")
    else:
        source = options[SOURCE]
        function = _KNOWN.get((name, source))
        priors = dict(part.split("=", 1) for part in options[PARAMETERS].split("; "))
    NAMED.update(priors)
    return model_of(name, ball, tangential, source, priors, function)


def model_of(
    name: str, ball: Ball, tangential: bool, source: str, priors: Mapping[str, str], function: OwnFunction | None
) -> OwnModel:
    """The model of a function, with the options by which it is composed again."""
    options = {SOURCE: source, PARAMETERS: "; ".join(f"{key}={text}" for key, text in priors.items())}
    return OwnModel(name, ball, options, tuple(map(spec, priors, priors.values())), function, tangential=tangential)


@dataclass(frozen=True)
class OwnModel(SteppedModel):
    """A model whose rebounds are those of a Python function; without its `function` it has none."""

    unported: ClassVar[str] = UNPORTED

    function: OwnFunction | None = field(repr=False)

    def linear_constraints(self, impacts: Impacts) -> tuple[LinearConstraint, ...]:  # noqa: ARG002
        """See `Model.linear_constraints`: nothing but the bounds of priors, and where the function has no answer."""
        return ()

    @property
    def has_regimes(self) -> bool:
        """See `Model.has_regimes`: a function returns none."""
        return False

    @property
    def known(self) -> OwnFunction:
        """The function. Raises ModelError if this process does not know it."""
        if self.function is None:
            raise ModelError(self.without)
        return self.function

    @property
    def without(self) -> str:
        """See `Model.without`."""
        if self.function is not None:
            return ""
        how = spoken("--model FILE:NAME", "load_fit(..., model=...), or fitball.model_from before it")
        wanted = f"a function of source {self.options[SOURCE]}"
        if (other := _LAST.get(self.name)) is not None:
            return (
                f"model {self.name}: read a function of source {other.source}, but the fit was made with {wanted}. "
                "Give the function as it was, or fit again"
            )
        return f"model {self.name} is {wanted}, which a saved fit names but does not contain: give it by {how}"

    def bounce(self, names: Sequence[str], values: NDArray[Any], states: States) -> Bounced:
        """See `SteppedModel.bounce`: rows of the function are draws times impacts."""
        shape = (values.shape[0], states[0].shape[1])

        def column(given: NDArray[Any]) -> NDArray[Any]:
            return np.array(np.broadcast_to(given, shape), dtype=values.dtype).reshape(-1)

        v_x1, v_y1, omega_1, _cor = states
        columns = {name: column(state) for name, state in zip(INPUTS, (v_x1, v_y1, omega_1), strict=True)}
        columns |= {name: column(values[:, [k]]) for k, name in enumerate(names) if name not in BALL_PARAMETERS}
        ball = OwnBall(*(column(item[:, None]) for item in ball_columns(self.ball, names, values)))
        out = self.known.rows(columns, ball)
        answered = np.all(np.isfinite(out), axis=0)
        out[:, ~answered] = np.nan
        status = np.where(answered, Status.OK, Status.NO_ANSWER).astype(np.int8)
        return out.reshape(len(GIVES), *shape), np.zeros(shape, dtype=np.int64), status.reshape(shape)

    def slopes(
        self, names: Sequence[str], values: FloatArray, impacts: Impacts | OwnImpacts, parameters: Sequence[str]
    ) -> FloatArray:
        """See `Model.slopes`: complex steps, or central differences."""
        return (super().slopes if self.known.stepped else self.differences)(names, values, impacts, parameters)

    def differences(
        self, names: Sequence[str], values: FloatArray, impacts: Impacts | OwnImpacts, parameters: Sequence[str]
    ) -> FloatArray:
        """The same by central differences; at a bound, one-sided."""
        v_x1, v_y1, omega_1, _cor = impacts.states()
        given, own = (v_x1, v_y1, omega_1), list(names)
        slopes = np.full((values.shape[0], len(impacts), len(OUTPUTS), INPUT_COUNT + len(parameters)), np.nan)

        def rates(low: Bounced, high: Bounced, width: FloatArray) -> FloatArray:
            return np.moveaxis((high[0] - low[0]) / width, 0, -1)

        def moved(place: int, step: FloatArray) -> Bounced:
            x, y, turn = (item + step if place == k else item for k, item in enumerate(given))
            return self.bounce(names, values, (x, y, turn, None))

        for k, scale in enumerate(SCALES):
            step = SHARE * np.maximum(np.abs(given[k]), scale)
            slopes[:, :, : len(GIVES), k] = rates(moved(k, -step), moved(k, step), 2.0 * step)
        for k, name in enumerate(parameters):
            at, limits = own.index(name), self.specs[name]
            step = SHARE * np.maximum(np.abs(values[:, at]), self.known.widths.get(name, 0.0))
            down, up = values.copy(), values.copy()
            down[:, at] = np.maximum(values[:, at] - step, limits.lower)
            up[:, at] = np.minimum(values[:, at] + step, limits.upper)
            low, high = (self.bounce(names, rows, (v_x1, v_y1, omega_1, None)) for rows in (down, up))
            slopes[:, :, : len(GIVES), INPUT_COUNT + k] = rates(low, high, (up - down)[:, [at]])
        return slopes
