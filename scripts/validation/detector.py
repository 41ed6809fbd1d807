"""How far is what `track` sees in films off their truth? `detector.py FOLDER [NAME ...]`.

FOLDER has films NAME.mp4, `truth.json` (states, radius [px], row time [s], tilt [rad] of each) and
NAME.frames.csv with the truth of frames. `--render N` first renders so many there, of drawn scenes.
`--none N` renders so many films without a ball, which must all be refused, and says why each is.

A line for each film: places less their mean [px, rms], the same over their sds, radius less the
true one [px], that over the sd of the disc's scale, row time and speeds over their total sds, and
frames in a second of CPU, decoding included. The last lines are of all films, and have the noise of
places and angles as `home_films.py` simulates it.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import pandas as pd

import fitball
from fitball.base.errors import FitballError
from fitball.base.values import FloatArray, IntArray
from fitball.data.scene import CameraSection, Scene
from fitball.report.total_errors import total_sds
from fitball.tracks.types import FilmOptions
from fitball.tracks.watch import Watched, watch

sys.path.insert(0, str(Path(__file__).parents[1]))
render: Any = import_module("render_film")

UNITS = {"v_x1": "m/s", "v_y1": "m/s", "v_x2": "m/s", "v_y2": "m/s"}
SPINS = {"omega_1": "rad/s", "omega_2": "rad/s"}
# Films are of one rate within this share.
SAME_RATE = 0.02
# Phases of frames before and after the contact.
FLYING = (0, 2)
BALLS = ((0.62, 0.75, 0.12), (0.8, 0.35, 0.08), (0.75, 0.73, 0.7), (0.9, 0.9, 0.9))
WALLS = ((0.10, 0.16, 0.10), (0.35, 0.35, 0.38), (0.04, 0.04, 0.05))


class Errors(NamedTuple):
    """Errors of one film by frame: `number` and `phase` of the frames, `time` between frames [s],
    `places` (2, frames) [px] less their means in each flight, and `angles` [rad] less theirs.
    """

    number: IntArray
    phase: IntArray
    time: float
    places: Annotated[FloatArray, "2 frames"]
    angles: FloatArray


class Line(NamedTuple):
    """What is printed of a film."""

    place: float
    place_sds: float
    radius: float
    radius_share: float
    radius_sds: float
    row_time_sds: float
    speeds: FloatArray
    spins: FloatArray
    pace: float
    # By how much the hand moved [px], which the truth of frames has and places have not.
    shake: float
    errors: Errors


def drawn_scene(rng: np.random.Generator) -> Any:
    """A scene of a phone, as people film a ball that they throw."""
    fast = bool(rng.uniform() < 0.8)
    speed, angle = rng.uniform(6.0, 10.5), rng.uniform(0.4, 1.0)
    v_x1, v_y1 = speed * np.cos(angle), max(speed * np.sin(angle), 3.5)
    return render.Scene(
        v_x1=v_x1,
        v_y1=v_y1,
        omega_1=rng.uniform(-120.0, 200.0),
        v_x2=v_x1 * rng.uniform(0.5, 0.8),
        v_y2=v_y1 * rng.uniform(0.72, 0.85),
        omega_2=rng.uniform(40.0, 220.0),
        rows=450,
        columns=800,
        rate=240.0 if fast else 120.0,
        mm_per_px=rng.uniform(1.4, 2.4),
        exposure=rng.uniform(3e-4, 1.5e-3),
        row_time=rng.uniform(0.0, 5.5e-6) if rng.uniform() < 0.5 else 0.0,
        tilt=rng.uniform(-0.04, 0.04) if rng.uniform() < 0.3 else 0.0,
        blur=rng.uniform(0.6, 1.3),
        shadow=rng.uniform(0.2, 0.6),
        people=int(rng.integers(0, 2)),
        mark=str(rng.choice(["dot", "stripe", "seam"])),
        ball=BALLS[int(rng.integers(len(BALLS)))],
        wall=WALLS[int(rng.integers(len(WALLS)))],
        leftward=bool(rng.uniform() < 0.5),
        before=0.17,
        after=0.17,
        bitrate=rng.uniform(4e6, 2e7),
    )


def render_films(folder: Path, count: int) -> None:
    """Render so many films of drawn scenes; those that are there stay."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "truth.json"
    known = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    for number in range(count):
        name = f"drawn-{number:02d}"
        if name in known:
            continue
        scene = drawn_scene(np.random.default_rng([58, number]))
        render_film(folder, name, scene, number)


def render_film(folder: Path, name: str, scene: Any, seed: int) -> None:
    """Render one film of a scene, with its truth."""
    path = folder / "truth.json"
    known = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    film = render.Film(scene, seed)
    render.write(folder / f"{name}.mp4", [film])
    (folder / f"{name}.truth.csv").rename(folder / f"{name}.frames.csv")
    known[name] = {
        "states": {key: getattr(scene, key) for key in (*UNITS, *SPINS)},
        "radius_px": film.radius,
        "row_time": scene.row_time,
        "tilt": scene.tilt,
        "fps": scene.rate,
    }
    path.write_text(json.dumps(known, indent=1), encoding="utf-8")


