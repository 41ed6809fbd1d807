"""A model from a Python function, see `model_from`; and from a file, as `--model FILE:NAME` names it."""

from __future__ import annotations

import hashlib
import inspect
import sys
import textwrap
import traceback
import types
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from fitball.errors import FitballError, ModelError, ParameterError, suggestion
from fitball.inference.problem.parameters import FAMILIES, NOISE_SPECS, parse_prior
from fitball.kinds import checked
from fitball.models.model import COR, INPUT_COUNT, INPUTS
from fitball.models.own import GIVES, SHARED, SOURCE, OwnFunction, OwnModel, compose_own, known, model_of, spec
from fitball.models.registry import MODELS
from fitball.models.specs import SPECS
from fitball.models.types import Status
from fitball.values import Ball, FloatArray, Impacts
from fitball.visible import one_line
from fitball.wording import spoken

ARGUMENTS = (*INPUTS, "ball")
# In a file: priors by name, of all its functions.
IN_FILE = "PARAMETERS"
ENDING = ".py:"
# A model: its name, FILE:NAME, or what `model_from` returns.
AnyModel: TypeAlias = str | OwnModel
# Draws of the priors and incident states at which a function is tried, and how well derivatives must agree there, as
# central differences can.
TRIED, AGREE = 24, 1e-5
LETTERS = 16


@checked
def model_from(
    function: Callable[..., Any], parameters: Mapping[str, str] | None = None, *, name: str | None = None
) -> OwnModel:
    """A model from a Python function, for `calibrate(model=...)`, `compare` and everything that follows.

    The function takes `v_x1`, `v_y1` [m/s], `omega_1` [rad/s], `ball` with `mass`, `radius`, `inertia` [SI], and its
    parameters by name. Each is an array (rows,), and each row is another impact: write it with numpy, without `if`,
    or with `numba.njit` and a loop. It returns `v_x2`, `v_y2`, `omega_2`, each (rows,). A number that is not finite
    means that the model has no answer there.

    `parameters` are priors as texts, `{"e_t": "uniform(-1, 1)"}`; an argument may have its prior as default instead.
    A uniform prior bounds its parameter. Parameters named mu, e_x, offset, cor_10 or cor_slope keep unit, bounds and
    meaning in fitball. `name` is that of the model (default: that of the function). Derivatives are complex steps
    if the function takes complex numbers and these agree with differences, else they are differences.

    A fit keeps the name and a hash of the source: of the function, and of functions and numbers of its module that it
    uses. Raises ModelError for a function that cannot be used, ParameterError for a prior.

    >>> def superball(v_x1, v_y1, omega_1, ball, e_y="uniform(0, 1)"):
    ...     return -v_x1, e_y * v_y1, -omega_1
    >>> fitball.model_from(superball).parameter_names
    ('e_y',)
    """
    own = getattr(function, "py_func", function)
    if not isinstance(own, types.FunctionType):
        raise ModelError(
            f"read {type(function).__name__}, expected a function written with def, or one of numba.njit"
        )
    called = own.__name__ if name is None else name
    if called in MODELS:
        raise ModelError(f"the name {called} is that of a model of fitball: choose another with name=...")
    if not called.replace("-", "_").isidentifier():
        raise ModelError(
            f"name {called!r}: expected letters, digits, _ and -, such as superball; choose it with name=..."
        )
    priors = _priors(called, own, parameters)
    source = _source(called, own, tuple(priors))
    rng = np.random.default_rng(1)
    drawn, widths = {}, {}
    for key, text in priors.items():
        own_spec = spec(key, text)
        prior = parse_prior(key, text, own_spec.lower, own_spec.upper, own_spec.unit)
        drawn[key] = prior.draw(rng, TRIED)
        low, high = prior.quantile(np.array([0.16, 0.84]))
        widths[key] = float(high - low)
    tried = OwnFunction(called, source, function, priors, widths, stepped=True)
    known(replace(tried, stepped=_try(tried, drawn)))
    return compose_own(called, Ball(), True, {})


