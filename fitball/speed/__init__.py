"""Room: speed against error of one bounce, of fitball and of integrators, and its error on hard
cases.
"""

import math
import time
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING, Annotated, NamedTuple, TypeAlias

from fitball.base.errors import Note
from fitball.base.findings import Findings
from fitball.base.progress import Progress
from fitball.base.values import DataFrame, FloatArray, Impacts

if TYPE_CHECKING:
    from fitball.models.model import Model
    from fitball.speed.rivals import Method

# Rounds in which all rivals take turns: the machine is seldom busy in all of them.
ROUNDS = 5
# Seconds that a turn takes at least, well above the resolution of CPU time.
TURN = 2e-3
# Draws of a large batch: what a call costs besides bounces is then small.
DRAWS = 200
# Numbers of equal steps, by order of the method: from the coarsest to where rounding is reached.
STEPS = {4: (5, 10, 20, 50, 100, 200, 400, 1600), 8: (5, 10, 20, 40, 80)}
# Relative tolerances of `solve_ivp`.
RELATIVE_TOLERANCES = (1e-3, 1e-6, 1e-9, 1e-12)
# Name of fitball on a large batch.
OURS = "fitball, many draws"
# Name of fitball called once a bounce.
OURS_SINGLY = "fitball, one call a bounce"
# Name of the scene of hard cases.
HARD = "hard cases"
# Names of rivals with equal steps, by order.
FIXED = {4: "RK4, compiled, events located", 8: "order 8, compiled, events located"}
# Rivals by `solve_ivp`: method, and longest step as a share of the contact. The first is as people
# call it, the second steps over no grip.
ADAPTIVE: Mapping[str, tuple["Method", float]] = {
    "solve_ivp RK45": ("RK45", math.inf),
    "solve_ivp DOP853, short steps": ("DOP853", 0.05),
}
# What gives `v_x2` [m/s] and `omega_2` [rad/s] of the impacts of a scene, (impacts, 2).
Solve: TypeAlias = Callable[[], FloatArray]


class Rival(NamedTuple):
    """What solves every impact of a scene `times` over: its name, its setting, and the function
    that gives the rebounds.
    """

    name: str
    setting: str
    solve: Solve
    times: int = 1


class TimedScene(NamedTuple):
    """Impacts with their `exact` rebounds, `v_x2` [m/s] and `omega_2` [rad/s]. Each row has the
    parameters of its impact, which are the same in all scenes but the hard cases.
    """

    rows: DataFrame
    impacts: Impacts
    exact: Annotated[FloatArray, "impacts 2"]

    def model(self, k: int) -> tuple["Model", dict[str, float]]:
        """The model of impact `k` and its parameters by name."""
        from fitball.models.registry import model

        row = self.rows.iloc[k]
        options = str(row["options"])
        chosen = model(f"two-mass+{options}" if options else "two-mass")
        return chosen, {spec.name: float(row[spec.name]) for spec in chosen.parameters}

    def errors(
        self, rebounds: Annotated[FloatArray, "impacts 2"]
    ) -> Annotated[FloatArray, "impacts"]:
        """Errors of `v_x2` [m/s] and `omega_2` [rad/s]: the larger of those of the velocity and of
        the speed of the surface, over the incident speed of the surface.
        """
        import numpy as np

        radius = self.model(0)[0].ball.radius
        impacts = self.impacts
        speed = np.hypot(impacts.v_x1, impacts.v_y1) + radius * np.abs(impacts.omega_1)
        off = np.abs(rebounds - self.exact) * (1.0, radius)
        return np.asarray(off.max(axis=1) / speed)


def scenes() -> dict[str, TimedScene]:
    """The scenes by name: Wang's 21 impacts, three kinds of contact, and cases that are hard. Their
    answers come from arithmetic of fifty digits.
    """
    import pandas as pd

    from fitball.data.bundled import datasets_folder

    usual = pd.read_csv(datasets_folder() / "bench" / "scenes.csv")
    hard = pd.read_csv(datasets_folder() / "bench" / "hard_cases.csv")
    hard["scene"] = HARD
    table = pd.concat([usual, hard]).fillna({"options": ""})
    by_name = {}
    for name, rows in table.groupby("scene", sort=False):
        states = [rows[column].to_numpy(float) for column in ("v_x1", "v_y1", "omega_1")]
        exact = rows[["v_x2", "omega_2"]].to_numpy(float)
        by_name[str(name)] = TimedScene(rows, Impacts(*states), exact)
    return by_name