def empty_scene(number: int) -> Any:
    """A scene in which people walk and nobody throws a ball, by a hand that shakes or not."""
    rng = np.random.default_rng([59, number])
    return render.Scene(
        ball_there=False,
        people=1 + number % 3,
        shake=rng.uniform(0.0, 3.0) if number % 4 == 0 else 0.0,
        rate=float(rng.choice([60.0, 120.0, 240.0])),
        wall=WALLS[number % len(WALLS)],
        mm_per_px=rng.uniform(1.8, 3.2),
        before=0.12,
        after=0.14,
    )


def report_empty(folder: Path, count: int) -> None:
    """Print why each film without a ball is refused, and of how many a ball was taken."""
    folder.mkdir(parents=True, exist_ok=True)
    taken = 0
    for number in range(count):
        path = folder / f"none-{number:02d}.mp4"
        if not path.exists():
            render.write(path, [render.Film(empty_scene(number), number)])
        try:
            watch([path], Scene(), FilmOptions(), lambda _stage, _share: None)
        except FitballError as error:
            print(error, flush=True)
        else:
            taken += 1
            print(f"{path.name}: a ball was taken", flush=True)
    print(f"{taken} of {count} films without a ball were taken")


def line_of(folder: Path, name: str, truth: dict[str, Any]) -> Line:
    """What a film shows against its truth. Raises FitballError: the film is refused."""
    start = time.process_time()
    seen = watch([folder / f"{name}.mp4"], Scene(), FilmOptions(), lambda _stage, _share: None)
    pace = seen.seen[0].clip.count / (time.process_time() - start)
    frames = pd.read_csv(folder / f"{name}.frames.csv")
    place, place_sds, radius = places_of(seen, frames)
    film = fitball.track(seen.positions, scene=seen.scene, as_read=True, progress=False)
    camera = seen.scene.camera or CameraSection()
    row_time: Any = camera.row_time
    row_time_sds = np.nan
    if row_time is not None:
        row_time_sds = (row_time.value - truth["row_time"]) / row_time.sd
    scale_sd = float(film.scales["by_ball_sd"].iloc[0])
    share = radius / truth["radius_px"]
    scores = scores_of(film, truth["states"])
    return Line(
        place,
        place_sds,
        radius,
        share,
        share / scale_sd,
        row_time_sds,
        *scores,
        pace,
        seen.seen[0].shake,
        errors_of(seen, frames),
    )


def places_of(seen: Watched, truth: pd.DataFrame) -> tuple[float, float, float]:
    """Errors of places in flights less their mean, rms [px] and over their sds, and the median
    error of the radius [px].
    """
    ball = seen.seen[0].balls[0]
    rows = truth.set_index("frame").reindex(ball.frame)
    errors = np.stack([ball.x - rows["col"], ball.y - rows["row"]])
    sds = np.stack([ball.x_sd, ball.y_sd])
    used = ball.used & rows["phase"].isin(FLYING).to_numpy()
    parts, over = [], []
    for phase in FLYING:
        of_flight = used & (rows["phase"] == phase).to_numpy()
        if of_flight.sum() > 1:
            off = errors[:, of_flight]
            off = off - off.mean(1, keepdims=True)
            parts.append(off.ravel())
            over.append((off / sds[:, of_flight]).ravel())
    radius = float(np.median((ball.radius - rows["radius"].to_numpy())[used]))
    return rms(np.concatenate(parts)), rms(np.concatenate(over)), radius


def errors_of(seen: Watched, truth: pd.DataFrame) -> Errors:
    """Errors of places and angles in the flights of a film, less their means in each."""
    of_film = seen.seen[0]
    ball = of_film.balls[0]
    rows = truth.set_index("frame").reindex(ball.frame)
    phase = rows["phase"].fillna(-1).to_numpy(int)
    used = ball.used & np.isin(phase, FLYING)
    places = np.stack([ball.x - rows["col"], ball.y - rows["row"]])[:, used]
    # Where the mark sits on the ball is not known, nor which of marks that look alike it is.
    turns = np.exp(1j * ball.fold * (ball.angle - rows["angle"].to_numpy())[used])
    angles = np.full(used.sum(), np.nan)
    phase = phase[used]
    for part in FLYING:
        of_part = phase == part
        places[:, of_part] -= places[:, of_part].mean(1, keepdims=True)
        seen_turns = of_part & np.isfinite(turns)
        if seen_turns.any():
            mean = turns[seen_turns].mean()
            angles[seen_turns] = np.angle(turns[seen_turns] / mean) / ball.fold
    return Errors(ball.frame[used], phase, 1.0 / of_film.clip.camera_rate, places, angles)


