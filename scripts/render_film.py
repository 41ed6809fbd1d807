"""Films of a bouncing ball with known truth, for tests, docs and checks of accuracy.

    python scripts/render_film.py OUT.mp4 [--seed 1] [NAME=VALUE ...]

A matt ball with marks flies, bounces and flies on before a wall, in linear light: exposure, rows
read one after the other, blur, shot noise, H.264. OUT.truth.csv has what the camera should see.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from fractions import Fraction
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.ndimage import gaussian_filter, map_coordinates, shift, zoom

from fitball.base.values import FloatArray

RADIUS = 0.033
GRAVITY = 9.81
# Force of the air over mass and the square of velocity of a tennis ball, for a coefficient of one
# [1/m]: rho A/(2 m); and the coefficient of drag.
AIR = 0.0356
DRAG = 0.507
GAMMA = 2.2
# Light from the upper left, in front: how much comes from there and from everywhere.
LIGHT = np.array([-0.35, 0.62, 0.70])
DIRECT, AROUND = 0.75, 0.38


@dataclass(frozen=True)
class Scene:
    """What is filmed and how. Velocities [m/s] and spins [rad/s, topspin positive] before and
    after a contact of `gap_time` [s], `gap_path` [m] and `gap_turn` [rad], of the mean spin if
    None; `rows` and `columns` [px], `rate` [1/s],
    `mm_per_px`, `exposure` [s], `row_time` [s/px], `tilt` [rad], `blur` [px]; `shake` [px] of a
    hand; `shadow` and `contrast` as shares; `people` walk behind. `ball` and `wall` are linear RGB,
    `mark` is dot, stripe, seam or plain. `land` and `court` place the impact as shares of width and
    height. With `ball_there` false nobody throws; `stretch` slows the playback. `drops` lets the
    ball bounce in place so many times, with a restitution of 0.75.
    """

    v_x1: float = 5.0
    v_y1: float = 5.0
    omega_1: float = 60.0
    v_x2: float = 3.2
    v_y2: float = 4.0
    omega_2: float = 110.0
    gap_time: float = 0.005
    gap_path: float = 0.02
    gap_turn: float | None = None
    rows: int = 360
    columns: int = 640
    rate: float = 240.0
    mm_per_px: float = 2.8
    exposure: float = 6e-4
    row_time: float = 0.0
    tilt: float = 0.0
    blur: float = 0.8
    shake: float = 0.0
    shadow: float = 0.5
    people: int = 0
    line: bool = True
    fence: bool = True
    mark: str = "dot"
    ball: tuple[float, float, float] = (0.62, 0.75, 0.12)
    wall: tuple[float, float, float] = (0.10, 0.16, 0.10)
    land: float = 0.5
    court: float = 0.85
    leftward: bool = False
    ball_there: bool = True
    second: bool = False
    drops: int = 0
    before: float = 0.16
    after: float = 0.18
    stretch: float = 1.0
    bitrate: float = 3e6


class State(NamedTuple):
    """Centre [px], turn counterclockwise in the picture [rad], at times of any shape."""

    column: FloatArray
    row: FloatArray
    turn: FloatArray


def course_of(scene: Scene) -> Callable[[FloatArray], State]:
    """Where the ball is at times [s] from landing."""
    flight = _dropped(scene) if scene.drops else _bounced(scene)
    metre = 1e-3 * scene.mm_per_px
    sign = -1.0 if scene.leftward else 1.0

    def at(times: FloatArray) -> State:
        x, y, turn = flight(np.asarray(times, float))
        cos, sin = np.cos(scene.tilt), np.sin(scene.tilt)
        x, y = cos * sign * x - sin * y, sin * sign * x + cos * y
        column = scene.land * scene.columns + x / metre
        row = scene.court * scene.rows - y / metre
        return State(column, row, -sign * turn)

    return at


def _bounced(scene: Scene) -> Callable[[FloatArray], FloatArray]:
    """Place [m] and turn of one bounce: two flights through air, and a smooth contact between."""

    def flight(v_x: float, v_y: float, omega: float, end: float) -> Any:
        def slope(_: float, s: FloatArray) -> list[float]:
            speed = np.hypot(s[2], s[3])
            pull = AIR * DRAG * speed
            lift = AIR * _lift(RADIUS * omega / speed) * speed
            return [s[2], s[3], -pull * s[2] + lift * s[3], -GRAVITY - pull * s[3] - lift * s[2]]

        solved = solve_ivp(slope, (0.0, end), [0.0, 0.0, v_x, v_y], rtol=1e-9, dense_output=True)
        return solved.sol

    first = flight(scene.v_x1, -scene.v_y1, scene.omega_1, -scene.before - 0.1)
    second = flight(scene.v_x2, scene.v_y2, scene.omega_2, scene.after + 0.1)
    gap, path, gap_turn = scene.gap_time, scene.gap_path, scene.gap_turn
    if gap_turn is None:
        gap_turn = 0.5 * (scene.omega_1 + scene.omega_2) * gap

    def at(times: FloatArray) -> FloatArray:
        s = np.clip(times / gap, 0.0, 1.0)
        down = first(np.minimum(times, 0.0).ravel())[:2].reshape(2, *times.shape)
        up = second(np.maximum(times - gap, 0.0).ravel())[:2].reshape(2, *times.shape)
        turn = scene.omega_1 * np.minimum(times, 0.0) + gap_turn * s
        turn = turn + scene.omega_2 * np.maximum(times - gap, 0.0)
        # Hermite's polynomials: place and velocity are continuous.
        start, end = (1.0 - s) ** 2 * s, s**2 * (s - 1.0)
        x = path * s**2 * (3.0 - 2.0 * s) + gap * (start * scene.v_x1 + end * scene.v_x2)
        y = gap * (-start * scene.v_y1 + end * scene.v_y2)
        return np.stack([down[0] + x + up[0], RADIUS + down[1] + y + up[1], turn])

    return at


def _lift(ratio: float) -> float:
    """The coefficient of lift of a tennis ball by the ratio of its spin, times its radius, to its
    speed; topspin presses it down (Cross and Lindsey, Sports Eng. 17
    (2014) 89).
    """
    return ratio / (0.981 + 2.022 * abs(ratio))


def _dropped(scene: Scene) -> Callable[[FloatArray], FloatArray]:
    """Place [m] and turn of a ball that bounces in place again and again, without air."""
    rises = [scene.v_y1 * 0.75**k for k in range(scene.drops + 1)]
    lands = np.cumsum([0.0] + [2.0 * v / GRAVITY for v in rises[1:]])

    def at(times: FloatArray) -> FloatArray:
        number = np.searchsorted(lands, times, side="right")
        since = times - lands[np.maximum(number - 1, 0)]
        v = np.where(number == 0, -scene.v_y1, np.array(rises)[np.minimum(number, scene.drops)])
        y = RADIUS + np.maximum(v * since - 0.5 * GRAVITY * since**2, 0.0)
        return np.stack([0.0 * times, y, scene.omega_1 * times])

    return at


def skin_of(mark: str, rng: np.random.Generator) -> Annotated[FloatArray, "latitudes longitudes"]:
    """Reflectance over latitude and longitude of felt with a mark."""
    latitude, longitude = np.meshgrid(
        np.linspace(-np.pi / 2, np.pi / 2, 128), np.linspace(-np.pi, np.pi, 256), indexing="ij"
    )
    point = np.stack(
        [
            np.cos(latitude) * np.cos(longitude),
            np.cos(latitude) * np.sin(longitude),
            np.sin(latitude),
        ]
    )
    skin = np.ones(latitude.shape)
    for scale, size in ((5.0, 0.04), (12.0, 0.035), (30.0, 0.025)):
        for _ in range(12):
            wave = rng.standard_normal(3)
            wave *= scale / np.linalg.norm(wave)
            phase = np.tensordot(wave, point, 1) + rng.uniform(0.0, 2.0 * np.pi)
            skin = skin + size * np.cos(phase)
    if mark == "dot":
        skin[np.tensordot([0.5, 0.0, 0.866], point, 1) > np.cos(0.32)] = 0.12
    elif mark == "stripe":
        skin[np.abs(point[0]) < 0.1] = 0.12
    elif mark == "seam":
        s = np.linspace(0.0, 2.0 * np.pi, 361)[:, None]
        x, y = 0.75 * np.cos(s) + 0.25 * np.cos(3.0 * s), 0.75 * np.sin(s) - 0.25 * np.sin(3.0 * s)
        curve = np.concatenate([x, y, 0.866 * np.sin(2.0 * s)], 1)
        curve /= np.linalg.norm(curve, axis=1, keepdims=True)
        nearest = (curve @ point.reshape(3, -1)).max(0).reshape(latitude.shape)
        skin[nearest > np.cos(0.07)] = 1.45
    return skin


def scenery_of(scene: Scene, rng: np.random.Generator) -> Annotated[FloatArray, "rows columns 3"]:
    """Linear light of wall and court, with the structure that pictures have."""
    rows, columns, court = scene.rows, scene.columns, int(scene.court * scene.rows)
    rough = np.zeros((rows, columns))
    for scale, size in ((4, 0.04), (16, 0.05), (64, 0.08)):
        grain = rng.standard_normal((rows // scale + 3, columns // scale + 3))
        rough = rough + size * zoom(grain, scale, order=1)[:rows, :columns]
    picture = np.array(scene.wall) * (1.0 + rough)[..., None]
    if scene.fence:
        for x in range(0, columns, 71):
            picture[:, x : x + 4] *= 0.4
        picture[: rows // 6] = np.array([0.55, 0.62, 0.75]) * (
            1.0 + 0.3 * rough[: rows // 6, :, None]
        )
        picture[rows // 3 : rows // 3 + 5] = 0.8
    picture[court:] = np.array([0.10, 0.17, 0.35]) * (1.0 + 2.0 * rough[court:, :, None])
    if scene.line:
        middle = court + (rows - court) // 2
        picture[middle : middle + 5] = 0.85
    if scene.tilt:
        # The world turns about the place of landing.
        y, x = np.mgrid[:rows, :columns].astype(float)
        x, y = x - scene.land * columns, y - scene.court * rows
        cos, sin = np.cos(scene.tilt), np.sin(scene.tilt)
        at = [scene.court * rows + cos * y + sin * x, scene.land * columns + cos * x - sin * y]
        picture = np.stack(
            [map_coordinates(picture[..., c], at, order=1, mode="nearest") for c in range(3)], -1
        )
    return np.clip(picture, 0.003, 0.95)


class Film:
    """A camera that looks at one ball."""

    def __init__(self, scene: Scene, seed: int) -> None:
        self.scene = scene
        self.rng = np.random.default_rng(seed)
        self.at = course_of(scene)
        self.radius = RADIUS / (1e-3 * scene.mm_per_px)
        self.back = scenery_of(scene, self.rng)
        self.skin = skin_of(scene.mark, self.rng)
        self.noise = self.rng.standard_normal((scene.rows + 32, scene.columns + 32, 3))
        mount = np.linalg.qr(self.rng.standard_normal((3, 3)))[0]
        self.mount = mount if scene.mark == "seam" else np.eye(3)
        self.hand = self.rng.uniform(1.0, 6.0, (4, 2)), self.rng.uniform(0.0, 6.28, (4, 2))
        self.walkers = self.rng.uniform([0.0, -1.6], [1.0, 1.6], (scene.people, 2))

    def moved(self, time: float) -> Annotated[FloatArray, "2"]:
        """How far the hand moved the picture [px]."""
        hertz, phase = self.hand
        return np.asarray(self.scene.shake * np.sin(6.283 * hertz * time + phase).sum(0) / 1.41)

    def seen_at(self, start: float, delay: float = 0.0) -> float:
        """Time at the middle of the exposure of the centre's row, of a frame that starts so."""
        time = start + self.scene.exposure / 2.0
        for _ in range(6):
            row = float(self.at(np.array(time - delay)).row)
            time = start + self.scene.exposure / 2.0 + self.scene.row_time * row
        return time

    def picture(self, start: float) -> Annotated[FloatArray, "rows columns 3"]:
        """One frame in linear light, without noise."""
        moved = self.moved(start)
        picture = self.back.copy()
        if self.scene.shake:
            picture = shift(picture, (moved[1], moved[0], 0.0), order=1, mode="nearest")
        for place, speed in self.walkers:
            self._walk(picture, place, speed, start, moved)
        if self.scene.second:
            self._put(picture, start, moved - np.array([0.25e3 / self.scene.mm_per_px, 0.0]), 0.06)
        if self.scene.ball_there:
            self._put(picture, start, moved, 0.0)
        return picture

    def _put(self, picture: FloatArray, start: float, moved: FloatArray, delay: float) -> None:
        """Shadow and ball, smeared over the exposure."""
        scene, r = self.scene, self.radius
        times = start + scene.row_time * scene.court * scene.rows + np.array([0.0, scene.exposure])
        ends = self.at(times - delay)
        column, row = ends.column.mean() + moved[0], ends.row.mean() + moved[1]
        self._shade(picture, column, row, moved)
        fall = scene.row_time * scene.rows * np.hypot(np.ptp(ends.column), np.ptp(ends.row))
        reach = int(1.6 * r + 14 + fall / scene.exposure)
        left, right = (int(np.clip(column + s * reach, 0, scene.columns)) for s in (-1, 1))
        top, bottom = (int(np.clip(row + s * reach, 0, scene.rows)) for s in (-1, 1))
        if right <= left or bottom <= top:
            return
        y, x = np.mgrid[top:bottom, left:right].astype(float)
        cover, light = np.zeros(y.shape), np.zeros(y.shape)
        length = np.hypot(np.ptp(ends.column), np.ptp(ends.row))
        steps = int(np.clip(np.ceil(2.0 * length), 3, 24))
        for step in range(steps):
            time = start + scene.row_time * (y - moved[1]) + scene.exposure * (step + 0.5) / steps
            state = self.at(time - delay)
            u, v = (x - moved[0] - state.column) / r, -(y - moved[1] - state.row) / r
            share = np.clip(0.5 + (1.0 - np.hypot(u, v)) * r, 0.0, 1.0) / steps
            cover += share
            light += share * self._brightness(u, v, state.turn)
        cover, light = gaussian_filter(cover, scene.blur), gaussian_filter(light, scene.blur)
        part = picture[top:bottom, left:right]
        part *= (1.0 - cover)[..., None]
        part += light[..., None] * np.array(scene.ball)

    def _brightness(self, u: FloatArray, v: FloatArray, turn: FloatArray) -> FloatArray:
        """Light from the surface of the ball at u to the right and v up, turned."""
        d2 = np.minimum(u * u + v * v, 1.0)
        height = np.sqrt(1.0 - d2)
        cos, sin = np.cos(turn), np.sin(turn)
        p = np.stack([cos * u + sin * v, cos * v - sin * u, height], -1) @ self.mount
        p /= np.maximum(np.linalg.norm(p, axis=-1, keepdims=True), 1e-9)
        rows, columns = self.skin.shape
        i = (np.arcsin(np.clip(p[..., 2], -1.0, 1.0)) / np.pi + 0.5) * (rows - 1)
        j = (np.arctan2(p[..., 1], p[..., 0]) / (2.0 * np.pi) + 0.5) * (columns - 1)
        skin = map_coordinates(self.skin, [i, j], order=1, mode="nearest")
        direct = np.maximum(u * LIGHT[0] + v * LIGHT[1] + height * LIGHT[2], 0.0)
        return np.asarray(skin * (AROUND + DIRECT * direct))

    def _shade(self, picture: FloatArray, column: float, row: float, moved: FloatArray) -> None:
        scene, r = self.scene, self.radius
        slope = np.tan(scene.tilt) * (column - scene.land * scene.columns)
        court = scene.court * scene.rows + moved[1] - slope
        high = max(court - row - r, 0.0)
        top, bottom = (int(np.clip(court + d, 0, scene.rows)) for d in (-2, 2.0 * r))
        y, x = np.mgrid[top:bottom, : scene.columns]
        d = np.hypot(
            (x - column - 0.25 * high) / (r + 0.3 * high), (y - court - 0.34 * r) / (0.28 * r)
        )
        dark = scene.shadow / (1.0 + 0.8 * high / r)
        picture[top:bottom] *= (1.0 - dark / (1.0 + np.exp(np.minimum(6.0 * (d - 1.0), 50.0))))[
            ..., None
        ]

    def _walk(
        self, picture: FloatArray, place: float, speed: float, time: float, moved: FloatArray
    ) -> None:
        """A person who walks: legs, body, head, and an arm that swings."""
        scene = self.scene
        tall = 0.75e3 / scene.mm_per_px
        middle = place * scene.columns + 1e3 * speed * time / scene.mm_per_px + moved[0]
        foot = scene.court * scene.rows - 3.0 + moved[1]
        swing = 0.15 * np.sin(9.4 * time + 6.0 * place)
        parts = (
            (0.0, 0.25, 0.05, 0.25, (0.05, 0.05, 0.2)),
            (0.0, 0.65, 0.09, 0.2, (0.5, 0.1, 0.1)),
            (0.0, 0.95, 0.055, 0.07, (0.45, 0.28, 0.2)),
            (swing, 0.6, 0.03, 0.15, (0.45, 0.28, 0.2)),
        )
        y, x = np.mgrid[: scene.rows, : scene.columns]
        for across, up, wide, high, colour in parts:
            dx = (x - middle - across * tall) / (wide * tall)
            dy = (y - foot + up * tall) / (high * tall)
            cover = np.clip((1.0 - np.hypot(dx, dy)) * min(wide, high) * tall, 0.0, 1.0)[..., None]
            cloth = 1.0 + 0.3 * np.sin((dy * high + 0.7 * dx * wide) * 60.0)[..., None]
            picture *= 1.0 - cover
            picture += cover * np.array(colour) * cloth

    def frames(self) -> Iterator[tuple[float, Annotated[np.ndarray[Any, Any], "rows columns 3"]]]:
        """Start [s] and picture of each frame."""
        scene = self.scene
        first = -scene.before + self.rng.uniform(0.0, 1.0) / scene.rate
        for k in range(int((scene.before + scene.after) * scene.rate)):
            start = first + k / scene.rate
            picture = self.picture(start)
            i, j = self.rng.integers(0, 32, 2)
            grain = self.noise[i : i + scene.rows, j : j + scene.columns]
            # Shot noise of 6,000 electrons at white, and that of reading.
            picture = picture + grain * np.sqrt(np.clip(picture, 0.0, None) / 6000.0 + 9e-6)
            yield (
                start,
                (255.0 * np.clip(picture, 0.0, 1.0) ** (1.0 / GAMMA) + 0.5).astype(np.uint8),
            )

    def truth(self, start: float) -> tuple[float, ...]:
        """Time, centre, radius, turn and phase of a frame that starts so, as `write` has them."""
        scene, r = self.scene, self.radius
        time = self.seen_at(start)
        state = self.at(np.array(time))
        column, row = np.array([state.column, state.row]) + self.moved(start)
        whole = r < column < scene.columns - r and r < row < scene.rows - r
        phase = 0 if time < 0.0 else 2 if time > scene.gap_time else 1
        return time, column, row, r, float(state.turn), phase if whole and scene.ball_there else 3


