"""Bounces of one ball in a recording of sound: when each began.

A bounce begins with a sudden rise of whatever the noise of the room does not have. The signal is
whitened by what is heard in its quiet parts, so that hum and coloured noise count little; a causal
filter moves nothing to before it happened. Rises that follow each other as bounces do, each
interval a like share of that before, are a series. The time of a bounce is where two variances, one
before and one after, describe the signal around it (Maeda, Zisin 38 (1985) 365, as seismology picks
arrivals): with the likelihood of each sample, its mean and sd.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
from scipy.linalg import solve_toeplitz
from scipy.signal import butter, lfilter, sosfilt

from fitball.base.values import FloatArray, IntArray

# Below this frequency [Hz] is the hum of mains and the rumble of rooms.
_LOWEST = 150.0
# Length [s] of pieces by whose loudness quiet parts are found, and the share of them that is quiet.
_PIECE = 0.02
_QUIET_SHARE = 0.3
# Coefficients of the filter that whitens.
_ORDER = 32
# Share of white noise that keeps the filter from inverting silence.
_REGULAR = 1e-6
# Times [s] over which the loudness after and before a moment is compared, and between them.
_AFTER = 2e-3
_BEFORE = 15e-3
_BETWEEN = 0.5e-3
# Ratio of these from which a sound begins suddenly.
_LEAST_RISE = 4.0
# Largest logarithm of a rise that counts: beyond, all are clear.
_MOST_WEIGHT = 6.0
# Time [s] within which only the strongest rise counts: no ball bounces as fast.
_APART = 0.03
# Most rises of which series are looked for.
_MOST_RISES = 60
# Shares of the interval before that an interval may be, and by how much their logarithm may change
# from bounce to bounce: restitution of any ball, and its growth as speed falls.
_SHARES = (0.3, 0.97)
_MOST_CHANGE = 0.12
# Time [s] by which a rough time may be off.
_ROUGH = 3e-3
# Longest interval [s] of bounces: a fall of 2 m.
_LONGEST = 1.5
# Fewest bounces of a series: three intervals show that they shrink alike.
_FEWEST = 4
# What a bounce that is not heard takes from the weight of a series.
_MISSED = 4.0


# Frequencies [Hz] below which the sound of a bounce may be clearest; 0: all.
_BANDS = (0.0, 5000.0, 2500.0, 1200.0)
# Share of the sampling rate up to which such a band is another one.
_HIGHEST = 0.4
# Time [s] before and after a rise in which its beginning is looked for.
_EARLIER = 8e-3
_LATER = 3e-3
# Fewest samples on each side of it.
_FEWEST_SAMPLES = 8
# What no recording shows of a beginning [s]: which part of the ball touches first.
_LEAST_SD = 2e-5
# Largest sd [s] of a bounce that counts as heard.
_MOST_SD = 1e-3


class Series(NamedTuple):
    """Bounces of one drop: samples where they begin, roughly, and how many were not heard before
    each.
    """

    sample: IntArray
    missed: IntArray


@dataclass(frozen=True, eq=False)
class Bounces:
    """Bounces of one drop: times [s] at which they begin, in the recording, with sds; the number
    (from 1) of each, with gaps where one was not heard; times of other sudden sounds meanwhile.
    """

    time: Annotated[FloatArray, "bounces"]
    sd: Annotated[FloatArray, "bounces"]
    number: Annotated[IntArray, "bounces"]
    others: Annotated[FloatArray, "others"]


def bounces_in(signal: Annotated[FloatArray, "samples"], rate: float) -> list[Bounces]:
    """The series of bounces in a signal at `rate` [1/s], in order of time."""
    bands = dict(_in_bands(signal, rate))
    best = list[Series]()
    all_rises = np.zeros(0, dtype=np.int64)
    for in_band in bands.values():
        sample, rise = rises(in_band, rate)
        found = series_of(sample, rise, rate)
        if _heard(found) > _heard(best):
            best = found
            all_rises = sample
    return [
        bounces
        for series in best
        if (bounces := _timed(series, all_rises, bands, rate)).time.size >= _FEWEST
    ]


def _heard(found: list[Series]) -> int:
    """How many bounces series have, less those that were not heard."""
    return sum(series.sample.size - int(series.missed.sum()) for series in found)


def _in_bands(signal: FloatArray, rate: float) -> Iterator[tuple[float, FloatArray]]:
    """The whitened signal below each frequency [Hz], as if its quiet parts had the variance 1."""
    white = whitened(signal, rate)
    for band in _BANDS:
        if not band:
            yield 0.5 * rate, white
        elif band < _HIGHEST * rate:
            low = sosfilt(butter(2, band, fs=rate, output="sos"), white)
            length = max(int(_PIECE * rate), 2 * _ORDER)
            pieces = low[: low.size // length * length].reshape(-1, length)
            quiet = np.quantile(np.square(pieces).mean(axis=1), 0.5 * _QUIET_SHARE)
            yield band, low / np.sqrt(quiet)


def _timed(
    series: Series, all_rises: IntArray, bands: Mapping[float, FloatArray], rate: float
) -> Bounces:
    """The bounces of a series by the band that shows their beginnings best; those that it does not
    show are not heard.
    """
    in_bands = [
        np.array([_beginning(in_band, int(k), rate, band) for k in series.sample])
        for band, in_band in bands.items()
    ]
    best, *others = sorted(in_bands, key=lambda times: float(np.square(times[:, 1]).mean()))
    time, sd = best.T
    if others:
        sd = _with_disagreement(time, sd, *others[0].T)
    number = 1 + np.arange(series.sample.size) + np.cumsum(series.missed)
    heard = sd < _MOST_SD
    heard[_end(time, number) :] = False
    begin, end = series.sample[[0, -1]]
    between = all_rises[(all_rises > begin) & (all_rises < end)]
    no_bounces = between[~np.isin(between, series.sample)]
    return Bounces(time[heard], sd[heard], number[heard], no_bounces / rate)


def _with_disagreement(
    time: FloatArray, sd: FloatArray, other: FloatArray, other_sd: FloatArray
) -> FloatArray:
    """The sds (bounces,) of times [s], with that by which the times of another band differ beyond
    their own sds. Each band has a delay, which all its times share.
    """
    apart = other - time
    apart = apart - np.median(apart)
    beyond = np.square(apart) - np.square(sd) - np.square(other_sd)
    known = np.where(np.isfinite(beyond), np.maximum(beyond, 0.0), 0.0)
    return np.asarray(np.sqrt(np.square(sd) + known))


def _end(time: FloatArray, number: IntArray) -> int:
    """How many of the times [s] are of bounces, as far as their intervals shrink alike."""
    steps = np.diff(number)
    logs = np.log(np.maximum(np.diff(time), 1e-6))
    # Of bounces that follow each other without one missing between.
    both = (steps[1:] == 1) & (steps[:-1] == 1)
    change = np.abs(np.diff(np.diff(logs)))
    sharp = np.flatnonzero(both[1:] & both[:-1] & (change > 2.0 * _MOST_CHANGE))
    return int(sharp[0]) + 3 if sharp.size else time.size


def _beginning(signal: FloatArray, rough: int, rate: float, band: float) -> tuple[float, float]:
    """The time [s] near a sample at which a signal below a frequency [Hz] begins to be louder, and
    its sd.
    """
    start = max(rough - int(_EARLIER * rate), 0)
    squares = np.square(signal[start : rough + int(_LATER * rate)])
    count = squares.size
    sums = np.cumsum(squares)
    before = np.arange(_FEWEST_SAMPLES, count - _FEWEST_SAMPLES)
    after = count - before
    quiet = sums[before - 1] / before
    loud = (sums[-1] - sums[before - 1]) / after
    tiny = np.finfo(float).tiny
    deviance = before * np.log(quiet + tiny) + after * np.log(loud + tiny)
    # Below a frequency neighbouring samples are alike: so many count.
    deviance *= min(2.0 * band / rate, 1.0)
    weight = np.where(loud > quiet, np.exp(-0.5 * (deviance - deviance.min())), 0.0)
    if not weight.any():
        return rough / rate, np.inf
    weight /= weight.sum()
    mean = float(weight @ before)
    variance = float(weight @ np.square(before - mean)) + 1.0 / 12.0
    return (start + mean) / rate, float(np.hypot(np.sqrt(variance) / rate, _LEAST_SD))


def whitened(signal: Annotated[FloatArray, "samples"], rate: float) -> FloatArray:
    """A signal (samples,), at `rate` [1/s], without hum, as if the noise in its quiet parts were
    white, of variance 1.
    """
    high = sosfilt(butter(2, _LOWEST, "high", fs=rate, output="sos"), signal)
    length = max(int(_PIECE * rate), 2 * _ORDER)
    pieces = high[: high.size // length * length].reshape(-1, length)
    power = np.square(pieces).mean(axis=1)
    quiet = pieces[power <= np.quantile(power, _QUIET_SHARE)]
    covariances = np.array(
        [np.mean(quiet[:, lag:] * quiet[:, : length - lag]) for lag in range(_ORDER + 1)]
    )
    # Silence has no spectrum: that of white noise far below the loudest sound.
    covariances[0] += _REGULAR * covariances[0] + 1e-12 * power.max()
    predictor = solve_toeplitz(covariances[:-1], covariances[1:])
    white = lfilter(np.concatenate([[1.0], -predictor]), np.ones(1), high)
    variance = covariances[0] - predictor @ covariances[1:]
    return np.asarray(white / np.sqrt(variance))


def rises(white: Annotated[FloatArray, "samples"], rate: float) -> tuple[IntArray, FloatArray]:
    """Samples (rises,) at which a whitened signal rises suddenly, and the logarithms of the rises,
    in order of time; the strongest ones.
    """
    total = np.concatenate([[0.0], np.cumsum(np.square(white))])
    after, before, between = (max(int(s * rate), 1) for s in (_AFTER, _BEFORE, _BETWEEN))
    place = np.arange(before + between, white.size - after)
    loud = (total[place + after] - total[place]) / after
    quiet = (total[place - between] - total[place - between - before]) / before
    rise = np.log((loud + 1.0) / (quiet + 1.0))
    found = list[int]()
    apart = int(_APART * rate)
    free = np.ones(rise.size, dtype=bool)
    for k in np.argsort(-rise, kind="stable").tolist():
        if rise[k] < np.log(_LEAST_RISE) or len(found) == _MOST_RISES:
            break
        if free[k]:
            found.append(k)
            free[max(k - apart, 0) : k + apart] = False
    order = np.sort(np.array(found, dtype=np.int64))
    return place[order] if order.size else order, rise[order]


def series_of(sample: IntArray, rise: FloatArray, rate: float) -> list[Series]:
    """The series of bounces among rises (rises,), the earliest first. Each has bounces whose
    intervals are like shares of those before; one that is not heard is passed over.
    """
    left = np.ones(sample.size, dtype=bool)
    found = list[Series]()
    while True:
        rows = np.flatnonzero(left)
        best = _best(sample[rows] / rate, np.minimum(rise[rows], _MOST_WEIGHT))
        if best is None:
            return sorted(found, key=lambda series: int(series.sample[0]))
        chain, missed = best
        found.append(Series(sample[rows[chain]], missed))
        # What is heard during a series belongs to it, or to nothing.
        left[rows[chain[0]] : rows[chain[-1]] + 1] = False


def _best(time: FloatArray, weight: FloatArray) -> tuple[IntArray, IntArray] | None:
    """Indices of the series with the largest weight among rises at times [s], and the bounces
    missed before each; None without one.
    """
    best_score = 0.0
    best = None
    for first in range(time.size):
        for second in range(first + 1, time.size):
            interval = float(time[second] - time[first])
            if interval > _LONGEST:
                break
            for third in range(second + 1, time.size):
                following = float(time[third] - time[second])
                if following > (_SHARES[1] + _SHARES[1] ** 2) * interval:
                    break
                for seed in _seeds(interval, following):
                    chain, missed = _continued([first, second, third], seed, time, weight)
                    score = float(weight[chain].sum()) - _MISSED * sum(missed)
                    if len(chain) >= _FEWEST and score > best_score:
                        best_score = score
                        best = (np.array(chain), np.array(missed))
    return best


class _Seed(NamedTuple):
    """How three sounds may begin a series: bounces missed before each, the share of an interval in
    that before, and the last interval [s].
    """

    missed: tuple[int, int, int]
    share: float
    last: float


def _seeds(interval: float, following: float) -> Iterator[_Seed]:
    """The ways in which two times [s] between three sounds may be intervals: each one, or the
    second or the first two of them, with the bounce between not heard.
    """
    ratio = following / interval
    whole = _root_share(ratio)
    # q^2/(1 + q) of the ratio.
    parted = 0.5 * (ratio + np.sqrt(ratio**2 + 4.0 * ratio))
    for seed in (
        _Seed((0, 0, 0), ratio, following),
        _Seed((0, 0, 1), whole, following * whole / (1.0 + whole)),
        _Seed((0, 1, 0), float(parted), following),
    ):
        if _SHARES[0] < seed.share < _SHARES[1]:
            yield seed


def _continued(
    chain: list[int], seed: _Seed, time: FloatArray, weight: FloatArray
) -> tuple[list[int], list[int]]:
    """A series continued from its first three sounds, and the bounces missed before each."""
    missed = [*seed.missed]
    before = seed.last
    share = seed.share
    while before > 2.0 * _APART:
        here = float(time[chain[-1]])
        follows, skipped = _follower(here, before, share, chain[-1], time, weight)
        if follows < 0:
            break
        lasts = float(time[follows]) - here
        if skipped:
            # The interval that was passed over shares its ratio with the next.
            share = _root_share(lasts / before)
            before = lasts * share / (1.0 + share)
        else:
            share = lasts / before
            before = lasts
        if not _SHARES[0] < share < _SHARES[1]:
            break
        chain = [*chain, follows]
        missed.append(skipped)
    return chain, missed


def _follower(
    here: float, before: float, share: float, last: int, time: FloatArray, weight: FloatArray
) -> tuple[int, int]:
    """The index of the sound that follows the last one of a series, at `here` [s] after an interval
    [s], and whether a bounce between was not heard; -1 without one.
    """
    ahead = np.arange(last + 1, time.size)
    expected = before * share
    for skipped, wanted in ((0, expected), (1, expected * (1.0 + share))):
        reach = _MOST_CHANGE * wanted + _ROUGH
        off = np.abs(time[ahead] - here - wanted) / reach
        near = off < 1.0
        if near.any():
            merit = np.where(near, weight[ahead] - 2.0 * off, -np.inf)
            return int(ahead[np.argmax(merit)]), skipped
    return -1, 0


def _root_share(ratio: float) -> float:
    """The share q of two intervals, each q times the one before, that are `ratio` together."""
    return float(0.5 * (np.sqrt(1.0 + 4.0 * ratio) - 1.0))
