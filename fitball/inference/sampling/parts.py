"""Parts of the draws of a posterior with a gap between them: its modes.

A split is a plane in coordinates. Along its normal the density of the draws has two peaks with a
dip between, which must be deep, more than chance, and there in either half of the chains. Planes
begin where a coordinate has a dip, or half way between two maxima of the search, and are turned by
linear discriminants (Fisher 1936) until the dip is deepest. Each part is split again.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, NamedTuple

import numpy as np

from fitball.base.selection import evenly_begun
from fitball.base.values import BoolArray, FloatArray, IntArray

# Draws in which dips are looked for: more take time and hardly say more than the effective ones.
SEARCHED_DRAWS = 4_000
# Bins between the quantiles of a projection that are looked at.
BINS = 40
SHOWN_QUANTILES = (0.002, 0.998)
# Share of the draws from which a part is a mode: less is no second answer. Chosen by hand.
LEAST_SHARE = 0.03
# Density in a dip over that at the lower peak, in all draws and in either half of the chains. Of
# two equal normal distributions it is that at 3.4 sds. Chosen by hand: on 93 tables of the model
# itself none is as deep.
DEEP_DIP = 0.45
DEEP_DIP_OF_HALF = 0.7
# Standard errors by which the density about the lower peak exceeds that in the dip, by effective
# draws. With both none of 1,350 distributions of one mode has two.
SURE_DIP = 4.5
# Density from which a bin is about a peak, over that at the peak.
ABOUT_PEAK = 0.75
# A dip of a coordinate so clear that no plane is turned: people can name it.
CLEAR_DIP = 0.05
# A dip above which turning the plane is given up.
SHALLOW_DIP = 0.95
# Times that a plane is turned at most.
MOST_TURNS = 5
# Maxima of the search, beside the highest, that give first planes.
MOST_MAXIMA = 6
# Whitened distance from which two maxima may lie in two parts.
LEAST_DISTANCE = 1.0
# Modes at most: a guard.
MOST_PARTS = 6
# Added to the variances of correlations: draws in a plane have none across it.
LEAST_VARIANCE = 1e-9


class Split(NamedTuple):
    """A plane that splits the draws of a `part`: what lies beyond the `threshold` along the
    `normal` is a new part.
    """

    part: int
    normal: Annotated[FloatArray, "coordinates"]
    threshold: float


class Parts(NamedTuple):
    """The parts of a posterior, numbered by their shares of the draws, the largest first; `ranks`
    has that number for each part as the splits made them.
    """

    splits: tuple[Split, ...]
    ranks: Annotated[IntArray, "parts"]

    def of(self, x: Annotated[FloatArray, "draws coordinates"]) -> Annotated[IntArray, "draws"]:
        """The number of the part in which coordinates lie."""
        return np.asarray(self.ranks[_labels(self.splits, x)])


# The parts of a posterior without a gap.
ONE_PART = Parts((), np.zeros(1, dtype=np.int64))


class _Dip(NamedTuple):
    """A dip of a projection: its density over that at the lower peak, where it is, and the standard
    errors by which the density about that peak exceeds the one in the dip, if all draws count.
    """

    ratio: float
    threshold: float
    sureness: float


def parts_of(
    chains: Annotated[FloatArray, "ensembles steps walkers coordinates"],
    maxima: Annotated[FloatArray, "maxima coordinates"],
    effective: float,
) -> Parts:
    """The parts of draws of which so many are `effective`, with the maxima of the search, the
    highest first, as hints.
    """
    ensembles, steps, walkers, size = chains.shape
    draws = chains.reshape(-1, size)
    chosen = evenly_begun(len(draws), min(SEARCHED_DRAWS, len(draws)))
    x = draws[chosen]
    # Halves are of other ensembles; a single one is in random order.
    ensemble = chosen // (steps * walkers)
    half = (ensemble if ensembles > 1 else np.arange(len(chosen))) % 2 == 0
    splits = list[Split]()
    waiting = [0]
    while waiting and len(splits) + 1 < MOST_PARTS:
        part = waiting.pop(0)
        inside = _labels(splits, x) == part
        share = float(inside.mean())
        least = LEAST_SHARE / share
        if least > 0.5:
            continue
        found = _split(x[inside], maxima, half[inside], effective * share, least)
        if found is not None:
            splits.append(Split(part, *found))
            waiting += [part, len(splits)]
    counts = np.bincount(_labels(splits, draws), minlength=len(splits) + 1)
    ranks = np.empty(len(counts), dtype=np.int64)
    ranks[np.argsort(-counts, kind="stable")] = np.arange(len(counts))
    return Parts(tuple(splits), ranks)


def centrality(
    draws: Annotated[FloatArray, "draws coordinates"],
    x: Annotated[FloatArray, "places coordinates"],
) -> Annotated[FloatArray, "places"]:
    """The share of draws that lie nearer to the middle of all than places do, by Mahalanobis'
    distance. A maximum that holds the mass lies near the middle, nearer than hardly any draw.
    """
    middle, whitening = _whitening(draws)
    distances = np.linalg.norm((draws - middle) @ whitening, axis=1)
    of_places = np.linalg.norm((x - middle) @ whitening, axis=1)
    return np.asarray(np.searchsorted(np.sort(distances), of_places) / len(draws))


def _labels(splits: Sequence[Split], x: FloatArray) -> IntArray:
    """The part (draws,) of coordinates (draws, coordinates), as the splits made them."""
    labels = np.zeros(len(x), dtype=np.int64)
    for k, split in enumerate(splits, 1):
        beyond = x @ split.normal > split.threshold
        labels[(labels == split.part) & beyond] = k
    return labels


def _whitening(x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The mean (coordinates,) of draws, and the matrix that makes deviations standard ones."""
    middle = x.mean(axis=0)
    scale = x.std(axis=0)
    scale[scale <= 0.0] = 1.0
    correlation = np.atleast_2d(np.cov(x / scale, rowvar=False))
    factor = np.linalg.cholesky(correlation + LEAST_VARIANCE * np.eye(len(scale)))
    return middle, np.asarray(np.linalg.inv(factor).T / scale[:, None])


