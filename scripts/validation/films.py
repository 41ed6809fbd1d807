"""Do films give impacts with errors that are right, and fits of them parameters? `films.py --films
10 --fits 40`.

Films with a known truth (`tests/support/films.py`) of twelve cameras, a rolling one, and lasting
errors: how often 68 and 95 % intervals of the nine quantities hold, beside controls that must fail.
Then whole roads at 240 and 1000 frames/s: a truth drawn from `PRIORS`, 21 impacts of the two-mass
ball, filmed by a camera whose scale, clock, tilt and court are off within their errors, tracked,
fitted with the same priors: how often 95 % intervals hold. The posterior is that of `calibrate`,
sampled by importance.
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
from fitball.base.columns import COLUMNS
from fitball.base.errors import FitballError, FitError, ParameterError
from fitball.base.priors import parse_prior
from fitball.base.values import FloatArray
from fitball.data.scene import CameraSection, Scene
from fitball.inference.density import log_posterior
from fitball.inference.effort import Effort
from fitball.inference.judgement.first_order import first_order
from fitball.inference.problem.build import problem_from_sources
from fitball.inference.problem.problem import Problem
from fitball.inference.sampling.importance import RELIABLE_K, importance
from fitball.inference.search.best_fit import best_fit
from fitball.models.types import Status

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
films: Any = import_module("support.films")
Film = films.Camera

# Name, camera, what the scene says beside rate and court.
SHUTTER = Film(240, row_time=3.7e-6)
LASTING = Film(1000, lasting=1e-3)
CAMERAS: tuple[tuple[str, Any, Mapping[str, float]], ...] = (
    ("240/s", Film(240), {}),
    ("240/s, 2 mm", Film(240, 2e-3), {}),
    ("240/s, stripe", Film(240, fold=2), {}),
    ("500/s", Film(500), {}),
    ("1000/s, 0.5 mm", Film(1000, 0.5e-3), {}),
    ("1000/s", Film(1000), {}),
    ("1000/s, no outliers", Film(1000, outliers=0.0), {}),
    ("1000/s, 10 % outliers", Film(1000, outliers=0.1), {}),
    ("1000/s, 2 mm", Film(1000, 2e-3), {}),
    ("1000/s, stripe", Film(1000, fold=2), {}),
    ("2000/s", Film(2000), {}),
    ("10000/s", Film(10000), {}),
    ("240/s, rolling", SHUTTER, {"row_time": 3.7e-6, "mm_per_px": 1.0}),
    ("control: rolling, unstated", SHUTTER, {"row_time": 0.0, "mm_per_px": 1.0}),
    ("1000/s, lasting 0.5 mm", replace(LASTING, lasting=0.5e-3), {"lasting": 0.5e-3}),
    ("1000/s, lasting 1 mm", LASTING, {"lasting": 1e-3}),
    ("control: lasting, unstated", LASTING, {}),
    ("1000/s, 1 mm over 10 ms", replace(LASTING, lasting_time=0.01), {"lasting": 1e-3}),
    ("1000/s, 1 mm over 50 ms", replace(LASTING, lasting_time=0.05), {"lasting": 1e-3}),
    ("240/s, lasting 1 mm", Film(240, lasting=1e-3), {"lasting": 1e-3}),
)
PRIORS: Mapping[str, str] = {
    "mass_ratio": "uniform(0.75, 0.97)",
    "k_y": "lognormal(2.0e4, 0.4)",
    "k_theta": "lognormal(19, 0.4)",
    "mu": "lognormal(0.58, 0.15)",
    "eps_10": "normal(0.0022, 0.0008)",
    "eps_slope": "normal(0, 5e-5)",
    "cor_10": "normal(0.76, 0.03)",
    "cor_slope": "normal(-0.015, 0.004)",
    "v_x_sd": "lognormal(0.1, 0.4)",
    "v_y_sd": "lognormal(0.1, 0.4)",
    "spin_sd": "lognormal(4, 0.4)",
    "gap_time_sd": "lognormal(3e-5, 0.5)",
    "gap_path_sd": "lognormal(4e-4, 0.5)",
    "gap_turn_sd": "lognormal(0.012, 0.5)",
}
# Sds of scale, clock, tilt [rad] and height of the court [m], as `track` takes them where none are
# stated.
ERRORS = {"scale": 0.01, "clock": 1e-3, "tilt": 0.005236, "court_height": 3e-3}
JUDGED = ("mu", "eps_10", "cor_10", "cor_slope", "k_theta", "k_y")
BALL = fitball.model("two-mass")
NOISES = {name: column.noise for name, column in COLUMNS.items() if column.noise is not None}
SPECS = {spec.name: spec for spec in (*BALL.parameters, *NOISES.values())}
ROWS = 21
ENOUGH = 500.0


def covered(
    camera: Any,
    said: Mapping[str, float],
    seed: int,
    count: int,
) -> tuple[FloatArray, int, int]:
    """By how many sds the nine of films of 8 impacts are off, how many spins are sure, and of these
    wrong.
    """
    rng = np.random.default_rng(seed)
    off = list[FloatArray]()
    wrong = 0
    for _ in range(count):
        truth = films.bounces(8, rng)
        table = films.filmed(
            truth,
            replace(camera, drag=films.DRAG + 0.05 * rng.standard_normal()),
            rng,
        )
        scene = Scene(camera=changed(CameraSection(fps=camera.fps, court=0.0), **said))
        z, errors = films.scores(
            fitball.track(table, scene=scene, as_read=True, progress=False),
            truth,
        )
        far = (np.abs(errors[:, [2, 5]]) > 40.0) & (np.abs(z[:, [2, 5]]) > 6.0)
        off = [*off, z]
        wrong = wrong + int(far.any(axis=1).sum())
    every = np.concatenate(off)
    return every, int(np.isfinite(every[:, 2]).sum()), wrong


def drawn(rng: np.random.Generator) -> tuple[dict[str, float], FloatArray, FloatArray, FloatArray]:
    """A truth from the priors, impacts (ROWS, 9) that it can have, with scatter, their contact
    times, and by how much the shell is ahead of its line at release.
    """
    impacts: list[FloatArray] = []
    while len(impacts) < ROWS:
        own = {
            n: float(parse_prior(SPECS[n], text).quantile(rng.uniform(size=1))[0])
            for n, text in PRIORS.items()
        }
        values = {spec.name: own[spec.name] for spec in BALL.parameters}
        impacts = []
        for one in films.bounces(3 * ROWS, rng):
            # What this ball cannot have is left out.
            with suppress(ParameterError):
                found = BALL.rebound(values, fitball.impacts(*one[:3]))
                if found.status[0] == Status.OK and found.v_x2[0] > 1.0 and len(impacts) < ROWS:
                    impacts.append(one[:3])
    states = fitball.impacts(*np.transpose(impacts))
    found = BALL.rebound(values, states)
    nodes, weights = np.polynomial.legendre.leggauss(40)
    ahead = np.empty(ROWS)
    for k, end in enumerate(found.contact_time.tolist()):
        course = BALL.history(values, states.take(np.array([k])), 0.5 * end * (nodes + 1.0)).courses
        line = found.gap_turn[k] - found.omega_2[k] * (found.gap_time[k] - end)
        ahead[k] = 0.5 * end * float(weights @ course["omega_shell"]) - line
    after = [
        getattr(found, n) + own[NOISES[n].name] * rng.standard_normal(ROWS)
        for n in films.TRACKED_NAMES[3:]
    ]
    return own, np.column_stack([impacts, *after]), found.contact_time, ahead


def intervals(problem: Problem) -> FloatArray:
    """Quantiles 0.025 and 0.975 (judged, 2). Raises FitError where weights are unreliable."""
    effort = Effort(cores=1)
    begin = first_order(problem, best_fit(problem, effort.stream("search"))).proposal
    q, weight, k = importance(
        lambda q: log_posterior(problem, q),
        [begin],
        effort.stream("weights"),
        ENOUGH,
    )
    if k > RELIABLE_K:
        raise FitError("weights are unreliable", "weights")
    values = problem.prior.value(q)[:, [problem.free.index(name) for name in JUDGED]]
    shares = np.exp(weight)
    ends = [
        (np.cumsum(shares[order]), one[order]) for one in values.T for order in [np.argsort(one)]
    ]
    return np.array([np.interp([0.025, 0.975], *pair) for pair in ends])


def road(fps: float, seed: int) -> list[bool] | str:
    """Whether the 95 % intervals of a film hold the truth, or why there are none."""
    rng = np.random.default_rng([int(fps), seed])
    own, truth, contact, ahead = drawn(rng)
    off = {
        name: sd * rng.standard_normal() + (name in ("scale", "clock"))
        for name, sd in ERRORS.items()
    }
    camera = Film(fps, drag=films.DRAG + 0.05 * rng.standard_normal(), **off)
    table = films.filmed(truth, camera, rng, contact, ahead)
    try:
        film = fitball.track(
            table,
            scene=Scene(camera=CameraSection(fps=fps, court=0.0)),
            progress=False,
        )
        problem, _ = problem_from_sources(
            [film.table], scene=film.scene, as_read=True, prior=PRIORS
        )
        return [
            bool(a <= own[name] <= b)
            for name, (a, b) in zip(JUDGED, intervals(problem), strict=True)
        ]
    except FitballError as error:
        return str(error)[:100]


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument(
        "--films",
        type=int,
        default=0,
        metavar="N",
        help="films of 8 impacts of each camera",
    )
    parser.add_argument(
        "--fits",
        type=int,
        default=0,
        metavar="N",
        help="films of 21 impacts to be fitted",
    )
    asked = parser.parse_args()
    for number, (name, camera, said) in enumerate(CAMERAS if asked.films else ()):
        z, sure, wrong = covered(camera, said, number + 1, asked.films)
        inside = np.array([np.sum(np.abs(z) < level, axis=0) for level in (0.9945, 1.96)])
        shares = (100.0 * inside / np.isfinite(z).sum(axis=0)).round().astype(int)
        print(
            f"{name:27s} {len(z)} impacts, {sure} spins sure, {wrong} wrong;",
            *shares,
            flush=True,
        )
    for fps in (240.0, 1000.0) if asked.fits else ():
        found = [road(fps, number) for number in range(asked.fits)]
        held = np.sum([one for one in found if not isinstance(one, str)], axis=0)
        shown = dict(zip(JUDGED, held.tolist(), strict=True))
        print(f"{fps:g}/s:", shown, *(one for one in found if isinstance(one, str)))


if __name__ == "__main__":
    main()
