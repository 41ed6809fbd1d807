"""The march along a linear phase: matrix exponentials on a grid, events bracketed there and polished."""

from __future__ import annotations

import numpy as np

from fitball.models.oracle.arithmetic import Arithmetic, Number
from fitball.models.oracle.phases import Matrix, Row
from fitball.values import FloatArray

# Over a twentieth of the fastest pole's time a guard is as good as a parabola: it can touch zero
# twice inside a step only around one extremum, which is looked for.
STEPS_PER_POLE_TIME = 20.0
STEPS_A_BLOCK = 64
# A phase may begin at a zero of its own guard; samples that crowd towards the start see a guard
# that rises and falls again within the first step.
START_SAMPLES: FloatArray = 0.25 ** np.arange(10.0, 0.0, -1.0)


class ExpmMarch:
    """`March` with numbers of one kind; arrays hold them as objects where they are no doubles."""

    def __init__(self, kind: Arithmetic) -> None:
        self.kind, self.rounding = kind, kind.rounding

    def __call__(self, matrix: Matrix, state: Row, guards: list[Row], duration: Number) -> tuple[Number, Row, bool]:
        """See `March`."""
        a, z = self.kind.array(matrix), self.kind.array(state)
        rows = self.kind.array(guards).reshape(-1, z.size)
        fastest = float(np.max(np.abs(np.linalg.eigvals(a.astype(np.float64)))))
        count = max(1, int(np.ceil(float(duration * fastest * STEPS_PER_POLE_TIME))))
        step = duration / count
        if not len(rows):
            return duration, list(self.kind.carried(a, z, duration)), False
        growths = _repeated(self.kind.growth(a * step), min(count, STEPS_A_BLOCK))
        reached = np.zeros((1, len(rows)))
        for block in range(0, count, STEPS_A_BLOCK):
            size = min(STEPS_A_BLOCK, count - block)
            times: FloatArray = np.arange(size + 1, dtype=np.float64) * step
            states = np.vstack([z, z + growths[:size] @ z])
            if block == 0:
                early = np.array([self.kind.carried(a, z, step * share) for share in START_SAMPLES.tolist()])
                times = np.concatenate([times[:1], START_SAMPLES * step, times[1:]])
                states = np.vstack([states[:1], early, states[1:]])
            sizes = np.maximum(_sizes(rows, a, states, block * step + times), reached)
            sizes = np.maximum.accumulate(sizes, axis=0)
            reached = sizes[-1:]
            first_falls = [
                self._first_fall(row, a, times, states, self.kind.noise * size)
                for row, size in zip(rows, sizes.T, strict=True)
            ]
            falls = [fall for fall in first_falls if fall is not None]
            if falls:
                index, beyond = min(falls, key=lambda fall: times[fall[0]] + fall[1])
                elapsed = block * step + times[index] + beyond
                return elapsed, list(self.kind.carried(a, states[index], beyond)), True
            z = states[-1]
        return duration, list(z), False

    def _first_fall(
        self, row: FloatArray, a: FloatArray, times: FloatArray, states: FloatArray, noise: FloatArray
    ) -> tuple[int, Number] | None:
        """Where the guard first falls through zero: index of the sample before it and the time beyond that."""
        values, slopes = states @ row, states @ (a.T @ row)
        below = np.flatnonzero(values < -noise)
        last = int(below[0]) if below.size else len(values) - 1
        gaps = np.diff(times)
        # A guard that falls and rises again within a step reaches zero only if its tangent does.
        dips = np.flatnonzero(
            (values[:-1] > 0) & (slopes[:-1] < 0) & (slopes[1:] > 0) & (values[:-1] + slopes[:-1] * gaps < 0)
        )
        for index in dips[dips < last]:
            gap, at = gaps[index], states[index]
            bottom = self._root(a.T @ row, a, at, gap)
            if row @ self.kind.carried(a, at, bottom) < -noise[index + 1]:
                return int(index), self._root(row, a, at, bottom)
        if not below.size:
            return None
        above = np.flatnonzero(values[:last] > 0)
        if not above.size:
            return 0, self.kind.number(0.0)
        index = int(above[-1])
        return index, self._root(row, a, states[index], gaps[index])

    def _root(self, row: FloatArray, a: FloatArray, z: FloatArray, span: Number) -> Number:
        """When a guard that changes sign within `span` is zero, or the end at which it is zero already."""

        def guard(time: Number) -> Number:
            return self.kind.number(row @ self.kind.carried(a, z, time))

        nothing, span = self.kind.number(0.0), self.kind.number(span)
        start, end = guard(nothing), guard(span)
        if (start > 0) == (end > 0):
            return nothing if abs(start) < abs(end) else span
        return self.kind.root(guard, span)


def _repeated(growth: FloatArray, count: int) -> FloatArray:
    """`exp(k a h) - 1` for k = 1, ..., count, given that of one step."""
    growths = [growth]
    for _ in range(count - 1):
        growths.append(growth + growths[-1] + growth @ growths[-1])
    return np.array(growths)


def _sizes(rows: FloatArray, a: FloatArray, states: FloatArray, elapsed: FloatArray) -> FloatArray:
    """Summands of each guard and of its growth since the phase began, shape (samples, guards)."""
    weights = np.abs(rows).T
    growth = np.abs(states) @ np.abs(a).T @ weights
    sizes: FloatArray = np.abs(states) @ weights + growth * elapsed[:, None]
    return sizes