def write(path: Path, films: Sequence[Film], preset: str = "veryfast") -> FloatArray:
    """A film of one or several throws, cut together, with the scene of the first, and beside it the
    truth of its frames: number, stamp, time from landing, centre, radius, turn, and phase (0 before
    the contact, 1 in it, 2 after it, 3 not whole in the picture).
    """
    import av

    scene = films[0].scene
    rate = Fraction(scene.rate / scene.stretch).limit_denominator(1001)
    rows = []
    with av.open(str(path), "w", options={"movflags": "use_metadata_tags"}) as box:
        stream: Any = box.add_stream("libx264", rate=rate)
        stream.width, stream.height, stream.pix_fmt = scene.columns, scene.rows, "yuv420p"
        stream.bit_rate = int(scene.bitrate)
        stream.options = {"preset": preset, "bf": "0", "threads": "1"}
        stream.codec_context.time_base = Fraction(1, 90000)
        if abs(scene.stretch - 1.0) > 0.0:
            box.metadata["com.android.capture.fps"] = f"{scene.rate:g}"
        throws = ((film, *taken) for film in films for taken in film.frames())
        for k, (film, start, picture) in enumerate(throws):
            frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
            frame.pts = round(k * 90000 * scene.stretch / scene.rate)
            frame.time_base = Fraction(1, 90000)
            box.mux(stream.encode(frame))
            rows.append((k, frame.pts / 90000, *film.truth(start)))
        box.mux(stream.encode())
    truth = np.array(rows)
    head = "frame,pts,t,col,row,radius,angle,phase"
    place = path.with_suffix(".truth.csv")
    np.savetxt(place, truth, fmt="%.7g", delimiter=",", header=head, comments="")
    return truth


def scene_with(changes: list[str]) -> Scene:
    """The usual scene with changes such as `tilt=0.03`."""
    usual = {field.name: getattr(Scene(), field.name) for field in fields(Scene)}
    kinds = {name: float if value is None else type(value) for name, value in usual.items()}
    values: dict[str, Any] = {}
    for change in changes:
        name, _, text = change.partition("=")
        kind = kinds[name]
        if kind is tuple:
            values[name] = tuple(float(part) for part in text.split(","))
        else:
            values[name] = text == "true" if kind is bool else kind(text)
    return replace(Scene(), **values)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("out", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("changes", nargs="*", help="name=value of a Scene")
    options = parser.parse_intermixed_args()
    made = write(options.out, [Film(scene_with(options.changes), options.seed)])
    print(f"{options.out}: {len(made)} frames, {options.out.stat().st_size / 1e3:.0f} kB")
