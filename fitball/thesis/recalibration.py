"""From the data up: the free parameters of Table 9 and Eq. (53) fitted to Wang's 21 impacts, and where the thesis's
own values lie in the posterior.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.stats import gaussian_kde

from fitball.data.balances import Balance, scene_balances
from fitball.data.published import fraction, thesis_table
from fitball.data.read import load_table
from fitball.data.scene import load_scene
from fitball.inference.assemble import diagnose
from fitball.inference.calibrate import Drawn, draw, search
from fitball.inference.effort import Effort, Stopwatch
from fitball.inference.prediction.posterior_predictive import predictive, predictive_generator
from fitball.inference.problem.build import Choices, build_problem
from fitball.inference.problem.problem import Problem
from fitball.inference.results.results import Diagnostics, RunStatus
from fitball.inference.thesis.published_cases import C1, C2, FRICTION, INCH, STIFFNESS, TORSION
from fitball.models.types import STATUS_REASON, Status
from fitball.values import FloatArray

TABLE = "wang_all.csv"
PUBLISHED = "published in the thesis"
MODELS = ("thesis", "thesis-exact", "two-mass")
# Of the draws, each so-many-th is asked whether the model admits a published value.
REFUSAL_STRIDE = 10
# Draws behind a density estimate: enough for a credible level to a per cent.
DENSITY_DRAWS = 3000


@dataclass(frozen=True)
class Placed:
    """Where a published point lies in a posterior: `level` of the highest-density region on whose edge it is; the
    share of draws `below` it by parameter; and the parameters whose published value the model refuses whatever draw
    the others are taken from, with its reason.
    """

    point: str
    level: float
    below: Mapping[str, float]
    excluded: Mapping[str, str]


@dataclass(frozen=True)
class Recalibration:
    """A free fit, and where each case of Table 9 and Eq. (53) lie in its posterior: of a fit what is shown here, no
    profiles, verdicts or budgets.
    """

    problem: Problem
    drawn: Drawn
    diagnostics: Diagnostics
    seed: int
    placed: tuple[Placed, ...] = ()

    @property
    def offset(self) -> Balance:
        """The model-free offset of each impact."""
        return scene_balances(self.problem.table, self.problem.scene).offset

    @property
    def points(self) -> pd.DataFrame:
        """`placed` as a table."""
        rows = [
            {"point": place.point, "credible level": place.level}
            | {f"{name} below": share for name, share in place.below.items()}
            for place in self.placed
        ]
        excluded = ["; ".join(f"{name}: {why}" for name, why in place.excluded.items()) for place in self.placed]
        return pd.DataFrame(rows).assign(**{"excluded by the model": excluded})

    def medians(self) -> dict[str, FloatArray]:
        """Medians of the predictive distribution by output, (21,)."""
        generator = predictive_generator(self.seed)
        foretold = predictive(self.problem, self.drawn.point, self.drawn.posterior, generator)
        return {observable.name: observable.median for observable in foretold.observables}

    def column(self, name: str) -> FloatArray:
        """Posterior draws of one parameter, (draws,)."""
        return np.asarray(self.problem.all_values(self.drawn.posterior.draws)[name], dtype=np.float64)


def recalibrate(name: str, effort: Effort, report: Callable[[str], None]) -> Recalibration:
    """Fit one model of `MODELS` freely and place the thesis's values."""
    report(f"calibrating {name}")
    problem = build_problem(load_table(TABLE), load_scene(TABLE), Choices(model=name))
    watch = Stopwatch()
    drawn = draw(problem, effort, *search(problem, effort, watch), watch)
    fitted = Recalibration(problem, drawn, diagnose(drawn.sampled, effort), effort.seed)
    return replace(fitted, placed=_place(fitted, np.random.default_rng(effort.seed)))


def offset_constants(recalibration: Recalibration) -> tuple[FloatArray, FloatArray]:
    """Posterior draws of `C1` [in/(m/s)] and `C2` [in] of Eq. (51)."""
    slope = recalibration.column("eps_slope")
    return slope / INCH, (recalibration.column("eps_10") - 10.0 * slope) / INCH


def _place(recalibration: Recalibration, rng: np.random.Generator) -> tuple[Placed, ...]:
    names = ("mass_ratio", "k_y", "k_theta")
    columns = {name: recalibration.column(name) for name in names}
    draws = _coordinates(columns)
    placed = []
    for case in thesis_table("table_9").to_dict("records"):
        printed = (
            fraction(case["mass_ratio"]),
            case["k_y [lb/in]"] * STIFFNESS,
            case["k_theta [lb in/rad]"] * TORSION,
        )
        values = dict(zip(names, map(float, printed), strict=True))
        below = {name: float(np.mean(columns[name] < value)) for name, value in values.items()}
        refused = {name: _refusal(recalibration, name, value) for name, value in values.items()}
        excluded = {name: why for name, why in refused.items() if why}
        level = credible_level(draws, _coordinates(values), rng)
        placed.append(Placed(f"case {case['case']}", level, below, excluded))
    c1, c2 = offset_constants(recalibration)
    level = credible_level(np.array([c1, c2]), np.array([C1, C2]), rng)
    placed.append(Placed("Eq. (53)", level, {"C1": float(np.mean(c1 < C1)), "C2": float(np.mean(c2 < C2))}, {}))
    return tuple(placed)


