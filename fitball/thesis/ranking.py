"""Seven sets of parameters ranked by Wang's impacts, and Table 9's three cases."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from fitball.base.errors import ParameterError, suggestion
from fitball.base.values import DataFrame, FloatArray
from fitball.data.bundled import printed
from fitball.inference.effort import Effort
from fitball.models.kernels.contact import CORE_RADIUS_RATIO
from fitball.models.specs import SPECS
from fitball.thesis import appendices
from fitball.thesis.appendices import MEAN_COR, OUTPUTS, SCALES, Outputs
from fitball.thesis.printed import DAMPING, SET_OF_CASE, appendix_c, set_values

# Samples of the bootstrap; the name of a reader's own set.
SAMPLES = 10_000
OWN = "yours"


def squares(missed: Outputs) -> FloatArray:
    """Mean of squared errors of velocity and spin over their scales, (sets, 21)."""
    return np.asarray(
        np.mean([(missed[name] / scale) ** 2 for name, scale in SCALES.items()], axis=0)
    )


def _rms(missed: Outputs, k: int) -> dict[str, float]:
    errors = {
        f"{name} [{unit}]": float(np.sqrt(np.mean(missed[name][k] ** 2)))
        for name, unit in OUTPUTS.items()
    }
    return errors | {"score": float(np.sqrt(np.mean(squares(missed)[k])))}


def ranking() -> DataFrame:
    """The seven sets of Appendix C as printed, as recomputed at Wang's own impacts (no erratum
    enters), and by the equations solved exactly: rms errors, the score of both, and of bootstrap
    samples of impacts within each spin the shares in which a set is first and `among_three`.
    """
    rows = appendix_c()
    sets = rows.sort_values("case", kind="stable")
    first = sets.iloc[::21]
    values = set_values(first)
    c_y = sets["c_y [lb s/in]"].to_numpy(np.float64).reshape(7, 21) * DAMPING
    sources = {
        "printed": appendices.as_printed(rows),
        "recomputed": appendices.by_computation(values, appendices.cor(), c_y),
        "exact": appendices.by_equations(values, appendices.states(), appendices.cor()),
    }
    rng = Effort().stream("bootstrap")
    drawn = np.concatenate(
        [rng.integers(0, 7, (SAMPLES, 7)) + 7 * k for k in range(len(MEAN_COR))],
        axis=1,
    )
    case_of = {number: str(case) for case, number in SET_OF_CASE.items()}
    found: list[dict[str, Any]] = []
    for source, outputs in sources.items():
        missed = appendices.misses(outputs)
        order = np.argsort(np.argsort(squares(missed)[:, drawn].mean(axis=2), axis=0), axis=0)
        found += [
            {
                "set": int(row["case"]),
                "case": case_of.get(int(row["case"]), ""),
                "mass_ratio": row["mass_ratio"],
                "k_y [lb/in]": row["k_y [lb/in]"],
                "source": source,
                **_rms(missed, k),
                "first": float(np.mean(order[k] == 0)),
                "among_three": float(np.mean(order[k] < 3)),
            }
            for k, row in enumerate(first.to_dict("records"))
        ]
    return pd.DataFrame(found)


def case_values(fix: Mapping[str, float]) -> tuple[list[str], dict[str, FloatArray]]:
    """Names and values of Table 9's cases, and of a reader's set: case 1 but for `fix`; a core of
    another mass has the inertia of a solid one in a thin shell. Raises ParameterError
    (`unknown-parameter`, `out-of-bounds`).
    """
    table = printed("table_9")
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
            ends = f"expected a value from {spec.lower:g} to {spec.upper:g}"
            raise ParameterError(
                f"fix: read {name} = {value:g} {spec.unit}".rstrip() + f"; {ends}",
                "out-of-bounds",
            )
    if not fix:
        return names, values
    own = dict(fix)
    if "mass_ratio" in own:
        own.setdefault("inertia_split", tied_split(own["mass_ratio"]))
    return [*names, OWN], {
        name: np.append(value, own.get(name, value[0])) for name, value in values.items()
    }


def tied_split(mass_ratio: Any) -> Any:
    """Share of inertia of a solid core in a thin shell (Eqs 67 and 69 with their fractions in the
    right order).
    """
    solid = 0.4 * CORE_RADIUS_RATIO**2 * mass_ratio
    thin = 2.0 / 3.0 * (1.0 - mass_ratio)
    return solid / (solid + thin)


def cases(names: list[str], values: Outputs) -> tuple[DataFrame, DataFrame]:
    """Errors of Table 9's cases by the computation, with the damping and mean restitution of
    Chapter V, and by the equations solved exactly; and the points of Figs 36 to 44. Raises
    ParameterError (`no-answer`).
    """
    found = {
        "thesis": appendices.by_computation(values, appendices.mean_cor()),
        "exact": appendices.by_equations(values, appendices.states(), appendices.cor()),
    }
    if names[-1] == OWN and not np.isfinite(found["thesis"]["omega_2"][-1]).all():
        text = (
            "fix: the joint is too soft to swing as fast as the vertical motion: use a larger "
            "k_theta"
        )
        raise ParameterError(text, "no-answer")
    errors = [
        {"case": name, "by": by, **_rms(appendices.misses(outputs), k)}
        for by, outputs in found.items()
        for k, name in enumerate(names)
    ]
    shown = found["thesis"]
    rows = printed("appendix_c").sort_values("case", kind="stable")
    points: list[DataFrame] = []
    for k, name in enumerate(names):
        part = appendices.wang()[["group", "theta_1 [deg]"]].rename(columns={"group": "spin"})
        part.insert(0, "case", name)
        number = SET_OF_CASE.get(k + 1)
        for output, unit in OUTPUTS.items():
            part[f"{output} measured [{unit}]"] = appendices.column(output)
            part[f"{output} recomputed [{unit}]"] = shown[output][k]
            # Angles are printed negative.
            sign = -1.0 if output == "theta_2" else 1.0
            old = sign * rows[f"{output} [{unit}]"].to_numpy(np.float64).reshape(7, 21)
            part[f"{output} printed [{unit}]"] = np.nan if number is None else old[number - 1]
        points.append(part)
    return pd.DataFrame(errors), pd.concat(points, ignore_index=True)
