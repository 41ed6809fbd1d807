"""How well each of the thesis's seven parameter sets predicts Wang's 21 impacts, how certain their order is, and what
follows for Table 9 and Eq. (53), in words: every word follows from the numbers given.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from fitball.data.published import SPINS, measured, thesis_table
from fitball.inference.thesis.published_cases import C1, case_parameters, printed_model, set_name
from fitball.models.model import Model
from fitball.models.registry import model
from fitball.report.form.numbers import listed
from fitball.thesis import appendices
from fitball.thesis.appendices import CASE_IN_APPENDIX_C
from fitball.thesis.printed_tables import spin_predictions
from fitball.thesis.recalibration import Placed
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
    """Errors of the seven sets by a model with given restitution, at Wang's incident states."""

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


def rank_all(appendix: appendices.AppendixC, seed: int) -> dict[str, Ranking]:
    """The seven sets ranked by what Appendix C prints, by print with known misprints mended, by the thesis's
    computation, and by its equations solved exactly.
    """
    sets = {
        PRINTED: printed_sets(appendix.rows),
        MENDED: printed_sets(appendices.mended(appendix)),
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


# Share of resampled sets of impacts from which on a place counts as certain; its complement rules the place out.
SURE = 0.95
# Relative difference in score within which two sets do equally well.
EQUAL = 0.01
# Shares that differ by less are the same.
SAME_SHARE = 0.05
# Levels are shares of some thousand correlated draws: beyond this one they cannot be distinguished.
CONTOUR = 0.99
# A published value outside the central share of a parameter's draws is named.
CENTRAL = 0.95
# Standard errors beyond which a slope is another one.
APART = 3.0
NOUNS: Mapping[str, str] = {"v_x2": "velocity", "omega_2": "spin"}


def ranking_verdict(rankings: Mapping[str, Ranking]) -> str:
    """Which set is best by the ranking that no erratum enters, and what the other rankings say."""
    answer = rankings[RECOMPUTED].pooled
    leader = str(answer["score"].idxmin())
    equal = _equals(answer, leader)
    others = f"Within {_percent(EQUAL)} of its score: {_numbers(equal) if equal else 'no other set'}"
    exact = rankings[EXACT].pooled
    best = str(exact["score"].idxmin())
    return (
        f"Recomputed at Wang's impacts (no erratum is used), {_set(leader)} is first of {len(answer)} in "
        f"{_percent(answer['best'][leader])} of the bootstrap samples. {others}. {_print(rankings)} With the "
        f"thesis's equations solved exactly, {_set(best)} is first in {_percent(exact['best'][best])}."
    )


def _print(rankings: Mapping[str, Ranking]) -> str:
    """Which set is first as printed, and whether that depends on misprints."""
    printed = rankings[PRINTED].pooled["best"]
    first = str(printed.idxmax())
    mended, recomputed = (float(rankings[name].pooled["best"][first]) for name in (MENDED, RECOMPUTED))
    depends = max(abs(printed[first] - share) for share in (mended, recomputed)) > SAME_SHARE
    how = "depends" if depends else "does not depend"
    return (
        f"As printed, {_set(first)} is first in {_percent(printed[first])}. This {how} on misprinted rows: "
        f"{_percent(mended)} after correction of those with a known cause, {_percent(recomputed)} recomputed."
    )


def case_verdict(case: int, rankings: Mapping[str, Ranking]) -> str:
    """Whether a case of Table 9 is among the three best of the seven sets."""
    pooled = {name: ranking.pooled for name, ranking in rankings.items()}
    answer = pooled[RECOMPUTED]
    mine = _chosen(answer, case)
    sure = float(answer["among the best three"][mine])
    shares = {name: _percent(float(item["best"][mine])) for name, item in pooled.items()}
    return (
        f"set {mine.partition(':')[0]} of Appendix C, rank {int(answer['score'].rank()[mine])} of {len(answer)} "
        f"recomputed. It is first in {shares[RECOMPUTED]} and among the best three in {_percent(sure)} of the "
        f"bootstrap samples. First as printed: {shares[PRINTED]}; with known misprints corrected: {shares[MENDED]}; "
        f"solved exactly: {shares[EXACT]}. {_claim(answer, mine, sure)}"
    )


def headline(rankings: Mapping[str, Ranking], placed: Mapping[str, Sequence[Placed]]) -> str:
    """Whether the claim of Table 9 holds, in two sentences."""
    sure = rankings[RECOMPUTED].pooled["among the best three"]
    standing: dict[str, list[str]] = {}
    for case in CASE_IN_APPENDIX_C:
        standing.setdefault(_standing(float(sure[_chosen(sure, case)])), []).append(f"case {case}")
    which = "; it ".join(f"{words} for {listed(names)}" for words, names in standing.items())
    cases = {name: [item for item in items if item.point.startswith("case")] for name, items in placed.items()}
    beyond = _grouped(
        (f"{sum(item.level > CONTOUR for item in items)} of {len(items)}", name) for name, items in cases.items()
    )
    return (
        f"Table 9 claims that its cases are the three best of the {len(sure)} sets. This {which}. Cases beyond "
        f"the {_percent(CONTOUR)} contour of a free fit: {beyond}."
    )


def _standing(sure: float) -> str:
    return "holds" if sure >= SURE else "fails" if sure <= 1.0 - SURE else "is undecided"


def _chosen(sets: pd.DataFrame | pd.Series, case: int) -> str:
    return next(str(name) for name in sets.index if str(name).startswith(f"{CASE_IN_APPENDIX_C[case]}:"))


def _claim(answer: pd.DataFrame, mine: str, sure: float) -> str:
    claim = f"Its claim to be among the three best {_standing(sure)}"
    if sure >= SURE:
        equal = _equals(answer, mine)
        shared = f", but shared: {_numbers(equal)} score within {_percent(EQUAL)} of it" if equal else ""
        return f"{claim}{shared}."
    leader = str(answer["score"].idxmin())
    heads = {output: f"{output} [{UNITS[output]}]" for output in SCALE}
    worst = max(SCALE, key=lambda output: answer[heads[output]][mine] / answer[heads[output]][leader])
    miss, best = answer[heads[worst]][mine], answer[heads[worst]][leader]
    return (
        f"{claim}: the rms error of its {NOUNS[worst]} is {miss:.3g} {UNITS[worst]}, {miss / best:.2g} times that of "
        f"{_set(leader)}."
    )


def fit_words(own: pd.DataFrame, case: int, fitted: str, rms: Mapping[str, float]) -> str:
    """Errors of a case with the damping of Chapter V beside those of a free fit."""
    mine = own.loc[f"case {case}"]
    return (
        f"With Chapter V's own c_y its rms errors are {mine['v_x2 [m/s]']:.2f} m/s and "
        f"{mine['omega_2 [rad/s]']:.0f} rad/s. Those of {fitted}, fitted freely, are {rms['v_x2']:.2f} m/s and "
        f"{rms['omega_2']:.0f} rad/s."
    )


def posterior_verdict(placed: Sequence[Placed]) -> str:
    """How far out in one posterior the published points lie, and by which parameters."""
    beyond = f"beyond the {_percent(CONTOUR)} contour"
    contours = _grouped(
        (beyond if place.level > CONTOUR else f"on the {_percent(place.level)} contour", place.point)
        for place in placed
    )
    names = dict.fromkeys(name for place in placed for name in place.below)
    outside = {
        name: _grouped((_outside(place, name), place.point) for place in placed if name in place.below)
        for name in names
    }
    parts = [f"{name} {words}" for name, words in outside.items() if words]
    central = f"outside the central {_percent(CENTRAL)}"
    return f"{contours}. Parameter by parameter, {f'{central}: ' + '; '.join(parts) if parts else f'none {central}'}."


def _outside(place: Placed, name: str) -> str:
    """Empty for a value among the central draws."""
    if name in place.excluded:
        return f"excluded by the model itself ({place.excluded[name]})"
    below = place.below[name]
    if min(below, 1.0 - below) >= 0.5 * (1.0 - CENTRAL):
        return ""
    side, share = ("above", below) if below > 0.5 else ("below", 1.0 - below)
    return f"{side} {'every draw' if share >= 1.0 else f'{_percent(share)} of draws'}"


def _grouped(pairs: Iterable[tuple[str, str]]) -> str:
    """Words with the points that they describe, in order; empty words are left out."""
    points: dict[str, list[str]] = {}
    for words, point in pairs:
        points.setdefault(words, []).append(point)
    return ", ".join(f"{words} ({listed(names)})" for words, names in points.items() if words)


def offset_verdict(v_y1: FloatArray, offset: FloatArray, sd: FloatArray) -> str:
    """Whether model-free offsets [in] grow with `v_y1` [m/s] as Eq. (53) states: a straight line weighted by `sd`."""
    (slope, _), covariance = np.polyfit(v_y1, offset, 1, w=1.0 / sd, cov="unscaled")
    error = float(np.sqrt(covariance[0, 0]))
    distance = abs(slope - C1) / error
    grows = "does not grow" if distance > APART else "may grow"
    return (
        f"A weighted line through the model-free offsets rises by {slope:.4f} +- {error:.4f} in per m/s, Eq. (53) by "
        f"{C1:g}: {distance:.0f} standard errors apart. The offset {grows} with the vertical velocity as Eq. (53) "
        "states."
    )


def _equals(pooled: pd.DataFrame, name: str) -> list[str]:
    """The other sets whose score is within `EQUAL` of one's."""
    near = np.abs(pooled["score"] / pooled["score"][name] - 1.0) <= EQUAL
    return [str(item) for item in pooled.index[near] if item != name]


def _set(name: str) -> str:
    """`set 5 (case 1 of Table 9)`, or the set's own values where it is not in Table 9."""
    number, _, values = name.partition(": ")
    cases = {index: case for case, index in CASE_IN_APPENDIX_C.items()}
    known = int(number) in cases
    return f"set {number} ({f'case {cases[int(number)]} of Table 9' if known else values})"


def _numbers(names: Sequence[str]) -> str:
    return listed([f"set {name.partition(':')[0]}" for name in names])


def _percent(share: float) -> str:
    """Whole per cents, tenths near none and all, and no rounding to none or all."""
    if share <= 0.0 or 0.01 <= share <= 0.99 or share >= 1.0:
        return f"{100.0 * share:.0f} %"
    if 0.001 <= share <= 0.999:
        return f"{100.0 * share:.1f} %"
    return "under 0.1 %" if share < 0.5 else "over 99.9 %"
