"""Models of a user: a Python function with priors as defaults, tried before use."""

import hashlib
import inspect
import textwrap
import traceback
import types
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fitball.base.columns import COLUMNS, STATE
from fitball.base.errors import ModelError, ParameterError, suggestion
from fitball.base.priors import ParameterSpec, parse_prior
from fitball.base.text import one_line
from fitball.base.values import Ball, FloatArray, Impacts
from fitball.models.model import Model
from fitball.models.specs import NAMES, SPECS, TAKEN
from fitball.models.types import Rebound, Status

# Parameters of fitball that a function may have; they keep their unit, bounds and meaning.
SHARED = ("mu", "e_x", "offset", "cor_10", "cor_slope")
# Arguments of a function before its parameters.
ARGUMENTS = (*STATE, "ball")
# Arrays that a function returns, in this order.
GIVES = ("v_x2", "v_y2", "omega_2")
# Bounds of a parameter that its prior leaves open: finite, so that figures have ends, beyond any
# quantity in SI.
LARGEST = 1e12
# Impacts, and draws of the priors, at which a function is tried: enough to see rows that depend on
# each other, few enough for functions in plain Python.
TRIED = 24


class RowBalls(NamedTuple):
    """What a function gets of the ball: mass [kg], radius [m], moment of inertia [kg m^2], each
    (rows,).
    """

    mass: FloatArray
    radius: FloatArray
    inertia: FloatArray


@dataclass(frozen=True)
class OwnSolver:
    """Rebounds by a user's Python `function`, whose rows are draws times impacts."""

    name: str
    function: Callable[..., Any]

    def __call__(
        self,
        ball: Ball,
        names: Sequence[str],
        values: FloatArray,
        impacts: Impacts,
        _cor: FloatArray | None,
    ) -> Rebound:
        """Rebounds (draws, impacts) as of `Model.evaluate`. Raises ModelError (`own-model`)."""
        shape = (len(values), len(impacts))

        def rows(column: FloatArray | float) -> FloatArray:
            # A copy, which the function may change.
            return np.array(np.broadcast_to(column, shape), dtype=np.float64).ravel()

        parameters = {name: rows(values[:, [k]]) for k, name in enumerate(names)}
        mass = parameters.pop("ball_mass", rows(ball.mass))
        radius = parameters.pop("ball_radius", rows(ball.radius))
        ratio = parameters.pop("inertia_ratio", rows(ball.inertia_ratio))
        balls = RowBalls(mass, radius, ratio * mass * radius**2)
        state = [rows(getattr(impacts, name)) for name in STATE]
        towards = state[1] > 0.0
        out = self._outputs(state, balls, parameters)
        answered = np.isfinite(out).all(axis=0)
        out[:, ~(answered & towards)] = np.nan
        status = np.where(answered, Status.OK, Status.NO_ANSWER)
        status = np.where(towards, status, Status.NO_IMPACT)
        v_x2, v_y2, omega_2 = out.reshape(3, *shape)
        none = np.full(shape, np.nan)
        regime = np.zeros(shape, np.int64)
        return Rebound(v_x2, v_y2, omega_2, none, none, none, none, regime, status.reshape(shape))

    def _outputs(
        self,
        state: list[FloatArray],
        balls: RowBalls,
        parameters: Mapping[str, FloatArray],
    ) -> FloatArray:
        """Outputs (3, rows) of the function at arguments (rows,). Raises ModelError
        (`own-model`).
        """
        try:
            with np.errstate(all="ignore"):
                returned = self.function(*state, balls, **parameters)
        except (Exception, SystemExit) as error:
            code = _plain(self.function).__code__
            text = f"fails at {_failed(error, code.co_filename, code.co_firstlineno)}"
            if "truth value" in str(error):
                text += ". Its arguments are arrays: use np.where instead of if"
            raise self.fault(text) from None
        expected = (
            f"expected three arrays {', '.join(GIVES)}, one number for each of the "
            f"{len(state[0])} rows"
        )
        if not isinstance(returned, tuple | list | np.ndarray) or len(returned) != len(GIVES):
            raise self.fault(f"returns a {type(returned).__name__}; {expected}")
        columns = [np.asarray(column) for column in returned]
        for name, column in zip(GIVES, columns, strict=True):
            if column.shape != state[0].shape or column.dtype.kind not in "iuf":
                raise self.fault(
                    f"returns {name} of shape {column.shape} and type {column.dtype}; {expected}"
                )
        return np.array(columns, dtype=np.float64)

    def fault(self, text: str) -> ModelError:
        """An error (`own-model`) in the function, not yet raised."""
        return ModelError(f"model {self.name}: the function {text}", "own-model")


