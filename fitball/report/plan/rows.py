"""A plan as rows of a table that can be filled in and fitted, and as JSON."""

from __future__ import annotations

import math

import numpy as np

from fitball.inference.design.asked import Setting
from fitball.inference.design.make_plan import Plan
from fitball.inference.problem.problem import Problem
from fitball.observables import OBSERVABLES
from fitball.report.form.numbers import output_scale
from fitball.values import FloatArray

Row = dict[str, object]
# What states the uncertainty of an incident state, by whether that is speed and angle or vertical, and which stated
# sds of a table call for it.
INCIDENT_SDS = {
    True: {
        "v_1_sd [m/s]": {"v_x1", "v_y1"}, "theta_1_sd [deg]": {"v_x1", "v_y1"}, "omega_1_sd [rad/s]": {"omega_1"},
    },
    False: {"v_y1_sd [m/s]": {"v_y1"}},
}  # fmt: skip


def plan_rows(plan: Plan, problem: Problem) -> list[Row]:
    """A row an impact, repeats included, in the columns that the fitted table has, so that both can be fitted
    together: incident state, labels of the surface, what is to be measured and stated (empty), and behind it gains
    and expected sds, which reading leaves aside.
    """
    table, found = problem.table, plan.settings
    empty = [name for one in plan.chosen for name in one.sensor.split("+") if name in OBSERVABLES]
    empty = list(dict.fromkeys([*(item.name for item in problem.observables), *empty]))
    stated = [f"{item.name}_sd" for item in problem.observables if item.sd is not None]
    incident = [
        head for head, names in INCIDENT_SDS[table.has_tangential].items() if names & table.incident_sd.keys()
    ]
    spun = "omega_1" in table.incident_columns or any(one.setting.spin for one in plan.chosen)
    rows: list[Row] = []
    for place, one in enumerate(plan.chosen, 1):
        state = one.setting
        for repeat in range(1, plan.repeats + 1):
            row: Row = {"id": f"{place}.{repeat}" if plan.repeats > 1 else str(place)}
            if table.has_tangential:
                row |= {"v_1 [m/s]": _number(state.speed), "theta_1 [deg]": _number(math.degrees(state.angle))}
                row |= {"omega_1 [rad/s]": _number(state.spin)} if spun else {}
            else:
                row["v_y1 [m/s]"] = _number(state.speed)
            at = found.rows[found.surfaces.index(state.surface)]
            row |= {pooling.column: pooling.labels[int(pooling.index[at])] for pooling in problem.pooling}
            row |= dict.fromkeys(f"{name} [{output_scale(name).unit}]" for name in empty)
            row |= dict.fromkeys(f"{name} [{output_scale(name.removesuffix('_sd')).unit}]" for name in stated)
            row |= dict.fromkeys(incident)
            row |= {"sensor": one.sensor, "gain of all repeats [nats]": _number(one.gain)}
            for part, sd in zip(plan.parts, one.sds, strict=True):
                unit = "" if part.log or not part.unit else f" [{part.unit}]"
                row[f"expected sd of {'ln ' if part.log else ''}{part.name}{unit}"] = _number(float(sd))
            rows.append(row)
    return rows


def plan_json(plan: Plan) -> Row:
    """All of it, SI units; sds of `log` parts are those of the logarithm."""
    found = plan.settings
    return {
        "target": plan.target,
        "parts": [
            {"name": part.name, "unit": part.unit, "log": part.log, "sd": _number(float(sd))}
            for part, sd in zip(plan.parts, plan.sds, strict=True)
        ],
        "repeats": plan.repeats,
        "chosen": [
            {
                **_state(one.setting), "sensor": one.sensor, "gain": _number(one.gain), "sds": _numbers(one.sds),
                "unsolved": one.unsolved, "regimes": dict(one.regimes),
            }
            for one in plan.chosen
        ],
        "gain": _number(plan.gain),
        "table_again": {"gain": _number(plan.again), "sds": _numbers(plan.again_sds)},
        "sensors": [
            {
                "name": worth.sensor, "words": worth.words, "cost": worth.cost, "best": _state(worth.best),
                "gain": _number(worth.gain), "batch": _number(worth.batch),
                "sds": _numbers(worth.sds),
            }
            for worth in plan.worths
        ],
        "settings": {
            "surfaces": list(found.surfaces), "speeds": _numbers(found.speeds), "angles": _numbers(found.angles),
            "spins": _numbers(found.spins), "assumed": list(found.assumed), "left_out": dict(plan.failed),
            "gains": [_number(float(gain)) for gain in plan.gains.ravel()],
        },
        "draws": plan.draws,
        "lost": plan.lost,
        "seed": plan.seed,
        "notes": list(plan.notes),
    }  # fmt: skip


def _state(setting: Setting) -> Row:
    state: Row = {"surface": setting.surface} if setting.surface else {}
    return state | {
        "v_1": _number(setting.speed),
        "theta_1": _number(setting.angle),
        "omega_1": _number(setting.spin),
    }


def _numbers(values: FloatArray) -> list[float | None]:
    return [_number(float(value)) for value in np.asarray(values).ravel()]


def _number(value: float) -> float | None:
    """A number to nine digits, which is more than it means and the same everywhere; None where there is none."""
    return float(f"{value:.9g}") if math.isfinite(value) else None
