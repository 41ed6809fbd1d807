"""What goes into files: impacts with their errors, as tables are read; frames, and spins that the marks allow.

`impacts.csv` has a row for each impact, in SI. Spins are empty where the marks do not say which of several they are;
of balls without marks there are no such columns. The covariance of a row is without what the session shares: scale,
clock, tilt and height of the court are in `[camera]` of `impacts.toml`, where a fit takes them from.
"""

from __future__ import annotations

import os
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from fitball.data.scene import Camera, Quantity
from fitball.observables import SI_UNITS
from fitball.tracks.frames import AFTER, BEFORE, CONTACT, NINE, UNUSED, TrackedImpact, Tracks

ROLES: Mapping[int, str] = {UNUSED: "unused", BEFORE: "before", CONTACT: "contact", AFTER: "after"}
# Digits that are kept: covariances are near singular.
DIGITS = 12


def measured(impact: TrackedImpact) -> list[str]:
    """Those of the `NINE` that an impact has, with their errors."""
    return [name for k, name in enumerate(NINE) if isfinite(impact.values[k]) and impact.covariance[k, k] > 0.0]


def columns_of(tracks: Tracks) -> list[str]:
    """Those of the `NINE` that any impact has; spins too where there are marks that do not determine them."""
    having = {name for impact in tracks.impacts for name in measured(impact)}
    if any(impact.pairs for impact in tracks.impacts):
        having |= {"omega_1", "omega_2", "gap_turn"}
    return [name for name in NINE if name in having]


def impact_rows(tracks: Tracks) -> list[dict[str, object]]:
    """`impacts.csv`: id, session if there are several, labels, each of the nine with its sd."""
    columns = columns_of(tracks)
    sessions = len({impact.track.session for impact in tracks.impacts}) > 1
    labels = dict.fromkeys(name for impact in tracks.impacts for name in impact.track.labels)
    rows = []
    for impact in tracks.impacts:
        row: dict[str, object] = {"id": impact.id}
        if sessions:
            row["session"] = impact.track.session
        row |= {name: impact.track.labels.get(name) for name in labels}
        own = measured(impact)
        for name in columns:
            unit, there = SI_UNITS[name], name in own
            row[f"{name} [{unit}]"] = _rounded(impact.values[NINE.index(name)]) if there else None
            row[f"{name}_sd [{unit}]"] = _rounded(impact.sd(name)) if there else None
        rows.append(row)
    return rows


def covariance_rows(tracks: Tracks) -> Iterator[dict[str, object]]:
    """`impacts_covariance.csv`: id, column, column, value, each pair once."""
    for impact in tracks.impacts:
        own = measured(impact)
        places = [NINE.index(name) for name in own]
        for i, one in enumerate(own):
            for j in range(i + 1):
                value = _rounded(impact.covariance[places[i], places[j]])
                yield {"id": impact.id, "column_1": one, "column_2": own[j], "value": value}


def frame_rows(tracks: Tracks) -> Iterator[dict[str, object]]:
    """`tracks.csv`: every frame of every impact, with what it was used for; residuals are measured less fitted."""
    angles = any(impact.track.angle is not None for impact in tracks.impacts)
    for impact in tracks.impacts:
        track = impact.track
        for k in range(track.time.size):
            used = impact.role[k] in (BEFORE, AFTER)
            row: dict[str, object] = {
                "id": impact.id,
                "frame": int(track.frame[k]),
                "t [s]": _rounded(track.time[k]),
                "x [m]": _rounded(track.x[k]),
                "y [m]": _rounded(track.y[k]),
                "role": ROLES[int(impact.role[k])],
                "outlier": round(1.0 - float(impact.weight[k]), 6) if used and isfinite(impact.weight[k]) else None,
                "residual_x [mm]": _rounded(1e3 * impact.residual[k, 0]),
                "residual_y [mm]": _rounded(1e3 * impact.residual[k, 1]),
            }
            if angles:
                row["angle [deg]"] = None if track.angle is None else _rounded(np.degrees(track.angle[k]))
                row["angle_fold"] = None if track.angle is None else track.fold
                row["residual_angle [deg]"] = _rounded(np.degrees(impact.angle_residual[k]))
            yield row


def spin_rows(tracks: Tracks) -> list[dict[str, object]]:
    """`spins.csv`: each pair of spins that the marks of an impact allow, the most probable first."""
    rows: list[dict[str, object]] = []
    for impact in tracks.impacts:
        for place, pair in enumerate(sorted(impact.pairs, key=lambda pair: -pair.probability)):
            sds = np.sqrt(np.diagonal(pair.covariance))
            rows.append(
                {
                    "id": impact.id,
                    "omega_1 [rad/s]": _rounded(pair.omega_1),
                    "omega_1_sd [rad/s]": _rounded(sds[0]),
                    "omega_2 [rad/s]": _rounded(pair.omega_2),
                    "omega_2_sd [rad/s]": _rounded(sds[1]),
                    "gap_turn [rad]": _rounded(pair.turn),
                    "gap_turn_sd [rad]": _rounded(sds[2]),
                    "probability": _rounded(pair.probability),
                    "used": "yes" if impact.sure and place == 0 else "no",
                }
            )
    return rows


def scene_tree(tracks: Tracks, scene: str | os.PathLike[str] | None, sources: Sequence[str]) -> dict[str, Any]:
    """`impacts.toml`: the keys of the scene file that was read, if any, with the camera as it was found.

    Without a scene the ball is that of `tracks` where it is not the usual one.
    """
    tree: dict[str, Any] = {} if scene is None else tomllib.loads(Path(scene).read_text(encoding="utf-8-sig"))
    usual = type(tracks.filmed.ball)()
    if "ball" not in tree and tracks.filmed.ball != usual:
        ball = tracks.filmed.ball
        tree["ball"] = {"mass": ball.mass, "radius": ball.radius, "inertia": ball.inertia}
    camera = camera_tree(tracks.camera)
    if camera:
        tree["camera"] = camera
    named = ", ".join(sources[:3]) + (f" and {len(sources) - 3} more" if len(sources) > 3 else "")
    tree.setdefault("source", {}).setdefault(
        "description", f"{len(tracks.impacts)} impacts tracked on film by fitball track, from {named or 'positions'}"
    )
    return tree


def camera_tree(camera: Camera) -> dict[str, Any]:
    """`[camera]` of a scene."""
    tree: dict[str, Any] = {}
    for name, value in vars(camera).items():
        if isinstance(value, Quantity):
            tree[name] = value.value if value.sd is None else {"value": value.value, "sd": value.sd}
        elif value is not None:
            tree[name] = value
    return tree


def _rounded(value: float) -> float | None:
    """As many digits as files have; None for what does not exist."""
    return float(f"{value:.{DIGITS}g}") if isfinite(value) else None
