"""Seven sets of parameters ranked by Wang's impacts, and Table 9's three cases."""

from collections.abc import Mapping
from typing import Annotated, TypeVar

import numpy as np
import pandas as pd

from fitball.base.errors import ParameterError, suggestion
from fitball.base.values import DataFrame, FloatArray
from fitball.data.bundled import printed_table
from fitball.inference.effort import Effort
from fitball.models.kernels.contact import CORE_RADIUS_RATIO
from fitball.models.specs import SPECS
from fitball.thesis import appendices
from fitball.thesis.appendices import JUDGED_OUTPUTS, MEAN_COR, SCALES, Outputs
from fitball.thesis.printed import LB_S_PER_IN, SET_OF_CASE, appendix_c, set_values

# Samples of the bootstrap: standard errors of shares are then at most half a per cent.
BOOTSTRAP_SAMPLES = 10_000
# Name of the set that a user passes.
USER_SET = "yours"
# One share of the mass, or an array of them.
Masses = TypeVar("Masses", float, FloatArray)


def mean_squares(misses: Outputs) -> Annotated[FloatArray, "sets 21"]:
    """Mean of the squared misses of velocity and of spin over their scales, by set and impact."""
    scaled = [(misses[name] / scale) ** 2 for name, scale in SCALES.items()]
    return np.asarray(np.mean(scaled, axis=0))


def _rms(misses: Outputs, k: int) -> dict[str, float]:
    """Root mean squares of the misses (sets, 21) of set `k` by heads of outputs, and its score."""
    errors = {}
    for name in JUDGED_OUTPUTS:
        errors[appendices.head_of(name)] = float(np.sqrt(np.mean(misses[name][k] ** 2)))
    return {**errors, "score": float(np.sqrt(np.mean(mean_squares(misses)[k])))}


def rank_sets() -> DataFrame:
    """The seven sets of Appendix C as printed, as recomputed at Wang's own impacts (no erratum
    enters), and by the equations solved exactly. Each has its rms errors, the score of velocity and
    spin, and the shares of bootstrap samples in which it is `first` and `among_three`. Samples are
    of impacts within each spin.
    """
    rows = appendix_c()
    sets = rows.sort_values("case", kind="stable")
    head_rows = sets.iloc[::21]
    values = set_values(head_rows)
    c_y = sets["c_y [lb s/in]"].to_numpy(np.float64).reshape(7, 21) * LB_S_PER_IN
    sources = {
        "printed": appendices.outputs_in_print(rows),
        "recomputed": appendices.outputs_by_computation(values, appendices.measured_cor(), c_y),
        "exact": appendices.outputs_by_equations(
            values, appendices.wang_states(), appendices.measured_cor()
        ),
    }
    rng = Effort().stream("bootstrap")
    spins = [rng.integers(0, 7, (BOOTSTRAP_SAMPLES, 7)) + 7 * k for k in range(len(MEAN_COR))]
    sampled = np.concatenate(spins, axis=1)
    case_of = {number: str(case) for case, number in SET_OF_CASE.items()}
    ranked: list[dict[str, object]] = []
    for source, outputs in sources.items():
        misses = appendices.misses_of(outputs)
        scores = mean_squares(misses)[:, sampled].mean(axis=2)
        places = np.argsort(np.argsort(scores, axis=0), axis=0)
        for k, row in enumerate(head_rows.to_dict("records")):
            number = int(row["case"])
            ranked.append(
                {
                    "set": number,
                    "case": case_of.get(number, ""),
                    "mass_ratio": row["mass_ratio"],
                    "k_y [lb/in]": row["k_y [lb/in]"],
                    "source": source,
                    **_rms(misses, k),
                    "first": float(np.mean(places[k] == 0)),
                    "among_three": float(np.mean(places[k] < 3)),
                }
            )
    return pd.DataFrame(ranked)


