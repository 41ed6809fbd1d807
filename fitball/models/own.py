"""Models of one's own: a Python function with priors as defaults, tried before use."""

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
from fitball.models.specs import BALL_PARAMETERS, NAMES, SPECS, TAKEN
from fitball.models.types import Rebound, Status

# Parameters of fitball that a function may have; they keep their unit, bounds and meaning.
SHARED = ("mu", "e_x", "offset", "cor_10", "cor_slope")
ARGUMENTS = (*STATE, "ball")
GIVES = ("v_x2", "v_y2", "omega_2")
# Bounds of a parameter that its prior leaves open: finite, so that figures have ends, beyond any
# quantity in SI.
LARGEST = 1e12
# Impacts, and draws of the priors, at which a function is tried.
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
    """Rebounds by a Python `function` whose rows are draws times impacts."""

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
        """See `Model.evaluate`. Raises ModelError (`own-model`)."""
        shape = (len(values), len(impacts))

        def rows(column: FloatArray | float) -> FloatArray:
            # A copy, which the function may change.
            return np.array(np.broadcast_to(column, shape), dtype=np.float64).ravel()

        given = {name: rows(values[:, [place]]) for place, name in enumerate(names)}
        mass, radius, ratio = (
            given.pop(name, rows(own))
            for name, own in zip(
                BALL_PARAMETERS,
                (ball.mass, ball.radius, ball.inertia_ratio),
                strict=True,
            )
        )
        state = [rows(getattr(impacts, name)) for name in STATE]
        towards = state[1] > 0.0
        out = self._called(state, RowBalls(mass, radius, ratio * mass * radius**2), given)
        answered = np.isfinite(out).all(axis=0)
        out[:, ~(answered & towards)] = np.nan
        status = np.where(
            towards,
            np.where(answered, Status.OK, Status.NO_ANSWER),
            Status.NO_IMPACT,
        )
        v_x2, v_y2, omega_2 = out.reshape(3, *shape)
        none = np.full(shape, np.nan)
        regime = np.zeros(shape, np.int64)
        return Rebound(v_x2, v_y2, omega_2, none, none, none, none, regime, status.reshape(shape))

    def _called(
        self,
        state: list[FloatArray],
        balls: RowBalls,
        given: Mapping[str, FloatArray],
    ) -> FloatArray:
        """What the function gives, (3, rows)."""
        try:
            with np.errstate(all="ignore"):
                found = self.function(*state, balls, **given)
        except (Exception, SystemExit) as error:
            code = _plain(self.function).__code__
            hint = ". Its arguments are arrays: use np.where instead of if" * (
                "truth value" in str(error)
            )
            raise self.fault(
                f"fails at {_failed(error, code.co_filename, code.co_firstlineno)}{hint}"
            ) from None
        wanted = (
            f"expected three arrays {', '.join(GIVES)}, one number for each of the "
            f"{len(state[0])} rows"
        )
        if not isinstance(found, tuple | list | np.ndarray) or len(found) != len(GIVES):
            raise self.fault(f"returns a {type(found).__name__}; {wanted}")
        columns = [np.asarray(column) for column in found]
        for name, column in zip(GIVES, columns, strict=True):
            if column.shape != state[0].shape or column.dtype.kind not in "iuf":
                raise self.fault(
                    f"returns {name} of shape {column.shape} and type {column.dtype}; {wanted}"
                )
        return np.array(columns, dtype=np.float64)

    def fault(self, text: str) -> ModelError:
        """What is wrong with the function."""
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
    text, function = (
        (function, _from_file(function)) if isinstance(function, str) else ("", function)
    )
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
    made = Model(name, text or name, Ball(), {}, _specs(solver, plain), solver, source=digest)
    _try(made, solver)
    return made


def _plain(function: Any) -> Any:
    """What was written with def, of a compiled or wrapped function too."""
    return inspect.unwrap(getattr(function, "py_func", function))


