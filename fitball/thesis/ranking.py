"""How well each of the thesis's seven parameter sets predicts Wang's 21 impacts, and how sure the order is."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from fitball.data.published import SPINS, measured, thesis_table
from fitball.inference.thesis.published_cases import case_parameters, printed_model, set_name
from fitball.models.model import Model
from fitball.models.registry import model
from fitball.thesis import appendix_c
from fitball.thesis.printed_tables import spin_predictions
from fitball.values import FloatArray

OUTPUTS = ("v_x2", "theta_2", "omega_2")
UNITS: Mapping[str, str] = {"v_x2": "m/s", "theta_2": "deg", "omega_2": "rad/s"}
# Scales that weigh velocity against spin in one score: the noise of such measurements.
SCALE: Mapping[str, float] = {"v_x2": 0.25, "omega_2": 10.0}
RESAMPLES = 10000
# Rankings by the source of their predictions. No erratum enters the last two: they are made at Wang's own incident
# states, and of Appendix C take only what defines a set.
PRINTED, MENDED, RECOMPUTED, EXACT = "printed", "mended", "recomputed", "exact"


@dataclass(frozen=True)
class Ranking:
    """`errors` by set and output, (21,); `scores`: one row per set and group of impacts, root mean square errors and
    the joint score; `certainty`: for each set how often it is best, and among the best three, when the impacts are
    drawn anew, and the central 90 % of its excess over the best score.
    """

    errors: Mapping[str, Mapping[str, FloatArray]]
    scores: pd.DataFrame
    certainty: pd.DataFrame

    @property
    def pooled(self) -> pd.DataFrame:
        """Scores over all impacts, and certainty, by the name of the set."""
        scores = self.scores[self.scores["impacts"] == "pooled"].drop(columns="impacts").set_index("set")
        return scores.join(self.certainty.set_index("set"))


def errors(predicted: Mapping[str, Mapping[str, FloatArray]]) -> dict[str, FloatArray]:
    """Predicted minus measured by output, (21,), spins in the order of `SPINS`; `predicted[spin][output]` is (7,)."""
    return {
        name: np.concatenate([predicted[spin][name] - measured(spin)[name] for spin in SPINS]) for name in OUTPUTS
    }


def joint_squares(by_output: Mapping[str, FloatArray]) -> FloatArray:
    """Mean of the squared errors of velocity and spin over their scales, an impact; (21,)."""
    return np.asarray(np.mean([(by_output[name] / scale) ** 2 for name, scale in SCALE.items()], axis=0))


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
    return Ranking(sets, scores, certainty)


def printed_sets(rows: pd.DataFrame) -> dict[str, dict[str, FloatArray]]:
    """Errors of the seven sets, from the printed outputs in rows of Appendix C."""

    def predicted(mine: pd.DataFrame, spin: str) -> dict[str, FloatArray]:
        v_x2 = mine["v_x2 [m/s]"].to_numpy()
        # The restitution is an input, so the measured one: two tables carry each other's printed V_y2.
        angle = np.degrees(np.arctan2(measured(spin)["v_y2"], v_x2))
        return {"v_x2": v_x2, "theta_2": angle, "omega_2": mine["omega_2 [rad/s]"].to_numpy()}

    return _sets(rows, predicted)


def solved_sets(chosen: Model) -> dict[str, dict[str, FloatArray]]:
    """Errors of the seven sets by a model that is told the restitution, at Wang's incident states."""

    def predicted(mine: pd.DataFrame, spin: str) -> dict[str, FloatArray]:
        row = mine.iloc[0]
        c_y = row["c_y [lb s/in]"] if "c_y" in chosen.parameter_names else None
        values = case_parameters(row["mass_ratio"], row["k_y [lb/in]"], row["i1_over_i"], c_y)
        return spin_predictions(chosen, values, spin)

    return _sets(thesis_table("appendix_c"), predicted)


def _sets(
    rows: pd.DataFrame, predicted: Callable[[pd.DataFrame, str], dict[str, FloatArray]]
) -> dict[str, dict[str, FloatArray]]:
    sets = {}
    for _case, mine in rows.groupby("case"):
        by_spin = {spin: predicted(mine[mine["spin"] == spin], spin) for spin in SPINS}
        sets[set_name(mine.iloc[0].to_dict())] = errors(by_spin)
    return sets


def rank_all(appendix: appendix_c.AppendixC, seed: int) -> dict[str, Ranking]:
    """The seven sets ranked by what Appendix C prints, by print with known misprints mended, by the thesis's
    computation, and by its equations solved exactly.
    """
    sets = {
        PRINTED: printed_sets(appendix.rows),
        MENDED: printed_sets(appendix_c.mended(appendix)),
        RECOMPUTED: solved_sets(printed_model()),
        EXACT: solved_sets(model("thesis-exact", inertia="table", cor="measured")),
    }
    return {name: rank(item, seed) for name, item in sets.items()}


def side_by_side(rankings: Mapping[str, Ranking]) -> pd.DataFrame:
    """One row per set: its score, and how often it is first and among the first three, in every ranking."""
    heads = {"score": "score", "best": "first", "among the best three": "among three"}
    parts = [
        ranking.pooled[list(heads)].rename(columns={key: f"{name}: {head}" for key, head in heads.items()})
        for name, ranking in rankings.items()
    ]
    return pd.concat(parts, axis=1).reset_index()


def in_brief(rankings: Mapping[str, Ranking]) -> pd.DataFrame:
    """One row per set, in every ranking its score and, in brackets, the share of resamples in which it is first."""
    cells = {
        name: [f"{row['score']:.3f} ({100.0 * row['best']:.1f} %)" for _, row in ranking.pooled.iterrows()]
        for name, ranking in rankings.items()
    }
    return pd.DataFrame({"set": next(iter(rankings.values())).pooled.index, **cells})
