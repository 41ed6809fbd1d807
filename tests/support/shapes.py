"""Shapes of arrays in annotations, held against the arrays that pass while something runs.

`Annotated[FloatArray, "draws rows"]` names the axes of an array. A name is one size within a call,
a number is that size, `...` in front stands for any axes before, an empty text for no axis.
"""

import functools
import importlib
import inspect
import pkgutil
import sys
import types
import typing
from collections import Counter
from contextlib import contextmanager
from dataclasses import dataclass, field, make_dataclass

import numpy as np

RESULT = "return"
# What a dataclass hands on for a field that has a factory and no value.
_NOT_GIVEN = next(
    parameter.default
    for parameter in inspect.signature(
        make_dataclass("Any", [("a", list, field(default_factory=list))])
    ).parameters.values()
)


def unfit(array, shape, sizes):
    """What is wrong with an array of a shape, "" where nothing is; learns the sizes of axes."""
    if not isinstance(array, np.ndarray):
        return f"is a {type(array).__name__}, no array"
    axes = shape.split()
    measured = array.shape
    if axes[:1] == ["..."]:
        axes = axes[1:]
        measured = measured[len(measured) - len(axes) :] if len(measured) >= len(axes) else measured
    if len(measured) != len(axes):
        return f"has the shape {array.shape}, not ({shape})"
    for axis, size in zip(axes, measured, strict=True):
        expected = int(axis) if axis.isdigit() else sizes.setdefault(axis, size)
        if size != expected:
            return f"has the shape {array.shape}, not ({shape}) where {axis} is {expected}"
    return ""


def annotated_shape(annotation):
    """The shape that an annotation names, and whether None may stand in its place; None without."""
    if typing.get_origin(annotation) in (types.UnionType, typing.Union):
        inner = typing.get_args(annotation)
        shapes = [found for found in map(annotated_shape, inner) if found]
        return (shapes[0][0], type(None) in inner) if shapes else None
    if typing.get_origin(annotation) is typing.Annotated:
        return annotation.__metadata__[0], False
    return None


@dataclass
class Shaped:
    """A function with shapes in its annotations, by name of argument or `return`."""

    name: str
    shapes: dict

    def faults(self, values, sizes):
        """What is wrong with arguments or the result, by name, of a call that knows sizes."""
        for name in self.shapes.keys() & values.keys():
            shape, optional = self.shapes[name]
            # A field that nobody gave is made in the body of `__init__`.
            if values[name] is _NOT_GIVEN or (optional and values[name] is None):
                continue
            fault = unfit(values[name], shape, sizes)
            if fault:
                yield f"{self.name}: {name} {fault}"


def modules(package):
    """Every module of a package, imported."""
    yield package
    for _, name, _ in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
        if not name.endswith("__main__"):
            yield importlib.import_module(name)


def functions_of(module):
    """The Python functions that a module defines, methods and properties too, by name."""
    for name, member in vars(module).items():
        if getattr(member, "__module__", None) != module.__name__:
            continue
        if isinstance(member, types.FunctionType):
            yield name, member
        elif inspect.isclass(member):
            for inner, attribute in vars(member).items():
                if isinstance(attribute, property):
                    attribute = attribute.fget
                elif isinstance(attribute, functools.cached_property):
                    attribute = attribute.func
                elif isinstance(attribute, classmethod | staticmethod):
                    attribute = attribute.__func__
                if isinstance(attribute, types.FunctionType):
                    yield f"{name}.{inner}", attribute


def shaped_functions(package):
    """Functions of a package with shapes in annotations, by the identity of their code.

    What a dataclass generates is among them, so that fields are held as it is made. Code of two
    such functions may be equal, so equality does not serve.
    """
    shaped = {}
    for module in modules(package):
        for name, function in functions_of(module):
            function = inspect.unwrap(function)
            shapes = shapes_of(function)
            if shapes:
                shaped[id(function.__code__)] = Shaped(f"{module.__name__}.{name}", shapes)
    return shaped


def shapes_of(function):
    """The shapes in a function's annotations, by name of argument or `return`.

    Only annotations with a shape are evaluated: others may name what checkers alone import.
    """
    shapes = {}
    for name, annotation in function.__annotations__.items():
        if "Annotated" not in str(annotation):
            continue
        if isinstance(annotation, str):
            annotation = eval(annotation, function.__globals__)
        shape = annotated_shape(annotation)
        if shape:
            shapes[name] = shape
    return shapes


@dataclass
class Trace:
    """Calls that were held: how many by function, and what was wrong."""

    calls: Counter = field(default_factory=Counter)
    faults: list = field(default_factory=list)


@contextmanager
def held(shaped):
    """Holds each call of the shaped functions against its annotations while the context lasts."""
    trace = Trace()
    sizes = {}

    def hold(frame, event, value):
        function = shaped.get(id(frame.f_code))
        if function is None:
            return
        if event == "call":
            sizes[id(frame)] = {}
            trace.calls[function.name] += 1
            trace.faults += function.faults(frame.f_locals, sizes[id(frame)])
        elif event == "return":
            # A function that raises returns nothing here.
            known = sizes.pop(id(frame), {})
            if value is not None:
                trace.faults += function.faults({RESULT: value}, known)

    before = sys.getprofile()
    sys.setprofile(hold)
    try:
        yield trace
    finally:
        sys.setprofile(before)