def model_from(function: Callable[..., Any] | str, *, name: str = "") -> Model:
    """A model from `f(v_x1, v_y1, omega_1, ball, mu="uniform(0, 1)", ...) -> v_x2, v_y2, omega_2`,
    arrays (rows,), or from FILE.py:NAME. Raises ModelError (`own-model`) with the line of the
    function, ParameterError (`prior`).

    `ball` has `mass`, `radius`, `inertia` (rows,), SI. Each row is another impact: write the
    function with numpy, without `if`, or with `numba.njit` and a loop. A number that is not finite
    means that it has no answer there. Parameters named mu, e_x, offset, cor_10 or cor_slope keep
    unit, bounds and meaning of fitball.
    """
    text = ""
    if isinstance(function, str):
        text = function
        function = _from_file(text)
    plain = _plain(function)
    if not isinstance(plain, types.FunctionType):
        raise ModelError(
            f"read a {type(function).__name__}, expected a function written with def",
            "own-model",
        )
    name = name or plain.__name__
    solver = OwnSolver(name, function)
    if name in NAMES:
        raise ModelError(
            f"model {name} is one of fitball: give the function another name",
            "own-model",
        )
    try:
        source = textwrap.dedent(inspect.getsource(plain))
    except (OSError, TypeError, SyntaxError):
        raise solver.fault(
            "has no source. Define it in a file or in a cell of a notebook"
        ) from None
    digest = hashlib.sha256(source.encode()).hexdigest()
    specs = _specs(solver, plain)
    model = Model(name, text or name, Ball(), {}, specs, solver, source=digest)
    _try(model, solver)
    return model


def _plain(function: Any) -> Any:
    """The function as it was written with def, of a compiled or wrapped one too."""
    return inspect.unwrap(getattr(function, "py_func", function))


def _specs(solver: OwnSolver, function: types.FunctionType) -> tuple[ParameterSpec, ...]:
    """Parameters of a function with their priors, from its arguments behind ARGUMENTS. Raises
    ModelError (`own-model`), ParameterError (`prior`).
    """
    arguments = inspect.signature(function).parameters
    if tuple(arguments)[: len(ARGUMENTS)] != ARGUMENTS or len(arguments) == len(ARGUMENTS):
        raise solver.fault(
            f"takes ({', '.join(arguments)}); expected ({', '.join(ARGUMENTS)}) and its "
            "parameters with priors as defaults, such as e_y='uniform(0, 1)'"
        )
    noises = [column.noise.name for column in COLUMNS.values() if column.noise]
    taken = {*SPECS, *TAKEN, *noises} - {*SHARED}
    specs = []
    for key, argument in list(arguments.items())[len(ARGUMENTS) :]:
        if key in taken or key.endswith("_spread"):
            raise solver.fault(
                f"has a parameter {key}, which has another meaning in fitball. Rename it"
            )
        if not isinstance(argument.default, str):
            raise ParameterError(
                f"model {solver.name}: parameter {key} has no prior; expected a text as default, "
                f"such as {key}='uniform(0, 1)'",
                "prior",
            )
        specs.append(_spec(key, argument.default))
    return tuple(specs)