def solvers(name: str, scene: TimedScene) -> Iterator[Rival]:
    """All that solve the scene of this name, with an offset towards positive v_x. Of the hard cases
    that is fitball alone: explicit steps of any practical size diverge on joints of 1e8 N m/rad.
    """
    import numpy as np

    calls = []
    for k in range(len(scene.rows)):
        model, values = scene.model(k)
        row = np.array([[*values.values()]])
        calls.append((model, [*values], row, scene.impacts.take(np.array([k]))))

    def one_by_one() -> FloatArray:
        rebounds = [
            model.solve(model.ball, names, row, impact, None) for model, names, row, impact in calls
        ]
        return np.array([(end.v_x2[0, 0], end.omega_2[0, 0]) for end in rebounds])

    yield Rival(OURS_SINGLY, "", one_by_one)
    if name == HARD:
        return
    model, names, row, _ = calls[0]
    draws = np.repeat(row, DRAWS, axis=0)

    def many() -> FloatArray:
        rebound = model.solve(model.ball, names, draws, scene.impacts, None)
        return np.stack([rebound.v_x2[-1], rebound.omega_2[-1]], axis=1)

    yield Rival(OURS, "", many, DRAWS)
    yield from _integrators(scene)


def _integrators(scene: TimedScene) -> Iterator[Rival]:
    """The rivals of fitball, at all their settings, on a scene with one set of parameters."""
    import numpy as np

    from fitball.speed import rivals

    model, values = scene.model(0)
    call = model.kernel_call(values)
    row = np.array(call.row)
    impacts = scene.impacts
    states = zip(impacts.v_x1, impacts.v_y1, impacts.omega_1, strict=True)
    setups = np.array([rivals.set_up(row, call.flags, *state) for state in states])
    for order, counts in STEPS.items():
        for steps in counts:
            solve = partial(rivals.fixed_steps, setups, order, steps)
            yield Rival(FIXED[order], f"{steps} steps", solve)
    for name, (method, most) in ADAPTIVE.items():
        for rtol in RELATIVE_TOLERANCES:
            solve = partial(rivals.adaptive, setups, method, rtol, most)
            yield Rival(name, f"rtol {rtol:g}", solve)


def by_turns(actions: Mapping[str, Solve]) -> dict[str, float]:
    """CPU seconds that one call of each action takes, by name: the least over the rounds, in each
    of which all have a turn. CPU time, because the machine may do other things; the least, because
    these can only add to it.
    """
    counts = {}
    for name, action in actions.items():
        # The first call, which may compile, is not counted.
        action()
        first = max(_spent(action, 1), 1e-7)
        counts[name] = max(1, math.ceil(TURN / first))
    least = dict.fromkeys(actions, math.inf)
    for _ in range(ROUNDS):
        for name, action in actions.items():
            least[name] = min(least[name], _spent(action, counts[name]))
    return least


def _spent(action: Solve, count: int) -> float:
    """CPU seconds of a call, the mean of `count` of them."""
    begun = time.process_time()
    for _ in range(count):
        action()
    return (time.process_time() - begun) / count


def bench(progress: Progress) -> Findings:
    """The frame `bench`: a row for each rival at each setting in each scene, with microseconds of
    CPU time a bounce (the least of several turns) and the relative error of its bounces.
    """
    import numpy as np
    import pandas as pd

    from fitball.base.environment import threads

    rows = []
    by_name = scenes()
    with threads(1):
        for k, (name, scene) in enumerate(by_name.items()):
            progress(f"measuring: {name}", k / len(by_name))
            rivals = {f"{rival.name}, {rival.setting}": rival for rival in solvers(name, scene)}
            seconds = by_turns({key: rival.solve for key, rival in rivals.items()})
            for key, rival in rivals.items():
                errors = scene.errors(rival.solve())
                bounces = len(errors) * rival.times
                rows.append(
                    {
                        "scene": name,
                        "solver": rival.name,
                        "setting": rival.setting,
                        "microseconds": 1e6 * seconds[key] / bounces,
                        "largest_error": float(errors.max()),
                        "median_error": float(np.median(errors)),
                    }
                )
    note = Note(
        "timings",
        "Times are CPU times on this machine, the least of several turns; only ratios carry over.",
    )
    return Findings({"bench": pd.DataFrame(rows)}, (note,))
