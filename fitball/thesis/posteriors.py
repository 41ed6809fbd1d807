"""Free fits of three models to Wang's impacts; where the thesis's values lie in them."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.stats import gaussian_kde

from fitball.base.environment import threads
from fitball.base.progress import Progress
from fitball.base.values import Ball, DataFrame, FloatArray, Impacts
from fitball.data.balances import balances
from fitball.data.read import load_data
from fitball.inference.effort import Effort
from fitball.inference.fitted import draws_of
from fitball.inference.judgement.first_order import first_order
from fitball.inference.problem.build import build_problem
from fitball.inference.problem.problem import Choices
from fitball.inference.sampling.sample import sample
from fitball.inference.search.best_fit import best_fit
from fitball.models.model import Model
from fitball.models.registry import model
from fitball.models.types import Rebound, Status
from fitball.thesis.appendices import SCALES, damping
from fitball.thesis.printed import C1, C2, INCH, STIFFNESS, TORSION, computed
from fitball.thesis.ranking import OWN, tied_split

TABLE = "wang_all"
MODELS = ("two-mass", "thesis-exact", "thesis")
LAW = ("mu", "cor_10", "cor_slope")
# What a case sets freely, and Eq. (53).
JOINT = ("mass_ratio", "k_y", "k_theta")
OFFSET = ("C1", "C2")
# Steps of each ensemble for the computation, whose joint is rarely very stiff: some 500 effective
# draws of that.
RARE = 1_000
# Draws behind a density, of which a level is known to a per cent or so; and draws that are kept for
# figures.
DENSITY = 3_000
KEPT = 500
_LAW = model("brody")
# Nominal errors of the tables, with which a model-free offset has one.
ERRORS = {**SCALES, "v_y2": 0.25}


def solve(
    ball: Ball,
    names: Sequence[str],
    values: FloatArray,
    impacts: Impacts,
    _cor: FloatArray | None = None,
) -> Rebound:
    """Rebounds of the thesis's own computation as `Model.solve` has them: with the damping of
    Chapter V, the law of restitution and the inertia of core and shell of the other models.
    """
    given = {name: values[:, [k]] for k, name in enumerate(names)}
    law = _LAW.evaluate(LAW, np.hstack([given[name] for name in LAW]), impacts)
    cor = law.v_y2 / impacts.v_y1
    ratio = given["mass_ratio"]
    given |= {"inertia_split": tied_split(ratio), "inertia_ratio": np.array(ball.inertia_ratio)}
    given |= {"ball_mass": np.array(ball.mass), "ball_radius": np.array(ball.radius)}
    c_y = damping(cor, ratio, given["k_y"], ball.mass)
    found = computed(given, impacts.v_x1, impacts.v_y1, impacts.omega_1, cor, c_y, ball.mass)
    status = np.where(np.isfinite(found.omega_2), Status.OK, Status.TORSION_TOO_SOFT)
    status = np.where(law.status == Status.OK, status, law.status).astype(np.int64)
    times = np.broadcast_to(found.contact_time, status.shape)
    none = np.full(status.shape, np.nan)
    return Rebound(
        found.v_x2,
        law.v_y2,
        found.omega_2,
        times,
        none,
        none,
        none,
        np.zeros_like(status),
        status,
    )


def computation() -> Model:
    """The thesis's own computation as a model, slips included; for reproduction only."""
    return Model("thesis", "thesis", Ball(), {}, model("two-mass").parameters, solve, timed=True)


class Fitted(NamedTuple):
    """A free fit: draws of its parameters with C1 and C2 in the thesis's units, rms residuals at
    the best, and of all parameters the largest R-hat and the least number of effective draws.
    """

    draws: dict[str, FloatArray]
    rms: Mapping[str, float]
    r_hat: float
    effective: float


def fitted(name: str, progress: Progress) -> Fitted:
    """Fit one of MODELS to Wang's impacts by the road of `calibrate`, without its judgements."""
    own = computation() if name == "thesis" else None
    effort = Effort() if own is None else Effort(max_steps=RARE)
    progress(f"fitting {name}", 0.0)
    # The computation is numpy, whose short calls no thread hastens.
    with threads(1 if own else None):
        problem = build_problem(*load_data(TABLE, None, False), Choices(name), own)
        point = best_fit(problem, effort.stream("search"))
        begin = [first_order(problem, point).proposal]
        posterior, found = sample(
            problem,
            begin,
            effort,
            lambda _stage, share: progress(f"fitting {name}", share),
        )
        draws = dict(draws_of(problem, point, posterior, effort).values)
    effective = min(*found.ess_bulk.values(), *found.ess_tail.values())
    return Fitted(with_line(draws), point.rms, max((found.r_hat or {}).values()), effective)


