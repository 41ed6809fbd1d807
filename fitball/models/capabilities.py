"""What a bounce model can do beside a rebound: other rooms ask for these, not for its name or class."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, Protocol

from fitball.models.types import Rebound
from fitball.values import Impacts

# How far inside an end where the model stops (a restitution of zero, a shell without mass) a search may go, in units
# of the quantity itself: nothing measurable, and far above rounding.
ROUNDING = 1e-6
# A hair inside a bound that a restitution and a mass ratio share: a few times the rounding of either.
HAIR = 1e-12
# The parameters of the lines in `v_y1` that the thesis's kernel is given as values.
LINES = ("eps_10", "eps_slope", "cor_10", "cor_slope")


@dataclass(frozen=True)
class LinearConstraint:
    """`sum(coefficients[name] * value) <= bound`, in SI: where it is broken the model has no answer.

    `margin` is how far inside a search stays, in units of the bound. `lower_bound_of` names a parameter, of
    coefficient -1, for which the others make this a lower bound that moves with them, and on which the best fit often
    lies; `words` say that bound to a reader.
    """

    coefficients: Mapping[str, float]
    bound: float
    margin: float = 0.0
    lower_bound_of: str = ""
    words: str = ""


class Oracle(Protocol):
    """A slow solution of the same motion that shares no formula with the kernel."""

    def steps(self, parameters: Mapping[str, float], impacts: Impacts) -> float:
        """Steps that the impact which takes most would need, of some microseconds each."""

    def rebound(self, parameters: Mapping[str, float], impacts: Impacts, digits: int | None = None) -> Rebound:
        """Rebound of each impact, (impacts,), in double precision or with so many `digits`."""


# How a kernel of one impact is called, as (arguments) -> (results):
#   impulse   (row, v_x1, v_y1, omega_1) -> (status, v_x2, v_y2, omega_2, phases)
#   two-mass  (row, codes, v_x1, v_y1, omega_1, cor, scratch) -> Bounce, see `kernels.quantities`
#   thesis    (row with its offset, code, cor, v_x1, v_y1, omega_1) -> (..., omega_2, contact_time, phases)
Convention = Literal["impulse", "two-mass", "thesis"]


@dataclass(frozen=True)
class KernelCall:
    """The kernel of one impact and its constant arguments, in SI: all that a port needs besides the kernel's source.

    `row` are the numbers named by `columns`, `codes` the closures as the kernel reads them. `lines` holds the lines
    in `v_y1` that the thesis's kernel is given as values (offset and restitution); empty for kernels that evaluate
    them.
    """

    convention: Convention
    entry: Callable[..., Any]
    columns: tuple[str, ...]
    row: tuple[float, ...]
    codes: tuple[int, ...]
    lines: Mapping[str, float]
