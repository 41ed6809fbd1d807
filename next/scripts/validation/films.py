"""Do films give impacts with errors that are right, and fits of them parameters? `films.py --films 10 --fits 40`.

Films with a known truth (`tests/support/films.py`) of twelve cameras, a rolling one, and lasting errors: how often 68
and 95 % intervals of the nine quantities hold, beside controls that must fail. Then whole roads at 240 and 1000
frames/s: a truth drawn from `PRIORS`, 21 impacts of the two-mass ball, filmed by a camera whose scale, clock, tilt
and court are off within their errors, tracked, fitted with the same priors: how often 95 % intervals hold. The
posterior is that of `calibrate`, sampled by importance, or by its chains where weights are unreliable.
"""

import argparse
import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import replace as changed

import fitball
from fitball.columns import COLUMNS
from fitball.data.scene import CameraSection, Scene
from fitball.errors import FitballError, ParameterError
from fitball.inference.density import log_posterior
from fitball.inference.effort import Effort
from fitball.inference.first_order import first_order
from fitball.inference.problem.build import pose
from fitball.inference.problem.problem import Problem
from fitball.inference.results import PointFit
from fitball.inference.sampling.importance import RELIABLE, importance
from fitball.inference.sampling.sample import sample
from fitball.inference.search.best_fit import best_fit
from fitball.models.types import Status
from fitball.priors import parse_prior
from fitball.values import FloatArray

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "support"))
films: Any = import_module("films")
Film = films.Camera

# Name, camera, what the scene says beside rate and court.
CAMERAS: tuple[tuple[str, Any, Mapping[str, float]], ...] = (
    ("240/s", Film(240), {}), ("240/s, 2 mm", Film(240, 2e-3), {}), ("240/s, stripe", Film(240, fold=2), {}),
    ("500/s", Film(500), {}), ("1000/s, 0.5 mm", Film(1000, 0.5e-3), {}), ("1000/s", Film(1000), {}),
    ("1000/s, no outliers", Film(1000, outliers=0.0), {}), ("1000/s, 10 % outliers", Film(1000, outliers=0.1), {}),
    ("1000/s, 2 mm", Film(1000, 2e-3), {}), ("1000/s, stripe", Film(1000, fold=2), {}), ("2000/s", Film(2000), {}),
    ("10000/s", Film(10000), {}),
    ("240/s, rolling", Film(240, row_time=3.7e-6), {"row_time": 3.7e-6, "mm_per_px": 1.0}),
    ("control: rolling, unstated", Film(240, row_time=3.7e-6), {"row_time": 0.0, "mm_per_px": 1.0}),
    ("1000/s, lasting 0.5 mm", Film(1000, lasting=0.5e-3), {"lasting": 0.5e-3}),
    ("1000/s, lasting 1 mm", Film(1000, lasting=1e-3), {"lasting": 1e-3}),
    ("1000/s, 1 mm over 10 ms", Film(1000, lasting=1e-3, lasting_time=0.01), {"lasting": 1e-3}),
    ("1000/s, 1 mm over 50 ms", Film(1000, lasting=1e-3, lasting_time=0.05), {"lasting": 1e-3}),
    ("240/s, lasting 1 mm", Film(240, lasting=1e-3), {"lasting": 1e-3}),
    ("control: lasting, unstated", Film(1000, lasting=1e-3), {}),
)  # fmt: skip
PRIORS: Mapping[str, str] = {
    "mass_ratio": "uniform(0.75, 0.97)", "k_y": "lognormal(2.0e4, 0.4)", "k_theta": "lognormal(19, 0.4)",
    "mu": "lognormal(0.58, 0.15)", "eps_10": "normal(0.0022, 0.0008)", "eps_slope": "normal(0, 5e-5)",
    "cor_10": "normal(0.76, 0.03)", "cor_slope": "normal(-0.015, 0.004)",
    "v_x_sd": "lognormal(0.1, 0.4)", "v_y_sd": "lognormal(0.1, 0.4)", "spin_sd": "lognormal(4, 0.4)",
    "gap_time_sd": "lognormal(3e-5, 0.5)", "gap_path_sd": "lognormal(4e-4, 0.5)",
    "gap_turn_sd": "lognormal(0.012, 0.5)",
}  # fmt: skip
# Sds of scale, clock, tilt [rad] and height of the court [m], as `track` takes them where none are stated.
ERRORS = {"scale": 0.01, "clock": 1e-3, "tilt": 0.005236, "court_height": 3e-3}
JUDGED = ("mu", "eps_10", "cor_10", "cor_slope", "k_theta", "k_y")
BALL = fitball.model("two-mass")
ENOUGH, Z68, Z95 = 500.0, 0.9945, 1.9600


def covered(camera: Any, said: Mapping[str, float], seed: int, count: int) -> tuple[FloatArray, int, int]:
    """By how many sds the nine of films of 8 impacts are off, how many spins are sure, and of these wrong."""
    rng, off, sure, wrong = np.random.default_rng(seed), list[FloatArray](), 0, 0
    for _ in range(count):
        truth = films.bounces(8, rng)
        table = films.filmed(truth, replace(camera, drag=films.DRAG + 0.05 * rng.standard_normal()), rng)
        scene = Scene(camera=changed(CameraSection(fps=camera.fps, court=0.0), **said))
        z, errors = films.scores(fitball.track(table, scene=scene, as_read=True, progress=False), truth)
        known = np.isfinite(z[:, 2])
        off, sure = [*off, z], sure + int(known.sum())
        wrong += int(np.sum((np.abs(errors[:, [2, 5]]) > 40.0).any(axis=1) & known))
    return np.concatenate(off), sure, wrong


