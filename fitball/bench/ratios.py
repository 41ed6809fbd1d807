"""Has something become slower? Costs over those of one yardstick in the same run, beside those of an earlier one.

A ratio survives another load and, but for what vectors a processor has, another machine; seconds do not.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from fitball.bench.clock import Action, Pace, by_turns, fresh_process
from fitball.bench.integrators import fixed_steps, set_up
from fitball.bench.problems import base_values, posed, spread_coordinates, spread_draws
from fitball.errors import ResultFolderError
from fitball.inference.effort import Effort
from fitball.inference.likelihood.posterior import log_posterior
from fitball.inference.point.point_fit import point_fit
from fitball.inference.problem.problem import Problem
from fitball.inference.sampling.ensembles import sample
from fitball.models.registry import model
from fitball.models.specs import DEFAULT_MODEL
from fitball.values import FloatArray

FILE = "ratios.csv"
# Slower by this factor is a fault.
TOLERATED = 1.5
WORK, RATIO = "work", "over the yardstick"
# Seconds of compiled work that fitball does not change: the yardstick of work, and that of starts.
YARDSTICK = "order 8 compiled, 20 steps, events located, 21 impacts"
START = "python -c 'import numpy, scipy.optimize, pandas'"
STEPS = 120
REBOUND = "import fitball; fitball.model('two-mass').rebound({values}, fitball.impacts(14.0, 12.0, 100.0))"


def ratios(pace: Pace) -> pd.DataFrame:
    """Costs over those of the yardsticks, one row a kind of work."""
    spent = by_turns({YARDSTICK: _yardstick(), **_work()}, pace)
    rows = [
        {WORK: name, "yardstick": YARDSTICK, RATIO: seconds / spent[YARDSTICK]}
        for name, seconds in spent.items() if name != YARDSTICK
    ]  # fmt: skip
    starts = {
        START: "import numpy, scipy.optimize, pandas",
        "fitball --help": "import fitball.cli.main",
        "first rebound": REBOUND.format(values=base_values()),
        "imports of calibrate": "import fitball.inference.calibrate",
    }
    rounds = [{name: fresh_process(code).seconds for name, code in starts.items()} for _ in range(pace.rounds)]
    least = {name: min(taken[name] for taken in rounds) for name in starts}
    rows += [
        {WORK: name, "yardstick": START, RATIO: seconds / least[START]}
        for name, seconds in least.items() if name != START
    ]  # fmt: skip
    return pd.DataFrame(rows)


def _yardstick() -> Action:
    ball, given = model(DEFAULT_MODEL).ball, posed("wang_all").impacts
    states = zip(given.v_x1.tolist(), given.v_y1.tolist(), given.omega_1.tolist(), strict=True)
    setups = np.array([set_up(ball, base_values(), *state) for state in states])
    return partial(fixed_steps, setups, 8, 20, located=True)


def _work() -> Mapping[str, Action]:
    chosen, draws = model(DEFAULT_MODEL), spread_draws(200)
    names = tuple(base_values())
    table = posed("wang_all")
    work: dict[str, Action] = {
        "rebounds, 1 draw of 21 impacts": partial(chosen.evaluate, names, draws[:1], table.impacts),
        "rebounds, 200 draws of 21 impacts": partial(chosen.evaluate, names, draws, table.impacts),
        "derivatives, 200 draws of 21 impacts": partial(chosen.jacobian, names, draws, table.impacts, names),
    }
    for problem in (posed("wang_zero_spin"), table, posed("wang_all", 2100)):
        at = spread_coordinates(problem, 40)
        work[f"log posterior, 40 walkers, {len(problem.impacts)} impacts"] = partial(log_posterior, problem, at)
    zero = posed("wang_zero_spin")
    at = spread_coordinates(zero, 4)
    work[f"sampling, {STEPS} steps, 7 impacts"] = partial(_sampled, zero, at)
    work["point fit, 7 impacts"] = lambda: point_fit(zero, np.random.default_rng(1))
    return work


def _sampled(problem: Problem, at: FloatArray) -> object:
    settings = Effort(cores=1, max_steps=STEPS).settings(problem)
    return sample(problem, at, settings, None, False, lambda _progress: None)


def read_ratios(path: Path) -> pd.DataFrame:
    """Ratios of an earlier run. Raises ResultFolderError for a file that has none."""
    try:
        kept = pd.read_csv(path)
        good = {WORK, RATIO} <= set(kept) and len(kept) > 0 and bool((kept[RATIO].astype(float) > 0.0).all())
    except (OSError, UnicodeError, ValueError) as error:
        what = getattr(error, "strerror", None) or error
        raise ResultFolderError(
            f"{path}: read {what}, expected the ratios of an earlier run; make them with fitball bench, or name "
            "their file after --check"
        ) from None
    if not good:
        raise ResultFolderError(
            f"{path}: read columns {', '.join(map(str, kept))}, expected '{WORK}' and '{RATIO}' with positive "
            "numbers; make them with fitball bench"
        )
    return kept


def compared(kept: pd.DataFrame, now: pd.DataFrame) -> pd.DataFrame:
    """Ratios now and then, `times` slower, by work. Raises ResultFolderError where the two are of different work."""
    before, after = (frame.set_index(WORK)[RATIO] for frame in (kept, now))
    other = sorted(set(before.index) ^ set(after.index))
    if other:
        raise ResultFolderError(
            f"kept ratios and those of this fitball are of different work ({'; '.join(other)}): measure them anew "
            "with fitball bench"
        )
    frame = pd.DataFrame({"kept": before, "now": after, "times": after / before})
    return frame.rename_axis(WORK).reset_index()


def least(first: pd.DataFrame, second: pd.DataFrame) -> pd.DataFrame:
    """Of two results of `compared` the lesser, work by work."""
    return first.where(first["times"] <= second["times"], second)
