"""Room: speed against error of one bounce, on hard cases as data."""

import math
import time
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

from fitball.base.errors import Note
from fitball.base.findings import Findings
from fitball.base.progress import Progress
from fitball.base.values import DataFrame, FloatArray, Impacts

if TYPE_CHECKING:
    from fitball.models.model import Model

# Rounds in which all rivals take turns, and seconds of a turn at least. Draws of a large batch.
ROUNDS = 5
TURN = 2e-3
DRAWS = 200
STEPS = {4: (5, 10, 20, 50, 100, 200, 400, 1600), 8: (5, 10, 20, 40, 80)}
TOLERANCES = (1e-3, 1e-6, 1e-9, 1e-12)
OURS = "fitball, many draws"
ONE = "fitball, one call a bounce"
HARD = "hard cases"
FIXED = {4: "RK4, compiled, events located", 8: "order 8, compiled, events located"}
# Longest steps of `solve_ivp` as a share of the contact: as it is called, and stepping over no
# grip.
ADAPTIVE = {"solve_ivp RK45": ("RK45", math.inf), "solve_ivp DOP853, short steps": ("DOP853", 0.05)}
Solve = Callable[[], FloatArray]


class Scene(NamedTuple):
    """Impacts with their exact rebounds `v_x2`, `omega_2` (impacts, 2), of one set of parameters or
    of many.
    """

    rows: DataFrame
    impacts: Impacts
    exact: FloatArray

    def model(self, k: int) -> tuple["Model", dict[str, float]]:
        """The model of an impact and its parameters."""
        from fitball.models.registry import model

        row = self.rows.iloc[k]
        chosen = model("+".join(filter(None, ["two-mass", str(row["options"])])))
        return chosen, {spec.name: float(row[spec.name]) for spec in chosen.parameters}

    def errors(self, found: FloatArray) -> FloatArray:
        """Error of velocity, or of the speed of the surface, over the incident speed of the
        surface, (impacts,).
        """
        import numpy as np

        radius = self.model(0)[0].ball.radius
        speed = np.hypot(self.impacts.v_x1, self.impacts.v_y1) + radius * np.abs(
            self.impacts.omega_1
        )
        return np.asarray((np.abs(found - self.exact) * (1.0, radius)).max(axis=1) / speed)


def scenes() -> dict[str, Scene]:
    """Wang's 21 impacts, three kinds of contact, and cases that are hard; answers of fifty
    digits.
    """
    import pandas as pd

    from fitball.data.bundled import folder

    tables = [pd.read_csv(folder() / "bench" / f"{name}.csv") for name in ("scenes", "hard_cases")]
    tables[1]["scene"] = HARD
    found = {}
    for name, rows in pd.concat(tables).fillna({"options": ""}).groupby("scene", sort=False):
        states = Impacts(*(rows[column].to_numpy(float) for column in ("v_x1", "v_y1", "omega_1")))
        found[str(name)] = Scene(rows, states, rows[["v_x2", "omega_2"]].to_numpy(float))
    return found


def solvers(name: str, scene: Scene) -> Iterator[tuple[str, str, Solve, int]]:
    """Name, setting, what solves every impact of a scene, and how many times over. Of the hard
    cases fitball alone: explicit steps of any practical size diverge on joints of 1e8 N m/rad.
    """
    import numpy as np

    from fitball.speed import rivals

    kept = [scene.model(k) for k in range(len(scene.rows))]
    states = [scene.impacts.take(np.array([k])) for k in range(len(kept))]
    calls = [
        (chosen, [*values], np.array([[*values.values()]]), one)
        for (chosen, values), one in zip(kept, states, strict=True)
    ]

    def one_by_one() -> FloatArray:
        made = [chosen.evaluate(names, row, one) for chosen, names, row, one in calls]
        return np.array([(one.v_x2[0, 0], one.omega_2[0, 0]) for one in made])

    yield ONE, "", one_by_one, 1
    if name == HARD:
        return
    chosen, names, row, _ = calls[0]
    draws = np.repeat(row, DRAWS, axis=0)

    def many() -> FloatArray:
        made = chosen.evaluate(names, draws, scene.impacts)
        return np.stack([made.v_x2[-1], made.omega_2[-1]], axis=1)

    yield OURS, "", many, DRAWS
    call = chosen.kernel_call(kept[0][1])
    given = scene.impacts
    coming = zip(given.v_x1, given.v_y1, given.omega_1, strict=True)
    setups = np.array([rivals.set_up(np.array(call.row), call.flags, *state) for state in coming])
    for order, counts in STEPS.items():
        for steps in counts:
            yield (
                FIXED[order],
                f"{steps} steps",
                partial(rivals.fixed_steps, setups, order, steps),
                1,
            )
    for rival, (method, most) in ADAPTIVE.items():
        for rtol in TOLERANCES:
            yield rival, f"rtol {rtol:g}", partial(rivals.adaptive, setups, method, rtol, most), 1


def by_turns(actions: Mapping[str, Solve]) -> dict[str, float]:
    """CPU seconds that one call of each takes: the least over the rounds, in each of which all have
    a turn. CPU time, because the machine may do other things; the least, because these can only add
    to it.
    """
    counts = {}
    for name, action in actions.items():
        # The first call, which may compile, is not counted.
        action()
        counts[name] = max(1, math.ceil(TURN / max(_spent(action, 1), 1e-7)))
    least = dict.fromkeys(actions, math.inf)
    for _ in range(ROUNDS):
        for name, action in actions.items():
            least[name] = min(least[name], _spent(action, counts[name]))
    return least


def _spent(action: Solve, count: int) -> float:
    begun = time.process_time()
    for _ in range(count):
        action()
    return (time.process_time() - begun) / count


def bench(progress: Progress) -> Findings:
    """Frame `bench`: microseconds a bounce and error of each rival in each scene, least CPU time of
    turns.
    """
    import numpy as np
    import pandas as pd

    from fitball.base.environment import threads

    rows = []
    known = scenes()
    with threads(1):
        for k, (name, scene) in enumerate(known.items()):
            progress(f"measuring: {name}", k / len(known))
            made = {
                f"{rival}, {setting}": (rival, setting, solve, times)
                for rival, setting, solve, times in solvers(name, scene)
            }
            spent = by_turns({key: solve for key, (_, _, solve, _) in made.items()})
            for key, (rival, setting, solve, times) in made.items():
                errors = scene.errors(solve())
                rows.append(
                    {
                        "scene": name,
                        "solver": rival,
                        "setting": setting,
                        "microseconds": 1e6 * spent[key] / (len(errors) * times),
                        "largest_error": float(errors.max()),
                        "median_error": float(np.median(errors)),
                    }
                )
    note = Note(
        "timings",
        "Times are CPU times on this machine, the least of several turns; only ratios carry over.",
    )
    return Findings({"bench": pd.DataFrame(rows)}, (note,))
