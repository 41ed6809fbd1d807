"""Tracks of simulated impacts as a camera would show them, with their truth: for lectures, planning and tests."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fitball.api.simulating import Subject
from fitball.data.lines import parse_spread
from fitball.errors import ModelError, ParameterError, check_whole
from fitball.files import all_or_none
from fitball.inference.prediction.simulate import refuse_told
from fitball.observables import SI_UNITS
from fitball.report.form.document import Document, Row, Table, Words, on_terminal
from fitball.report.form.files import csv_text, json_text, write_csv, write_text
from fitball.report.form.folders import clear_folder, held
from fitball.report.form.numbers import digits, output_scale
from fitball.tracks.film_text import parse_film
from fitball.tracks.frames import NINE, Track
from fitball.tracks.precision import nine_covariance
from fitball.tracks.simulate import Film, ahead_at_release, simulated_tracks, truth
from fitball.values import Ball, FloatArray, Impacts

if TYPE_CHECKING:
    import pandas as pd

JSON_NAME, TRACKS, TRUTH, SCENE = "simulate.json", "tracks.csv", "truth.csv", "tracks.toml"
# A practice session: speed [m/s], angle to the court [rad], spin [rad/s]. Slower balls rebound too fast for the
# defaults of the model.
SPREAD = {"v_1": (15.0, 25.0), "theta_1": (math.radians(16.0), math.radians(60.0)), "omega_1": (-300.0, 400.0)}
MOST = 10_000


@dataclass(frozen=True, repr=False)
class FilmedImpacts:
    """Simulated `tracks` of impacts with known `true` values (impacts, 9) of the `NINE`, filmed by a camera `film`.
    `sds` (impacts, 9) are the standard errors to be expected; `subject` is the model or fit.
    """

    tracks: tuple[Track, ...]
    true: FloatArray
    sds: FloatArray
    film: Film
    subject: Subject
    ball: Ball

    def __repr__(self) -> str:
        return f"<FilmedImpacts: {len(self.tracks)} tracks at {self.film.fps:g} frames/s>"

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the values of the model."""
        return self.subject.notes

    @property
    def name(self) -> str:
        """The name of its folder."""
        return f"tracks_{self.subject.name}_{self.film.fps:g}"

    def to_frame(self) -> pd.DataFrame:
        """Every frame of every track, a long table that `fitball.track` reads."""
        import pandas as pd

        return pd.DataFrame(list(self._rows()))

    def _rows(self) -> Any:
        for track in self.tracks:
            for k in range(track.time.size):
                row: dict[str, object] = {
                    "id": track.id, "frame": int(track.frame[k]), "t [s]": float(f"{track.time[k]:.9g}"),
                    "x [m]": float(f"{track.x[k]:.8g}"), "y [m]": float(f"{track.y[k]:.8g}"),
                }  # fmt: skip
                if track.angle is not None:
                    row |= {"angle [deg]": float(f"{math.degrees(track.angle[k]):.7g}"), "angle_fold": track.fold}
                if track.radius is not None:
                    row["radius [m]"] = float(f"{track.radius[k]:.8g}")
                yield row

    def _truth(self) -> list[dict[str, object]]:
        return [
            {"id": track.id}
            | {f"{name} [{SI_UNITS[name]}]": float(value) for name, value in zip(NINE, one, strict=True)}
            for track, one in zip(self.tracks, self.true, strict=True)
        ]

    def report(self) -> str:
        """What was simulated, and the standard errors that such a film leaves."""
        film = self.film
        counts = np.array([track.time.size for track in self.tracks])
        lost = int(np.isnan(self.sds[:, 0]).sum())
        words = [
            f"{len(self.tracks)} impacts at {film.fps:g} frames/s, noise {1e3 * film.noise:g} mm, view "
            f"{film.width:g} m: {counts.min()} to {counts.max()} frames each.",
            *([f"{lost} of them have fewer than three frames on a side."] if lost else []),
        ]
        rows: list[Row] = []
        for k, name in enumerate(NINE):
            column = self.sds[:, k][np.isfinite(self.sds[:, k])]
            if not column.size:
                continue
            unit, factor = _unit(name)
            cells = [digits(factor * float(value), 2) for value in np.quantile(column, [0.5, 0.0, 1.0])]
            rows.append(
                {"quantity": name, "expected standard error": f"{cells[0]} {unit}", "from": cells[1], "to": cells[2]}
            )
        table = Table.from_rows("Expected standard errors", rows, rank="first")
        return on_terminal(Document("", [Words(words, "lead", rank="first"), table], []))

    def json(self) -> dict[str, object]:
        """Model, camera and truth."""
        fitted = self.subject.fitted.model
        return {
            "model": fitted.name,
            "closures": dict(fitted.options),
            "parameters": self.subject.parameters,
            "camera": asdict(self.film),
            "truth": self._truth(),
        }

    def save(self, folder: Path, *, overwrite: bool = False) -> tuple[Path, ...]:
        """Write `tracks.csv` with a scene, `truth.csv` and `simulate.json`; returns the paths. Raises
        ResultFolderError.
        """
        import tomli_w

        ball = self.ball
        scene = {
            "ball": {"mass": ball.mass, "radius": ball.radius, "inertia": ball.inertia},
            "camera": {"fps": float(self.film.fps), "court": 0.0},
            "source": {"description": f"{len(self.tracks)} simulated impacts on film; their truth is in {TRUTH}"},
        }
        places = tuple(folder / name for name in (TRACKS, SCENE, TRUTH, JSON_NAME))
        with held(folder), all_or_none():
            clear_folder(folder, JSON_NAME, TRACKS, SCENE, TRUTH, overwrite=overwrite)
            write_csv(places[0], self._rows())
            write_text(places[1], tomli_w.dumps(scene))
            write_text(places[2], csv_text(self._truth()))
            write_text(places[3], json_text(self.json()))
        return places


