"""From the data up: the free parameters of Table 9 and Eq. (53) fitted to Wang's 21 impacts, and where the thesis's
own values lie in the posterior.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.stats import gaussian_kde

from fitball.data.read import load_table
from fitball.data.scene import load_scene
from fitball.data.thesis_tables import fraction, thesis_table
from fitball.inference.calibrate import Effort, run
from fitball.inference.problem import Choices, build_problem
from fitball.inference.results import Fit
from fitball.inference.thesis_inputs import C1, C2, INCH, STIFFNESS, TORSION
from fitball.values import FloatArray

TABLE = "wang_all.csv"
MODELS = ("thesis", "thesis-exact", "two-mass")
# Draws behind a density estimate: enough for a credible level to a per cent.
DENSITY_DRAWS = 3000


@dataclass(frozen=True)
class Recalibration:
    """A free fit; `points`: credible level of each case of Table 9 and of Eq. (53) in its posterior."""

    fit: Fit
    points: pd.DataFrame

    @property
    def name(self) -> str:
        """The model."""
        return self.fit.problem.model.name

    def column(self, name: str) -> FloatArray:
        """Posterior draws of one parameter, (draws,)."""
        assert self.fit.posterior is not None
        return np.asarray(self.fit.problem.all_values(self.fit.posterior.draws)[name], dtype=np.float64)


def recalibrate(name: str, effort: Effort, report: Callable[[str], None]) -> Recalibration:
    """Fit one model of `MODELS` freely and place the thesis's values."""
    report(f"calibrating {name}")
    problem = build_problem(load_table(TABLE), load_scene(TABLE), Choices(model=name))
    fit = run(problem, effort)
    made = Recalibration(fit, pd.DataFrame())
    return Recalibration(fit, _place(made, np.random.default_rng(effort.seed)))


def offset_constants(found: Recalibration) -> tuple[FloatArray, FloatArray]:
    """Posterior draws of `C1` [in/(m/s)] and `C2` [in] of Eq. (51)."""
    slope = found.column("eps_slope")
    return slope / INCH, (found.column("eps_10") - 10.0 * slope) / INCH


def _place(found: Recalibration, rng: np.random.Generator) -> pd.DataFrame:
    draws = np.array([found.column("mass_ratio"), np.log(found.column("k_y")), np.log(found.column("k_theta"))])
    rows = []
    for case in thesis_table("table_9").to_dict("records"):
        values = {
            "mass_ratio": fraction(case["mass_ratio"]),
            "k_y": float(case["k_y [lb/in]"]) * STIFFNESS,
            "k_theta": float(case["k_theta [lb in/rad]"]) * TORSION,
        }
        point = np.array([values["mass_ratio"], np.log(values["k_y"]), np.log(values["k_theta"])])
        tails = {f"{name} below": float(np.mean(found.column(name) < value)) for name, value in values.items()}
        rows.append({"point": f"case {case['case']}", "credible level": credible_level(draws, point, rng), **tails})
    c1, c2 = offset_constants(found)
    level = credible_level(np.array([c1, c2]), np.array([C1, C2]), rng)
    rows.append({"point": "Eq. (53)", "credible level": level,
                 "C1 below": float(np.mean(c1 < C1)), "C2 below": float(np.mean(c2 < C2))})  # fmt: skip
    return pd.DataFrame(rows)


def credible_level(draws: FloatArray, point: FloatArray, rng: np.random.Generator) -> float:
    """Probability of the highest-density region on whose edge `point` lies; `draws` (dimensions, draws)."""
    chosen = rng.choice(draws.shape[1], min(DENSITY_DRAWS, draws.shape[1]), replace=False)
    density = gaussian_kde(draws[:, chosen])
    return float(np.mean(density(draws[:, chosen]) > density(point)[0]))


def parameter_table(found: Mapping[str, Recalibration]) -> pd.DataFrame:
    """Medians and 95 % intervals in the thesis's units beside Table 9 and Eq. (53)."""
    scales = {"mass_ratio": ("M1/M", "", 1.0, "2/3, 2/3, 1/2"), "k_y": ("k_y", "lb/in", STIFFNESS, "80, 90, 72"),
              "k_theta": ("k_theta", "lb in/rad", TORSION, "1000"), "mu": ("mu", "", 1.0, "0.55")}  # fmt: skip
    rows = []
    for name, (label, unit, scale, printed) in scales.items():
        rows.append({"parameter": label, "unit": unit, "thesis": printed,
                     **{key: interval(item.column(name) / scale) for key, item in found.items()}})  # fmt: skip
    for k, (label, unit, value) in enumerate((("C1", "in/(m/s)", C1), ("C2", "in", C2))):
        rows.append({"parameter": label, "unit": unit, "thesis": f"{value:g}",
                     **{key: interval(offset_constants(item)[k]) for key, item in found.items()}})  # fmt: skip
    return pd.DataFrame(rows)


def interval(draws: FloatArray) -> str:
    """Median and central 95 % of draws as text."""
    low, median, high = np.quantile(draws, (0.025, 0.5, 0.975))
    return f"{median:.3g} [{low:.3g}, {high:.3g}]"


def fit_table(found: Mapping[str, Recalibration]) -> pd.DataFrame:
    """How well each free fit does, and whether its chain converged."""
    rows = []
    for name, item in found.items():
        least, diagnosis = item.fit.least_squares, item.fit.diagnostics
        assert diagnosis is not None
        rows.append(
            {"model": name, "status": str(item.fit.status), "chi-square": least.chi_square,
             **{f"rms {key}": value for key, value in least.rms.items()},
             "min ESS": min(diagnosis.min_ess_bulk, diagnosis.min_ess_tail), "max R-hat": diagnosis.max_r_hat}
        )  # fmt: skip
    return pd.DataFrame(rows)


def offset_table(found: Mapping[str, Recalibration]) -> pd.DataFrame:
    """Each impact's model-free offset [in] with its sd beside Eq. (53) and the fitted lines."""
    first = next(iter(found.values())).fit
    balance = first.balances.offset
    v_y1 = first.problem.impacts.v_y1
    frame = pd.DataFrame(
        {"impact": first.problem.table.ids, "v_y1 [m/s]": v_y1, "model-free [in]": balance.values / INCH,
         "sd [in]": balance.sd / INCH, "Eq. (53) [in]": C1 * v_y1 + C2}
    )  # fmt: skip
    for name, item in found.items():
        c1, c2 = (float(np.median(draws)) for draws in offset_constants(item))
        frame[f"{name} [in]"] = c1 * v_y1 + c2
    return frame
