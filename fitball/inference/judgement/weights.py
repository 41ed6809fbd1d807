"""How much variants of a model count beside a fit, by how well they predict left-out impacts, and
values that most of them put elsewhere.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import erfc, exp, log, pi, sqrt

from fitball.base.text import listed
from fitball.inference.judgement.bounds import CONDITIONAL_SHIFT
from fitball.inference.schema import Alternative, Summary

# Weight of a variant beside the fit below which no value rests on it: wherever it puts the value, a
# 95 % interval still holds 85 %.
LEAST_WEIGHT = 0.1
# Share of the weight of the fit and its variants that may put a value outside of its 95 % interval:
# beyond it the value is more probably elsewhere.
MOST_OUTSIDE = 0.5
# Shares of the weight that are named, largest first, until so much of what is outside is.
_NAMED_SHARE = 0.8


def log_odds(alternative: Alternative) -> float:
    """The logarithm of how probable a variant is over the fit: its score, with the error of that.

    The mean of a logistic function over a normal distribution is that of the score divided by
    sqrt(1 + pi error^2/8) (MacKay 1992, Neural Comput. 4, 720); over the errors of scores it is
    pseudo-BMA+ (Yao et al. 2018). Without a score both are equally probable.
    """
    if alternative.score is None:
        return 0.0
    return alternative.score / sqrt(1.0 + pi * alternative.error**2 / 8.0)


def counts(alternative: Alternative) -> bool:
    """Whether a variant is so probable beside the fit that a value may rest on it."""
    return log_odds(alternative) > log(LEAST_WEIGHT / (1.0 - LEAST_WEIGHT))


def share_outside(fit: Summary, there: Summary) -> float:
    """The share of the distribution `there` outside of the 95 % interval of a fit; that is normal
    to either side of its median.
    """
    below = there.median - there.q16
    above = there.q84 - there.median

    def beyond(distance: float) -> float:
        """The share further than a distance above, or below a negative one, the median."""
        size = above if distance > 0.0 else below
        if not size > 0.0:
            return 0.0
        return 0.5 * erfc(abs(distance) / (size * sqrt(2.0)))

    up = fit.q975 - there.median
    down = fit.q025 - there.median
    over = beyond(up) if up > 0.0 else 1.0 - beyond(up)
    under = beyond(down) if down < 0.0 else 1.0 - beyond(down)
    return over + under


def outvoted(
    tried: Sequence[Alternative],
    fit: Mapping[str, Summary],
) -> dict[str, str]:
    """For each quantity a sentence on what denies its value, if anything does: a surely better
    variant that moves it by CONDITIONAL_SHIFT, or variants with more than MOST_OUTSIDE of the
    weight, which put it outside of the 95 % interval of the fit. Before their scores the fit counts
    as much as all variants together.
    """
    doubts = {}
    for name, here in fit.items():
        odds = dict[str, float]()
        outside = dict[str, float]()
        better = list[str]()
        for alternative in tried:
            if name not in alternative.summaries or alternative.reason:
                continue
            there = alternative.summaries[name]
            odds[alternative.choice] = log_odds(alternative)
            outside[alternative.choice] = share_outside(here, there)
            moved = abs(there.median - here.median) > CONDITIONAL_SHIFT * here.half
            if alternative.better and moved:
                better.append(alternative.choice)
        highest = max([0.0, *odds.values()])
        weights = {choice: exp(odd - highest) / len(odds) for choice, odd in odds.items()}
        whole = exp(-highest) + sum(weights.values())
        parts = {choice: weights[choice] * outside[choice] / whole for choice in odds}
        total = sum(parts.values())
        if better:
            doubts[name] = f"But {listed(better)} predict better and move it."
        elif total > MOST_OUTSIDE:
            named = list[str]()
            for choice in sorted(parts, key=lambda choice: -parts[choice]):
                if sum(parts[other] for other in named) < _NAMED_SHARE * total:
                    named.append(choice)
            doubts[name] = f"But {listed(named)} predict as well, or better, and put it elsewhere."
    return doubts