def _coordinates(values: Mapping[str, float] | Mapping[str, FloatArray]) -> FloatArray:
    return np.array([values["mass_ratio"], np.log(values["k_y"]), np.log(values["k_theta"])])


def _refusal(recalibration: Recalibration, name: str, value: float) -> str:
    """Why the model has no solution for some impact with this value in any draw; empty where one draw has."""
    chosen, problem = recalibration.problem.model, recalibration.problem
    names = chosen.parameter_names
    columns = [recalibration.column(item)[::REFUSAL_STRIDE] for item in names]
    columns[names.index(name)] = np.full_like(columns[0], value)
    status = chosen.evaluate(names, np.column_stack(columns), problem.impacts).status
    failed = status != Status.OK
    return STATUS_REASON[Status(int(status[failed][0]))].partition(":")[0] if failed.any(axis=1).all() else ""


def credible_level(draws: FloatArray, point: FloatArray, rng: np.random.Generator) -> float:
    """Probability of the highest-density region on whose edge `point` lies; `draws` (dimensions, draws)."""
    chosen = rng.choice(draws.shape[1], min(DENSITY_DRAWS, draws.shape[1]), replace=False)
    density = gaussian_kde(draws[:, chosen])
    return float(np.mean(density(draws[:, chosen]) > density(point)[0]))


def parameter_table(fits: Mapping[str, Recalibration]) -> pd.DataFrame:
    """Medians and 95 % intervals in the thesis's units beside Table 9 (its three cases) and Eq. (53)."""
    cases = thesis_table("table_9").astype(str).agg(", ".join)
    scales = {"mass_ratio": ("M1/M", "", 1.0, cases["mass_ratio"]),
              "k_y": ("k_y", "lb/in", STIFFNESS, cases["k_y [lb/in]"]),
              "k_theta": ("k_theta", "lb in/rad", TORSION, cases["k_theta [lb in/rad]"]),
              "mu": ("mu", "", 1.0, f"{FRICTION:g}")}  # fmt: skip
    shown = {
        head: {key: recalibration.column(name) / head[2] for key, recalibration in fits.items()}
        for name, head in scales.items()
    }
    for k, head in enumerate((("C1", "in/(m/s)", 1.0, f"{C1:g}"), ("C2", "in", 1.0, f"{C2:g}"))):
        shown[head] = {key: offset_constants(recalibration)[k] for key, recalibration in fits.items()}
    # One of the fitted models is called `thesis` too.
    return pd.DataFrame(
        [
            {"parameter": label, "unit": unit, PUBLISHED: printed}
            | {f"{key}, fitted": interval(draws) for key, draws in columns.items()}
            for (label, unit, _scale, printed), columns in shown.items()
        ]
    )


def interval(draws: FloatArray) -> str:
    """Median and central 95 % of draws as text."""
    low, median, high = np.quantile(draws, (0.025, 0.5, 0.975))
    return f"{median:.3g} [{low:.3g}, {high:.3g}]"


def fit_table(fits: Mapping[str, Recalibration]) -> pd.DataFrame:
    """How well each free fit does, and whether its chain converged."""
    rows = []
    for name, recalibration in fits.items():
        least, diagnosis = recalibration.drawn.squares, recalibration.diagnostics
        status = RunStatus.CONVERGED if diagnosis.converged else RunStatus.NOT_CONVERGED
        rows.append(
            {"model": name, "status": str(status), "chi-square": least.chi_square,
             **{f"rms {key}": value for key, value in least.rms.items()},
             "min ESS": min(diagnosis.min_ess_bulk, diagnosis.min_ess_tail), "max R-hat": diagnosis.max_r_hat}
        )  # fmt: skip
    return pd.DataFrame(rows)


def offset_table(fits: Mapping[str, Recalibration]) -> pd.DataFrame:
    """Each impact's model-free offset [in] with its sd beside Eq. (53) and the fitted lines."""
    first = next(iter(fits.values()))
    balance = first.offset
    v_y1 = first.problem.impacts.v_y1
    frame = pd.DataFrame(
        {"impact": first.problem.table.ids, "v_y1 [m/s]": v_y1, "model-free [in]": balance.values / INCH,
         "sd [in]": balance.sd / INCH, "Eq. (53) [in]": C1 * v_y1 + C2}
    )  # fmt: skip
    for name, recalibration in fits.items():
        c1, c2 = (float(np.median(draws)) for draws in offset_constants(recalibration))
        frame[f"{name} [in]"] = c1 * v_y1 + c2
    return frame
