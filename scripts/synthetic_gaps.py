"""Write the bundled table of twenty-four filmed impacts with gaps between the flights, `datasets/synthetic_gaps.csv`,
with the covariances of its rows beside it. Its truth is known.

It is what a film of 1000 frames a second would give: a straight line (after gravity and drag) through the last frames
before each contact, another through the first ones after it, both followed to the height of the court.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

import fitball
from fitball.inference.problem.camera import LEVEL, seen
from fitball.models.types import OUTPUTS
from fitball.values import FloatArray, Impacts

TRUTH = {
    "mass_ratio": 0.883,
    "k_y": 2.0e4,
    "k_theta": 19.0,
    "mu": 0.568,
    "eps_10": 2.38e-3,
    "eps_slope": 0.0,
    "cor_10": 0.774,
    "cor_slope": -0.0151,
}
CAMERA = {"scale": 1.004, "tilt": np.radians(0.15), "court_height": 1.2e-3}
# By how much balls scatter, beyond errors of the film: m/s, m/s, rad/s, s, m, rad.
SCATTER = {
    "v_x2": 0.1, "v_y2": 0.1, "omega_2": 4.0, "gap_time": 3e-5, "gap_path": 4e-4, "gap_turn": np.radians(0.7)
}  # fmt: skip
INCIDENT = ("v_x1", "v_y1", "omega_1")
COLUMNS = (*INCIDENT, *SCATTER)
# A film: frames of each flight, frames a second, errors in a frame [m, rad], and of the angle between both flights:
# the mark looks different from another side.
FRAMES, RATE, POINT, ANGLE, MARK = 24, 1000.0, 8.5e-4, 0.027, np.radians(1.6)
ROWS = 24
# Unit in the table, how many of it are one in SI, and decimals: of values, and of standard deviations.
PRINTED = {
    **dict.fromkeys(("v_x1", "v_y1", "v_x2", "v_y2"), ("m/s", 1.0, 4, 4)),
    **dict.fromkeys(("omega_1", "omega_2"), ("rad/s", 1.0, 3, 3)),
    "gap_time": ("ms", 1e3, 4, 4), "gap_path": ("mm", 1e3, 3, 3), "gap_turn": ("deg", 180.0 / np.pi, 2, 3),
}  # fmt: skip


def line_covariance() -> FloatArray:
    """Covariance (2, 2) of a place and its rate at the end of a line through `FRAMES` frames of unit error, the
    nearest half a frame away; at the beginning of one it has the opposite sign off the diagonal.
    """
    times = -(np.arange(FRAMES) + 0.5) / RATE
    line = np.stack([np.ones(FRAMES), times], axis=1)
    return np.asarray(np.linalg.inv(line.T @ line))


def film_covariance(measured: Mapping[str, FloatArray]) -> FloatArray:
    """Errors (impacts, 9, 9) in SI of `COLUMNS` with these values, that a film makes.

    A flight that is `dy` too high is followed to the court for `dy/v_y` too long before contact, and begins as much
    too early after it. Meanwhile the ball moves on and turns.
    """
    v_x1, v_y1, omega_1, v_x2, v_y2, omega_2 = (measured[name] for name in COLUMNS[:6])
    end = line_covariance()
    sides = [end, end * np.array([[1.0, -1.0], [-1.0, 1.0]])]
    # x and its rate, y upwards and its rate, angle and its rate: before, then after; and the mark.
    basis = np.zeros((13, 13))
    for side, own in enumerate(sides):
        for place, size in enumerate((POINT, POINT, ANGLE)):
            first = 6 * side + 2 * place
            basis[first : first + 2, first : first + 2] = own * size**2
    basis[12, 12] = MARK**2
    slopes = np.zeros((len(v_x1), 9, 13))
    # v_y1 is downwards.
    for column, part, sign in ((0, 1, 1), (1, 3, -1), (2, 5, 1), (3, 7, 1), (4, 9, 1), (5, 11, 1)):
        slopes[:, column, part] = sign
    for column, (before, after) in ((6, (1.0, 1.0)), (7, (v_x1, v_x2)), (8, (omega_1, omega_2))):
        slopes[:, column, 2] = -before / v_y1
        slopes[:, column, 8] = -after / v_y2
    slopes[:, 7, [0, 6]] = slopes[:, 8, [4, 10]] = -1.0, 1.0
    slopes[:, 8, 12] = 1.0
    made = slopes @ basis @ slopes.swapaxes(1, 2)
    return np.asarray(0.5 * (made + made.swapaxes(1, 2)))


def incidence(rows: int, rng: np.random.Generator) -> Impacts:
    """True incident states as flat and as fast as Wang's: without spin, with topspin and with backspin."""
    speed = rng.uniform(16.5, 18.5, rows)
    angle = np.radians(17.0 + 51.0 * (np.arange(rows) // 3 + rng.uniform(size=rows)) / (rows / 3.0))
    spin = np.array([0.0, 150.0, -165.0])[np.arange(rows) % 3] + 12.0 * rng.standard_normal(rows)
    return Impacts(speed * np.cos(angle), speed * np.sin(angle), spin)


def pictured(impacts: Impacts, camera: Mapping[str, float]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Incident states as a camera shows them: its map from shown to true states, solved for those that it shows."""
    known = {**LEVEL, **camera}
    slow, cosine, sine = known["clock"] / known["scale"], np.cos(known["tilt"]), np.sin(known["tilt"])
    v_x, v_y = impacts.v_x1, impacts.v_y1
    return slow * (v_x * cosine + v_y * sine), slow * (v_y * cosine - v_x * sine), impacts.omega_1 * known["clock"]


def film(
    impacts: Impacts,
    truth: Mapping[str, float],
    camera: Mapping[str, float],
    scatter: Mapping[str, float],
    rng: np.random.Generator,
    worse: float = 1.0,
) -> tuple[FloatArray, FloatArray]:
    """A film of these true impacts: measured `COLUMNS` (impacts, 9) in SI, and their errors (impacts, 9, 9). Those of
    the gaps are so many times `worse`.
    """
    rebound = fitball.model("two-mass").rebound(truth, impacts)
    shown = pictured(impacts, camera)
    after = seen({**LEVEL, **camera}, shown, {name: getattr(rebound, name) for name in OUTPUTS})
    exact = np.stack([*shown, *(after[name] for name in SCATTER)], axis=1)
    size = np.where([name.startswith("gap_") for name in COLUMNS], worse, 1.0)
    errors = film_covariance(dict(zip(COLUMNS, exact.T, strict=True))) * np.outer(size, size)
    by_film = np.einsum("kij,kj->ki", np.linalg.cholesky(errors), rng.standard_normal(exact.shape))
    by_ball = np.array([scatter.get(name, 0.0) for name in COLUMNS]) * rng.standard_normal(exact.shape)
    return exact + by_film + by_ball, errors


def texts(seed: int) -> tuple[str, str]:
    """The table and its covariances as text."""
    rng = np.random.default_rng(seed)
    values, errors = film(incidence(ROWS, rng), TRUTH, CAMERA, SCATTER, rng)
    units, factors, digits, sd_digits = (
        list(part) for part in zip(*(PRINTED[name] for name in COLUMNS), strict=True)
    )
    head = [f"{name} [{unit}]" for name, unit in zip(COLUMNS, units, strict=True)]
    head += [f"{name}_sd [{unit}]" for name, unit in zip(COLUMNS, units, strict=True)]
    lines, entries = [",".join(["id", *head])], ["id,column,column,value"]
    for row in range(ROWS):
        own = errors[row] * np.outer(factors, factors)
        cells = [f"{value * factor:.{n}f}" for value, factor, n in zip(values[row], factors, digits, strict=True)]
        cells += [f"{np.sqrt(own[k, k]):.{n}f}" for k, n in enumerate(sd_digits)]
        lines.append(",".join([str(row + 1), *cells]))
        entries += [
            f"{row + 1},{one},{other},{own[i, j]:.5g}"
            for i, one in enumerate(COLUMNS)
            for j, other in enumerate(COLUMNS)
            if i < j and abs(own[i, j]) > 1e-12 * np.sqrt(own[i, i] * own[j, j])
        ]
    return "\n".join(lines) + "\n", "\n".join(entries) + "\n"


def write(folder: Path, seed: int = 1) -> None:
    """Write both files into a folder."""
    for name, text in zip(("synthetic_gaps.csv", "synthetic_gaps_covariance.csv"), texts(seed), strict=True):
        (folder / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    write(Path(__file__).resolve().parent.parent / "datasets")
