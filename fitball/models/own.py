"""A user's model: a Python function with priors as defaults, which is tried before use."""

import hashlib
import inspect
import textwrap
import traceback
import types
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np

from fitball.base.columns import COLUMNS, STATE
from fitball.base.errors import ModelError, ParameterError, suggestion
from fitball.base.priors import ParameterSpec, parse_prior
from fitball.base.text import one_line
from fitball.base.values import Ball, FloatArray, Impacts
from fitball.models.model import Model
from fitball.models.specs import MODEL_NAMES, SPECS, TAKEN_NAMES
from fitball.models.types import Rebound, Status

# Parameters of fitball that a function may have. They keep their unit, bounds and meaning.
SHARED_PARAMETERS = ("mu", "e_x", "offset", "cor_10", "cor_slope")
# Arguments of a function before its parameters.
ARGUMENTS = (*STATE, "ball")
# Arrays that a function returns, in this order.
OUTPUT_NAMES = ("v_x2", "v_y2", "omega_2")
# Bounds of a parameter that its prior leaves open: finite, so that figures have ends, beyond any
# quantity in SI.
LARGEST_BOUND = 1e12
# Impacts, and draws of the priors, at which a function is tried: enough to see rows that depend on
# each other, few enough for functions in plain Python.
TRIALS = 24


class RowBalls(NamedTuple):
    """The ball as a function gets it, a value a row: mass [kg], radius [m], inertia [kg m^2]."""

    mass: Annotated[FloatArray, "rows"]
    radius: Annotated[FloatArray, "rows"]
    inertia: Annotated[FloatArray, "rows"]


@dataclass(frozen=True)
class FunctionSolver:
    """Rebounds of the model `name` by a user's Python `function`, whose rows are draws times
    impacts.
    """

    name: str
    function: Callable[..., object]

    def __call__(
        self,
        ball: Ball,
        names: Sequence[str],
        values: Annotated[FloatArray, "draws parameters"],
        impacts: Impacts,
        _cor: Annotated[FloatArray, "impacts"] | None,
    ) -> Rebound:
        """Rebounds (draws, impacts) of a ball, as `Model.evaluate` returns them.

        Raises:
            ModelError: the function fails, or returns something else than three arrays
                (`own-model`).
        """
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
            written = _as_written(self.function)
            assert isinstance(written, types.FunctionType)
            code = written.__code__
            text = f"fails at {_failed(error, code.co_filename, code.co_firstlineno)}"
            if "truth value" in str(error):
                text += ". Its arguments are arrays: use np.where instead of if"
            raise self.fault(text) from None
        expected = (
            f"expected three arrays {', '.join(OUTPUT_NAMES)}, one number for each of the "
            f"{len(state[0])} rows"
        )
        if not isinstance(returned, tuple | list | np.ndarray) or len(returned) != len(
            OUTPUT_NAMES
        ):
            raise self.fault(f"returns a {type(returned).__name__}; {expected}")
        columns = [np.asarray(column) for column in returned]
        for name, column in zip(OUTPUT_NAMES, columns, strict=True):
            if column.shape != state[0].shape or column.dtype.kind not in "iuf":
                raise self.fault(
                    f"returns {name} of shape {column.shape} and type {column.dtype}; {expected}"
                )
        return np.array(columns, dtype=np.float64)

    def fault(self, text: str) -> ModelError:
        """An error (`own-model`) in the function, not yet raised."""
        return ModelError(f"model {self.name}: the function {text}", "own-model")


def model_from(function: Callable[..., object] | str, *, name: str = "") -> Model:
    """A model from `f(v_x1, v_y1, omega_1, ball, mu="uniform(0, 1)", ...) -> v_x2, v_y2, omega_2`.

    All are arrays (rows,) in SI, and `ball` has `mass`, `radius`, `inertia` (rows,). Each row is
    another impact: write the function with numpy, without `if`, or with `numba.njit` and a loop. A
    number that is not finite means that the model has no answer there. Parameters named mu, e_x,
    offset, cor_10 or cor_slope keep unit, bounds and meaning of fitball.

    Args:
        function: a function written with def, or its address FILE.py:NAME
        name: name of the model; by default that of the function

    Raises:
        ModelError: the function cannot be read, fails, or does not return three arrays, in which
            each row depends on itself alone; or its name is one of fitball (`own-model`).
        ParameterError: a parameter has no prior, or one that cannot be read (`prior`).

    Example:
        >>> import fitball
        >>> def elastic(v_x1, v_y1, omega_1, ball, e_y="uniform(0, 1)"):
        ...     return v_x1, e_y * v_y1, omega_1
        >>> model = fitball.model_from(elastic)
        >>> model.rebound({"e_y": 0.75}, fitball.impacts(10.0, 8.0)).v_y2.tolist()
        [6.0]
    """
    text = ""
    if isinstance(function, str):
        text = function
        function = _from_file(text)
    written = _as_written(function)
    if not isinstance(written, types.FunctionType):
        raise ModelError(
            f"read a {type(function).__name__}, expected a function written with def",
            "own-model",
        )
    name = name or written.__name__
    solver = FunctionSolver(name, function)
    if name in MODEL_NAMES:
        raise ModelError(
            f"model {name} is one of fitball: give the function another name",
            "own-model",
        )
    try:
        source = textwrap.dedent(inspect.getsource(written))
    except (OSError, TypeError, SyntaxError):
        raise solver.fault(
            "has no source. Define it in a file or in a cell of a notebook"
        ) from None
    digest = hashlib.sha256(source.encode()).hexdigest()
    specs = _specs(solver, written)
    model = Model(name, text or name, Ball(), {}, specs, solver, source=digest)
    _try(model, solver)
    return model


