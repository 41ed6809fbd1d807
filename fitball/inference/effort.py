"""What a fit may cost, and every size that decides by the number of rows or draws."""

from typing import Any
from zlib import crc32

import msgspec
import numpy as np

from fitball.base.errors import ParameterError

# Rows above which chains take too long: draws of an approximation are weighted instead, and tests
# take evenly spread rows.
LONG = 3_000
# Rows above which profiles are left out: standard errors are then as good as they are.
PROFILED = 300
# Rows of a longer table, evenly spread, with which alternatives are fitted: each is a whole fit.
ALTERNATIVES = 1_000
# Rows above which fewer than PREDICTING draws predict, so that memory and time stay as they are.
PREDICTED = 20_000
# Draws of predictions: 100 of them are beyond either end of a 95 % interval.
PREDICTING = 4_000
# Draws at which derivatives are taken: a mean over them has 8 % of their spread as its error.
DIFFERENTIATED = 160
# Independent draws that sampling wants of each parameter: a median is known to 4 % of an sd.
TARGET_ESS = 1_000.0
# The largest split R-hat of sampling, as Vehtari et al. 2021 recommend.
TARGET_R_HAT = 1.01
# Draws times states that are evaluated at once: some twenty arrays of as many numbers live at a
# time (80 MB).
AT_ONCE = 500_000


class Effort(msgspec.Struct, frozen=True):
    """`seed` of all random numbers, `point_only`, `max_steps` of each ensemble, `cores` (None:
    all). Raises ParameterError (`effort`).
    """

    seed: int = 1
    point_only: bool = False
    max_steps: int = 20_000
    cores: int | None = None

    def __post_init__(self) -> None:
        for name, least in (("seed", 0), ("max_steps", 100), ("cores", 1)):
            value = getattr(self, name)
            if value is not None and not (isinstance(value, int) and value >= least):
                raise ParameterError(
                    f"read {name} = {value!r}; expected an int of at least {least}",
                    "effort",
                )

    def stream(self, purpose: str) -> np.random.Generator:
        """Random numbers of "search", "chains", "predict" and so on: independent of what other
        purposes drew, so a new stage moves no other. `SeedSequence(seed,
        spawn_key=(crc32(purpose),))`.
        """
        return np.random.default_rng(
            np.random.SeedSequence(self.seed, spawn_key=(crc32(purpose.encode()),))
        )


def stated_effort(
    seed: int | None,
    max_steps: int | None,
    point_only: bool,
    cores: int,
) -> dict[str, Any]:
    """Those fields of an Effort that a user stated, by name; the rest is as it was, or default."""
    fields: dict[str, int | bool | None] = {
        "seed": seed,
        "max_steps": max_steps,
        "point_only": point_only or None,
        "cores": cores or None,
    }
    return {name: value for name, value in fields.items() if value is not None}