def _unit(name: str) -> tuple[str, float]:
    if name.startswith("gap"):
        scale = output_scale(name)
        return scale.unit, scale.factor
    return SI_UNITS[name], 1.0


def filmed_impacts(subject: Subject, spread: str, camera: str, count: int, seed: int) -> FilmedImpacts:
    """Tracks of `count` impacts drawn from `spread`, such as `v=15..25, theta=16..60, spin=-300..400`, as a `camera`
    such as `fps=1000, noise=1mm` shows them.

    Raises ModelError for a model without gaps between flights, and ParameterError.
    """
    check_whole(impacts=count, seed=seed)
    if not 1 <= count <= MOST:
        raise ParameterError(f"impacts = {count}: expected 1 to {MOST:,}")
    fitted = subject.fitted
    if not fitted.model.has_gaps:
        raise ModelError(
            f"model {fitted.model.name} does not say when and where a ball leaves: tracks need a model that follows "
            "the contact, such as two-mass"
        )
    refuse_told(fitted)
    film = parse_film(camera) if camera.strip() else Film()
    given: Mapping[str, tuple[float, float]] = {**SPREAD, **(parse_spread(spread) if spread.strip() else {})}
    rng = np.random.default_rng(seed)
    speed, angle, spin = (rng.uniform(*given[name], count) for name in ("v_1", "theta_1", "omega_1"))
    impacts = Impacts.polar(speed, angle, spin)
    ball = Ball() if subject.saved is None else subject.saved.problem.scene.ball
    rebound = fitted.rebound(impacts).each(lambda array: array[0])
    twist = ahead_at_release(fitted.model, subject.parameters, impacts, rebound)
    tracks = simulated_tracks(impacts, rebound, film, rng, ball=ball, twist=twist)
    sds = np.sqrt(np.diagonal(nine_covariance(impacts, rebound, film, ball), axis1=1, axis2=2))
    return FilmedImpacts(tracks, truth(impacts, rebound), np.asarray(sds), film, subject, ball)