def _as_written(function: Callable[..., object]) -> object:
    """The function as it was written with def, of a compiled or wrapped function too."""
    written: object = inspect.unwrap(getattr(function, "py_func", function))
    return written


def _specs(solver: FunctionSolver, function: types.FunctionType) -> tuple[ParameterSpec, ...]:
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
    taken = {*SPECS, *TAKEN_NAMES, *noises} - {*SHARED_PARAMETERS}
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
    if key in SHARED_PARAMETERS:
        shared = replace(SPECS[key], prior=text.strip())
        # Refuses a prior that cannot be read.
        parse_prior(shared)
        return shared
    head, _, index = key.partition("_")
    symbol = rf"\mathrm{{{head}}}"
    if index:
        symbol += rf"_\mathrm{{{index.replace('_', ',')}}}"
    spec = ParameterSpec(
        name=key,
        unit="",
        lower=-LARGEST_BOUND,
        upper=LARGEST_BOUND,
        prior=text.strip(),
        meaning=f"{key}, a parameter of your function",
        symbol=f"${symbol}$",
    )
    prior = parse_prior(spec)
    lower, upper = prior.value(np.array([prior.lower, prior.upper])).tolist()
    return replace(spec, lower=lower, upper=upper, logarithmic=prior.log)


def _try(model: Model, solver: FunctionSolver) -> None:
    """Call a function on TRIALS impacts at as many draws of its priors. Raises ModelError
    (`own-model`) if it fails, has no answer for any of them, or mixes rows.
    """
    rng = np.random.default_rng(1)
    impacts = Impacts(
        rng.uniform(2.0, 30.0, TRIALS),
        rng.uniform(3.0, 20.0, TRIALS),
        rng.uniform(-400.0, 400.0, TRIALS),
    )
    names = [spec.name for spec in model.parameters]
    priors = [parse_prior(spec) for spec in model.parameters]
    draws = np.stack([prior.quantile(rng.uniform(size=TRIALS)) for prior in priors], axis=1)
    together = model.evaluate(names, draws, impacts)
    if not np.any(together.status == Status.OK):
        values = [f"{name} = {value:.4g}" for name, value in zip(names, draws[0], strict=True)]
        raise solver.fault(
            f"gives a number that is not finite for each of {TRIALS} impacts at {TRIALS} draws of "
            f"its priors, such as v_x1 = {impacts.v_x1[0]:.4g} m/s, v_y1 = {impacts.v_y1[0]:.4g} "
            f"m/s, omega_1 = {impacts.omega_1[0]:.4g} rad/s at {', '.join(values)}"
        )
    # Each impact alone: a function that takes the largest speed is right about the fastest impact.
    for k in range(TRIALS):
        alone = model.evaluate(names, draws[[k]], impacts.take(np.array([k])))
        for column in OUTPUT_NAMES:
            by_itself = getattr(alone, column)[0, 0]
            among = getattr(together, column)[k, k]
            # Vectorised functions may round a row differently by its place.
            if not np.isclose(by_itself, among, rtol=1e-9, atol=1e-12, equal_nan=True):
                raise solver.fault(
                    f"gives {column} = {by_itself:.6g} for an impact alone, and {among:.6g} among "
                    "others. Each row must depend on itself alone"
                )


def _from_file(text: str) -> Callable[..., object]:
    """The function of FILE.py:NAME. The file is run; it is no module, so that other processes get
    the function itself instead of its address. Raises ModelError (`own-model`).
    """
    file, _, name = text.rpartition(":")
    path = Path(file).resolve()
    names: dict[str, object] = {"__name__": f"{path.stem} of a model", "__file__": str(path)}
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
    function = names.get(name)
    if not callable(function):
        functions = [key for key, value in names.items() if isinstance(value, types.FunctionType)]
        raise ModelError(
            f"model {text}: {file} has no function '{name}': {suggestion(name, functions)}",
            "own-model",
        )
    return function


def _failed(error: BaseException, file: str, first: int) -> str:
    """Where and how code of a `file` failed, in words: at its last line in the trace of the error,
    or at its `first` line.
    """
    line: int | None = first
    for frame in traceback.extract_tb(error.__traceback__):
        if frame.filename == file:
            line = frame.lineno
    where = f"line {line} of {Path(file).name}"
    return f"{where} with {type(error).__name__}: {one_line(str(error))}"
