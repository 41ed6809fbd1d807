"""What a fit may cost, and every size that decides by the number of rows or draws."""

from typing import Any
from zlib import crc32

import msgspec
import numpy as np

from fitball.base.errors import ParameterError

# Rows above which draws are weighted and tests take evenly spread rows; profiles are left out;
# alternatives take a part; fewer draws predict. Draws of predictions, of derivatives; targets of
# sampling.
LONG = 3_000
PROFILED = 300
ALTERNATIVES = 1_000
PREDICTED = 20_000
PREDICTING = 4_000
DIFFERENTIATED = 160
TARGET_ESS = 1_000.0
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
