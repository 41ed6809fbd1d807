"""The looks at every parameter as rows of text, for page and terminal."""

from __future__ import annotations

from dataclasses import dataclass

from markupsafe import Markup

from fitball.inference.results.evidence import InformationEvidence, Profile
from fitball.inference.results.results import Fit
from fitball.report.fit.summary import parameter_symbols
from fitball.report.form.display_units import Scale, handy
from fitball.report.form.palette import verdict_mark
from fitball.report.form.rounding import decimals, fixed, significant

# Ratio of the ends of an interval from which each has digits of its own.
WIDE = 20.0


@dataclass(frozen=True)
class LookRow:
    """One free parameter: every look as text, dashes where there is none."""

    name: str
    unit: str
    profile: str
    alone: str
    information: str
    contraction: str
    power: str
    active_impacts: str
    verdict: str
    mark: str
    symbol: Markup


@dataclass(frozen=True)
class EvidenceTable:
    """All rows, remarks (what cannot be told apart, where evidence disagree), whether the scene takes part, and how
    often a 95 % interval of a profile holds the truth.
    """

    rows: tuple[LookRow, ...]
    remarks: tuple[str, ...]
    scene: bool
    coverage: str


def evidence_rows(fit: Fit) -> EvidenceTable:
    """The looks at every free parameter."""
    scene = fit.problem.contact_time is not None
    rows = []
    remarks = list(fit.identifiability.eigendirections.sentences)
    if fit.identifiability.profiles_missing:
        remarks.append(f"there are no profiles: {fit.identifiability.profiles_missing}")
    symbols = parameter_symbols(fit)
    for name, evidence in fit.identifiability.evidence.items():
        estimate = fit.parameters[name]
        scale = handy(name, estimate.unit)
        rows.append(
            LookRow(
                name=name,
                unit=scale.unit,
                profile=_interval(evidence.profile, scale),
                alone=_interval(evidence.alone, scale)
                if evidence.alone is not None
                else "the same"
                if scene
                else "-",
                information=_information(evidence.information, scene),
                contraction="-" if evidence.contraction is None else f"{evidence.contraction.contraction:.2f}",
                power="-"
                if evidence.power is None
                else f"{evidence.power.prior:.2f} | {evidence.power.likelihood:.2f}",
                active_impacts="-"
                if evidence.active_impacts is None
                else f"{evidence.active_impacts.acting} of {evidence.active_impacts.of}",
                verdict=estimate.verdict_words,
                mark=verdict_mark(estimate.verdict),
                symbol=symbols[name],
            )
        )
        if evidence.disagreement:
            remarks.append(f"{name}: {evidence.disagreement}")
    return EvidenceTable(tuple(rows), tuple(remarks), scene, f"{100.0 * fit.identifiability.profile_coverage:.0f} %")


def _interval(profile: Profile | None, scale: Scale) -> str:
    """The 95 % interval with the decimals a quarter of it supports; an open end is said to be open."""
    if profile is None:
        return "-"
    low, high = profile.interval_95
    if low is None and high is None:
        return "open"
    if low is not None and high is not None:
        low, high = low * scale.factor, high * scale.factor
        places = decimals(0.25 * (high - low))
        text = f"[{fixed(low, places)}, {fixed(high, places)}]"
        if high > WIDE * low > 0.0:
            text = f"[{significant(low, 2)}, {significant(high, 2)}]"
    elif low is not None:
        text = f"> {significant(low * scale.factor)}"
    else:
        text = f"< {significant(high * scale.factor)}" if high is not None else "open"
    leaning = sorted({name for names in profile.leans_on for name in names})
    return f"{text} by the bounds of {', '.join(leaning)}" if leaning else text


def _information(look: InformationEvidence | None, scene: bool) -> str:
    if look is None:
        return "-"
    error = _error(look.error)
    return f"{error} | {_error(look.error_without_scene)}" if scene else error


def _error(error: float | None) -> str:
    return "none" if error is None else significant(error, 2)


def direction_rows(fit: Fit) -> tuple[tuple[str, ...], ...]:
    """Combinations from stiff to sloppy with what each is known to; beside them those without the scene, if it knows
    anything.
    """
    eigendirections = fit.identifiability.eigendirections
    if fit.problem.contact_time is None:
        return tuple((item.words, item.known_to) for item in eigendirections.directions)
    return tuple(
        (item.words, item.known_to, alone.words, alone.known_to)
        for item, alone in zip(eigendirections.directions, eigendirections.directions_without_scene, strict=True)
    )
