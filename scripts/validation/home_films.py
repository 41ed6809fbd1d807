"""What does a phone's film of a bouncing ball determine? `home_films.py FOLDER --sessions 40`.

A session is 8 to 20 films, as positions in pixels; rendered films showed how those of a detector
err, and `discs.Noise` has it. The scale is by the disc and by gravity, the time of a row by the
picture, the court by a ball that rolls on it or not at all.

`--sessions`: balls from priors are filmed, tracked, and fitted with the same priors. The study
counts how often 95 % intervals hold, with a ball that rolls (`roll`) and without (`bare`).

`--table`: the ball of the thesis, by films, rates and with or without a ball that rolls: what
`calibrate` says of its stiffnesses in so many sessions of each.

`--worth`: errors of one film by how it is filmed: rate, exposure, distance, mark, court.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Mapping
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from films import DRAG_SD, JUDGED, PRIORS, Film, Truth, draw_truth, films, intervals
from study import Rate, Record, replicates

import fitball
from fitball.base.values import FloatArray
from fitball.data.scene import BallSection, CameraSection, Scene, ValueWithSd
from fitball.inference.problem.build import problem_from_sources

# `films` made tests importable.
discs: Any = import_module("support.discs")
sys.path.insert(0, str(Path(__file__).parents[1]))
bundled: Any = import_module("bundled_film")
# Rows of the picture of a phone.
ROWS = 720
# Most speed [m/s] of a ball that people throw or hit before a phone.
SPEEDS = (6.0, 11.0)


class CameraErrors(NamedTuple):
    """What a picture shows of the camera: sds of row time [s], tilt [rad] and clock."""

    row_time: float = 0.7e-6
    tilt: float = 0.00175
    clock: float = 1e-3


# As rendered films showed it (`detector.py`, its last line).
NOISE: Any = discs.Noise()
ERRORS = CameraErrors()


class Setting(NamedTuple):
    """How a session is filmed: frames a second, millimetres a pixel, whether a ball is rolled."""

    fps: float = 240.0
    mm_per_px: float = 1.4
    roll: bool = True
    marked: bool = True


def throws(count: int, rng: np.random.Generator) -> FloatArray:
    """Incident velocities [m/s] and spins [rad/s] (count, 3) of balls before a phone."""
    speed = rng.uniform(*SPEEDS, count)
    angle = np.radians(rng.uniform(20.0, 62.0, count))
    v_y = np.maximum(speed * np.sin(angle), 3.5)
    return np.stack([speed * np.cos(angle), v_y, rng.uniform(-200.0, 200.0, count)], axis=1)


def session_of(
    truth: Truth,
    setting: Setting,
    rng: np.random.Generator,
    noise: Any,
    errors: CameraErrors,
) -> tuple[pd.DataFrame, pd.DataFrame, Scene]:
    """The positions of a session's films, those of a ball that rolls, and what is known of the
    camera.
    """
    readout = np.clip(rng.normal(0.8, 0.2), 0.1, 1.0)
    row_time = readout / (setting.fps * ROWS)
    camera = Film(
        setting.fps,
        row_time=row_time,
        mm_per_px=setting.mm_per_px,
        clock=1.0 + errors.clock * rng.standard_normal(),
        tilt=errors.tilt * rng.standard_normal(),
        court_height=0.05 * rng.standard_normal(),
        drag=films.DRAG + DRAG_SD * rng.standard_normal(),
    )
    ends = truth.contact_time, truth.ahead
    positions = discs.disc_films(truth.impacts, camera, noise, rng, *ends)
    if not setting.marked:
        positions = positions.drop(columns=["angle [rad]", "angle_fold"])
    stated = max(row_time + errors.row_time * rng.standard_normal(), 0.0)
    section = CameraSection(
        fps=setting.fps,
        row_time=ValueWithSd(float(stated), errors.row_time),
        tilt=ValueWithSd(0.0, errors.tilt),
    )
    scene = Scene(ball=BallSection(radius=films.RADIUS), camera=section)
    return positions, discs.rolled(camera, noise, rng), scene


def tracked(
    truth: Truth,
    setting: Setting,
    rng: np.random.Generator,
    noise: Any = NOISE,
    errors: CameraErrors = ERRORS,
) -> fitball.Film:
    """The impacts that `track` finds in a session."""
    positions, roll, scene = session_of(truth, setting, rng, noise, errors)
    shows_court = roll if setting.roll else ""
    return fitball.track(positions, scene=scene, roll=shows_court, as_read=True, progress=False)


def record_of_session(setting: Setting, number: int) -> Record:
    """For each parameter JUDGED whether its 95 % interval holds the truth, and the interval; and
    the errors of states over their sds.
    """
    rng = np.random.default_rng([int(setting.fps), setting.roll, number])
    count = int(rng.integers(8, 21))
    truth = draw_truth(rng, count, throws)
    film = tracked(truth, setting, rng)
    problem, _ = problem_from_sources(
        [film.table],
        scene=film.scene,
        as_read=True,
        prior=PRIORS,
    )
    ends = intervals(problem)
    z, _ = films.scores(film, truth.impacts)
    return {
        "films": count,
        "truth": {name: truth.values[name] for name in JUDGED},
        "ends": {name: pair.tolist() for name, pair in zip(JUDGED, ends, strict=True)},
        "z": z.tolist(),
    }


def report_sessions(folder: Path, count: int) -> None:
    """Print how often intervals hold, with a ball that rolls and without."""
    for name, roll in (("roll", True), ("bare", False)):
        make = partial(record_of_session, Setting(roll=roll))
        records = replicates(f"home-{name}", make, range(count), folder)
        fitted = [record for record in records if "failed" not in record]
        print(f"{name}: {len(fitted)} of {count} sessions fitted")
        for parameter in JUDGED:
            hits = 0
            for record in fitted:
                low, high = record["ends"][parameter]
                hits += low <= record["truth"][parameter] <= high
            print(f"    {parameter}: {Rate(hits, len(fitted))}")
        for reason in {record["failed"] for record in records if "failed" in record}:
            print("    failed:", str(reason)[:300])


STIFFNESSES = ("k_y", "k_theta")
# The ball of the bundled film, and how its rebounds scatter.
BALL: Mapping[str, float] = bundled.BALL | {
    "v_x_sd": 0.05,
    "v_y_sd": 0.05,
    "spin_sd": 2.0,
    "gap_time_sd": 3e-5,
    "gap_path_sd": 4e-4,
    "gap_turn_sd": 0.012,
}


def truth_of_thesis(count: int, rng: np.random.Generator) -> Truth:
    """So many impacts of the ball of the thesis."""
    return draw_truth(rng, count, throws, BALL)


class Cell(NamedTuple):
    """A cell of the table: so many films, and how they are filmed."""

    films: int
    setting: Setting

    @property
    def name(self) -> str:
        """What is varied, in words."""
        roll = "roll" if self.setting.roll else "bare"
        mark = "mark" if self.setting.marked else "plain"
        return f"{self.films} films, {self.setting.fps:g}/s, {roll}, {mark}"


FILMS = (6, 12, 24)
RATES = (120.0, 240.0)
CELLS = (
    *(Cell(n, Setting(fps, roll=r)) for n in FILMS for fps in RATES for r in (True, False)),
    Cell(12, Setting(marked=False)),
)


def record_of_cell(number: int) -> Record:
    """What `calibrate` says of the stiffnesses in a session of a cell; numbers go through all cells
    before a second session of the first.
    """
    cell = CELLS[number % len(CELLS)]
    rng = np.random.default_rng([58, number])
    truth = truth_of_thesis(cell.films, rng)
    film = tracked(truth, cell.setting, rng)
    # Profiles have the ends of intervals too, and take a tenth of the time.
    fit = fitball.calibrate(
        film.table,
        scene=film.scene,
        as_read=True,
        point_only=True,
        cores=1,
        progress=False,
    )
    said: dict[str, dict[str, Any]] = {}
    for name in STIFFNESSES:
        if name in fit.parameters:
            row: Any = fit.summary.loc[name]
            keys = ("point", "profile_low", "profile_high")
            said[name] = {key: float(row[key]) for key in keys}
            said[name] |= {key: str(row[key]) for key in ("verdict", "given")}
    return {"cell": cell.name, "said": said}


def report_table(folder: Path, count: int) -> None:
    """Print what so many sessions of each cell determine: how many 95 % intervals hold the truth,
    by profiles, the median of their half widths, and verdicts with what they rest on.
    """
    records = replicates("home-table", record_of_cell, range(count * len(CELLS)), folder)
    for place, cell in enumerate(CELLS):
        of_cell = records[place :: len(CELLS)]
        fitted = [record["said"] for record in of_cell if "failed" not in record]
        print(f"{cell.name}: {len(fitted)} of {len(of_cell)} sessions fitted")
        for name in STIFFNESSES:
            rows = [said[name] for said in fitted if name in said]
            if not rows:
                print(f"    {name}: no parameter of the model that is chosen")
                continue
            ends = [(row["profile_low"], row["profile_high"]) for row in rows]
            held = sum(low <= BALL[name] <= high for low, high in ends)
            widths = [50.0 * (high - low) / BALL[name] for low, high in ends]
            verdicts = Counter(f"{row['verdict']} ({row['given']})" for row in rows)
            print(f"    {name}: {held} of {len(rows)} hold, +- {np.median(widths):.0f} %", end="; ")
            print(", ".join(f"{words} {times}" for words, times in verdicts.items()))


def report_worth(count: int) -> None:
    """Print rms errors of one film by how it is filmed."""
    usual = Setting()
    ways: Mapping[str, tuple[Setting, Any, CameraErrors]] = {
        "as usual": (usual, NOISE, ERRORS),
        "120/s": (usual._replace(fps=120.0), NOISE, ERRORS),
        "480/s": (usual._replace(fps=480.0), NOISE, ERRORS),
        "0.7 mm/px": (usual._replace(mm_per_px=0.7), NOISE, ERRORS),
        "2.8 mm/px": (usual._replace(mm_per_px=2.8), NOISE, ERRORS),
        "errors of discs twice": (usual, NOISE._replace(lasting=0.24, radius=0.03), ERRORS),
        "balls within 5 mm of one plane": (usual, NOISE._replace(distance=0.002), ERRORS),
        "row time not seen": (usual, NOISE, ERRORS._replace(row_time=0.2 / (240.0 * ROWS))),
        "tilt to 0.3 deg": (usual, NOISE, ERRORS._replace(tilt=0.005236)),
        "no mark": (usual._replace(marked=False), NOISE, ERRORS),
        "no ball rolled": (usual._replace(roll=False), NOISE, ERRORS),
    }
    for name, (setting, noise, camera) in ways.items():
        errors = []
        for number in range(count):
            rng = np.random.default_rng(number)
            truth = truth_of_thesis(12, rng)
            film = tracked(truth, setting, rng, noise, camera)
            errors.append(films.scores(film, truth.impacts)[1])
        rms = np.sqrt(np.nanmean(np.concatenate(errors) ** 2, axis=0))
        words = [f"{key} {size:.2g}" for key, size in zip(films.TRACKED_NAMES, rms, strict=True)]
        print(f"{name}: {', '.join(words)}", flush=True)


def main() -> None:
    """Print what is asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("folder", type=Path, help="where results of the studies are kept")
    parser.add_argument(
        "--sessions", type=int, default=0, metavar="N", help="sessions to be fitted"
    )
    parser.add_argument(
        "--table", type=int, default=0, metavar="N", help="sessions of each cell of the table"
    )
    parser.add_argument(
        "--worth", type=int, default=0, metavar="N", help="sessions of each way to film"
    )
    arguments = parser.parse_args()
    if arguments.sessions:
        report_sessions(arguments.folder, arguments.sessions)
    if arguments.table:
        report_table(arguments.folder, arguments.table)
    if arguments.worth:
        report_worth(arguments.worth)


if __name__ == "__main__":
    main()
