"""A comparison in words: which model for which use, and whether two masses earn their parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping

from fitball.inference.comparison.cross_validation import GROUPS, IMPACTS
from fitball.inference.comparison.results import Comparison, ModelScore
from fitball.inference.prediction.outputs import OUTPUTS
from fitball.models.specs import DEFAULT_MODEL
from fitball.report.compare.rows import in_unit, schemes, scored_outputs
from fitball.report.form.numbers import fixed, output_scale


def words(comparison: Comparison) -> str:
    """A paragraph; what it recommends rests on the numbers of this table alone."""
    return " ".join(sentences(comparison))


def sentences(comparison: Comparison) -> list[str]:
    """What the words say, point by point, the best model first."""
    if not comparison.meaningful:
        return [
            f"{len(comparison.table)} impacts are too few: the numbers describe these impacts and recommend no "
            "model. Measure at least six, better twenty, over the angles and spins that matter."
        ]
    points = [
        _best(comparison),
        _simplest(comparison),
        _beyond(comparison),
        _time(comparison),
        _masses(comparison),
        _caution(comparison),
    ]
    return [point for point in points if point]


def _best(comparison: Comparison) -> str:
    best = comparison.models[0]
    close = [
        scored.name for scored in comparison.models[1:] if not comparison.elpd_difference(best.name, scored.name).sure
    ]
    text = f"For impacts like these {best.name} predicts best ({_errors(best.out_of_sample())})"
    if not close:
        return text + ", ahead of every other by more than luck."
    return f"{text}; not told apart from it with certainty: {', '.join(close)}."


def _simplest(comparison: Comparison) -> str:
    chosen, best = comparison.simplest, comparison.models[0]
    if chosen is best:
        return f"None with fewer parameters comes up to it ({best.free} free, noise included)."
    gap = comparison.elpd_difference(chosen.name, best.name)
    return (
        f"The fewest parameters among those has {chosen.name} ({chosen.free} free against {best.free}, elpd "
        f"{fixed(gap.value, 1)} +- {fixed(gap.se, 1)}; {_errors(chosen.out_of_sample())}): take it where a quick "
        "formula or a sparse table is all there is."
    )


def _beyond(comparison: Comparison) -> str:
    """Best by group and at the ends of incidence, judged by the mean ratio of its errors to the smallest ones."""
    parts = []
    for way in schemes(comparison):
        if way == IMPACTS:
            continue
        rms = {scored.name: scored.out_of_sample(way) for scored in comparison.models}
        complete = {name: one for name, one in rms.items() if one.keys() == rms[comparison.models[0].name].keys()}
        if len(complete) < 2:
            continue
        name = min(complete, key=lambda item: _mean_ratio(item, complete))
        place = "a group it has not seen" if way == GROUPS else f"the {way}"
        parts.append(f"{place}: {name} ({_errors(complete[name])})")
    return f"Best where the table ends, predicting {'; '.join(parts)}." if parts else ""


def _mean_ratio(name: str, rms: Mapping[str, Mapping[str, float]]) -> float:
    least = {output: min(one[output] for one in rms.values()) for output in rms[name]}
    return sum(math.log(max(rms[name][output], 1e-12) / max(least[output], 1e-12)) for output in least)


def _time(comparison: Comparison) -> str:
    timed = [scored for scored in comparison.models if scored.fit.problem.model.has_time]
    if not timed or len(timed) == len(comparison.models):
        return ""
    return (
        "Contact time, forces and the course of the contact come from the two-mass family alone; of it "
        f"{timed[0].name} scores best here."
    )


def _masses(comparison: Comparison) -> str:
    """The two-mass ball against its strongest rival without a time axis, as composed and as chosen afterwards."""
    rivals = [scored for scored in comparison.models if not scored.fit.problem.model.has_time]
    family = [scored for scored in comparison.models if scored.fit.problem.model.has_time]
    if not rivals or not family or not comparison.table.has_spin or not comparison.table.has_tangential:
        return ""
    rival = rivals[0]
    default = comparison.by_name.get(DEFAULT_MODEL, family[0])
    duel, verdict = _duel(comparison, default, rival), _verdict(comparison, default, rival)
    text = f"Do two masses earn their parameters? {duel}: {verdict}."
    if family[0] is not default:
        duel, verdict = _duel(comparison, family[0], rival), _verdict(comparison, family[0], rival)
        text += f" {duel}: {verdict}, though chosen afterwards as the best of {len(family)}."
    return text


def _duel(comparison: Comparison, one: ModelScore, other: ModelScore) -> str:
    gap = comparison.elpd_difference(one.name, other.name)
    more = one.free - other.free
    changes = []
    for output in scored_outputs(comparison):
        change = comparison.rms_difference(one.name, other.name, output)
        if change is None:
            continue
        scale = output_scale(output)
        value, low, high = (scale.factor * x for x in (change.value, change.q05, change.q95))
        places = 1 if max(abs(low), abs(high)) >= 1.0 else 2
        if max(abs(value), abs(low), abs(high)) < 0.5 * 10.0**-places:
            continue
        ends = f"[{_signed(low, places)}, {_signed(high, places)}]"
        changes.append(f"{output} {_signed(value, places)} {ends} {scale.unit}")
    return (
        f"{one.name} against {other.name}, {abs(more)} {'more' if more >= 0 else 'fewer'} free: elpd "
        f"{_signed(gap.value, 1)} +- {fixed(gap.se, 1)}; rms error left out (with 90 % of the bootstrap) "
        f"{', '.join(changes)}"
    )


def _verdict(comparison: Comparison, one: ModelScore, other: ModelScore) -> str:
    gap = comparison.elpd_difference(one.name, other.name)
    if not gap.sure:
        return "this table does not decide it"
    return "they do" if gap.value > 0.0 else "they do not, the rival predicts better"


def _caution(comparison: Comparison) -> str:
    if len(comparison.table) >= 100:
        return ""
    return (
        f"With {len(comparison.table)} impacts a standard error of a difference is itself uncertain: below 4, or "
        "below two standard errors, nothing is decided."
    )


def _errors(rms: Mapping[str, float]) -> str:
    shown = [name for name in OUTPUTS if name in rms]
    return ", ".join(f"{name} {in_unit(name, rms[name])} {output_scale(name).unit}" for name in shown[:3])


def _signed(value: float, places: int) -> str:
    text = fixed(value, places)
    return text if text.startswith("-") else f"+{text}"
