"""`Marginal`: one quantity of a fit, with its draws and its summary."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from fitball.base.numbers import counted
from fitball.base.shown import as_html, as_text
from fitball.base.values import FloatArray
from fitball.inference.schema import Estimate

if TYPE_CHECKING:
    from pandas import Series


@dataclass(frozen=True, eq=False, repr=False)
class Marginal:
    """The marginal posterior of a quantity: `draws`, of the same steps for all quantities of a fit,
    none of a point fit, and its row of `Fit.summary`, all in SI.
    """

    estimate: Estimate
    draws: Annotated[FloatArray, "draws"]
    summary: Series

    def __repr__(self) -> str:
        return as_text(self._title, self.summary.to_frame())

    def _repr_html_(self) -> str:
        return as_html(self._title, self.summary.to_frame())

    @property
    def _title(self) -> str:
        return f"{self.estimate.name}, {counted(self.draws.size, 'draw')}, in SI"
