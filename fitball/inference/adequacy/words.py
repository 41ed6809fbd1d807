"""The answer, and what it is based on: which sentences apply, and the facts in them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from fitball.inference.adequacy.looks import DISTRIBUTED
from fitball.inference.adequacy.refit import covariates
from fitball.inference.problem.problem import Problem
from fitball.inference.results import sentences
from fitball.inference.results.assumptions import Alternative
from fitball.inference.results.evidence import (
    FALSE_EXCEPT,
    FALSE_FAILS,
    FAR_FROM_STATED,
    Answer,
    Check,
    NoiseCheck,
)
from fitball.inference.results.sentences import capital, counted, listed
from fitball.observables import OBSERVABLES

# Exceptions that a sentence names; a hint is what fewer than this share of the simulated data sets show.
NAMED, HINT = 3, 0.5
# Sds by which the misfit must shift a parameter for the model's error to be mentioned beside that of measurements.
FAR = 5.0
# A column cannot be tested where a pattern that explains this share of its variance would not be found.
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
    what fits significantly better.
    """
    impacts = len(problem.impacts)
    scatter = [f"{capital(noise_words(check))}." for check in noise] or [sentences.NO_NOISE]
    if answer is Answer.UNDECIDED and not covariates(problem):
        return " ".join([sentences.ALL_ALIKE.format(impacts=impacts), *scatter])
    wide, beyond = _wide(noise, checks), _beyond(moved)
    if answer is Answer.UNDECIDED:
        return " ".join([*_too_few(problem, unseen), *scatter, *wide])
    if answer is Answer.DESCRIBES:
        if small := strongest(check for check in checks if check.p < FALSE_EXCEPT):
            found = sentences.DESCRIBED_FINELY.format(impacts=impacts, faults=_some(small))
            return " ".join([found, *beyond, *scatter, *wide])
        hints = "; ".join(
            sentences.HINT.format(fault=check_words(check), chance=100.0 * check.p) for check in _hints(checks)
        )
        more = [sentences.HINTS.format(hints=hints)] * bool(hints)
        return " ".join([sentences.DESCRIBED, *scatter, *wide, *more])
    worse = [noise_words(check) for check in noise if check.found]
    patterns = strongest(check for check in checks if check.found)
    faults = "; ".join([*worse, *[_some(patterns)] * bool(patterns), *(better_words(item) for item in better)])
    if answer is Answer.FAILS:
        return " ".join([sentences.NOT_DESCRIBED.format(faults=faults), *beyond, sentences.ALL_CONDITIONAL])
    rest = [] if worse else scatter
    return " ".join([sentences.EXCEPTIONS.format(faults=faults), *beyond, *rest, *wide])


def blind(unseen: Mapping[str, float]) -> list[str]:
    """Columns in which no pattern could be found that explains less than most of the residual variance."""
    return [name for name, share in unseen.items() if share > BLIND]


def _too_few(problem: Problem, unseen: Mapping[str, float]) -> list[str]:
    """Which columns are too short to be tested, and what the others show."""
    columns = blind(unseen)
    rows = max(o.observed.size for o in problem.observables if o.name in columns)
    least = 100.0 * min(unseen[name] for name in columns)
    seen = [name for name in unseen if name not in columns]
    noun = sentences.FEW_MEASUREMENTS if seen else sentences.FEW_IMPACTS
    answer = sentences.TOO_FEW.format(
        few=f"{counted(rows)} {noun} is" if rows == 1 else f"{counted(rows)} {noun}s are",
        where=sentences.WHERE.format(columns=listed(columns)) if seen else "",
        limit=sentences.NONE_NOTICED if least >= 100.0 else sentences.ONLY_STRONG.format(share=least),
    )
    return [answer, *[sentences.ELSEWHERE.format(columns=listed(seen))] * bool(seen)]


def _wide(noise: Sequence[NoiseCheck], checks: Sequence[Check]) -> list[str]:
    """That a noise is far above what fitball expects where nobody stated one, and outliers do not make it so."""
    known = {check.column for check in checks if check.found and check.kind == "outlier"}
    ratios = "; ".join(
        sentences.WIDE_RATIO.format(columns=listed(check.columns), ratio=_number(check.ratio))
        for check in noise
        if check.assumed and not check.found and check.ratio >= FAR_FROM_STATED and not known & {*check.columns}
    )
    return [sentences.WIDE.format(ratios=ratios)] * bool(ratios)


def better_words(alternative: Alternative) -> str:
    """An alternative that fits significantly better, with its score."""
    assert alternative.difference is not None
    gain = f"{_number(alternative.difference.value)} ± {_number(alternative.difference.se)}"
    return sentences.BETTER.format(name=alternative.name, instead_of=alternative.instead_of, gain=gain)


def _beyond(moved: Mapping[str, float]) -> list[str]:
    """That the model is wrong by more than the measurements leave open, where it is by far."""
    name = max(moved, key=lambda name: moved[name], default="")
    far = bool(name) and moved[name] >= FAR
    return [sentences.MODEL_ERROR.format(name=name, sds=moved[name])] if far else []