def _priors(name: str, function: types.FunctionType, parameters: Mapping[str, str] | None) -> dict[str, str]:
    """The priors of the arguments, in their order. Raises ModelError, ParameterError."""
    arguments = inspect.signature(function).parameters
    head = tuple(arguments)[: len(ARGUMENTS)]
    if head != ARGUMENTS or any(item.kind in (item.VAR_KEYWORD, item.VAR_POSITIONAL) for item in arguments.values()):
        raise ModelError(
            f"model {name}: the function takes ({', '.join(arguments)}), expected ({', '.join(ARGUMENTS)}, and its "
            "parameters by name)"
        )
    given = dict(parameters or {})
    own = [key for key in arguments if key not in ARGUMENTS]
    for key in given:
        if key not in own:
            raise ParameterError(f"model {name}: the function takes no parameter '{key}': {suggestion(key, own)}")
    found = {}
    for key in own:
        text = given.get(key, arguments[key].default)
        if not isinstance(text, str):
            raise ParameterError(
                f"model {name}: parameter {key} has no prior: expected a text, such as parameters={{'{key}': "
                f"'uniform(0, 1)'}}, or {key}='uniform(0, 1)' in the function; forms: "
                f"{', '.join(item.form for item in FAMILIES.values())}"
            )
        if (key in SPECS and key not in SHARED) or key in NOISE_SPECS:
            raise ParameterError(f"model {name}: {key} is a parameter of fitball with another meaning; rename it")
        if parse_prior(key, text, -np.inf, np.inf).has_mass:
            found[key] = text.strip()
    if not found:
        raise ModelError(f"model {name}: the function has no parameter to fit after {', '.join(ARGUMENTS)}")
    return found


def _source(name: str, function: types.FunctionType, parameters: tuple[str, ...]) -> str:
    """The hash of what the function is made of. Raises ModelError if its text cannot be read."""
    digest = hashlib.sha256(" ".join(parameters).encode())
    try:
        for part in _parts(function, set()):
            digest.update(part.encode())
    except (OSError, TypeError, ValueError) as error:
        raise ModelError(
            f"model {name}: the source of the function cannot be read ({one_line(str(error))}); define it in a file "
            "or in a cell of a notebook"
        ) from None
    return digest.hexdigest()[:LETTERS]


def _parts(function: types.FunctionType, seen: set[str]) -> Iterator[str]:
    """Sources of the function and of those of its module that it calls, and values of the names that it reads."""
    yield textwrap.dedent(inspect.getsource(function))
    for name, value in sorted(_read(function).items()):
        own = getattr(value, "py_func", value)
        if name in seen:
            continue
        seen.add(name)
        if isinstance(own, types.FunctionType) and own.__module__ == function.__module__:
            yield from _parts(own, seen)
        elif isinstance(value, int | float | complex | str | tuple | list | dict):
            yield f"{name}={value!r}"
        elif isinstance(value, np.ndarray):
            yield f"{name}={value.tolist()!r}"


def _read(function: types.FunctionType) -> dict[str, Any]:
    """What a function reads of its module and of functions around it, those inside it and its comprehensions too
    (which are functions before Python 3.12).
    """
    codes, names = [function.__code__], set[str]()
    for code in codes:
        names.update(code.co_names)
        codes += [item for item in code.co_consts if isinstance(item, types.CodeType)]
    known = function.__globals__
    return {name: known[name] for name in names if name in known} | dict(inspect.getclosurevars(function).nonlocals)


