"""Free fits of three models to Wang's impacts, and where the thesis's values lie in them."""

from collections.abc import Mapping, Sequence
from typing import Annotated, NamedTuple

import numpy as np
import pandas as pd
from scipy.stats import gaussian_kde

from fitball.base.environment import threads
from fitball.base.progress import Progress
from fitball.base.values import Ball, DataFrame, FloatArray, Impacts
from fitball.data.balances import impact_balances
from fitball.data.load import load_data
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
from fitball.thesis.printed import C1, C2, INCH, LB_IN_PER_RAD, LB_PER_IN, compute_sets
from fitball.thesis.ranking import USER_SET, tied_split

# The bundled table of Wang's 21 impacts.
WANG_TABLE = "wang_all"
# Models that are fitted; `thesis` is the thesis's own computation.
FITTED_MODELS = ("two-mass", "thesis-exact", "thesis")
# Parameters of the model `brody`, by which the computation has its law of restitution.
LAW_PARAMETERS = ("mu", "cor_10", "cor_slope")
_LAW_MODEL = model("brody")
# Parameters that the thesis sets in each of its cases.
JOINT_PARAMETERS = ("mass_ratio", "k_y", "k_theta")
# Parameters of Eq. (53), which all its cases share.
OFFSET_PARAMETERS = ("C1", "C2")
# Steps of each ensemble for the computation. Its joint is rarely very stiff: these give some 500
# effective draws there.
COMPUTATION_STEPS = 1_000
# Draws behind a density, with which a level is known to a per cent or so.
DENSITY_DRAWS = 3_000
# Draws of a fit in figures: more would hide each other.
DRAWS_SHOWN = 500
# Nominal sds of Wang's measurements, SI, from which the sds of model-free offsets follow.
NOMINAL_SDS = {**SCALES, "v_y2": 0.25}


def thesis_solve(
    ball: Ball,
    names: Sequence[str],
    values: Annotated[FloatArray, "draws parameters"],
    impacts: Impacts,
    _cor: FloatArray | None = None,
) -> Rebound:
    """Rebounds (draws, impacts) by the thesis's computation at `values` of the parameters `names`,
    called as `Model.solve` is. The damping is that of Chapter V; the law of restitution and the
    inertias of core and shell are those of the other models.
    """
    columns = {name: values[:, [k]] for k, name in enumerate(names)}
    law = _LAW_MODEL.evaluate(
        LAW_PARAMETERS, np.hstack([columns[name] for name in LAW_PARAMETERS]), impacts
    )
    cor = law.v_y2 / impacts.v_y1
    ratio = columns["mass_ratio"]
    columns["inertia_split"] = tied_split(ratio)
    columns["inertia_ratio"] = np.array(ball.inertia_ratio)
    columns["ball_mass"] = np.array(ball.mass)
    columns["ball_radius"] = np.array(ball.radius)
    c_y = damping(cor, ratio, columns["k_y"], ball.mass)
    v_x1 = impacts.v_x1
    rebound = compute_sets(columns, v_x1, impacts.v_y1, impacts.omega_1, cor, c_y, ball.mass)
    status = np.where(np.isfinite(rebound.omega_2), Status.OK, Status.TORSION_TOO_SOFT)
    status = np.where(law.status == Status.OK, status, law.status).astype(np.int64)
    none = np.full(status.shape, np.nan)
    return Rebound(
        v_x2=rebound.v_x2,
        v_y2=law.v_y2,
        omega_2=rebound.omega_2,
        contact_time=np.broadcast_to(rebound.contact_time, status.shape),
        gap_time=none,
        gap_path=none,
        gap_turn=none,
        regime=np.zeros_like(status),
        status=status,
    )


def computation_model() -> Model:
    """A model that is the computation of the thesis, slips included, for reproduction only."""
    return Model(
        "thesis", "thesis", Ball(), {}, model("two-mass").parameters, thesis_solve, timed=True
    )


