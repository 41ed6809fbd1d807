"""What a user asks for beyond table and scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Choices:
    """What the user asked for beyond the scene; everything here wins over it.

    `noise` is one of `noise.KINDS`, `pool` maps parameters to the label column over whose levels they
    differ, `offsets` names the label column whose groups may be biased. Without `incident_errors` the incident state
    counts as exact even where its sd is stated. `velocity_noise` is "tied", "separate" or None, see
    `measurement_noise.noise_by_column`.
    """

    model: str | None = None
    closures: Mapping[str, str] = field(default_factory=dict)
    priors: Mapping[str, str] = field(default_factory=dict)
    fix: Mapping[str, float] = field(default_factory=dict)
    noise: str | None = None
    pool: Mapping[str, str] = field(default_factory=dict)
    offsets: str | None = None
    incident_errors: bool = True
    velocity_noise: str | None = None
