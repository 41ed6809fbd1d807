"""Rebounds as people compare them: each measured output of a table, what a model says of it, and the difference."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from fitball.data.table import ImpactTable
from fitball.inference.problem.observables import PREDICTED
from fitball.models.types import Rebound
from fitball.values import FloatArray

OUTPUTS = ("v_x2", "v_y2", "omega_2", "theta_2", "v_2", "contact_time")


def measured_outputs(table: ImpactTable) -> dict[str, FloatArray]:
    """Outputs (impacts,) in SI that the table measures, with velocity and angle also where they follow from the
    independent columns.
    """
    found = {item.name: item.values for item in table.measurements}
    if "v_2" in found and "theta_2" in found:
        found["v_x2"] = found["v_2"] * np.cos(found["theta_2"])
        found["v_y2"] = found["v_2"] * np.sin(found["theta_2"])
    if "v_x2" in found and "v_y2" in found and "theta_2" not in found:
        found["theta_2"] = np.arctan2(found["v_y2"], found["v_x2"])
    return {name: found[name] for name in OUTPUTS if name in found}


def predicted_outputs(rebound: Rebound, given_columns: Collection[str]) -> dict[str, FloatArray]:
    """Outputs of one parameter set (impacts,), from rebounds (1, impacts); those given to a model, and a contact time
    it does not have, are left out.
    """
    found = {name: PREDICTED[name](rebound)[0] for name in OUTPUTS if name not in given_columns}
    if np.any(np.isnan(found["contact_time"])):
        del found["contact_time"]
    if "v_y2" in given_columns:
        found.pop("v_2")
    return found


def output_errors(measured: Mapping[str, FloatArray], predicted: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Predicted minus measured for every output both have, (impacts,); angles by the short way round."""
    errors = {name: predicted[name] - measured[name] for name in OUTPUTS if name in measured and name in predicted}
    if "theta_2" in errors:
        errors["theta_2"] = np.angle(np.exp(1j * errors["theta_2"]))
    return errors


def root_mean_square(errors: FloatArray) -> float:
    """Root mean square of errors (impacts,)."""
    return float(np.sqrt(np.mean(errors**2)))
