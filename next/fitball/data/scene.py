"""Scenes: what is known besides the numbers; the type is the file, the value, a part of fit.json. Imports: itf, base.

Sections `prior`, `fix`, `pool`, `columns` are the options of the same names, which override them.
"""

from pathlib import Path
from typing import Literal

import msgspec

from fitball.errors import Note
from fitball.values import Ball


class Section(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """A section; an unknown key is a fault."""


class Quantity(Section, frozen=True):
    """A number with its sd, which is fitted; a plain number is held."""

    value: float
    sd: float


class BallSection(Section, frozen=True):
    """The ball: kg, m, I/(M R^2) or I [kg m^2] (`inertia`, not both), degrees Celsius, ITF type."""

    mass: float | Quantity = 0.0576
    radius: float | Quantity = 0.03302
    inertia_ratio: float | Quantity = 0.56
    inertia: float | Quantity | None = None
    temperature: float | None = None
    type: str = "type-2"


class CameraSection(Section, frozen=True):
    """What the impacts of a camera share. Of fits: `scale`, `clock` (true over measured), `tilt` [rad],
    `court_height` [m]. Of films: rate, scale, directions, `court` [m], `fold` of marks, and `lasting` [m], errors
    that last over frames, `row_time` [s/px] of a rolling shutter.
    """

    scale: float | Quantity | None = None
    clock: float | Quantity | None = None
    tilt: float | Quantity | None = None
    court_height: float | Quantity | None = None
    fps: float | None = None
    mm_per_px: float | None = None
    y: Literal["up", "down"] = "up"
    angles: Literal["counterclockwise", "clockwise"] = "counterclockwise"
    court: float | Quantity | None = None
    fold: int = 1
    lasting: float = 0.0
    row_time: float | None = None


class Scene(Section, frozen=True):
    """What is known; SI, every section may be left out. `surface` has name, court, mu; `measurement` for each noise
    parameter NAME (held) or nominal_NAME (median of its prior), `noise`, `ignore`; `flight` drag, lift, spin_sd and
    `air` of a film; `model` a name as `--model` takes it; `laboratory` and `source` texts for reports.
    """

    ball: BallSection = BallSection()
    surface: dict[str, str | float | Quantity] = {}
    contact_time: Quantity | None = None
    measurement: dict[str, float | str | tuple[str, ...]] = {}
    camera: CameraSection | None = None
    flight: dict[str, float | Quantity] = {}
    air: dict[str, float] = {}
    model: dict[str, str] = {}
    prior: dict[str, str] = {}
    fix: dict[str, float] = {}
    pool: dict[str, str] = {}
    columns: dict[str, str] = {}
    laboratory: dict[str, str] = {}
    source: dict[str, str] = {}

    def value(self) -> Ball:
        """The ball at its stated values."""

    def assumed(self) -> tuple[Note, ...]:
        """What is assumed because nothing was stated."""


def load_scene(table: Path | None, given: str | Path | None = None) -> Scene:
    """The scene in `given`, else beside the table, else all defaults. Raises InputError (`scene`)."""