def strongest(checks: Iterable[Check]) -> list[Check]:
    """The checks, surest first, each column and quantity once, and what all columns show only where none does. Of
    equally sure ones those that name an impact are first: it may cause the others.
    """
    some = list(checks)
    count = max(1, len({check.column for check in some} - {ALL}))

    def order(check: Check) -> tuple[float, bool, bool, float]:
        # A share of the variance of all columns is more than the same share of one column's.
        share = (check.explained or 0.0) * (count if check.column == ALL else 1.0)
        return check.p, check.kind != "outlier", _of_all(check), -share

    kept: dict[tuple[str, str], Check] = {}
    for check in sorted(some, key=order):
        same = [other for other in kept.values() if other.over == check.over]
        if not same or (check.column != ALL and all(other.column != ALL or _of_all(other) for other in same)):
            kept.setdefault((check.column, check.over), check)
    return list(kept.values())


def _of_all(check: Check) -> bool:
    """Whether a check does not show in which columns it is."""
    return check.column == ALL and check.kind == "jointly"


def _hints(checks: Sequence[Check]) -> list[Check]:
    """The surest check of each column that fewer than `HINT` of the simulated data sets show, surest first."""
    kept: dict[str, Check] = {}
    for check in strongest(check for check in checks if check.p < HINT):
        kept.setdefault(check.column, check)
    return list(kept.values())[:NAMED]


def check_words(check: Check) -> str:
    """A pattern that was looked for, with how much of the residual variance it explains."""
    if check.explained is None:
        return check.words
    return sentences.SHARE.format(fault=check.words, share=_percent(check.explained))


def noise_words(check: NoiseCheck) -> str:
    """A noise beside its stated or expected size."""
    scale, unit = 1.0, check.unit
    for column in check.columns:
        handy = OBSERVABLES[column].handy if column in OBSERVABLES else None
        if handy is not None and check.unit == OBSERVABLES[column].unit:
            unit, scale = handy
    ratio, residuals = _number(check.ratio), sentences.RESIDUALS.format(columns=listed(check.columns))
    if check.stated and not check.unit:
        return sentences.NOISE_BY_ROW.format(what=residuals, ratio=ratio)
    return sentences.NOISE.format(
        # A share of the peak is no scatter of the column, which has its own.
        what=residuals if check.unit else sentences.PARAMETER.format(name=check.noise),
        size=f"{_number(check.fitted * scale)} {unit}".rstrip(),
        ratio=ratio,
        known=sentences.STATED if check.stated else sentences.EXPECTED,
        reference=f"{_number(check.reference * scale)} {unit}".rstrip(),
    )


def size_words(column: str, size: float) -> str:
    """A size of a column in the unit of reports."""
    unit, scale = OBSERVABLES[column].handy or (OBSERVABLES[column].unit, 1.0)
    return f"{_number(size * scale)} {unit}"


def based_on(
    problem: Problem,
    noise: Sequence[NoiseCheck],
    checks: Sequence[Check],
    unseen: Mapping[str, float],
    simulated: str,
    sampled: bool,
) -> str:
    """What the answer is based on."""
    count, stated = len(checks), sum(check.stated for check in noise)
    tests = f"{count} residual test{'s' * (count != 1)}"
    parts = [sentences.TESTS.format(tests=tests, simulated=simulated) if checks else sentences.NO_TESTS]
    if noise:
        kinds = [sentences.STATED] * (stated > 0) + [sentences.EXPECTED] * (stated < len(noise))
        one = len(noise) == 1
        parts.append(
            sentences.NOISES.format(
                count=f"{counted(len(noise))} noise size{'s' * (not one)}",
                known=f"the {' or '.join(kinds)} one{'s' * (not one)}",
            )
        )
    if not sampled:
        parts.append(sentences.NO_LOO)
    elif max(observable.observed.size for observable in problem.observables) >= DISTRIBUTED:
        parts.append(sentences.LOO)
    parts.append(sentences.POWER.format(shares=", ".join(f"{name} {_percent(it)}" for name, it in unseen.items())))
    parts.append(sentences.FALSE_ALARMS.format(exceptions=100.0 * FALSE_EXCEPT, fails=100.0 * FALSE_FAILS))
    return " ".join(parts)


def _some(checks: Sequence[Check]) -> str:
    """The first of the patterns, and how many more there are."""
    words = [check_words(check) for check in checks]
    more = sentences.MORE.format(more=len(words) - NAMED) if len(words) > NAMED else ""
    return "; ".join(words[:NAMED]) + more


def _percent(share: float) -> str:
    """A share, of one percent and more to a percent."""
    percent = 100.0 * share
    return f"{percent:.0f} %" if percent >= 1.0 or percent == 0.0 else f"{percent:.1g} %"


def _number(value: float) -> str:
    return f"{value:.2g}" if abs(value) < 10.0 else f"{value:.3g}"
