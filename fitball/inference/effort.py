"""What a fit may cost: effort by the user's options, and limits of rows and draws."""

from typing import TypedDict
from zlib import crc32

import msgspec
import numpy as np

from fitball.base.errors import ParameterError, suggestion

# Rows at most, evenly spread, of which residuals are tested.
LONG_ROWS = 3_000
# Rows above which profiles are left out: standard errors are then as good.
PROFILED_ROWS = 300
# Rows at most, evenly spread, to which alternatives are fitted: each is a fit of its own.
ALTERNATIVE_ROWS = 1_000
# Rows above which predictions take fewer than PREDICTION_DRAWS: time and memory do not grow.
PREDICTED_ROWS = 20_000
# Draws of predictions: 100 of them lie beyond either end of a 95 % interval.
PREDICTION_DRAWS = 4_000
# Draws at which derivatives are taken: the error of a mean over them is 8 % of their spread.
DERIVATIVE_DRAWS = 160
# Effective draws of each parameter that end sampling: the error of a median is 4 % of an sd.
TARGET_ESS = 1_000.0
# R-hat of each parameter below which sampling ends, as Vehtari et al. 2021 recommend.
TARGET_R_HAT = 1.01
# Draws times states that are evaluated at once: some twenty arrays of as many numbers are then in
# memory (80 MB).
STATES_AT_ONCE = 500_000

# How the posterior may be sampled.
SAMPLERS = ("weighted", "emcee")


class Effort(msgspec.Struct, frozen=True):
    """The effort of a fit. All random numbers come from the `seed`. If it is `point_only`, only the
    best values are searched for. An ensemble makes `max_steps` at most, and computations use so
    many `cores` (None: all).

    Raises:
        ParameterError: a number is not an int, or too small (`effort`).
    """

    seed: int = 1
    point_only: bool = False
    max_steps: int = 20_000
    cores: int | None = None
    sampler: str = "weighted"

    def __post_init__(self) -> None:
        for name, least in (("seed", 0), ("max_steps", 100), ("cores", 1)):
            value = getattr(self, name)
            if value is not None and not (isinstance(value, int) and value >= least):
                raise ParameterError(
                    f"read {name} = {value!r}; expected an int of at least {least}",
                    "effort",
                )

        if self.sampler not in SAMPLERS:
            words = suggestion(self.sampler, SAMPLERS)
            raise ParameterError(f"read sampler '{self.sampler}'; {words}", "effort")

    def stream(self, purpose: str) -> np.random.Generator:
        """Random numbers for a purpose, such as "search", "chains" or "predict". They do not depend
        on what other purposes drew: a new stage of a fit moves no other. They are those of
        `SeedSequence(seed, spawn_key=(crc32(purpose),))`.
        """
        return np.random.default_rng(
            np.random.SeedSequence(self.seed, spawn_key=(crc32(purpose.encode()),))
        )


class StatedEffort(TypedDict, total=False):
    """The fields of an `Effort` that a user stated."""

    seed: int
    max_steps: int
    point_only: bool
    cores: int
    sampler: str


def stated_effort(
    seed: int | None,
    max_steps: int | None,
    point_only: bool,
    cores: int,
    sampler: str,
) -> StatedEffort:
    """The fields of an `Effort` that a user stated; the others have defaults, or stay as they were
    in a stored fit. A number that is None, no `cores` and an empty `sampler` were not
    stated.
    """
    stated: StatedEffort = {}
    if seed is not None:
        stated["seed"] = seed
    if max_steps is not None:
        stated["max_steps"] = max_steps
    if point_only:
        stated["point_only"] = True
    if cores:
        stated["cores"] = cores
    if sampler:
        stated["sampler"] = sampler
    return stated
