"""A plan: frozen values only. Gains are in nats, everything else in SI, angles in radians."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from fitball.inference.design.settings import Setting, Settings
from fitball.inference.design.target import Part
from fitball.values import FloatArray, Impacts


@dataclass(frozen=True)
class Chosen:
    """A recommended impact, read by the `sensor`, after those before it: the `gain` that it adds for all its repeats,
    the standard deviations (parts,) of the target expected then, the share of draws without an answer there, and
    phase sequences with their probabilities.
    """

    setting: Setting
    sensor: str
    gain: float
    sds: FloatArray
    unsolved: float
    regimes: Mapping[str, float]


@dataclass(frozen=True)
class Worth:
    """What one way of measuring is worth, to first order: its best single impact with its `gain`; of the whole batch
    read that way the gain `batch` and the expected sds (parts,) after it.
    """

    sensor: str
    words: str
    cost: float
    best: Setting
    gain: float
    batch: float
    sds: FloatArray


@dataclass(frozen=True)
class Plan:
    """What to measure next.

    `sds` (parts,) are those of the posterior, in coordinates (of `log` parts those of the logarithm), of the target's
    `parts`. `gains` (surfaces, speeds, angles, spins) are of one impact measured as before, at most that share of
    whose draws cannot be evaluated; else NaN. `chosen` are in the order of choice, each made `repeats` times;
    `again` and `again_sds` are what as many impacts of the fitted table, measured again, would tell to first order.
    `worths` begin with measuring as before. `failed` maps reasons why draws cannot be evaluated to the number of
    settings withheld for it. `draws` were averaged over, `lost` of them without the target.
    """

    target: str
    parts: tuple[Part, ...]
    sds: FloatArray
    settings: Settings
    gains: FloatArray
    chosen: tuple[Chosen, ...]
    repeats: int
    again: float
    again_sds: FloatArray
    worths: tuple[Worth, ...]
    measured: Impacts
    by_cost: bool
    failed: Mapping[str, int]
    draws: int
    lost: float
    seed: int
    notes: tuple[str, ...]

    @property
    def gain(self) -> float:
        """Nats that all chosen impacts tell, to first order."""
        return float(sum(one.gain for one in self.chosen))
