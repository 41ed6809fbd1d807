"""The answer, and what it is based on, in words."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from fitball.inference.adequacy.looks import DISTRIBUTED
from fitball.inference.adequacy.refit import covariates
from fitball.inference.problem.problem import Problem
from fitball.inference.results.adequacy import (
    FALSE_EXCEPT,
    FALSE_FAILS,
    FAR_FROM_STATED,
    Answer,
    Check,
    NoiseCheck,
)
from fitball.inference.results.assumptions import Alternative
from fitball.observables import OBSERVABLES

# Exceptions that a sentence names; a hint is what fewer than this share of the model's own tables show.
NAMED, HINT = 3, 0.5
# Sds by which what is missed must move a parameter for the model's error to be told beside that of measurements.
FAR = 5.0
# Nothing can be told of a column where a pattern that explains this share of its variance would not be found.
BLIND = 0.6
ALL = "all columns"


def sentence(
    problem: Problem,
    answer: Answer,
    noise: Sequence[NoiseCheck],
    checks: Sequence[Check],
    unseen: Mapping[str, float],
    moved: Mapping[str, float],
    better: Sequence[Alternative],
) -> str:
    """The answer in a few sentences; `moved` is by how many of its sds what was found moves each parameter, `better`
    what fits surely better.
    """
    scatter = "; ".join(noise_words(check) for check in noise)
    if answer is Answer.UNTOLD and not covariates(problem):
        return (
            f"Whether the model describes the table cannot be told: its {len(problem.impacts)} impacts all come "
            f"alike, so that no pattern in the residuals could be found. {_cap(scatter)}."
        )
    wide = _wide(noise, checks)
    if answer is Answer.UNTOLD:
        return f"{_untold(problem, unseen)} {_cap(scatter)}.{wide}"
    beyond = _beyond(moved)
    if answer is Answer.DESCRIBES:
        small = strongest(check for check in checks if check.p < FALSE_EXCEPT)
        if small:
            return (
                "The model describes the table, but for patterns far below the noise that so many rows make sure: "
                f"{_listed(small)}.{beyond} {_cap(scatter)}.{wide}"
            )
        hints = "; ".join(f"{check_words(check)} in {100.0 * check.p:.0f} %" for check in _hints(checks))
        told = (
            f" The strongest hints, and in how many tables that the model made they are met: {hints}."
            if hints
            else ""
        )
        return (
            f"The model describes the table: no check of the residuals finds a pattern. {_cap(scatter)}.{wide}{told}"
        )
    worse = [noise_words(check) for check in noise if check.found]
    found = strongest(check for check in checks if check.found)
    faults = "; ".join([*worse, *([_listed(found)] if found else []), *(better_words(item) for item in better)])
    if answer is Answer.FAILS:
        return (
            f"The model does NOT describe the table: {faults}.{beyond} All that follows is conditional: it would "
            "hold if the model did."
        )
    rest = "" if worse else f" {_cap(scatter)}."
    return f"The model describes the table with exceptions: {faults}.{beyond}{rest}{wide}"


def blind(unseen: Mapping[str, float]) -> list[str]:
    """Columns in which no pattern could be found that explains less than most of the residual variance."""
    return [name for name, share in unseen.items() if share > BLIND]


def _untold(problem: Problem, unseen: Mapping[str, float]) -> str:
    """Which columns are too short to be looked at, and what the others say."""
    columns = blind(unseen)
    rows = max(o.observed.size for o in problem.observables if o.name in columns)
    least = 100.0 * min(unseen[name] for name in columns)
    seen = [name for name in unseen if name not in columns]
    what = " and ".join(columns) if seen else "the table"
    found = (
        "no pattern in the residuals could be found"
        if least >= 100.0
        else f"a pattern would have to explain {least:.0f} % of the residual variance to be found"
    )
    others = f" In {' and '.join(seen)} no check finds a pattern." if seen else ""
    return f"Too few rows to tell whether the model describes {what}: with {rows} {found}.{others}"


def _wide(noise: Sequence[NoiseCheck], checks: Sequence[Check]) -> str:
    """That a noise is far above what fitball expects where nobody stated one, and outliers do not make it so."""
    known = {check.column for check in checks if check.found and check.kind == "outlier"}
    far = [
        check
        for check in noise
        if check.assumed and not check.found and check.ratio >= FAR_FROM_STATED and not known & {*check.columns}
    ]
    if not far:
        return ""
    said = "; ".join(f"{' and '.join(check.columns)} {_number(check.ratio)} times" for check in far)
    return (
        f" That is far above what is usual where no noise was stated ({said}): state the noise in the scene if the "
        "instruments are so, else look for signs, units and rows that were misread."
    )


def better_words(item: Alternative) -> str:
    """An alternative that fits surely better, with its score."""
    assert item.difference is not None
    gain = f"{_number(item.difference.value)} ± {_number(item.difference.se)}"
    return f"{item.name} fits surely better than {item.instead_of} (by {gain} in log predictive density)"


def _beyond(moved: Mapping[str, float]) -> str:
    """That the model is wrong by more than the measurements leave open, where it is by far."""
    name = max(moved, key=lambda name: moved[name], default="")
    if not name or moved[name] < FAR:
        return ""
    return (
        f" What it misses moves {name} by {moved[name]:.0f} of its sds: the error of the model is larger than that "
        "of the measurements, which is all that sds and intervals tell of."
    )


def strongest(checks: Iterable[Check]) -> list[Check]:
    """The checks, surest first, each column and quantity once, and what all columns show only where none does."""
    some = list(checks)
    count = max(1, len({check.column for check in some} - {ALL}))

    def order(check: Check) -> tuple[float, bool, float]:
        # A share of the variance of all columns is more than the same share of one column's.
        share = (check.explained or 0.0) * (count if check.column == ALL else 1.0)
        return check.p, _of_all(check), -share

    kept: dict[tuple[str, str], Check] = {}
    for check in sorted(some, key=order):
        same = [other for other in kept.values() if other.over == check.over]
        if not same or (check.column != ALL and all(other.column != ALL or _of_all(other) for other in same)):
            kept.setdefault((check.column, check.over), check)
    return list(kept.values())


def _of_all(check: Check) -> bool:
    """Whether a check says nothing of what it is in the columns."""
    return check.column == ALL and check.kind == "jointly"


def _hints(checks: Sequence[Check]) -> list[Check]:
    """The surest check of each column that fewer than `HINT` of the model's own tables meet, surest first."""
    kept: dict[str, Check] = {}
    for check in strongest(check for check in checks if check.p < HINT):
        kept.setdefault(check.column, check)
    return list(kept.values())[:NAMED]