class FreeFit(NamedTuple):
    """A fit of all parameters: `draws` (draws,) in SI, with C1 and C2 in the thesis's units, and
    the `rms` residuals at the best values by column, SI. `r_hat` is the largest and `effective` the
    least effective sample size of all parameters.
    """

    draws: dict[str, FloatArray]
    rms: Mapping[str, float]
    r_hat: float
    effective: float


def free_fit(name: str, progress: Progress) -> FreeFit:
    """The free fit of one of FITTED_MODELS to Wang's impacts, searched and sampled as by
    `calibrate`, without its judgements.
    """
    user_model = None
    effort = Effort()
    threads_used = None
    if name == "thesis":
        user_model = computation_model()
        effort = Effort(max_steps=COMPUTATION_STEPS)
        # The computation is in short calls of NumPy, which threads do not hasten.
        threads_used = 1

    def report_share(_stage: str, share: float) -> None:
        progress(f"fitting {name}", share)

    report_share("", 0.0)
    with threads(threads_used):
        problem = build_problem(*load_data(WANG_TABLE, None, False), Choices(name), user_model)
        point = best_fit(problem, effort.stream("search"))
        begin = [first_order(problem, point).proposal]
        posterior, convergence = sample(problem, begin, effort, report_share)
        draws = dict(draws_of(problem, point, posterior, effort).values)
    effective = min(*convergence.ess_bulk.values(), *convergence.ess_tail.values())
    r_hat = max((convergence.r_hat or {}).values())
    return FreeFit(with_offset_line(draws), point.rms, r_hat, effective)


