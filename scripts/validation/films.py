"""Are errors of impacts on film right, and intervals of fits to them? `films.py --films 10 --fits
40`.

`--films`: simulated films (`tests/support/films.py`) of twelve cameras, of a rolling shutter, and
with lasting errors. The study counts how often 68 and 95 % intervals of the nine quantities hold,
with controls that must fail.

`--good`: the same of the first twelve cameras, whose films are good, as `track` takes them: which
values are within their errors, which films are refused, and which have notes that something is
wrong, by code.

`--fits`: a truth is drawn from `PRIORS`, and 21 impacts of the two-mass ball are filmed at 240 and
1000 frames/s. Scale, clock, tilt and court of the camera are off within their errors. The films are
tracked and fitted with the same priors. The study counts how often 95 % intervals hold, of the
posterior of `calibrate`, sampled by importance.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

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

# A camera that reads rows one after the other.
SHUTTER = Film(240, row_time=3.7e-6)
# A camera with errors that last over frames.
LASTING = Film(1000, lasting=1e-3)
# Name, camera, and what the scene states of it besides rate and court.
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
# Priors of the truth and of the fits.
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
# Parameters whose intervals are counted.
JUDGED = ("mu", "eps_10", "cor_10", "cor_slope", "k_theta", "k_y")
MODEL = fitball.model("two-mass", ball=Scene().ball_value())
# Parameter of the scatter of a column, by name of the column.
NOISES = {name: column.noise for name, column in COLUMNS.items() if column.noise is not None}
SPECS = {spec.name: spec for spec in (*MODEL.parameters, *NOISES.values())}
# Cameras whose films are good, and what is rightly noted of these: the shutter of slow ones may be
# a rolling one, and marks that look alike leave spins open.
GOOD = CAMERAS[:12]
RIGHT_NOTES = frozenset(["shutter", "spins-ambiguous", "no-spins"])
# Impacts of a film of `--films`.
FILM_ROWS = 8
# Impacts of a film that is fitted, as many as Wang measured.
FIT_ROWS = 21
# Effective draws of a posterior.
EFFECTIVE_DRAWS = 500.0
# Levels of intervals in sds: 68 and 95 %.
LEVELS = (0.9945, 1.96)
# Sd over films of the drag coefficient.
DRAG_SD = 0.05
# Spins are wrong that are off by more than this [rad/s] and this many sds.
WRONG_SPIN = 40.0
WRONG_SDS = 6.0
# Indices of the spins among the nine quantities.
SPINS = [2, 5]


def scores_of_films(
    camera: Any,
    stated: Mapping[str, float],
    seed: int,
    count: int,
) -> tuple[FloatArray, int, int]:
    """Errors of the nine quantities over their stated sds, (impacts, 9), of films by a camera; the
    number of impacts whose spins are sure, and of these the number whose spins are wrong.
    """
    rng = np.random.default_rng(seed)
    scores = list[FloatArray]()
    wrong = 0
    for _ in range(count):
        truth = films.bounces(FILM_ROWS, rng)
        drag = films.DRAG + DRAG_SD * rng.standard_normal()
        table = films.filmed(truth, replace(camera, drag=drag), rng)
        scene = Scene(camera=changed(CameraSection(fps=camera.fps, court=0.0), **stated))
        film = fitball.track(table, scene=scene, as_read=True, progress=False)
        z, errors = films.scores(film, truth)
        far = np.abs(errors[:, SPINS]) > WRONG_SPIN
        far &= np.abs(z[:, SPINS]) > WRONG_SDS
        scores.append(z)
        wrong += int(far.any(axis=1).sum())
    z = np.concatenate(scores)
    sure = int(np.isfinite(z[:, SPINS[0]]).sum())
    return z, sure, wrong


# What throws balls: quantities (count, n) of impacts, of which the first three are incident ones.
Throws = Callable[[int, np.random.Generator], FloatArray]


class Truth(NamedTuple):
    """A simulated ball: values of all parameters, SI; the nine quantities of its impacts,
    (impacts, 9); for each impact the contact time [s] and the angle [rad] by which the shell is
    ahead of its line at release.
    """

    values: dict[str, float]
    impacts: FloatArray
    contact_time: FloatArray
    ahead: FloatArray


def incident_states(
    values: Mapping[str, float],
    rng: np.random.Generator,
    rows: int,
    throws: Throws,
) -> list[FloatArray]:
    """Incident velocities and spins (3,) of impacts for which the model has an answer, at most so
    many `rows`, among `throws`.
    """
    states: list[FloatArray] = []
    for bounce in throws(3 * rows, rng):
        # What this ball cannot have is left out.
        with suppress(ParameterError):
            rebound = MODEL.rebound(values, fitball.impacts(*bounce[:3]))
            possible = rebound.status[0] == Status.OK and rebound.v_x2[0] > 1.0
            if possible and len(states) < rows:
                states.append(bounce[:3])
    return states


def draw_truth(
    rng: np.random.Generator,
    rows: int = FIT_ROWS,
    throws: Throws = films.bounces,
    ball: Mapping[str, float] = MappingProxyType({}),
) -> Truth:
    """A ball with parameters from the priors, or as they are in `ball`, and so many impacts that it
    can have, with scatter. Their incident states are the first three columns of `throws`.
    """
    incident: list[FloatArray] = []
    while len(incident) < rows:
        drawn = {}
        for name, text in PRIORS.items():
            quantile = parse_prior(SPECS[name], text).quantile(rng.uniform(size=1))
            drawn[name] = ball.get(name, float(quantile[0]))
        values = {spec.name: drawn[spec.name] for spec in MODEL.parameters}
        incident = incident_states(values, rng, rows, throws)
    states = fitball.impacts(*np.transpose(incident))
    rebound = MODEL.rebound(values, states)
    nodes, weights = np.polynomial.legendre.leggauss(40)
    ahead = np.empty(rows)
    for k, end in enumerate(rebound.contact_time.tolist()):
        times = 0.5 * end * (nodes + 1.0)
        course = MODEL.history(values, states.take(np.array([k])), times).courses
        line = rebound.gap_turn[k] - rebound.omega_2[k] * (rebound.gap_time[k] - end)
        ahead[k] = 0.5 * end * float(weights @ course["omega_shell"]) - line
    measured = []
    for name in films.TRACKED_NAMES[3:]:
        scatter = drawn[NOISES[name].name] * rng.standard_normal(rows)
        measured.append(getattr(rebound, name) + scatter)
    impacts = np.column_stack([incident, *measured])
    return Truth(drawn, impacts, rebound.contact_time, ahead)


def intervals(problem: Problem) -> FloatArray:
    """Quantiles 0.025 and 0.975 of the parameters JUDGED, (parameters, 2).

    Raises:
        FitError: importance weights are unreliable (`weights`).
    """
    effort = Effort(cores=1)
    begin = first_order(problem, best_fit(problem, effort.stream("search"))).proposal
    q, log_weights, k = importance(
        lambda q: log_posterior(problem, q),
        [begin],
        effort.stream("weights"),
        EFFECTIVE_DRAWS,
    )
    if k > RELIABLE_K:
        raise FitError("weights are unreliable", "weights")
    values = problem.prior.value(q)
    shares = np.exp(log_weights)
    ends = []
    for name in JUDGED:
        column = values[:, problem.free.index(name)]
        order = np.argsort(column)
        ends.append(np.interp([0.025, 0.975], np.cumsum(shares[order]), column[order]))
    return np.array(ends)


def holds(fps: float, seed: int) -> list[bool] | str:
    """For each parameter JUDGED whether the 95 % interval of the fit to a film contains the truth,
    or the reason why there is no fit.
    """
    rng = np.random.default_rng([int(fps), seed])
    truth = draw_truth(rng)
    errors = {}
    for name, sd in ERRORS.items():
        # Scale and clock are factors about 1.
        errors[name] = sd * rng.standard_normal() + (name in ("scale", "clock"))
    camera = Film(fps, drag=films.DRAG + DRAG_SD * rng.standard_normal(), **errors)
    table = films.filmed(truth.impacts, camera, rng, truth.contact_time, truth.ahead)
    scene = Scene(camera=CameraSection(fps=fps, court=0.0))
    try:
        film = fitball.track(table, scene=scene, progress=False)
        problem, _ = problem_from_sources(
            [film.table],
            scene=film.scene,
            as_read=True,
            prior=PRIORS,
        )
        ends = intervals(problem)
    except FitballError as error:
        return str(error)[:100]
    pairs = zip(JUDGED, ends, strict=True)
    return [bool(low <= truth.values[name] <= high) for name, (low, high) in pairs]


def report_films(count: int) -> None:
    """Print for each camera how often intervals of `count` films hold, in per cent."""
    for number, (name, camera, stated) in enumerate(CAMERAS):
        z, sure, wrong = scores_of_films(camera, stated, number + 1, count)
        inside = np.array([np.sum(np.abs(z) < level, axis=0) for level in LEVELS])
        shares = (100.0 * inside / np.isfinite(z).sum(axis=0)).round().astype(int)
        counts = f"{len(z)} impacts, {sure} spins sure, {wrong} wrong;"
        print(f"{name:27s} {counts}", *shares, flush=True)


def report_good(count: int) -> None:
    """Print for `count` films of each good camera how many values are within 1 and 1.96 sds, how
    many spins are wrong, and the codes of refusals and of false notes with the number of films.
    """
    codes = Counter[str]()
    pieces = list[FloatArray]()
    wrong = 0
    for number, (_, camera, stated) in enumerate(GOOD):
        for k in range(count):
            rng = np.random.default_rng([number, k])
            truth = films.bounces(FILM_ROWS, rng)
            drag = films.DRAG + DRAG_SD * rng.standard_normal()
            table = films.filmed(truth, replace(camera, drag=drag), rng)
            scene = Scene(camera=changed(CameraSection(fps=camera.fps, court=0.0), **stated))
            try:
                film = fitball.track(table, scene=scene, progress=False)
            except FitballError as error:
                codes[f"refused: {error.code}"] += 1
                continue
            codes.update({note.code for note in film.notes} - RIGHT_NOTES)
            z, errors = films.scores(film, truth)
            far = (np.abs(errors[:, SPINS]) > WRONG_SPIN) & (np.abs(z[:, SPINS]) > WRONG_SDS)
            wrong += int(far.any(axis=1).sum())
            pieces.append(z[np.isfinite(z)])
    z = np.concatenate(pieces)
    inside = [int(np.sum(np.abs(z) < level)) for level in LEVELS]
    print(f"{count * len(GOOD)} films, {z.size} values, within 1 and 1.96 sds: {inside};", end=" ")
    print(f"wrong spins: {wrong}; refused or noted: {dict(codes)}")


def report_fits(count: int) -> None:
    """Print for each rate how many of `count` fits have intervals that hold, and why some
    failed.
    """
    for fps in (240.0, 1000.0):
        results = [holds(fps, number) for number in range(count)]
        fitted = [result for result in results if not isinstance(result, str)]
        reasons = [result for result in results if isinstance(result, str)]
        hits = np.array(fitted, dtype=np.int64).reshape(-1, len(JUDGED)).sum(axis=0)
        print(f"{fps:g}/s:", dict(zip(JUDGED, hits.tolist(), strict=True)), *reasons)


def main() -> None:
    """Print what is asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument(
        "--films",
        type=int,
        default=0,
        metavar="N",
        help="films of 8 impacts of each camera",
    )
    parser.add_argument(
        "--good",
        type=int,
        default=0,
        metavar="N",
        help="films of 8 impacts of each of twelve good cameras",
    )
    parser.add_argument(
        "--fits",
        type=int,
        default=0,
        metavar="N",
        help="films of 21 impacts to be fitted",
    )
    arguments = parser.parse_args()
    if arguments.films:
        report_films(arguments.films)
    if arguments.good:
        report_good(arguments.good)
    if arguments.fits:
        report_fits(arguments.fits)


if __name__ == "__main__":
    main()
