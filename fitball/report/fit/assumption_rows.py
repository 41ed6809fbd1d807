"""What rests on an assumption, as sentences and rows of text, for page and terminal."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from fitball.inference.results.assumptions import PACE, Alternative, Assumptions, Constant, Span
from fitball.inference.results.results import Fit
from fitball.report.form.display_units import Scale, handy
from fitball.report.form.rounding import decimals, fixed, interval
from fitball.report.form.sentences import listed
from fitball.report.form.text_table import Row

# Sds by which its median must move over the assumptions for a quantity to get a line of its own on a terminal.
WORTH_A_LINE = 1.0


@dataclass(frozen=True)
class AssumptionTable:
    """All of it for a page; `missing` says why there is nothing."""

    sentence: str
    spans: tuple[Row, ...]
    alternatives: tuple[Row, ...]
    constants: tuple[Row, ...]
    missing: str


def assumption_table(fit: Fit) -> AssumptionTable | None:
    """The look at assumptions of a fit; None where there was none."""
    found = fit.assumptions
    if found is None:
        return None
    spans = tuple(_row(name, unit, scale, item) for name, unit, scale, item in _spans(fit, found))
    rows = tuple(
        {
            "changed to": item.name,
            "from": item.instead_of,
            "score less this fit's": _difference(item),
            "describes the table": _verdict(item),
        }
        for item in found.alternatives
    )
    constants = tuple(_constant_row(fit, *item) for item in _by_constant(found))
    return AssumptionTable("" if found.missing else _sentence(found), spans, rows, constants, found.missing)


def assumption_lines(fit: Fit) -> tuple[str, ...]:
    """The same for a terminal: what describes the table as well, then a line for each quantity that moves."""
    found = fit.assumptions
    if found is None:
        return ()
    return (*_choice_lines(fit, found), *_constant_lines(fit, found))


def _choice_lines(fit: Fit, found: Assumptions) -> tuple[str, ...]:
    if found.missing:
        return (f"What rests on assumptions was not looked at: {found.missing}.",)
    if not found.as_good:
        return (_sentence(found),)
    lines, still = [_sentence(found)], []
    for name, unit, scale, item in _spans(fit, found):
        if item.shift < WORTH_A_LINE and not item.given:
            still.append(name)
            continue
        row = _row(name, unit, scale, item)
        told, within = f"{row['over all as good']} {unit}".rstrip(), row["within this fit"].rpartition(" ")[2]
        lines.append(
            f"{name}: {told} over assumptions that this table cannot tell apart; within one, +-{within} ({item.by} "
            f"moves it by {fixed(item.shift, 1)} sd)"
        )
    if still:
        lines.append(f"{listed(still)}: by less than one sd")
    return tuple(lines)


def _scale(fit: Fit, name: str) -> Scale:
    unit = next((item.unit for item in (*fit.estimates, *fit.derived.values()) if item.name == name), "")
    return handy(name, unit)


def _by_constant(found: Assumptions) -> Iterator[tuple[Constant, str, tuple[float, float]]]:
    """Each constant with the quantities that rest on it."""
    for constant in found.constants:
        for name, ends in constant.parameters.items():
            yield constant, name, ends
        for surface, ends in constant.court_pace.items():
            yield constant, f"{PACE} of {surface}" if surface else PACE, ends


def _constant_row(fit: Fit, constant: Constant, name: str, ends: tuple[float, float]) -> Row:
    scale, own = _scale(fit, name), handy(constant.name, fit.problem.model.specs[constant.name].unit)
    shown = [scale.factor * end for end in ends]
    places = decimals(0.1 * abs(shown[1] - shown[0]))
    known = [own.factor * at for at in (constant.low, constant.high, constant.value)]
    digits = decimals(0.1 * (known[1] - known[0]))
    return {
        "quantity": name,
        "unit": scale.unit,
        "from": fixed(shown[0], places),
        "to": fixed(shown[1], places),
        "over": f"{constant.name} {fixed(known[0], digits)} to {fixed(known[1], digits)} {own.unit}".rstrip(),
        "in this fit": f"held at {fixed(known[2], digits)}"
        if constant.held
        else f"prior of {fixed(known[2], digits)}",
    }


def _constant_lines(fit: Fit, found: Assumptions) -> Iterator[str]:
    for item in _by_constant(found):
        row = _constant_row(fit, *item)
        told = f"{row['from']} to {row['to']} {row['unit']}".rstrip()
        yield f"{row['quantity']}: {told} over {row['over']} ({row['in this fit']} here), to first order"


def _spans(fit: Fit, found: Assumptions) -> list[tuple[str, str, Scale, Span]]:
    """Name, unit, scale and span of each quantity, those of the model first."""
    rows = []
    for name, item in found.parameters.items():
        scale = _scale(fit, name)
        rows.append((name, scale.unit, scale, item))
    for surface, item in found.court_pace.items():
        rows.append((f"{PACE} of {surface}" if surface else PACE, "", Scale("", 1.0), item))
    return rows


def _row(name: str, unit: str, scale: Scale, item: Span) -> Row:
    factor = scale.factor
    places = decimals(item.own.sd * factor)
    return {
        "parameter": name,
        "unit": unit,
        "within this fit": f"{fixed(item.own.median * factor, places)} +- {fixed(item.own.sd * factor, places)}",
        "over all as good": f"{fixed(item.low * factor, places)} to {fixed(item.high * factor, places)}",
        "95 % over all": interval(item.q025 * factor, item.q975 * factor, places),
        "moved by [sd]": fixed(item.shift, 1),
        "most by": item.by,
        "holds only given": ", ".join(item.given),
    }


def _sentence(found: Assumptions) -> str:
    """Which changes the table cannot tell from the fit, which it prefers, and which it refuses."""
    if not found.alternatives:
        return "No choice of the model can be changed here."
    groups = (
        ("describe the table as well as this fit, within the error of the score", "as well"),
        ("fit too, and with so few impacts no score can refuse them", "not refused"),
        ("describe it better", "better"),
        ("describe it worse", "worse"),
        ("could not be scored", "not scored"),
    )
    parts = []
    for words, verdict in groups:
        names = [item.name for item in found.alternatives if _verdict(item).partition(":")[0] == verdict]
        if names:
            parts.append(f"{listed(names)} {words if len(names) > 1 else _singular(words)}")
    return "Changed one at a time, " + "; ".join(parts) + "."


def _singular(words: str) -> str:
    for plural, single in (("describe ", "describes "), ("fit too", "fits too"), ("refuse them", "refuse it")):
        words = words.replace(plural, single, 1)
    return words


def _verdict(item: Alternative) -> str:
    if item.difference is None:
        return f"not scored: {item.reason}" if item.reason else "not refused"
    verdict = "better" if item.better else "as well" if item.as_good else "worse"
    return f"{verdict}: {item.reason}" if item.reason else verdict


def _difference(item: Alternative) -> str:
    if item.difference is None:
        return "-"
    return f"{fixed(item.difference.value, 1)} +- {fixed(item.difference.se, 1)}"