def _split(
    x: FloatArray,
    maxima: FloatArray,
    half: BoolArray,
    effective: float,
    least: float,
) -> tuple[FloatArray, float] | None:
    """The normal (coordinates,) and threshold of the plane that splits draws (draws, coordinates),
    each side with a share of at least `least`; None where there is no gap.
    """
    middle, whitening = _whitening(x)
    z = (x - middle) @ whitening
    axes = np.asarray(np.linalg.inv(whitening), dtype=np.float64)
    planes = [*_first_planes(z, (maxima - middle) @ whitening, axes, least)]
    if not any(dip.ratio < CLEAR_DIP for _, dip in planes):
        planes = [_turned(z, normal, dip, least) for normal, dip in planes]
    if not planes:
        return None
    normal, dip = min(planes, key=lambda plane: plane[1].ratio)
    # No more count than are looked at.
    sureness = dip.sureness * min(effective / len(z), 1.0) ** 0.5
    is_deep = dip.ratio < DEEP_DIP and sureness > SURE_DIP
    if not (is_deep and _is_in_halves(z, normal, dip, half, least)):
        return None
    direction = whitening @ normal
    return direction, float(dip.threshold + middle @ direction)


def _first_planes(
    z: FloatArray,
    maxima: FloatArray,
    axes: FloatArray,
    least: float,
) -> Iterator[tuple[FloatArray, _Dip]]:
    """Normals (coordinates,) of first planes, with their dips: the `axes` of coordinates, and from
    the highest of the maxima to others, all whitened.
    """
    apart = np.linalg.norm(maxima - maxima[0], axis=1) > LEAST_DISTANCE
    between = maxima[apart][:MOST_MAXIMA] - maxima[0]
    for normal in (*axes.T, *between):
        dip = _deepest_dip(z @ normal, least)
        if dip is not None:
            yield normal, dip


def _turned(
    z: FloatArray,
    normal: FloatArray,
    dip: _Dip,
    least: float,
) -> tuple[FloatArray, _Dip]:
    """The plane with the deepest dip to which discriminants turn a first one: its normal, and the
    dip.
    """
    for _ in range(MOST_TURNS):
        beyond = z @ normal > dip.threshold
        share = beyond.mean()
        if min(share, 1.0 - share) < 0.5 * least:
            break
        turned = _discriminant(z, beyond)
        deeper = _deepest_dip(z @ turned, least)
        if deeper is None or deeper.ratio >= dip.ratio:
            break
        normal, dip = turned, deeper
        if dip.ratio > SHALLOW_DIP:
            break
    return normal, dip


