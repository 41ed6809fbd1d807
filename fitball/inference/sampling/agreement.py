"""Whether weighted draws and chains say the same: shares of modes, medians, widths, heights."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np

from fitball.base.values import FloatArray
from fitball.inference.sampling.parts import Parts

# Distance of two medians at most, in half widths of the 68 % interval, which are sds.
MOST_SHIFT = 0.15
# Difference of two half widths at most, as a share.
MOST_WIDENING = 0.1
# Standard errors at most by which shares of modes differ; a median or width of a mode of few draws
# may differ by as many too. More than 3.5 have a chance of 1 in 2,000.
MOST_ERRORS = 3.5
# Standard errors of a median, in sds, and of a half width, as a share, of one normal draw.
ERROR_OF_MEDIAN = 1.25
ERROR_OF_WIDTH = 0.96
# Log density by which the highest draw of chains exceeds that of weighted draws at most. Of 5,000
# draws in twenty coordinates the highest lies 2 below the peak.
MOST_ABOVE = 4.0
# Effective draws of a mode, of both kinds, below which only its share is compared.
LEAST_DRAWS = 50.0


class Sample(NamedTuple):
    """Draws of a posterior of which so many are `effective`."""

    x: Annotated[FloatArray, "draws coordinates"]
    scores: Annotated[FloatArray, "draws"]
    effective: float


def disagreement(
    names: Sequence[str],
    weighted: Sample,
    chains: Sample,
    parts: Parts,
) -> str:
    """In words how chains differ from weighted draws by more than is allowed; empty if they agree.
    Medians and widths are those within each of the `parts` of the posterior.
    """
    above = float(chains.scores.max() - weighted.scores.max())
    if above > MOST_ABOVE:
        return f"chains found a log density higher by {above:.1f}"
    part_of_weighted = parts.of(weighted.x)
    part_of_chains = parts.of(chains.x)
    for part in range(len(parts.ranks)):
        ours = weighted.x[part_of_weighted == part]
        theirs = chains.x[part_of_chains == part]
        share = len(ours) / len(weighted.x)
        other = len(theirs) / len(chains.x)
        both = weighted.effective + chains.effective
        mean = (share * weighted.effective + other * chains.effective) / both
        spread = mean * (1.0 - mean)
        error = (spread / weighted.effective + spread / chains.effective) ** 0.5
        if abs(share - other) > MOST_ERRORS * error:
            return f"the share of a solution is {share:.3f} by weights, {other:.3f} by chains"
        if min(share * weighted.effective, other * chains.effective) < LEAST_DRAWS:
            continue
        variance = 1.0 / (share * weighted.effective) + 1.0 / (other * chains.effective)
        found = _differing(names, ours, theirs, MOST_ERRORS * variance**0.5)
        if found:
            return found
    return ""


def _differing(
    names: Sequence[str],
    ours: Annotated[FloatArray, "draws coordinates"],
    theirs: Annotated[FloatArray, "other_draws coordinates"],
    errors: float,
) -> str:
    """The first parameter whose median or width differs, in words. `errors` are the allowed
    standard errors of a mean, in sds.
    """
    low, middle, high = np.quantile(ours, (0.16, 0.5, 0.84), axis=0)
    low_there, middle_there, high_there = np.quantile(theirs, (0.16, 0.5, 0.84), axis=0)
    most_shift = max(MOST_SHIFT, ERROR_OF_MEDIAN * errors)
    most_widening = max(MOST_WIDENING, ERROR_OF_WIDTH * errors)
    half = 0.5 * (high - low)
    half_there = 0.5 * (high_there - low_there)
    for k, name in enumerate(names):
        shift = abs(middle_there[k] - middle[k])
        if shift > most_shift * half[k]:
            return f"{name}: medians by weights and by chains differ by {shift / half[k]:.2f} sd"
        widening = abs(half_there[k] - half[k])
        if widening > most_widening * half[k]:
            share = 100.0 * widening / half[k]
            return f"{name}: widths by weights and by chains differ by {share:.0f} %"
    return ""
