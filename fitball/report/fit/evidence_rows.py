"""The looks at every parameter as rows of text, for page and terminal."""

from __future__ import annotations

from dataclasses import dataclass

from fitball.inference.results.evidence import InformationLook, Profile
from fitball.inference.results.results import Fit
from fitball.report.form.display_units import Scale, handy
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
    action: str
    verdict: str


@dataclass(frozen=True)
class LookTable:
    """All rows, remarks (what cannot be told apart, where looks disagree), whether the scene takes part, and how
    often a 95 % interval of a profile holds the truth.
    """

    rows: tuple[LookRow, ...]
    remarks: tuple[str, ...]
    scene: bool
    coverage: str


def look_rows(fit: Fit) -> LookTable:
    """The looks at every free parameter."""
    scene = fit.problem.contact_time is not None
    rows = []
    remarks = list(fit.examination.spectrum.sentences)
    if fit.examination.profiles_missing:
        remarks.append(f"there are no profiles: {fit.examination.profiles_missing}")
    for name, looks in fit.examination.looks.items():
        estimate = fit.parameters[name]
        scale = handy(name, estimate.unit)
        rows.append(
            LookRow(
                name=name,
                unit=scale.unit,
                profile=_interval(looks.profile, scale),
                alone=_interval(looks.alone, scale) if looks.alone is not None else "the same" if scene else "-",
                information=_information(looks.information, scene),
                contraction="-" if looks.contraction is None else f"{looks.contraction.contraction:.2f}",
                power="-" if looks.power is None else f"{looks.power.prior:.2f} | {looks.power.likelihood:.2f}",
                action="-" if looks.action is None else f"{looks.action.acting} of {looks.action.of}",
                verdict=estimate.verdict,
            )
        )
        if looks.disagreement:
            remarks.append(f"{name}: {looks.disagreement}")
    return LookTable(tuple(rows), tuple(remarks), scene, f"{100.0 * fit.examination.profile_coverage:.0f} %")


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


def _information(look: InformationLook | None, scene: bool) -> str:
    if look is None:
        return "-"
    found = _error(look.error)
    return f"{found} | {_error(look.error_without_scene)}" if scene else found


def _error(error: float | None) -> str:
    return "none" if error is None else significant(error, 2)


def spectrum_rows(fit: Fit) -> tuple[tuple[str, ...], ...]:
    """Combinations from stiff to sloppy with what each is known to; beside them those without the scene, if it knows
    anything.
    """
    spectrum = fit.examination.spectrum
    if fit.problem.contact_time is None:
        return tuple((item.words, item.known_to) for item in spectrum.directions)
    return tuple(
        (item.words, item.known_to, alone.words, alone.known_to)
        for item, alone in zip(spectrum.directions, spectrum.directions_without_scene, strict=True)
    )
