"""Derivatives of a rebound with respect to what goes into it, and the complex step that gives them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from fitball.models.kernels.dual import STEP, NumberArray
from fitball.models.types import OUTPUTS, Rebound
from fitball.values import FloatArray, Impacts, OwnImpacts

INPUTS = ("v_x1", "v_y1", "omega_1")


@dataclass(frozen=True)
class ReboundJacobian:
    """A rebound, (draws, impacts), and its derivatives, SI units; the outputs are in the order of `OUTPUTS`.

    `inputs` (draws, impacts, 4, 3): with respect to `INPUTS`, including what the lines of `eps` and of the
    restitution make of `v_y1`. `parameters` (draws, impacts, 4, names): with respect to `names`. `cor` (draws,
    impacts, 4): with respect to the impact's own measured restitution, which the closure `cor = measured` makes an
    input independent of the speeds; None without that closure. All are those of the regime the impact is in; on the
    boundary of two regimes the rebound has a kink, and they are one-sided. Where the status is not OK they are NaN,
    as is the contact time of models that have none.
    """

    rebound: Rebound
    names: tuple[str, ...]
    inputs: FloatArray
    parameters: FloatArray
    cor: FloatArray | None


def by_output(slopes: FloatArray) -> dict[str, FloatArray]:
    """Derivatives (..., outputs, inputs) as a view (..., inputs) of each output, by name."""
    return {name: slopes[..., place, :] for place, name in enumerate(OUTPUTS)}


def seeds(
    rows: Callable[[Sequence[str], NumberArray], NumberArray],
    names: Sequence[str],
    values: FloatArray,
    parameters: Sequence[str],
) -> FloatArray:
    """What each column of `rows(names, values)` gains per unit of a parameter, (parameters, draws, columns)."""
    moved = np.repeat(values[None].astype(np.complex128), len(parameters), axis=0)
    for k, name in enumerate(parameters):
        moved[k, :, list(names).index(name)] += 1j * STEP
    gains = rows(names, moved.reshape(-1, values.shape[1])).imag / STEP
    return gains.reshape(len(parameters), values.shape[0], gains.shape[1])


@dataclass(frozen=True)
class Moved:
    """What a model is given to find derivative number `place`: all as it is but for the one input that is moved."""

    place: int
    values: NumberArray
    v_x1: NumberArray
    v_y1: NumberArray
    omega_1: NumberArray
    cor: NumberArray | None


def moved_inputs(
    names: Sequence[str], values: FloatArray, impacts: Impacts | OwnImpacts, parameters: Sequence[str]
) -> Iterator[Moved]:
    """One complex step after the other: along `INPUTS`, the measured restitution if there is one, `parameters`."""
    given = [column for column in impacts.states() if column is not None]
    for place in range(len(given) + len(parameters)):
        moved = values.astype(np.complex128)
        if place >= len(given):
            moved[:, list(names).index(parameters[place - len(given)])] += 1j * STEP
        inputs = [column + (1j * STEP if k == place else 0j) for k, column in enumerate(given)]
        yield Moved(place, moved, inputs[0], inputs[1], inputs[2], inputs[3] if len(inputs) > 3 else None)