def with_offset_line(values: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """The same parameters (draws,) in SI, with C1 [in/(m/s)] and C2 [in] of Eq. (53) added."""
    slope = values["eps_slope"] / INCH
    return {**values, "C1": slope, "C2": values["eps_10"] / INCH - 10.0 * slope}


def fits_frame(fits: Mapping[str, FreeFit]) -> DataFrame:
    """The frame `fits`, a row a free fit: convergence, and rms residuals by column, SI."""
    rows = []
    for name, fit in fits.items():
        row: dict[str, object] = {"model": name, "r_hat": fit.r_hat, "effective": fit.effective}
        for column, rms in fit.rms.items():
            row[f"rms {column}"] = rms
        rows.append(row)
    return pd.DataFrame(rows)


def parameters_frame(
    fits: Mapping[str, FreeFit],
    names: list[str],
    values: Mapping[str, FloatArray],
) -> DataFrame:
    """The frame `parameters`: median and 95 % interval of each fit in the thesis's units, beside
    the sets `names`, Table 9's and a user's, with their `values` (sets,), SI.
    """
    units = (
        ("mass_ratio", "", 1.0),
        ("k_y", "lb/in", LB_PER_IN),
        ("k_theta", "lb in/rad", LB_IN_PER_RAD),
        ("mu", "", 1.0),
        ("C1", "in/(m/s)", 1.0),
        ("C2", "in", 1.0),
    )
    rows = []
    values = with_offset_line(values)
    for name, unit, scale in units:
        in_sets = dict(zip(names, values[name] / scale, strict=True))
        for fitted_model, fit in fits.items():
            low, median, high = np.quantile(fit.draws[name] / scale, (0.025, 0.5, 0.975))
            rows.append(
                {
                    "parameter": name,
                    "unit": unit,
                    "model": fitted_model,
                    "q025": low,
                    "median": median,
                    "q975": high,
                    **in_sets,
                }
            )
    return pd.DataFrame(rows)


def places_frame(
    fits: Mapping[str, FreeFit],
    names: list[str],
    values: Mapping[str, FloatArray],
) -> DataFrame:
    """The frame `places`: where the sets `names` with their `values` (sets,), SI, and Eq. (53) lie
    in each posterior. `level` is the probability of the highest-density region on whose edge a
    point lies; `NAME_below` are shares of draws below it.
    """
    values = with_offset_line(values)
    # Points with their parameters and the set that has their values; the cases share Eq. (53).
    points: list[tuple[str, tuple[str, ...], int]] = []
    for k, name in enumerate(names):
        points.append((name, JOINT_PARAMETERS, k))
        if name == USER_SET:
            points.append((name, OFFSET_PARAMETERS, k))
    points.append(("Eq. (53)", OFFSET_PARAMETERS, 0))
    rows = []
    for fitted_model, fit in fits.items():
        rng = Effort().stream("density")
        for point, parameters, k in points:
            draws = [fit.draws[name] for name in parameters]
            at = [float(values[name][k]) for name in parameters]
            level = credible_level(draws, at, parameters == JOINT_PARAMETERS, rng)
            row: dict[str, object] = {"model": fitted_model, "point": point, "level": level}
            for name, value in zip(parameters, at, strict=True):
                row[f"{name}_below"] = float(np.mean(fit.draws[name] < value))
            rows.append(row)
    return pd.DataFrame(rows)


def credible_level(
    draws: Sequence[FloatArray],
    point: Sequence[float],
    log: bool,
    rng: np.random.Generator,
) -> float:
    """Probability of the highest-density region on whose edge a `point` lies. `draws` are (draws,)
    of each parameter, `point` has a value of each. With `log` the density is that of logarithms,
    for positive quantities.
    """
    cloud = np.array(draws)
    edge = np.array(point)[:, np.newaxis]
    if log:
        cloud = np.log(cloud)
        edge = np.log(edge)
    count = cloud.shape[1]
    chosen = cloud[:, rng.choice(count, min(DENSITY_DRAWS, count), replace=False)]
    density = gaussian_kde(chosen)
    return float(np.mean(density(chosen) > density(edge)))


def offsets_frame(fits: Mapping[str, FreeFit]) -> DataFrame:
    """The frame `offsets`: the offset [in] of each impact that the balance of angular momentum
    gives without any model, with its sd, Eq. (53), and the line of each fit.
    """
    table, scene = load_data(WANG_TABLE, None, False)
    frame = impact_balances(table, scene.ball_value(), NOMINAL_SDS)
    v_y1 = table.impacts.v_y1
    columns = {
        "id": table.labels["id"],
        "spin": table.labels["group"],
        "v_y1 [m/s]": v_y1,
        "offset [in]": frame["offset [m]"].to_numpy() / INCH,
        "sd [in]": frame["offset_sd [m]"].to_numpy() / INCH,
        "Eq. (53) [in]": C1 * v_y1 + C2,
    }
    for name, fit in fits.items():
        slope = np.median(fit.draws["C1"])
        columns[f"{name} [in]"] = slope * v_y1 + np.median(fit.draws["C2"])
    return pd.DataFrame(columns)


def slope_of(offsets: DataFrame) -> tuple[float, float]:
    """Slope of a weighted line through the model-free offsets [in/(m/s)], and its standard error,
    scaled by the residuals: the sds of offsets follow from errors that Wang does not state.
    """
    (slope, _), covariance = np.polyfit(
        offsets["v_y1 [m/s]"],
        offsets["offset [in]"],
        1,
        w=1.0 / offsets["sd [in]"],
        cov=True,
    )
    return float(slope), float(np.sqrt(covariance[0, 0]))


def draws_frame(fits: Mapping[str, FreeFit]) -> DataFrame:
    """The frame `draws`: DRAWS_SHOWN draws of each fit, evenly spread, in the thesis's units."""
    frames = []
    for name, fit in fits.items():
        step = len(fit.draws["mu"]) // DRAWS_SHOWN
        draws = {parameter: values[::step] for parameter, values in fit.draws.items()}
        frames.append(
            pd.DataFrame(
                {
                    "model": name,
                    "mass_ratio": draws["mass_ratio"],
                    "k_y [lb/in]": draws["k_y"] / LB_PER_IN,
                    "k_theta [lb in/rad]": draws["k_theta"] / LB_IN_PER_RAD,
                    "C1": draws["C1"],
                    "C2": draws["C2"],
                }
            )
        )
    return pd.concat(frames, ignore_index=True)