def check_words(check: Check) -> str:
    """What a check looked for, with how much of the residual variance it explains."""
    share = "" if check.explained is None else f" ({_percent(check.explained)} of the residual variance)"
    return f"{check.words}{share}"


def noise_words(check: NoiseCheck) -> str:
    """A noise beside what was known of it."""
    scale, unit = 1.0, check.unit
    for column in check.columns:
        shown = OBSERVABLES[column].shown if column in OBSERVABLES else None
        if shown is not None and check.unit == OBSERVABLES[column].unit:
            unit, scale = shown
    size = f"{_number(check.fitted * scale)} {unit}".rstrip()
    known = f"{_number(check.reference * scale)} {unit}".rstrip()
    columns = " and ".join(check.columns)
    if check.stated and not check.unit:
        return f"{columns} scatter by {_number(check.ratio)} times the stated sds"
    word = "stated" if check.stated else "expected"
    # A share of the peak is no scatter of the column, which has its own.
    what = f"{columns} scatter by" if check.unit else f"{check.noise} is"
    return f"{what} {size} ({known} {word}, {_number(check.ratio)} times)"


def based_on(
    problem: Problem,
    noise: Sequence[NoiseCheck],
    checks: Sequence[Check],
    unseen: Mapping[str, float],
    made: str,
    sampled: bool,
) -> str:
    """What the answer rests on."""
    stated = sum(check.stated for check in noise)
    parts = [
        f"{len(checks)} check{'s' * (len(checks) != 1)} of the residuals at the best fit, held against {made} that "
        "the fitted model makes, each refitted to first order"
        if checks
        else "no check of the residuals: too few rows",
    ]
    if noise:
        known = "what was stated" if stated == len(noise) else "stated or expected" if stated else "what was expected"
        parts.append(f"{len(noise)} noise{'s' * (len(noise) != 1)} against {known}")
    if not sampled:
        parts.append("no posterior, so that measurements are left out to first order only")
    elif max(observable.observed.size for observable in problem.observables) >= DISTRIBUTED:
        parts.append("predictions of each impact from all others (LOO-PIT)")
    seen = ", ".join(f"{name} {_percent(share)}" for name, share in unseen.items())
    return (
        f"Based on {'; '.join(parts)}. A trend is found as often as not from this share of the residual variance on: "
        f"{seen}. Of tables that the model made {100.0 * FALSE_EXCEPT:.0f} % are called described with an exception, "
        f"{100.0 * FALSE_FAILS:.0f} % not described."
    )


def _listed(checks: Sequence[Check]) -> str:
    words = [check_words(check) for check in checks]
    more = f" and {len(words) - NAMED} more" if len(words) > NAMED else ""
    return "; ".join(words[:NAMED]) + more


def _percent(share: float) -> str:
    """A share, of one percent and more to a percent."""
    percent = 100.0 * share
    return f"{percent:.0f} %" if percent >= 1.0 or percent == 0.0 else f"{percent:.1g} %"


def _number(value: float) -> str:
    return f"{value:.2g}" if abs(value) < 10.0 else f"{value:.3g}"


def _cap(text: str) -> str:
    """What the residuals scatter by, as a sentence."""
    return f"Residuals: {text}" if text else "No noise could be estimated"
