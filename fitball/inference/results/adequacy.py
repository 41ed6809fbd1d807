"""Whether the model describes the table, as frozen values. Nothing is computed here; see `inference.adequacy`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from fitball.data.table import FrozenMapping

# Chances that a table which the model made is said to be described only with an exception, or not at all.
FALSE_EXCEPT, FALSE_FAILS = 0.05, 0.01
# A parameter that a misfit moves by more than so many of its standard deviations is known conditionally only.
MOVED = 1.0
# A noise that is so many times what the scene states is an exception however wide its prior.
FAR_FROM_STATED = 3.0


class Answer(StrEnum):
    """Does the model describe the table?"""

    DESCRIBES = "describes"
    EXCEPT = "describes except"
    FAILS = "does not describe"
    UNTOLD = "cannot be told"


@dataclass(frozen=True)
class NoiseCheck:
    """The noise that residuals of `columns` show against what was stated (`stated`) or expected; `assumed` where the
    scene says nothing of it, so that the expectation is fitball's own, or a prior that was chosen.

    `fitted` is the root mean square residual by degree of freedom, `reference` the stated size or the prior's median,
    both in `unit`; of noises stated row by row both are in units of these. `ratio` is the one over the other, `p` the
    probability of one as large: under the stated noise, or under the prior. `adjusted` is that of any noise or
    pattern as improbable, and `found` whether it makes an exception.
    """

    noise: str
    columns: tuple[str, ...]
    unit: str
    stated: bool
    fitted: float
    reference: float
    degrees_of_freedom: float
    ratio: float
    p: float
    adjusted: float
    found: bool
    assumed: bool = False


@dataclass(frozen=True)
class Check:
    """One look for a pattern in the residuals of `column`, `over` a quantity, a group or another column.

    `statistic` is what was seen, `usual` what 95 % of the tables that the model made stay below in size, and `p` the
    probability that such a table shows as much in any of all checks. `explained` is the share of the residual
    variance that the pattern explains, `size` its root mean square in units of the noise (None: it has none).
    """

    kind: str
    column: str
    over: str
    words: str
    statistic: float
    usual: float
    p: float
    explained: float | None
    size: float | None
    found: bool


@dataclass(frozen=True)
class Misfit:
    """One measurement far from its prediction, in SI, and its distance in standard deviations of what the model
    predicts for a measurement that took no part in the fit (to first order).
    """

    id: str
    column: str
    unit: str
    measured: float
    predicted: float
    distance: float


@dataclass(frozen=True)
class Adequacy:
    """The answer, in a `sentence`, and what it is based on.

    `exceptions` are what was found, in words; `moved` by how many of its sds each free parameter would move if the
    largest of the patterns found were taken out; `given` names the kind of noise that sizes of noise rest on which
    outliers make larger. `unseen` is the share of the residual variance that a pattern must
    explain to be found at all, by column. `loo_pit` are the probabilities that a measurement of a column exceeds its
    prediction by all the other impacts (empty where there are too few, or so many that none matters), `replicates`
    the number of tables that the checks were held against.
    """

    answer: Answer
    sentence: str
    based_on: str
    exceptions: tuple[str, ...]
    noise: tuple[NoiseCheck, ...]
    checks: tuple[Check, ...]
    misfits: tuple[Misfit, ...]
    moved: Mapping[str, float]
    unseen: Mapping[str, float]
    loo_pit: Mapping[str, tuple[float, ...]]
    replicates: int
    given: Mapping[str, tuple[str, ...]] = field(default_factory=FrozenMapping)

    def why(self, name: str) -> str:
        """What a conditional parameter `name` rests on, before a reason that would hold then."""
        if self.answer is Answer.FAILS:
            return "if the model described it"
        return f"without what the model misses it would move by {self.moved[name]:.2g} of its sds; if it did not"

    def conditional(self, name: str) -> bool:
        """Whether what the table says of parameter `name` holds only if the misfits do not matter."""
        return self.answer is Answer.FAILS or self.moved.get(name, 0.0) > MOVED