def with_line(values: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Parameters, and C1 and C2 of their offset as in Eq. (53)."""
    slope = values["eps_slope"] / INCH
    return {**values, "C1": slope, "C2": values["eps_10"] / INCH - 10.0 * slope}


def fits_frame(fits: Mapping[str, Fitted]) -> DataFrame:
    """How well each free fit does."""
    return pd.DataFrame(
        [
            {"model": name, "r_hat": one.r_hat, "effective": one.effective}
            | {f"rms {key}": value for key, value in one.rms.items()}
            for name, one in fits.items()
        ]
    )


def parameters_frame(
    fits: Mapping[str, Fitted],
    names: list[str],
    values: Mapping[str, FloatArray],
) -> DataFrame:
    """Median and 95 % interval of each fit in the thesis's units, beside Table 9 and Eq. (53)."""
    rows = []
    values = with_line(values)
    for name, unit, scale in (
        ("mass_ratio", "", 1.0),
        ("k_y", "lb/in", STIFFNESS),
        ("k_theta", "lb in/rad", TORSION),
        ("mu", "", 1.0),
        ("C1", "in/(m/s)", 1.0),
        ("C2", "in", 1.0),
    ):
        printed = dict(zip(names, values[name] / scale, strict=True))
        for key, one in fits.items():
            low, median, high = np.quantile(one.draws[name] / scale, (0.025, 0.5, 0.975))
            rows.append(
                {
                    "parameter": name,
                    "unit": unit,
                    "model": key,
                    "q025": low,
                    "median": median,
                    "q975": high,
                }
                | printed
            )
    return pd.DataFrame(rows)


def places_frame(
    fits: Mapping[str, Fitted],
    names: list[str],
    values: Mapping[str, FloatArray],
) -> DataFrame:
    """Where cases and Eq. (53) lie in each posterior: the `level` of the highest-density region on
    whose edge the point is, and the shares of draws below it.
    """
    rows = []
    values = with_line(values)
    for key, one in fits.items():
        rng = Effort().stream("density")
        for k, point in enumerate([*names, "Eq. (53)"]):
            # The three cases share Eq. (53).
            for group in {OWN: (JOINT, OFFSET), "Eq. (53)": (OFFSET,)}.get(point, (JOINT,)):
                at = {name: values[name][k % len(names)] for name in group}
                level = credible_level(
                    [one.draws[name] for name in group],
                    [*at.values()],
                    group == JOINT,
                    rng,
                )
                below = {
                    f"{name}_below": float(np.mean(one.draws[name] < value))
                    for name, value in at.items()
                }
                rows.append({"model": key, "point": point, "level": level, **below})
    return pd.DataFrame(rows)


def credible_level(
    draws: Sequence[FloatArray],
    point: Sequence[float],
    log: bool,
    rng: np.random.Generator,
) -> float:
    """Probability of the highest-density region of `draws` on whose edge `point` is; `log`:
    positive quantities.
    """
    known = np.array(draws)
    here = np.array(point)[:, np.newaxis]
    if log:
        known = np.log(known)
        here = np.log(here)
    chosen = known[:, rng.choice(known.shape[1], min(DENSITY, known.shape[1]), replace=False)]
    density = gaussian_kde(chosen)
    return float(np.mean(density(chosen) > density(here)))


def offsets_frame(fits: Mapping[str, Fitted]) -> DataFrame:
    """The offset of each impact [in] that angular momentum gives without any model, with its sd,
    Eq. (53), and the line of each fit.
    """
    table, scene = load_data(TABLE, None, False)
    frame = balances(table, scene.ball_value(), ERRORS)
    v_y1 = table.impacts.v_y1
    made = {"id": table.labels["id"], "spin": table.labels["group"], "v_y1 [m/s]": v_y1}
    made |= {
        "offset [in]": frame["offset [m]"].to_numpy() / INCH,
        "sd [in]": frame["offset_sd [m]"].to_numpy() / INCH,
    }
    lines = {"Eq. (53)": (C1, C2)} | {
        key: (one.draws["C1"], one.draws["C2"]) for key, one in fits.items()
    }
    return pd.DataFrame(
        made
        | {f"{key} [in]": np.median(c1) * v_y1 + np.median(c2) for key, (c1, c2) in lines.items()}
    )


def slope_of(offsets: DataFrame) -> tuple[float, float]:
    """Slope of a weighted line through the model-free offsets [in/(m/s)], and its standard
    error.
    """
    (slope, _), covariance = np.polyfit(
        offsets["v_y1 [m/s]"],
        offsets["offset [in]"],
        1,
        w=1.0 / offsets["sd [in]"],
        cov="unscaled",
    )
    return float(slope), float(np.sqrt(covariance[0, 0]))


def draws_frame(fits: Mapping[str, Fitted]) -> DataFrame:
    """Some draws of each fit."""
    scales = {
        "mass_ratio": 1.0,
        "k_y [lb/in]": STIFFNESS,
        "k_theta [lb in/rad]": TORSION,
        "C1": 1.0,
        "C2": 1.0,
    }
    made = []
    for key, one in fits.items():
        step = len(one.draws["mu"]) // KEPT
        some = {
            head: one.draws[head.partition(" ")[0]][::step] / scale
            for head, scale in scales.items()
        }
        made.append(pd.DataFrame({"model": key} | some))
    return pd.concat(made, ignore_index=True)
