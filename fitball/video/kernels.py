"""Loops over pixels, compiled: a smaller picture, what changed in it, connected things, and the
edge of a disc. All of one file: numba does not see edits of what a kernel calls elsewhere.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

import numba
import numpy as np
from numpy.typing import NDArray

from fitball.base.values import FloatArray, IntArray
from fitball.models.kernels.compiled import OPTIONS, entry

Bytes = NDArray[np.uint8]
Singles = NDArray[np.float32]
# Columns of the things that `things` returns.
AREA, LEFT, TOP, RIGHT, BOTTOM, X, Y, XX, XY, YY, STRENGTH = range(11)
# Parameters of a disc: centre and radius [px], how much longer it is along the readout of the
# rows and how much it leans against it, exposure [s], blur of the edge [px].
DISC = ("x", "y", "r", "stretch", "lean", "exposure", "blur")
# Functions of brightness within a disc: harmonics of the first and second order of the surface's
# normal (u, v, h), which hold 99 % of the light that a matt ball sends back (Basri and Jacobs, IEEE
# PAMI 25 (2003) 218): 1, u, v, h, uv, uh, vh, uu - vv, 3hh - 1.
SHADES = 9
# A look is on a square from -LOOK to LOOK radii about the centre.
LOOK = 1.1
# Beyond so many sds of its blur an edge is sharp.
_EDGE = 4.0


def _part(function: Any) -> Any:
    """Compile what kernels of this file call."""
    return numba.njit(inline="never", **OPTIONS)(function)


@entry
def reduced(plane: Bytes, unit: int, out: Bytes) -> None:
    """Means of squares of `unit` pixels."""
    area = unit * unit
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            total = area // 2
            for a in range(unit):
                for b in range(unit):
                    total += plane[unit * i + a, unit * j + b]
            out[i, j] = total // area


@entry
def nearest(plane: Bytes, out: Bytes) -> None:
    """The plane with as many rows and columns as `out` has: at each the nearest value."""
    rows, columns = plane.shape
    for i in range(out.shape[0]):
        row = (2 * i + 1) * rows // (2 * out.shape[0])
        for j in range(out.shape[1]):
            out[i, j] = plane[row, (2 * j + 1) * columns // (2 * out.shape[1])]


@entry
def moved(plane: Bytes, x: float, y: float, out: Bytes) -> None:
    """The plane as if the camera had not moved by x and y [px]: linear, its edges repeated."""
    rows, columns = plane.shape
    column = math.floor(x)
    row = math.floor(y)
    right = np.float32(x - column)
    lower = np.float32(y - row)
    for i in range(rows):
        above = min(max(i + row, 0), rows - 1)
        below = min(max(i + row + 1, 0), rows - 1)
        for j in range(columns):
            before = min(max(j + column, 0), columns - 1)
            after = min(max(j + column + 1, 0), columns - 1)
            top = plane[above, before] * (np.float32(1.0) - right) + plane[above, after] * right
            low = plane[below, before] * (np.float32(1.0) - right) + plane[below, after] * right
            out[i, j] = np.uint8(top + (low - top) * lower + np.float32(0.5))


@entry
def between(
    plane: Annotated[Bytes, "rows columns"],
    first: tuple[float, float],
    step: tuple[float, float],
    out: Annotated[Singles, "rows columns"],
) -> None:
    """Values at rows and columns from the `first` one on, `step` pixels apart: linear between
    pixels, the edges repeated.
    """
    rows, columns = plane.shape
    for i in range(out.shape[0]):
        row = first[0] + step[0] * i
        above = math.floor(row)
        lower = row - above
        a = min(max(above, 0), rows - 1)
        b = min(max(above + 1, 0), rows - 1)
        for j in range(out.shape[1]):
            column = first[1] + step[1] * j
            before = math.floor(column)
            right = column - before
            c = min(max(before, 0), columns - 1)
            d = min(max(before + 1, 0), columns - 1)
            top = plane[a, c] * (1.0 - right) + plane[a, d] * right
            low = plane[b, c] * (1.0 - right) + plane[b, d] * right
            out[i, j] = top * (1.0 - lower) + low * lower


@entry
def median(planes: NDArray[Any], out: NDArray[Any]) -> None:
    """Median of planes (planes, ...) in each place."""
    count = planes.shape[0]
    flat = planes.reshape(count, -1)
    medians = out.reshape(-1)
    few = np.empty(count, planes.dtype)
    for k in range(flat.shape[1]):
        for i in range(count):
            value = flat[i, k]
            j = i
            while j > 0 and few[j - 1] > value:
                few[j] = few[j - 1]
                j -= 1
            few[j] = value
        medians[k] = few[count // 2]


@entry
def changes(
    frames: Annotated[Bytes, "frames 3 pixels"],
    gains: Annotated[Singles, "frames 3"],
    now: int,
    pairs: Annotated[IntArray, "lags 2"],
    back: Annotated[Bytes, "3 pixels"],
    weights: Annotated[Singles, "3"],
    out: Annotated[Singles, "3 pixels"],
) -> None:
    """How much a frame differs, squared, in sds of noise: from the background; from that and from
    earlier and later frames at any of the lags; and at the shortest. `pairs` holds the numbers of
    frames a lag earlier and later, negative where there is none; `gains` how much brighter than
    the background a frame is.
    """
    size = back.shape[1]
    out[:] = 0.0
    side = np.empty(size, np.float32)
    other = np.empty(size, np.float32)
    for c in range(3):
        weight = weights[c]
        gain = gains[now, c]
        a = frames[now, c]
        b = back[c]
        for k in range(size):
            d = (np.float32(a[k]) - np.float32(b[k]) - gain) * weight
            out[0, k] += d * d
    for lag in range(pairs.shape[0]):
        first, second = pairs[lag]
        if first < 0 and second < 0:
            continue
        _difference(frames, gains, now, first if first >= 0 else second, weights, side)
        if first >= 0 and second >= 0:
            _difference(frames, gains, now, second, weights, other)
            for k in range(size):
                side[k] = min(side[k], other[k])
        for k in range(size):
            out[1, k] = max(out[1, k], side[k])
        if lag == 0:
            for k in range(size):
                out[2, k] = side[k]
    for k in range(size):
        out[1, k] = min(out[0, k], out[1, k])
        out[2, k] = min(out[0, k], out[2, k])


@_part
def _difference(
    frames: Bytes,
    gains: Singles,
    now: int,
    then: int,
    weights: Singles,
    out: Singles,
) -> None:
    out[:] = 0.0
    for c in range(3):
        weight = weights[c]
        gain = gains[now, c] - gains[then, c]
        a = frames[now, c]
        b = frames[then, c]
        for k in range(out.shape[0]):
            d = (np.float32(a[k]) - np.float32(b[k]) - gain) * weight
            out[k] += d * d


@entry
def things(
    change: Annotated[Singles, "rows columns"],
    least: float,
    cap: float,
    labels: Annotated[NDArray[np.int32], "rows columns"],
    most: int,
) -> Annotated[FloatArray, "things 11"]:
    """Connected places where the mean over 3 x 3 pixels of the root of `change`, at most `cap`, is
    above `least`: their areas, boxes, sums of coordinates and of their products, and of strength.
    At most `most` of them; `labels` is room to work in.
    """
    rows, columns = change.shape
    parent = np.zeros(rows * columns // 4 + 2, np.int32)
    count = 0
    across = np.empty((3, columns), np.float32)
    strong = np.empty(columns, np.float32)
    strengths = np.zeros(parent.shape[0], np.float64)
    for i in range(rows + 1):
        if i < rows:
            _across(change[i], cap, across[i % 3])
        row = i - 1
        if row < 0:
            continue
        below = across[min(i, rows - 1) % 3]
        above = across[max(row - 1, 0) % 3]
        middle = across[row % 3]
        for j in range(columns):
            strong[j] = (below[j] + above[j] + middle[j]) / np.float32(9.0)
        for j in range(columns):
            if strong[j] <= least:
                labels[row, j] = 0
                continue
            left = labels[row, j - 1] if j > 0 else 0
            up = labels[row - 1, j] if row > 0 else 0
            label = max(left, up)
            if label == 0:
                if count + 2 >= parent.shape[0]:
                    labels[row, j] = 0
                    continue
                count += 1
                label = count
                parent[label] = label
            elif left > 0 and up > 0 and left != up:
                a = _root(parent, left)
                b = _root(parent, up)
                parent[max(a, b)] = min(a, b)
                label = min(a, b)
            labels[row, j] = label
            strengths[label] += strong[j]
    found: FloatArray = _summed(labels, parent, strengths, count, most)
    return found


@_part
def _across(change: Singles, cap: float, out: Singles) -> None:
    """Sums of the roots of each three neighbours in a row."""
    last = change.shape[0] - 1
    for j in range(last + 1):
        out[j] = min(math.sqrt(change[j]), cap)
    before = out[0]
    for j in range(last + 1):
        here = out[j]
        after = out[min(j + 1, last)]
        out[j] = before + here + after
        before = here


@_part
def _root(parent: Any, label: int) -> int:
    while parent[label] != label:
        parent[label] = parent[parent[label]]
        label = parent[label]
    return label


@_part
def _summed(labels: Any, parent: Any, strengths: FloatArray, count: int, most: int) -> FloatArray:
    number = np.full(count + 1, -1, np.int64)
    found = 0
    for label in range(1, count + 1):
        if parent[label] == label and found < most:
            number[label] = found
            found += 1
    out = np.zeros((found, 11))
    out[:, LEFT] = labels.shape[1]
    out[:, TOP] = labels.shape[0]
    for label in range(1, count + 1):
        root = _root(parent, label)
        number[label] = number[root]
        if number[label] >= 0:
            out[number[label], STRENGTH] += strengths[label]
    for i in range(labels.shape[0]):
        for j in range(labels.shape[1]):
            if labels[i, j] == 0 or number[labels[i, j]] < 0:
                continue
            one = out[number[labels[i, j]]]
            one[AREA] += 1.0
            one[LEFT] = min(one[LEFT], j)
            one[RIGHT] = max(one[RIGHT], j)
            one[TOP] = min(one[TOP], i)
            one[BOTTOM] = max(one[BOTTOM], i)
            one[X] += j
            one[Y] += i
            one[XX] += j * j
            one[XY] += i * j
            one[YY] += i * i
    return out


@entry
def disc(
    image: Annotated[FloatArray, "channels pixels"],
    back: Annotated[FloatArray, "channels pixels"],
    x: Annotated[FloatArray, "pixels"],
    y: Annotated[FloatArray, "pixels"],
    p: Annotated[FloatArray, "7"],
    velocity: Annotated[FloatArray, "2"],
    colours: Annotated[FloatArray, "channels colours 9"],
    factors: Annotated[FloatArray, "channels colours"],
    look: Annotated[FloatArray, "channels size size"],
    noise: Annotated[FloatArray, "channels"],
    softer: Annotated[FloatArray, "channels"],
    upper: float,
) -> tuple[Annotated[FloatArray, "all all"], Annotated[FloatArray, "all"], FloatArray]:
    """Normal equations of a blurred, moving disc `p` (DISC) before a background. Its brightness is
    the sum of `factors` times `colours`, each a sum of shades, times a `look` (its marks), and its
    edge is as much `softer` [px] in each channel. Free are the disc and the factors, channel after
    channel: matrix, right side, and of each channel three sums: of weighted squared residuals,
    robust; the same of the background alone; of weights.

    The share of a pixel that the disc covers is that of a blurred edge, averaged over the exposure.
    Residuals count fully at the rim and by a quarter inside, where marks are; with `upper` above 0
    only where v < `upper` (a ball that lies on its shadow).
    """
    channels = image.shape[0]
    count = colours.shape[1]
    size = 7 + count * channels
    matrix = np.zeros((size, size))
    right = np.zeros(size)
    sums = np.zeros((3, channels))
    edge = np.zeros(7)
    base = np.zeros(SHADES)
    parts = np.zeros(count)
    for k in range(image.shape[1]):
        dx = x[k] - p[0]
        dy = y[k] - p[1]
        v = dy / ((1.0 + p[3]) * p[2])
        u = (dx - p[4] * dy) / p[2]
        d = math.sqrt(u * u + v * v) + 1e-9
        weight = _weight(d, v, upper)
        for c in range(channels):
            if c == 0 or abs(softer[c] - softer[c - 1]) > 0.0:
                blur = math.hypot(p[6], softer[c])
                cover = _covered(dx, dy, p, blur, velocity, edge)
                if cover > 0.0:
                    inner = _inward(u, v, d, p, blur, velocity)
                    _shaded(u * inner, v * inner, base)
            empty = (image[c, k] - back[c, k]) / noise[c]
            sums[1, c] += weight * empty * empty / (1.0 + empty * empty / 36.0)
            sums[2, c] += weight
            if cover <= 0.0:
                sums[0, c] += weight * empty * empty / (1.0 + empty * empty / 36.0)
                continue
            seen = _sampled(look[c], base[1], base[2])
            ball = _brightness(colours[c], factors[c], base, seen * cover, parts) / cover
            bright = ball - back[c, k]
            residual = empty - cover * bright / noise[c]
            robust = 1.0 / (1.0 + residual * residual / 36.0)
            sums[0, c] += weight * residual * residual * robust
            robust *= robust * weight / (noise[c] * noise[c])
            _added(matrix, right, edge, bright, parts, robust, residual * noise[c], c)
    for i in range(size):
        for j in range(i):
            matrix[j, i] = matrix[i, j]
    return matrix, right, sums


@entry
def lit(
    x: Annotated[FloatArray, "pixels"],
    y: Annotated[FloatArray, "pixels"],
    p: Annotated[FloatArray, "7"],
    velocity: Annotated[FloatArray, "2"],
    softer: float,
    covers: Annotated[FloatArray, "pixels"],
    places: Annotated[FloatArray, "2 pixels"],
) -> None:
    """Of each pixel the share that a disc `p` covers, with an edge that is `softer` [px], and the
    place (u, v) of the disc [radii] that is seen there on average.
    """
    edge = np.zeros(7)
    blur = math.hypot(p[6], softer)
    for k in range(x.shape[0]):
        dx = x[k] - p[0]
        dy = y[k] - p[1]
        v = dy / ((1.0 + p[3]) * p[2])
        u = (dx - p[4] * dy) / p[2]
        d = math.sqrt(u * u + v * v) + 1e-9
        inner = _inward(u, v, d, p, blur, velocity)
        covers[k] = _covered(dx, dy, p, blur, velocity, edge)
        places[0, k] = u * inner
        places[1, k] = v * inner


@_part
def _weight(d: float, v: float, upper: float) -> float:
    """The weight of a pixel by its distance from the centre [radii], squared."""
    weight = 0.25 + 0.75 * _step(25.0 * (d - 0.75))
    if upper > 0.0:
        weight *= 0.02 + 0.98 * _step(12.0 * (upper - v))
    return float(weight * weight)


@_part
def _brightness(
    colours: FloatArray, factors: FloatArray, base: FloatArray, share: float, parts: FloatArray
) -> float:
    """The brightness of a share of the ball, and in `parts` its derivatives by the factors."""
    brightness = 0.0
    for i in range(parts.shape[0]):
        total = 0.0
        for j in range(SHADES):
            total += colours[i, j] * base[j]
        parts[i] = total * share
        brightness += factors[i] * parts[i]
    return float(brightness)


@_part
def _added(
    matrix: FloatArray,
    right: FloatArray,
    edge: FloatArray,
    bright: float,
    parts: FloatArray,
    weight: float,
    residual: float,
    channel: int,
) -> None:
    """Add a pixel of a channel to the lower half of the normal equations."""
    first = 7 + parts.shape[0] * channel
    at_edge = abs(edge[2]) > 0.0
    if at_edge:
        for i in range(7):
            g = weight * edge[i] * bright
            right[i] += g * residual
            for j in range(i + 1):
                matrix[i, j] += g * edge[j] * bright
    for i in range(parts.shape[0]):
        g = weight * parts[i]
        right[first + i] += g * residual
        if at_edge:
            for j in range(7):
                matrix[first + i, j] += g * edge[j] * bright
        for j in range(i + 1):
            matrix[first + i, first + j] += g * parts[j]


@_part
def _step(z: float) -> float:
    """From 0 to 1, smoothly."""
    return 1.0 / (1.0 + math.exp(min(max(-z, -40.0), 40.0)))


@_part
def _covered(
    dx: float,
    dy: float,
    p: FloatArray,
    blur: float,
    velocity: FloatArray,
    g: FloatArray,
) -> float:
    """The share of a pixel that the disc covers, and in `g` its derivatives by `p`."""
    for i in range(7):
        g[i] = 0.0
    r, stretch, lean, exposure = p[2], p[3], p[4], p[5]
    length = math.hypot(velocity[0], velocity[1]) * exposure
    steps = int(min(max(math.ceil(length / (1.5 * blur + 0.1 * r)), 1.0), 31.0))
    part = exposure / steps
    cover = 0.0
    for j in range(steps):
        share = (j + 0.5) / steps - 0.5
        ey = dy - share * exposure * velocity[1]
        ex = dx - share * exposure * velocity[0] - lean * ey
        v = ey / ((1.0 + stretch) * r)
        u = ex / r
        d = math.sqrt(u * u + v * v) + 1e-9
        # How far the edge moves outwards here if the centre moves by one.
        nu = u / d
        nv = v / d / (1.0 + stretch)
        along = nu * (velocity[0] - lean * velocity[1]) + nv * velocity[1]
        # Within a step the edge moves evenly, which blurs it.
        soft = math.sqrt(blur * blur + (along * part) ** 2 / 12.0)
        z = (1.0 - d) * r / soft
        if z > _EDGE:
            cover += 1.0
        if abs(z) > _EDGE:
            continue
        cover += 0.5 * (1.0 + math.erf(z * math.sqrt(0.5)))
        density = math.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi) / soft / steps
        g[0] += density * nu
        g[1] += density * (nv - lean * nu)
        g[2] += density
        g[3] += density * nv * ey / (1.0 + stretch)
        g[4] += density * nu * ey
        g[5] += density * (share * along - z * part * along * along / (12.0 * steps * soft))
        g[6] -= density * z * p[6] / soft
    return cover / steps


@_part
def _inward(
    u: float, v: float, d: float, p: FloatArray, blur: float, velocity: FloatArray
) -> float:
    """By what factor nearer to the centre the light of a pixel at (u, v) comes from, on average: at
    a blurred edge only from inside of it.
    """
    along = (u * velocity[0] + v * velocity[1]) / d * p[5]
    soft = math.sqrt(blur * blur + along * along / 12.0)
    z = max((1.0 - d) * p[2] / soft, -_EDGE)
    if z > _EDGE:
        return 1.0
    density = math.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)
    mean = z + density / (0.5 * math.erfc(-z * math.sqrt(0.5)))
    return float(max(1.0 - mean * soft / p[2], 0.0) / d)


@_part
def _shaded(u: float, v: float, base: FloatArray) -> None:
    """The functions of brightness at a place within the disc, into `base`."""
    height = math.sqrt(max(1.0 - u * u - v * v, 0.0))
    base[0] = 1.0
    base[1] = u
    base[2] = v
    base[3] = height
    base[4] = u * v
    base[5] = u * height
    base[6] = v * height
    base[7] = u * u - v * v
    base[8] = 3.0 * height * height - 1.0


@_part
def _sampled(look: FloatArray, u: float, v: float) -> float:
    """The look at u and v, linear between its places."""
    last = look.shape[0] - 1
    column = min(max((u + LOOK) / (2.0 * LOOK) * last, 0.0), last - 1e-6)
    row = min(max((v + LOOK) / (2.0 * LOOK) * last, 0.0), last - 1e-6)
    j = int(column)
    i = int(row)
    x = column - j
    y = row - i
    upper = look[i, j] * (1.0 - x) + look[i, j + 1] * x
    lower = look[i + 1, j] * (1.0 - x) + look[i + 1, j + 1] * x
    return float(upper * (1.0 - y) + lower * y)
