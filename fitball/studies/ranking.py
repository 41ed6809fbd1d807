"""How well each of the thesis's seven parameter sets predicts Wang's 21 impacts, and how sure the order is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from fitball.data.thesis_tables import thesis_table
from fitball.data.wang import SPINS, measured
from fitball.values import FloatArray

OUTPUTS = ("v_x2", "theta_2", "omega_2")
UNITS: Mapping[str, str] = {"v_x2": "m/s", "theta_2": "deg", "omega_2": "rad/s"}
# Scales that weigh velocity against spin in one score: the noise of such measurements.
SCALE: Mapping[str, float] = {"v_x2": 0.25, "omega_2": 10.0}
RESAMPLES = 10000


@dataclass(frozen=True)
class Ranking:
    """`scores`: one row a set and group of impacts, root mean square errors and the joint score;
    `certainty`: for each set how often it is best, and among the best three, when the impacts are drawn anew, and
    the central 90 % of its excess over the best score.
    """

    scores: pd.DataFrame
    certainty: pd.DataFrame


def errors(predicted: Mapping[str, Mapping[str, FloatArray]]) -> dict[str, FloatArray]:
    """Predicted minus measured by output, (21,), spins in the order of `SPINS`; `predicted[spin][output]` is (7,)."""
    return {
        name: np.concatenate([predicted[spin][name] - measured(spin)[name] for spin in SPINS]) for name in OUTPUTS
    }


def joint_squares(found: Mapping[str, FloatArray]) -> FloatArray:
    """Mean of the squared errors of velocity and spin over their scales, an impact; (21,)."""
    return np.asarray(np.mean([(found[name] / scale) ** 2 for name, scale in SCALE.items()], axis=0))


def rank(sets: Mapping[str, Mapping[str, FloatArray]], seed: int = 1) -> Ranking:
    """Score sets from their `errors`; the bootstrap draws impacts within each spin."""
    groups = {spin: np.arange(7) + 7 * k for k, spin in enumerate(SPINS)}
    groups["pooled"] = np.arange(21)
    scores = pd.DataFrame(
        [
            {"set": name, "impacts": group,
             **{f"{output} [{UNITS[output]}]": float(np.sqrt(np.mean(found[output][chosen] ** 2)))
                for output in OUTPUTS},
             "score": float(np.sqrt(np.mean(joint_squares(found)[chosen])))}
            for name, found in sets.items() for group, chosen in groups.items()
        ]
    )  # fmt: skip
    rng = np.random.default_rng(seed)
    drawn = np.concatenate([rng.integers(0, 7, (RESAMPLES, 7)) + 7 * k for k in range(len(SPINS))], axis=1)
    names = list(sets)
    resampled = np.sqrt(np.array([joint_squares(sets[name])[drawn].mean(axis=1) for name in names]))
    order = np.argsort(np.argsort(resampled, axis=0), axis=0)
    best = names[int(np.argmin([np.mean(joint_squares(sets[name])) for name in names]))]
    excess = resampled - resampled[names.index(best)]
    certainty = pd.DataFrame(
        [
            {"set": name, "best": float(np.mean(order[k] == 0)), "among the best three": float(np.mean(order[k] < 3)),
             "excess over the best, 5 %": float(np.quantile(excess[k], 0.05)),
             "median": float(np.median(excess[k])), "95 %": float(np.quantile(excess[k], 0.95))}
            for k, name in enumerate(names)
        ]
    )  # fmt: skip
    return Ranking(scores, certainty)


def set_name(row: Mapping[str, object]) -> str:
    """A set of Appendix C as people name it."""
    return f"{row['case']}: M1/M = {row['mass_ratio']}, k_y = {row['k_y [lb/in]']}"


def appendix_c_sets(rows: pd.DataFrame, *, recomputed: bool) -> dict[str, dict[str, FloatArray]]:
    """Errors of the seven sets, from the printed outputs of Appendix C or from recomputed ones."""
    printed = thesis_table("appendix_c")
    sets = {}
    for case in sorted(printed["case"].unique()):
        predicted = {}
        for spin in SPINS:
            chosen = (printed["spin"] == spin) & (printed["case"] == case)
            mine, wang = rows[chosen], measured(spin)
            v_x2 = (mine["v_x2"] if recomputed else mine["v_x2 [m/s]"]).to_numpy()
            omega = (mine["omega_2"] if recomputed else mine["omega_2 [rad/s]"]).to_numpy()
            # The restitution is an input, so the measured one: two tables carry each other's printed V_y2.
            angle = np.degrees(np.arctan2(wang["v_y2"], v_x2))
            predicted[spin] = {"v_x2": v_x2, "theta_2": angle, "omega_2": omega}
        first = printed[printed["case"] == case].iloc[0].to_dict()
        sets[set_name(first)] = errors(predicted)
    return sets
