"""The looks at every parameter as rows of text, for page and terminal."""

from __future__ import annotations

from fitball.inference.results.evidence import InformationEvidence, Profile
from fitball.inference.results.results import Fit
from fitball.report.fit.summary import named, verdict_cell
from fitball.report.form.display_units import Scale, handy
from fitball.report.form.rounding import decimals, interval, significant
from fitball.report.form.sentences import listed
from fitball.report.form.text_table import Row

# Ratio of the ends of an interval from which each has digits of its own.
WIDE = 20.0


def evidence_rows(fit: Fit) -> tuple[Row, ...]:
    """Every look at every free parameter, dashes where there is none."""
    scene = fit.problem.contact_time is not None
    rows = []
    for name, item in fit.identifiability.evidence.items():
        estimate = fit.parameters[name]
        scale = handy(name, estimate.unit)
        row = named(fit, name, scale) | {"profile, 95 %": _interval(item.profile, scale)}
        if scene:
            row["without scene"] = "the same" if item.alone is None else _interval(item.alone, scale)
        power, acts = item.power, item.active_impacts
        rows.append(
            row
            | {
                "information": _information(item.information, scene),
                "contraction": "-" if item.contraction is None else f"{item.contraction.contraction:.2f}",
                "power: priors | likelihood": "-" if power is None else f"{power.prior:.2f} | {power.likelihood:.2f}",
                "acts in": "-" if acts is None else f"{acts.acting} of {acts.of}",
                "verdict": verdict_cell(estimate),
            }
        )
    return tuple(rows)


def evidence_remarks(fit: Fit) -> tuple[str, ...]:
    """Next to which values the model ends, and why there are no profiles."""
    found = fit.identifiability
    held = listed(found.eigendirections.held)
    ends = (
        f"the model ends next to the maximum in {held}: there is no derivative, and what is said to first order "
        f"takes {held} as fixed"
    )
    return (
        *([ends] if held else []),
        *([f"there are no profiles: {found.profiles_missing}"] if found.profiles_missing else []),
    )


def _interval(profile: Profile | None, scale: Scale) -> str:
    """The 95 % interval with the decimals a quarter of it supports; an open end is said to be open."""
    if profile is None:
        return "-"
    low, high = (None if end is None else end * scale.factor for end in profile.interval_95)
    if low is not None and high is not None:
        text = interval(low, high, decimals(0.25 * (high - low)))
        if high > WIDE * low > 0.0:
            text = f"[{significant(low, 2)}, {significant(high, 2)}]"
    elif low is not None:
        text = f"> {significant(low)}"
    elif high is not None:
        text = f"< {significant(high)}"
    else:
        return "open"
    leaning = sorted({name for names in profile.leans_on for name in names})
    return f"{text} by the bounds of {', '.join(leaning)}" if leaning else text


def _information(look: InformationEvidence | None, scene: bool) -> str:
    if look is None:
        return "-"
    errors = [look.error, look.error_without_scene] if scene else [look.error]
    return " | ".join("none" if error is None else significant(error, 2) for error in errors)


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