def _discriminant(z: FloatArray, beyond: BoolArray) -> FloatArray:
    """Fisher's linear discriminant (coordinates,) of the draws beyond a plane and the others."""
    within = np.eye(z.shape[1]) * LEAST_VARIANCE
    for side in (z[beyond], z[~beyond]):
        away = side - side.mean(axis=0)
        within += away.T @ away / len(z)
    return np.linalg.solve(within, z[beyond].mean(axis=0) - z[~beyond].mean(axis=0))


def _smoothed_counts(along: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The counts (bins,) of a projection (draws,), their means over three bins, and the edges."""
    low, high = np.quantile(along, SHOWN_QUANTILES).tolist()
    # Draws that are all the same lie in one bin.
    edges = np.linspace(low, high if high > low else low + 1.0, BINS + 1)
    counts = np.histogram(np.clip(along, edges[0], edges[-1]), edges)[0].astype(np.float64)
    padded = np.pad(counts, 1, mode="edge")
    return counts, (padded[:-2] + padded[1:-1] + padded[2:]) / 3.0, edges


def _deepest_dip(along: FloatArray, least: float) -> _Dip | None:
    """The deepest dip of a projection (draws,) with a share of at least `least` on both sides."""
    counts, smooth, edges = _smoothed_counts(along)
    below = (counts.cumsum() - 0.5 * counts) / along.size
    left = np.maximum.accumulate(smooth)
    right = np.maximum.accumulate(smooth[::-1])[::-1]
    peak = np.minimum(left, right)
    possible = (below >= least) & (below <= 1.0 - least) & (peak > 0.0)
    if not possible.any():
        return None
    ratio = np.where(possible, smooth / np.maximum(peak, 1.0 / along.size), np.inf)
    deepest = ratio.min()
    # The middle of a gap in which there is no draw at all.
    equal = np.flatnonzero(ratio == deepest)
    k = int(equal[equal.size // 2])
    threshold = 0.5 * (edges[k] + edges[k + 1])
    side = slice(0, k) if left[k] < right[k] else slice(k + 1, BINS)
    top = int(smooth[side].argmax()) + (side.start or 0)
    about_peak = counts[_run(smooth > ABOUT_PEAK * peak[k], top)]
    in_dip = counts[_run(smooth < DEEP_DIP * peak[k], k)]
    away = about_peak.mean() - in_dip.mean()
    # A bin without a draw may have had one.
    variance = about_peak.sum() / about_peak.size**2 + (in_dip.sum() + 1.0) / in_dip.size**2
    return _Dip(float(deepest), float(threshold), float(away / variance**0.5))


def _run(holds: BoolArray, k: int) -> slice:
    """The run of bins about the bin `k` in which something holds; the bin alone if not in it."""
    fails = np.flatnonzero(~holds)
    low = fails[fails <= k]
    high = fails[fails >= k]
    first = int(low[-1]) + 1 if low.size else 0
    last = int(high[0]) if high.size else len(holds)
    return slice(first, last) if first < last else slice(k, k + 1)


def _is_in_halves(
    z: FloatArray,
    normal: FloatArray,
    dip: _Dip,
    half: BoolArray,
    least: float,
) -> bool:
    """Whether the dip is there in either half of the chains, along the other's discriminant."""
    beyond = z @ normal > dip.threshold
    for there in (half, ~half):
        sides = beyond[there]
        if min(sides.mean(), 1.0 - sides.mean()) < 0.5 * least:
            return False
        direction = _discriminant(z[there], sides)
        same = _deepest_dip(z[there] @ direction, 0.5 * least)
        _, smooth, edges = _smoothed_counts(z[~there] @ direction)
        if same is None:
            return False
        k = int(np.clip(np.searchsorted(edges, same.threshold) - 1, 1, BINS - 2))
        peak = min(smooth[:k].max(), smooth[k + 1 :].max())
        if not smooth[k - 1 : k + 2].min() < DEEP_DIP_OF_HALF * peak:
            return False
    return True
