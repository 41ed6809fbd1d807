"""Who measured what, where and when, for a report and a certificate."""

from __future__ import annotations

from fitball.data.labels import Role, role_of
from fitball.inference.results.results import Fit


def circumstance_rows(fit: Fit) -> tuple[tuple[str, str], ...]:
    """Who measured what, where and when, in words; empty where the scene does not say, to be filled in by hand."""
    known = fit.source.circumstances
    surfaces = [
        name for column, labels in fit.fitted.labels.items() if role_of(column) is Role.SURFACE for name in labels
    ]
    warmth = known.ball_temperature or (known.stated_temperature,) * 2
    low, high = ("" if end is None else f"{end:.3g}" for end in warmth)
    degrees = f"{low} degrees Celsius" if low == high else f"{low} to {high} degrees Celsius"
    return (
        ("Laboratory", known.laboratory or ""),
        ("Operator", known.operator or ""),
        ("Instrument", known.instrument or ""),
        ("Date of measurement", known.date or ""),
        ("Court", known.court or ""),
        ("Surface", known.surface or ", ".join(surfaces)),
        ("Ball temperature", degrees if low else ""),
    )


def circumstance_line(fit: Fit) -> str:
    """What is known of it in a line; empty where nothing is."""
    known = [f"{name.lower()}: {value}" for name, value in circumstance_rows(fit) if value]
    line = "; ".join(known)
    return f"{line[:1].upper()}{line[1:]}." if known else ""
