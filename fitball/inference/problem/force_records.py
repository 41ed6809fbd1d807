"""Force records as the likelihood sees them: some two dozen means of each, how these scatter together, and their
noise.

A record has many samples and little information. Its samples are averaged to means with triangular weights at evenly
spaced nodes. The residuals of these are white noise of the sensor, with an sd of `force_sd` per sample, plus a slow
misfit of the model's force: a smooth random course with an sd of `force_misfit` times the record's peak during the
contact (a Gaussian process with a Matern covariance of order 3/2, whose courses bend but do not jump). The misfit is
what keeps a record sampled ten times as fast from knowing ten times as much. Both covariances have common axes
(generalised eigenvectors), found here once: along these the deviations are independent whatever the size of the two.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from fitball.data.force import ForceFile, ForceRecord
from fitball.data.scene import Scene
from fitball.inference.problem.parameters import FORCE_NOISE
from fitball.models.model import Model
from fitball.values import FloatArray

# Means of a record at most: the contact then has at least a dozen, a tenth of a half-sine being lost in none.
NODES = 24
# How far before and after the contact a record counts, as a share of its length.
MARGIN = 0.25
# Length over which the misfit is alike, as a share of the contact's: a pulse of the right height and length that is
# lopsided, flat or peaked deviates so.
ALIKE = 0.3
# How far before and after the contact the misfit dies out, as a share of its length.
SOFT = 0.2
# Sd of the start of contact about where the record rises, as a share of the contact's length: the record decides.
UNKNOWN_START = 0.25


@dataclass(frozen=True, eq=False)
class ForceRecords:
    """The records of a table: `means` [N] (records, nodes) at times `first` [s] and every `spacing` [s], each over
    `block` samples and as many on either side; `begin` [s], the time at which a record rises; `length` [s] and `peak`
    [N] of the contact; `centroid` [s], the mean time of its force; how many `samples` count; `rows`, the impacts; all
    (records,). Means are padded with NaN to the longest record. `start_sd` [s] is how well t = 0 is known to be the
    start of contact, None where the start is found from the record.
    """

    source: str
    digest: str
    start_sd: float | None
    rows: NDArray[np.int64]
    block: NDArray[np.int64]
    samples: NDArray[np.int64]
    first: FloatArray
    spacing: FloatArray
    begin: FloatArray
    length: FloatArray
    peak: FloatArray
    centroid: FloatArray
    measured: FloatArray

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def nodes(self) -> int:
        """Number of means of the longest record."""
        return int(self.measured.shape[1])

    @cached_property
    def mask(self) -> NDArray[np.bool_]:
        """Where there is a mean (records, nodes)."""
        return np.asarray(~np.isnan(self.measured))

    @cached_property
    def means(self) -> FloatArray:
        """The means (records, nodes) [N], 0 where there is none."""
        return np.where(self.mask, self.measured, 0.0)

    @cached_property
    def start(self) -> tuple[FloatArray, FloatArray]:
        """Where contact is expected to start before model and record are compared, and its sd, (records,) [s]."""
        if self.start_sd is not None:
            return np.zeros(len(self)), np.full(len(self), self.start_sd)
        return self.begin, UNKNOWN_START * self.length

    @cached_property
    def _axes(self) -> tuple[FloatArray, FloatArray, float, FloatArray]:
        rotation = np.zeros((len(self), self.nodes, self.nodes))
        slow = np.zeros((len(self), self.nodes))
        variances = np.zeros((2, len(self), self.nodes))
        constant = 0.0
        for place, count in enumerate(self.mask.sum(axis=1).tolist()):
            white, smooth = self._covariances(place, count)
            values, vectors = eigh(smooth, white)
            rotation[place, :count, :count] = vectors.T
            # Rounding leaves the least of them at its own size on either side of zero.
            slow[place, :count] = np.maximum(values, 0.0)
            variances[:, place, :count] = np.diag(white), np.diag(smooth)
            constant -= 0.5 * float(np.linalg.slogdet(white)[1]) + 0.5 * count * np.log(2.0 * np.pi)
        return rotation, slow, constant, variances

    def _covariances(self, place: int, count: int) -> tuple[FloatArray, FloatArray]:
        """Covariances (count, count) of the means of a record by white noise of sd 1 a sample, and by a misfit of
        sd 1.
        """
        block, length = int(self.block[place]), self.length[place]
        weights = triangle(block)
        white = float(weights @ weights) * np.eye(count)
        # Neighbouring means share the samples between them.
        shared = float(weights[block:] @ weights[: block - 1])
        white += shared * (np.eye(count, k=1) + np.eye(count, k=-1))
        times = self.spacing[place] * np.arange(count)
        ahead = self.begin[place] - self.first[place]
        # Well before landing and after release there is no force to miss; where these are the model may be wrong too.
        beyond = np.maximum(ahead - times, times - ahead - length) / length
        within = np.clip(1.0 - beyond / SOFT, 0.0, 1.0)
        apart = np.sqrt(3.0) * np.abs((times[:, None] - times) / (ALIKE * length))
        return white, within[:, None] * within * (1.0 + apart) * np.exp(-apart)

    @property
    def rotation(self) -> FloatArray:
        """From means to independent deviations (records, nodes, nodes), each of variance 1 by white noise of sd 1."""
        return self._axes[0]

    @property
    def slow(self) -> FloatArray:
        """Variance (records, nodes) of each such deviation by a misfit of sd 1."""
        return self._axes[1]

    @property
    def constant(self) -> float:
        """What the log likelihood has beside the log density of the deviations in units of their spread."""
        return self._axes[2]

    @property
    def variances(self) -> FloatArray:
        """Variances (2, records, nodes) of the means by white noise of sd 1 a sample, and by a misfit of sd 1."""
        return self._axes[3]

    def _some(self, kept: NDArray[np.bool_]) -> ForceRecords | None:
        if not kept.any():
            return None
        longest = int(self.mask[kept].sum(axis=1).max())
        columns = {name: getattr(self, name)[kept] for name in COLUMNS}
        return replace(self, **columns, measured=self.measured[kept, :longest])

    def take(self, kept: NDArray[np.int64]) -> ForceRecords | None:
        """Those of the impacts `kept` (sorted), numbered as these are; None when there is none."""
        mine = self._some(np.isin(self.rows, kept))
        return None if mine is None else replace(mine, rows=np.searchsorted(kept, mine.rows))

    def without(self, rows: NDArray[np.int64]) -> ForceRecords | None:
        """Those of all other impacts than `rows`, None when there is none."""
        return self._some(~np.isin(self.rows, rows))


# What there is of each record besides its means.
COLUMNS = ("rows", "block", "samples", "first", "spacing", "begin", "length", "peak", "centroid")


def triangle(block: int) -> FloatArray:
    """Weights (2 block - 1,) of the samples in a mean; they add up to one."""
    steps = np.abs(np.arange(-(block - 1), block))
    return np.asarray((1.0 - steps / block) / block)


def build_records(file: ForceFile, start_sd: float | None) -> ForceRecords:
    """The records of a file, averaged around their contacts."""
    made = [_averaged(record) for record in file.records]
    measured = np.full((len(made), max(means.size for _numbers, means in made)), np.nan)
    for place, (_numbers, means) in enumerate(made):
        measured[place, : means.size] = means
    columns = dict(zip(COLUMNS, map(np.array, zip(*(numbers for numbers, _means in made), strict=True)), strict=True))
    return ForceRecords(file.source, file.digest, start_sd, **columns, measured=measured)


def _averaged(record: ForceRecord) -> tuple[tuple[float, ...], FloatArray]:
    """What is known of a record around its contact, as in `COLUMNS`, and its means."""
    first, last = record.pulse
    length = last - first + 1
    margin = int(np.ceil(MARGIN * length))
    low, high = max(first - margin, 0), min(last + margin, record.force.size - 1)
    block = max(1, -(-(high - low + 1) // NODES))
    weights = triangle(block)
    reach = block - 1
    centres = np.arange(max(low, reach), min(high, record.force.size - 1 - reach) + 1, block)
    means = np.array([weights @ record.force[k - reach : k + reach + 1] for k in centres])
    inside = slice(first, last + 1)
    centroid = float(record.force[inside] @ record.times[inside] / record.force[inside].sum())
    numbers = (
        *(record.row, block, high - low + 1),
        *(record.begin + record.step * float(centres[0]), record.step * block),
        *(record.begin + record.step * (first - 0.5), record.step * length, float(record.force.max()), centroid),
    )
    return numbers, means


# Noise of a sample that is expected, as a share of the records' mean peak.
EXPECTED = 0.01


def records_for(chosen: Model, scene: Scene, records: ForceRecords | None, notes: list[str]) -> ForceRecords | None:
    """The records, with `notes` on them; None, with a note, where the model has no force to compare."""
    if records is None:
        if scene.force_file is not None:
            notes.append(f"the force records of {scene.force_file} are not used here")
        return None
    if not chosen.has_force:
        notes.append(f"{Path(records.source).name} is not used: model {chosen.name} has no force-time course")
        return None
    counts = records.samples
    notes.append(
        f"force records of {len(counts)} impacts ({Path(records.source).name}): {counts.min()} to {counts.max()} "
        f"samples each, averaged to {records.nodes} means. Sensor noise is independent between samples; the "
        "misfit of the model's force is one slow curve per record"
    )
    notes.append(
        f"t = 0 of a force record is the start of contact within {1e3 * scene.force_start_sd:g} ms"
        if scene.force_start_sd is not None
        else "the start of contact of each force record is a nuisance parameter, integrated out"
    )
    if chosen.force_remark:
        notes.append(chosen.force_remark)
    return records


def force_noise(
    records: ForceRecords, scene: Scene, priors: dict[str, str], fixed: dict[str, tuple[float, str]]
) -> tuple[str, ...]:
    """Names of the noise parameters of records; an sd known to the scene fixes that of a sample."""
    if scene.force_sd is not None:
        fixed[FORCE_NOISE[0]] = (scene.force_sd, "stated in the scene")
    else:
        priors[FORCE_NOISE[0]] = f"lognormal({EXPECTED * float(records.peak.mean()):.6g}, 1.0)"
    return FORCE_NOISE
