"""What a model hands to its kernel for one parameter set: all that a port of it needs besides the kernel's source."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fitball.errors import ModelError
from fitball.models.grip_slip import GripSlipModel
from fitball.models.kernels import algebraic, bounce
from fitball.models.model import Model
from fitball.models.thesis import kernel as thesis
from fitball.models.thesis.model import DAMPING_CODES, ThesisModel
from fitball.models.two_mass_model import TwoMassModel
from fitball.values import FloatArray

THESIS_COLUMNS = (
    "mass_ratio", "k_y", "k_theta", "mu", "eps", "c_y", "inertia_split", "ball_mass", "ball_radius", "ball_inertia"
)  # fmt: skip
LINES = ("eps_10", "eps_slope", "cor_10", "cor_slope")


@dataclass(frozen=True)
class KernelCall:
    """The kernel of one impact and its constant arguments, in SI.

    `row` are the numbers named by `columns`, `codes` the closures as the kernel reads them. `lines` holds the lines
    in `v_y1` that the thesis's kernel is given as values (offset and restitution); empty for kernels that evaluate
    them.
    """

    entry: Callable[..., Any]
    columns: tuple[str, ...]
    row: tuple[float, ...]
    codes: tuple[int, ...]
    lines: Mapping[str, float]


def kernel_call(model: Model, names: Sequence[str], values: FloatArray) -> KernelCall:
    """The call that `model.evaluate` makes for `values` (names,). Raises ModelError for a model without a kernel."""
    rows = np.asarray(values, dtype=np.float64)[None, :]
    if isinstance(model, GripSlipModel):
        return KernelCall(algebraic.algebraic_bounce, algebraic.COLUMNS, _numbers(model._rows(names, rows)), (), {})
    if isinstance(model, TwoMassModel):
        codes = tuple(int(code) for code in model.codes)
        return KernelCall(bounce.bounce, bounce.COLUMNS, _numbers(model._rows(names, rows)), codes, {})
    if isinstance(model, ThesisModel):
        row, index = model._rows(names, rows)
        lines = {name: float(rows[0, index[name]]) if name in index else 0.0 for name in LINES}
        code = DAMPING_CODES[model.closures.damping]
        return KernelCall(thesis.thesis_bounce, THESIS_COLUMNS, _numbers(row), (code,), lines)
    raise ModelError(f"model {model.name} has no kernel of one impact")


def _numbers(rows: FloatArray) -> tuple[float, ...]:
    return tuple(float(value) for value in rows[0])