def case_values(fix: Mapping[str, float]) -> tuple[list[str], dict[str, FloatArray]]:
    """Names and parameters (sets,), SI, of Table 9's cases, and of a user's set, which is case 1
    but for the values `fix`. A core of another mass has the inertia of a solid one in a thin shell.

    Raises:
        ParameterError: `fix` has an unknown name (`unknown-parameter`), or a value beyond its
            bounds (`out-of-bounds`).
    """
    table = printed_table("table_9")
    names = [f"case {case}" for case in table["case"]]
    values = set_values(table)
    for name, value in fix.items():
        if name not in values:
            raise ParameterError(
                f"fix: read '{name}'; {suggestion(name, values)}",
                "unknown-parameter",
            )
        spec = SPECS[name]
        if not spec.lower <= value <= spec.upper:
            read = f"fix: read {name} = {value:g} {spec.unit}".rstrip()
            raise ParameterError(
                f"{read}; expected a value from {spec.lower:g} to {spec.upper:g}",
                "out-of-bounds",
            )
    if not fix:
        return names, values
    chosen = dict(fix)
    if "mass_ratio" in chosen:
        chosen.setdefault("inertia_split", tied_split(chosen["mass_ratio"]))
    extended = {}
    for name, column in values.items():
        extended[name] = np.append(column, chosen.get(name, column[0]))
    return [*names, USER_SET], extended


def tied_split(mass_ratio: Masses) -> Masses:
    """Share of the moment of inertia that a solid core of this share of the mass has in a thin
    shell: Eqs (67) and (69) with their fractions in the right order.
    """
    solid = 0.4 * CORE_RADIUS_RATIO**2 * mass_ratio
    thin = 2.0 / 3.0 * (1.0 - mass_ratio)
    return solid / (solid + thin)


def errors_and_points(names: list[str], values: Outputs) -> tuple[DataFrame, DataFrame]:
    """Two frames: errors of sets, and the points of Figs 36 to 44. Sets are `names` with parameters
    `values` (sets,). Errors are by the computation, with the damping and mean restitution of
    Chapter V, and by the equations solved exactly.

    Raises:
        ParameterError: the computation has no answer for a user's set (`no-answer`).
    """
    by_computation = appendices.outputs_by_computation(values, appendices.mean_cor())
    by_equations = appendices.outputs_by_equations(
        values, appendices.wang_states(), appendices.measured_cor()
    )
    if names[-1] == USER_SET and not np.isfinite(by_computation["omega_2"][-1]).all():
        text = (
            "fix: the joint is too soft to swing as fast as the vertical motion: use a larger "
            "k_theta"
        )
        raise ParameterError(text, "no-answer")
    errors = []
    for by, outputs in (("thesis", by_computation), ("exact", by_equations)):
        misses = appendices.misses_of(outputs)
        errors += [{"case": name, "by": by, **_rms(misses, k)} for k, name in enumerate(names)]
    points = [_points(name, k, by_computation) for k, name in enumerate(names)]
    return pd.DataFrame(errors), pd.concat(points, ignore_index=True)


def _points(name: str, k: int, recomputed: Outputs) -> DataFrame:
    """The 21 points of Figs 36 to 44 of set `k`: outputs as measured, as `recomputed` (sets, 21),
    and as printed in Appendix C. Only the first three sets, Table 9's cases, are printed; others
    are NaN.
    """
    rows = printed_table("appendix_c")
    rows = rows[rows["case"] == SET_OF_CASE.get(k + 1)]
    points = appendices.wang()[["group", "theta_1 [deg]"]].rename(columns={"group": "spin"})
    points.insert(0, "case", name)
    for output, unit in JUDGED_OUTPUTS.items():
        points[f"{output} measured [{unit}]"] = appendices.wang_column(output)
        points[f"{output} recomputed [{unit}]"] = recomputed[output][k]
        # Angles are printed negative.
        sign = -1.0 if output == "theta_2" else 1.0
        in_print = sign * rows[appendices.head_of(output)].to_numpy(np.float64)
        points[f"{output} printed [{unit}]"] = in_print if len(rows) else np.nan
    return points