def _specs(solver: OwnSolver, function: types.FunctionType) -> tuple[ParameterSpec, ...]:
    """Parameters of a function, from its arguments behind ARGUMENTS."""
    arguments = inspect.signature(function).parameters
    if tuple(arguments)[: len(ARGUMENTS)] != ARGUMENTS or len(arguments) == len(ARGUMENTS):
        raise solver.fault(
            f"takes ({', '.join(arguments)}); expected ({', '.join(ARGUMENTS)}) and its "
            "parameters with priors as "
            "defaults, such as e_y='uniform(0, 1)'"
        )
    taken = {
        *SPECS,
        *TAKEN,
        *(column.noise.name for column in COLUMNS.values() if column.noise),
    } - {*SHARED}
    specs = []
    for key, argument in list(arguments.items())[len(ARGUMENTS) :]:
        if key in taken or key.endswith("_spread"):
            raise solver.fault(
                f"has a parameter {key}, which has another meaning in fitball. Rename it"
            )
        if not isinstance(argument.default, str):
            raise ParameterError(
                f"model {solver.name}: parameter {key} has no prior; expected a text as default, "
                "such as "
                f"{key}='uniform(0, 1)'",
                "prior",
            )
        specs.append(_spec(key, argument.default))
    return tuple(specs)


def _spec(key: str, text: str) -> ParameterSpec:
    """A parameter with its prior, whose support are its bounds unless it is a parameter of
    fitball.
    """
    head, _, index = key.partition("_")
    symbol = rf"$\mathrm{{{head}}}" + (rf"_\mathrm{{{index.replace('_', ',')}}}$" if index else "$")
    free = ParameterSpec(
        key,
        "",
        -LARGEST,
        LARGEST,
        "",
        f"{key}, a parameter of your function",
        symbol,
    )
    spec = replace(SPECS[key] if key in SHARED else free, prior=text.strip())
    prior = parse_prior(spec)
    if key in SHARED:
        return spec
    lower, upper = prior.value(np.array([prior.lower, prior.upper])).tolist()
    return replace(spec, lower=lower, upper=upper, logarithmic=prior.log)


def _try(model: Model, solver: OwnSolver) -> None:
    """Call a function on some impacts at draws of its priors. Raises ModelError if it fails, has no
    answer at any, or mixes rows.
    """
    rng = np.random.default_rng(1)
    given = Impacts(
        rng.uniform(2.0, 30.0, TRIED),
        rng.uniform(3.0, 20.0, TRIED),
        rng.uniform(-400.0, 400.0, TRIED),
    )
    names = [spec.name for spec in model.parameters]
    draws = np.stack(
        [parse_prior(spec).quantile(rng.uniform(size=TRIED)) for spec in model.parameters],
        axis=1,
    )
    whole = model.evaluate(names, draws, given)
    if not np.any(whole.status == Status.OK):
        row = ", ".join(f"{key} = {value:.4g}" for key, value in zip(names, draws[0], strict=True))
        raise solver.fault(
            f"gives a number that is not finite for each of {TRIED} impacts at {TRIED} draws of "
            "its priors, such as "
            f"v_x1 = {given.v_x1[0]:.4g} m/s, v_y1 = {given.v_y1[0]:.4g} m/s, omega_1 = "
            f"{given.omega_1[0]:.4g} rad/s "
            f"at {row}"
        )
    # Each impact alone: a function that takes the largest speed is right about the fastest impact.
    for k in range(TRIED):
        alone = model.evaluate(names, draws[[k]], given.take(np.array([k])))
        for column in GIVES:
            one = getattr(alone, column)[0, 0]
            among = getattr(whole, column)[k, k]
            # Vectorised functions may round a row differently by its place.
            if not np.isclose(one, among, rtol=1e-9, atol=1e-12, equal_nan=True):
                raise solver.fault(
                    f"gives {column} = {one:.6g} for an impact alone, and {among:.6g} among "
                    "others. Each row must "
                    "depend on itself alone"
                )


def _from_file(text: str) -> Callable[..., Any]:
    """The function of FILE.py:NAME. The file is run; it is no module, so that other processes get
    the function itself instead of its address.
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
        line = (error.lineno if isinstance(error, SyntaxError) else None) or 1
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
    found: Callable[..., Any] = names[name]
    return found


def _failed(error: BaseException, file: str, first: int) -> str:
    """Where and how: the last line of this file in the trace, or its `first`."""
    lines = [
        frame.lineno
        for frame in traceback.extract_tb(error.__traceback__)
        if frame.filename == file
    ]
    where = f"line {lines[-1] if lines else first} of {Path(file).name}"
    return f"{where} with {type(error).__name__}: {one_line(str(error))}"
