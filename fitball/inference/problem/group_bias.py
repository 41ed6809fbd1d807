"""Offsets of whole groups: a bias of one group's measurements shown as such instead of hidden in the noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitball.data.table import REBOUND_UNITS, ImpactTable
from fitball.errors import FitError
from fitball.inference.problem.observables import Channel
from fitball.inference.problem.pooling import labels_of
from fitball.models.specs import ParameterSpec
from fitball.values import FloatArray

# A bias of twice the noise is expected: more would have been noticed by who measured.
EXPECTED = 2.0
# Angle [rad] that a velocity noise turns a rebound by, when it is asked for without knowing the rebound: per m/s.
ANGLE_OF_SPEED = 0.1


@dataclass(frozen=True)
class GroupOffsets:
    """An offset for each channel and each of `labels`; `index` (impacts,) says which label an impact has."""

    column: str
    labels: tuple[str, ...]
    index: NDArray[np.int64]

    def name(self, channel: str, label: str) -> str:
        """Name of the offset of a channel in a group."""
        return f"{channel}_offset[{label}]"

    def names(self, channels: Sequence[Channel]) -> set[str]:
        """Names of all offsets."""
        return {self.name(channel.name, label) for channel in channels for label in self.labels}

    def offset(self, columns: Mapping[str, FloatArray], channel: str) -> FloatArray:
        """Offset (draws, impacts) of a channel."""
        by_label = np.stack([columns[self.name(channel, label)] for label in self.labels], axis=1)
        return by_label[:, self.index]

    def take(self, rows: NDArray[np.int64]) -> GroupOffsets:
        """The same groups for some of the impacts."""
        return GroupOffsets(self.column, self.labels, self.index[rows])

    def specs(self, channels: Sequence[Channel], nominal: Mapping[str, float]) -> dict[str, ParameterSpec]:
        """What the offsets are, by name; `nominal` is the expected noise by noise parameter."""
        made = {}
        for channel in channels:
            size = EXPECTED * _expected_noise(channel, nominal)
            for label in self.labels:
                name = self.name(channel.name, label)
                plain = "".join(item for item in f"{channel.name}{label}" if item.isalnum())
                made[name] = ParameterSpec(
                    name, REBOUND_UNITS[channel.name], -50.0 * size, 50.0 * size, f"normal(0, {size:.6g})",
                    f"how much more than the model {channel.name} is in group {label}",
                    rf"$\Delta_{{\mathrm{{{plain}}}}}$",
                )  # fmt: skip
        return made


def _expected_noise(channel: Channel, nominal: Mapping[str, float]) -> float:
    if channel.sd is not None:
        return float(np.median(channel.sd))
    size = nominal[str(channel.noise)]
    return ANGLE_OF_SPEED * size if channel.turned else size


def build_offsets(table: ImpactTable, column: str) -> GroupOffsets:
    """Offsets over a label column. Raises FitError when there is none, or only one label."""
    asked = f"--offsets {column}"
    labels = labels_of(table, column, asked)
    distinct = tuple(dict.fromkeys(labels))
    if len(distinct) < 2:
        raise FitError(f"{asked}: column {column} of {table.source} holds one label only: {distinct[0]}")
    return GroupOffsets(column, distinct, np.array([distinct.index(item) for item in labels], dtype=np.int64))
