"""Tracks with a known truth: bounces of fitball's two-mass ball, filmed."""

import numpy as np

import fitball
from fitball.tracks.frames import Filmed, Track, Tracks
from fitball.tracks.session import estimate
from fitball.tracks.simulate import Film, simulated_tracks, truth
from fitball.values import FloatArray

VALUES = {
    "mass_ratio": 0.883, "k_y": 2.0e4, "k_theta": 19.0, "mu": 0.568, "eps_10": 2.38e-3, "eps_slope": 0.0,
    "cor_10": 0.774, "cor_slope": -0.0151,
}  # fmt: skip
# Views that phones and cameras of these rates have.
VIEWS = {240: (1.2, 0.8), 500: (0.8, 0.5), 1000: (0.8, 0.5), 2000: (0.5, 0.35), 10000: (0.25, 0.15)}


def film(fps: int, **changes: object) -> Film:
    """A film of this rate with its view."""
    width, height = VIEWS[fps]
    return Film(**{"fps": float(fps), "width": width, "height": height, **changes})


def filmed_bounces(count: int, of: Film, seed: int = 11, bounces: int = 7) -> tuple[FloatArray, tuple[Track, ...]]:
    """The `NINE` of some bounces, (count, 9), and their tracks."""
    rng = np.random.default_rng(bounces)
    speed, angle = rng.uniform(12, 25, count), np.radians(rng.uniform(16, 60, count))
    impacts = fitball.impacts(
        speed * np.cos(angle), np.clip(speed * np.sin(angle), 4, 16), rng.uniform(-300, 400, count)
    )
    rebound = fitball.model("two-mass").rebound(VALUES, impacts).each(np.ravel)
    tracks = simulated_tracks(impacts, rebound, of, np.random.default_rng(seed))
    return truth(impacts, rebound), tracks


def dropped_balls(count: int, of: Film, seed: int = 3) -> tuple[FloatArray, tuple[Track, ...]]:
    """As `filmed_bounces`, of balls that fall nearly straight down."""
    rng = np.random.default_rng(seed)
    impacts = fitball.impacts(rng.uniform(0.0, 0.02, count), rng.uniform(4.0, 8.0, count), np.zeros(count))
    rebound = fitball.model("two-mass").rebound(VALUES, impacts).each(np.ravel)
    return truth(impacts, rebound), simulated_tracks(impacts, rebound, of, rng)


def errors(true: FloatArray, found: Tracks) -> FloatArray:
    """Errors over their sds, (impacts, 9), of what was found; NaN where it is not known."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.array(
            [(made.values - true[int(made.id) - 1]) / np.sqrt(np.diagonal(made.covariance)) for made in found.impacts]
        )


def estimated(count: int, of: Film, filmed: Filmed | None = None, seed: int = 11) -> tuple[FloatArray, Tracks]:
    """Truth and estimate of some bounces."""
    true, tracks = filmed_bounces(count, of, seed)
    return true, estimate(tracks, filmed or Filmed())