def drawn(rng: np.random.Generator) -> tuple[dict[str, float], FloatArray, FloatArray, FloatArray]:
    """A truth from the priors, 21 impacts (21, 9) that it can have, with scatter, their contact times, and by how
    much the shell is ahead of its line at release.
    """
    noises = {name: column.noise for name, column in COLUMNS.items() if column.noise is not None}
    specs = {spec.name: spec for spec in (*BALL.parameters, *noises.values())}
    impacts: list[FloatArray] = []
    while len(impacts) < 21:
        own = {n: float(parse_prior(specs[n], text).quantile(rng.uniform(size=1))[0]) for n, text in PRIORS.items()}
        values, impacts = {spec.name: own[spec.name] for spec in BALL.parameters}, []
        for one in films.bounces(60, rng):
            # What this ball cannot have is left out.
            with suppress(ParameterError):
                found = BALL.rebound(values, fitball.impacts(*one[:3]))
                if found.status[0] == Status.OK and found.v_x2[0] > 1.0 and len(impacts) < 21:
                    impacts.append(one[:3])
    states = fitball.impacts(*np.transpose(impacts))
    found = BALL.rebound(values, states)
    rebound = [getattr(found, name) for name in films.NINE[3:]]
    ahead = np.empty(21)
    nodes, weights = np.polynomial.legendre.leggauss(40)
    for k, end in enumerate(found.contact_time.tolist()):
        course = BALL.history(values, states.take(np.array([k])), 0.5 * end * (nodes + 1.0)).courses
        turned = 0.5 * end * float(weights @ course["omega_shell"])
        ahead[k] = turned - rebound[5][k] + rebound[2][k] * (rebound[3][k] - end)
    scatter = [own[noises[name].name] * rng.standard_normal(21) for name in films.NINE[3:]]
    after = [value + noise for value, noise in zip(rebound, scatter, strict=True)]
    return own, np.column_stack([impacts, *after]), found.contact_time, ahead


def posterior(problem: Problem) -> FloatArray:
    """Quantiles 0.025 and 0.975 (2, judged)."""
    effort = Effort(cores=1)
    point = best_fit(problem, effort.stream("search"))
    tops = [PointFit((one,), (score,), point.log_likelihood, point.rms)
            for one, score in zip(point.optima, point.log_posterior, strict=True)]  # fmt: skip
    begin = [first_order(problem, one).proposal for one in tops]
    q, weight, k = importance(lambda q: log_posterior(problem, q), begin, effort.stream("weights"), ENOUGH)
    places = [problem.free.index(name) for name in JUDGED]
    if k > RELIABLE:
        found = sample(problem, begin, effort, lambda _stage, _share: None)[0].values
        return np.quantile(found.reshape(-1, found.shape[-1])[:, places], [0.025, 0.975], axis=0)
    values, shares = problem.prior.value(q)[:, places], np.exp(weight)
    order = np.argsort(values, axis=0)
    ends = [
        np.interp([0.025, 0.975], np.cumsum(shares[order[:, j]]), values[order[:, j], j]) for j in range(len(places))
    ]
    return np.stack(ends, axis=1)


def road(fps: float, seed: int) -> list[bool] | str:
    """Whether the 95 % intervals of a film hold the truth, or why there are none."""
    rng = np.random.default_rng([int(fps), seed])
    own, truth, contact, ahead = drawn(rng)
    off = {name: sd * rng.standard_normal() for name, sd in ERRORS.items()}
    camera = Film(fps, scale=1.0 + off["scale"], clock=1.0 + off["clock"], tilt=off["tilt"],
                  court_height=off["court_height"], drag=films.DRAG + 0.05 * rng.standard_normal())  # fmt: skip
    table = films.filmed(truth, camera, rng, contact, ahead)
    try:
        film = fitball.track(table, scene=Scene(camera=CameraSection(fps=fps, court=0.0)), progress=False)
        problem, _ = pose([film.table], scene=film.scene, as_read=True, prior=PRIORS)
        low, high = posterior(problem)
    except FitballError as error:
        return str(error)[:100]
    return [bool(a <= own[name] <= b) for name, a, b in zip(JUDGED, low, high, strict=True)]


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--films", type=int, default=0, metavar="N", help="films of 8 impacts of each camera")
    parser.add_argument(
        "--fits", type=int, default=0, metavar="N", help="films of 21 impacts to be fitted, each rate"
    )
    asked = parser.parse_args()
    for number, (name, camera, said) in enumerate(CAMERAS if asked.films else ()):
        z, sure, wrong = covered(camera, said, number + 1, asked.films)
        shares = [
            " ".join(f"{100 * np.mean(np.abs(one[np.isfinite(one)]) < z_of):3.0f}" for one in z.T)
            for z_of in (Z68, Z95)
        ]
        print(
            f"{name:27s} {len(z):4d} impacts, {sure} sure, {wrong} wrong; 68 %: {shares[0]}; 95 %: {shares[1]}",
            flush=True,
        )
    for fps in (240.0, 1000.0):
        held = []
        for number in range(asked.fits):
            found = road(fps, number)
            held += [] if isinstance(found, str) else [found]
            counts = " ".join(f"{n} {c}" for n, c in zip(JUDGED, np.sum(held, axis=0), strict=True)) if held else ""
            print(
                f"{fps:g}/s, film {number + 1}: {found if isinstance(found, str) else ''} {counts} of {len(held)}",
                flush=True,
            )


if __name__ == "__main__":
    main()