def _try(tried: OwnFunction, drawn: Mapping[str, FloatArray]) -> bool:
    """Whether complex steps give the derivatives of a function, from some impacts at draws of its priors.

    Raises ModelError if the function fails, has no finite answer at any, or mixes rows.
    """
    rng = np.random.default_rng(2)
    given = Impacts(rng.uniform(2.0, 30.0, TRIED), rng.uniform(3.0, 20.0, TRIED), rng.uniform(-400.0, 400.0, TRIED))
    names, values = tuple(drawn), np.stack([*drawn.values()], axis=1)
    model = model_of(tried.name, Ball(), True, tried.source, tried.priors, tried)
    whole = model.evaluate(names, values, given)
    if not np.any(whole.status == Status.OK):
        row = ", ".join(f"{name} = {value:.4g}" for name, value in zip(names, values[0], strict=True))
        raise ModelError(
            f"model {tried.name}: the function gives a number that is not finite for every one of {TRIED} impacts at "
            f"{TRIED} draws of the priors. Impact 1 has v_x1 = {given.v_x1[0]:.4g} m/s, "
            f"v_y1 = {given.v_y1[0]:.4g} m/s, omega_1 = {given.omega_1[0]:.4g} rad/s, draw 1 {row}"
        )
    alone = model.evaluate(names, values[-1:], given.take(np.array([TRIED - 1])))
    for name in GIVES:
        last, one = getattr(whole, name)[-1, -1], getattr(alone, name)[0, 0]
        if not np.isclose(last, one, rtol=1e-9, atol=1e-12, equal_nan=True):
            raise ModelError(
                f"model {tried.name}: the function gives {name} = {one:.6g} for an impact alone and {last:.6g} among "
                "others: each row must depend on itself alone"
            )
    differences = model.differences(names, values, given, names)
    try:
        steps = super(OwnModel, model).slopes(names, values, given, names)
    except FitballError:
        # It takes no complex numbers.
        return False
    places = [*range(COR), *range(INPUT_COUNT, INPUT_COUNT + len(names))]
    one, other = (item[:, :, : len(GIVES), places] for item in (steps, differences))
    both = np.isfinite(other)
    scale = np.max(np.abs(other), axis=(0, 1), where=both, initial=1e-9)
    return bool(np.all(np.abs(one - other)[both] <= (AGREE * scale * np.ones_like(other))[both]))


def named_model(model: AnyModel) -> str:
    """The name of a model; of `FILE.py:NAME` the file is run, and its function known from now on.

    Raises ModelError for a file or function that cannot be used.
    """
    return model.known.name if not isinstance(model, str) else own_model(model).name if ENDING in model else model


def own_model(text: str) -> OwnModel:
    """The model of `FILE.py:NAME`. The file is run; its `PARAMETERS`, if any, are priors by name."""
    file, _, name = text.rpartition(":")
    path = Path(file)
    if not file.endswith(".py") or not name.isidentifier():
        raise ModelError(f"model {text}: expected FILE.py:NAME, such as mymodel.py:rebound")
    try:
        code = compile(path.read_bytes(), str(path.resolve()), "exec")
    except (OSError, SyntaxError, ValueError) as error:
        raise ModelError(f"model {text}: {path} cannot be read as Python: {one_line(str(error))}") from None
    module = types.ModuleType(f"{path.stem} of a model")
    module.__file__ = str(path.resolve())
    # Known by name only while it runs, so that other processes get the function itself.
    sys.modules[module.__name__] = module
    try:
        exec(code, vars(module))
    except Exception as error:
        lines = [
            item.lineno for item in traceback.extract_tb(error.__traceback__) if item.filename == module.__file__
        ]
        where = f"line {lines[-1]} of " if lines else ""
        raise ModelError(
            f"model {text}: {where}{path} fails with {type(error).__name__}: {one_line(str(error))}"
        ) from None
    finally:
        del sys.modules[module.__name__]
    if not callable(found := getattr(module, name, None)):
        functions = [key for key, value in vars(module).items() if callable(value)]
        raise ModelError(f"model {text}: {path} has no function '{name}': {suggestion(name, functions)}")
    listed = getattr(module, IN_FILE, {})
    if not isinstance(listed, Mapping):
        raise ModelError(f"model {text}: {IN_FILE} of {path} is a {type(listed).__name__}, expected a dict of priors")
    taken = inspect.signature(getattr(found, "py_func", found)).parameters
    return model_from(found, {key: value for key, value in listed.items() if key in taken})


def check_same(path: Path, name: str, options: Mapping[str, str], model: AnyModel) -> None:
    """Raise ModelError unless a saved fit, with this model and options, is of the function given again."""
    if SOURCE not in options:
        given = spoken("--model", "model")
        raise ModelError(f"{path}: the fit is of model {name}, which fitball has: leave out {given}")
    own = own_model(model) if isinstance(model, str) else model
    if (own.name, own.options[SOURCE]) != (name, options[SOURCE]):
        raise ModelError(
            f"{path}: read function {own.name} of source {own.options[SOURCE]}, but the fit was made with {name} of "
            f"source {options[SOURCE]}. Give the function as it was, or fit again"
        )