def covariance(errors: Sequence[Errors], lag: int, angles: bool) -> float:
    """The mean product of errors of frames of a flight that are so many frames apart."""
    products = list[FloatArray]()
    for film in errors:
        rows = film.angles[None] if angles else film.places
        later = np.searchsorted(film.number, film.number + lag)
        here = np.flatnonzero(later < len(film.number))
        later = later[here]
        same = film.number[later] == film.number[here] + lag
        same &= film.phase[later] == film.phase[here]
        products.append((rows[:, here[same]] * rows[:, later[same]]).ravel())
    return float(np.nanmean(np.concatenate(products)))


def noise_words(errors: Sequence[Errors]) -> str:
    """What lasts over frames and what does not, of errors whose correlation falls as a bell, by
    their covariances at no, one and two frames. Films of the most usual rate count.
    """
    if not errors:
        return "noise: no film whose camera stood still"
    step = float(np.median([film.time for film in errors]))
    alike = [film for film in errors if abs(film.time / step - 1.0) < SAME_RATE]
    words = []
    for name, unit, angles in (("places", "px", False), ("angles", "rad", True)):
        total, near, far = (covariance(alike, lag, angles) for lag in range(3))
        if not 0.0 < far < near:
            words.append(f"{name} {np.sqrt(total):.2g} {unit} rms, nothing lasts two frames")
            continue
        bell = np.log(near / far) / 3.0
        lasting = near * np.exp(bell)
        words.append(
            f"{name} lasting {np.sqrt(lasting):.2g} {unit} for {1e3 * step / np.sqrt(2 * bell):.1f}"
            f" ms, of a frame {np.sqrt(max(total - lasting, 0.0)):.2g} {unit}"
        )
    return f"noise of {len(alike)} films at {1.0 / step:.0f}/s: " + "; ".join(words)


def scores_of(film: fitball.Film, states: dict[str, float]) -> tuple[FloatArray, FloatArray]:
    """Errors of speeds and of spins over their total sds."""
    frame = film.impacts
    # Where no mark is seen there are no spins.
    columns = {name: unit for name, unit in (UNITS | SPINS).items() if f"{name} [{unit}]" in frame}
    values = {name: frame[f"{name} [{unit}]"].to_numpy() for name, unit in columns.items()}
    own = {name: frame[f"{name}_sd [{unit}]"].to_numpy() for name, unit in columns.items()}
    totals = total_sds(values, own, film.scene.camera or CameraSection())
    scores = {name: (values[name][0] - states[name]) / totals[name][0] for name in columns}
    speeds = [scores[name] for name in UNITS]
    return np.array(speeds), np.array([scores.get(name, np.nan) for name in SPINS])


def rms(values: FloatArray) -> float:
    """The root of the mean square of what is finite."""
    return float(np.sqrt(np.nanmean(np.square(values))))


def words_of(line: Line) -> str:
    """A line in words."""
    speeds = " ".join(f"{z:+.1f}" for z in line.speeds)
    spins = " ".join(f"{z:+.1f}" for z in line.spins)
    return (
        f"place {line.place:.3f} px ({line.place_sds:.1f} sd), radius {line.radius:+.2f} px "
        f"({line.radius_sds:+.1f} sd), row {line.row_time_sds:+.1f} sd, speeds {speeds}, "
        f"spins {spins}, {line.pace:.1f} frames/s"
    )


def main() -> None:
    """Print what is asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("folder", type=Path, help="films and their truth")
    parser.add_argument("names", nargs="*", help="only these films")
    parser.add_argument("--render", type=int, default=0, metavar="N", help="films to be drawn")
    parser.add_argument("--none", type=int, default=0, metavar="N", help="films without a ball")
    options = parser.parse_args()
    if options.none:
        report_empty(options.folder, options.none)
        return
    render_films(options.folder, options.render)
    truths = json.loads((options.folder / "truth.json").read_text(encoding="utf-8"))
    lines = []
    for name in options.names or truths:
        try:
            line = line_of(options.folder, name, truths[name])
        except FitballError as error:
            print(f"{name}: refused: {error}", flush=True)
            continue
        lines.append(line)
        print(f"{name}: {words_of(line)}", flush=True)
    if not lines:
        return
    speeds = np.concatenate([line.speeds for line in lines])
    spins = np.concatenate([line.spins for line in lines])
    within = np.mean(np.abs(speeds) < 2.0)
    print(
        f"{len(lines)} of {len(options.names or truths)} films: speeds {rms(speeds):.2f} sd rms, "
        f"largest {np.abs(speeds).max():.1f}, within two {100.0 * within:.0f} %; "
        f"spins {rms(spins):.2f} sd rms; radius {rms(np.array([x.radius for x in lines])):.3f} px, "
        f"{100.0 * rms(np.array([x.radius_share for x in lines])):.2f} %, "
        f"{rms(np.array([x.radius_sds for x in lines])):.2f} sd rms; "
        f"median {np.median([x.pace for x in lines]):.1f} frames/s"
    )
    print(noise_words([line.errors for line in lines if line.shake <= 0.0]))


if __name__ == "__main__":
    main()