def _spec(key: str, text: str) -> ParameterSpec:
    """A parameter with its prior, whose support are its bounds unless it is a parameter of
    fitball.
    """
    if key in SHARED:
        shared = replace(SPECS[key], prior=text.strip())
        # Faults of the prior are found here.
        parse_prior(shared)
        return shared
    head, _, index = key.partition("_")
    symbol = rf"\mathrm{{{head}}}"
    if index:
        symbol += rf"_\mathrm{{{index.replace('_', ',')}}}"
    spec = ParameterSpec(
        name=key,
        unit="",
        lower=-LARGEST,
        upper=LARGEST,
        prior=text.strip(),
        meaning=f"{key}, a parameter of your function",
        symbol=f"${symbol}$",
    )
    prior = parse_prior(spec)
    lower, upper = prior.value(np.array([prior.lower, prior.upper])).tolist()
    return replace(spec, lower=lower, upper=upper, logarithmic=prior.log)


def _try(model: Model, solver: OwnSolver) -> None:
    """Call a function on TRIED impacts at draws of its priors. Raises ModelError (`own-model`) if
    it fails, has no answer at any, or mixes rows.
    """
    rng = np.random.default_rng(1)
    impacts = Impacts(
        rng.uniform(2.0, 30.0, TRIED),
        rng.uniform(3.0, 20.0, TRIED),
        rng.uniform(-400.0, 400.0, TRIED),
    )
    names = [spec.name for spec in model.parameters]
    priors = [parse_prior(spec) for spec in model.parameters]
    draws = np.stack([prior.quantile(rng.uniform(size=TRIED)) for prior in priors], axis=1)
    together = model.evaluate(names, draws, impacts)
    if not np.any(together.status == Status.OK):
        values = [f"{name} = {value:.4g}" for name, value in zip(names, draws[0], strict=True)]
        raise solver.fault(
            f"gives a number that is not finite for each of {TRIED} impacts at {TRIED} draws of "
            f"its priors, such as v_x1 = {impacts.v_x1[0]:.4g} m/s, v_y1 = {impacts.v_y1[0]:.4g} "
            f"m/s, omega_1 = {impacts.omega_1[0]:.4g} rad/s at {', '.join(values)}"
        )
    # Each impact alone: a function that takes the largest speed is right about the fastest impact.
    for k in range(TRIED):
        alone = model.evaluate(names, draws[[k]], impacts.take(np.array([k])))
        for column in GIVES:
            by_itself = getattr(alone, column)[0, 0]
            among = getattr(together, column)[k, k]
            # Vectorised functions may round a row differently by its place.
            if not np.isclose(by_itself, among, rtol=1e-9, atol=1e-12, equal_nan=True):
                raise solver.fault(
                    f"gives {column} = {by_itself:.6g} for an impact alone, and {among:.6g} among "
                    "others. Each row must depend on itself alone"
                )


def _from_file(text: str) -> Callable[..., Any]:
    """The function of FILE.py:NAME. The file is run; it is no module, so that other processes get
    the function itself instead of its address. Raises ModelError (`own-model`).
    """
    file, _, name = text.rpartition(":")
    path = Path(file).resolve()
    names: dict[str, Any] = {"__name__": f"{path.stem} of a model", "__file__": str(path)}
    try:
        exec(compile(path.read_bytes(), str(path), "exec"), names)
    except OSError as error:
        raise ModelError(
            f"model {text}: {file} cannot be read: {error.strerror}",
            "own-model",
        ) from None
    except (Exception, SystemExit) as error:
        line = 1
        if isinstance(error, SyntaxError) and error.lineno:
            line = error.lineno
        raise ModelError(
            f"model {text}: the file fails at {_failed(error, str(path), line)}",
            "own-model",
        ) from None
    if not callable(names.get(name)):
        functions = [key for key, value in names.items() if isinstance(value, types.FunctionType)]
        raise ModelError(
            f"model {text}: {file} has no function '{name}': {suggestion(name, functions)}",
            "own-model",
        )
    function: Callable[..., Any] = names[name]
    return function


def _failed(error: BaseException, file: str, first: int) -> str:
    """Where and how it failed: at the last line of this file in the trace, or at its `first`."""
    line: int | None = first
    for frame in traceback.extract_tb(error.__traceback__):
        if frame.filename == file:
            line = frame.lineno
    where = f"line {line} of {Path(file).name}"
    return f"{where} with {type(error).__name__}: {one_line(str(error))}"
