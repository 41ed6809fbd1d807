"""Colours, each with one meaning in every figure and page. They differ for colour-blind eyes too (Okabe and Ito)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from fitball.inference.results.results import Verdict

# What was measured; what the model says, its posterior included; what noise adds to it; what was known beforehand.
MEASURED = "#1b1f24"
MODEL = "#0072b2"
NOISE = "#a8b0b8"
PRIOR = "#d55e00"
# Means over many impacts, drawn over these.
TREND = "#b3006b"
# Helping lines, and what stands back behind the rest.
GUIDE, FAINT = "#6b737b", "#c9ced3"
# Things set side by side, such as groups of impacts, ensembles or simulated courses: a colour and a marker each.
SERIES = ("#009e73", "#cc79a7", "#56b4e9", "#8c6d1f", "#7b4fb3", "#a3ad12")
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
# Sequences of slip and grip, and phases behind courses: pale, since these are areas and all others lines or points.
# A phase has the hue of the sequence that it is alone or ends: slide, slide back, grip; then hold and free.
REGIMES = ("#77aadd", "#ee8866", "#44bb99", "#ffaabb", "#eedd88", "#bbcc33")
PHASES = ("#dbe8f6", "#fae1d7", "#ffe2e8", "#d9f0e9", "#e8e8e8")


@dataclass(frozen=True)
class Tone:
    """A colour of text on light paper and on dark, and its number among those of terminals (ISO 6429)."""

    light: str
    dark: str
    terminal: str


GOOD, PART, POOR, QUIET = (
    Tone("#00684a", "#5fd3a8", "32"),
    Tone("#8a5500", "#f0b95a", "33"),
    Tone("#9c2f2f", "#f29a94", "31"),
    Tone("#59626b", "#a2abb4", "2"),
)
VERDICTS: Mapping[Verdict, Tone] = {
    Verdict.IDENTIFIED: GOOD,
    Verdict.GIVEN: PART,
    Verdict.UNEXAMINED: PART,
    Verdict.CONDITIONAL: PART,
    Verdict.EXTRAPOLATED: PART,
    Verdict.ONE_SIDED: PART,
    Verdict.PRIOR_DOMINATED: POOR,
    Verdict.FIXED: QUIET,
    Verdict.NOT_JUDGED: QUIET,
}


def pale(colour: str, share: float) -> str:
    """`share` of a colour on white paper."""
    parts = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
    return "#" + "".join(f"{round(255 + share * (part - 255)):02x}" for part in parts)


def series_style(place: int) -> tuple[str, str]:
    """Colour and marker of the thing at `place` of several; no two of the first 42 are alike."""
    return SERIES[place % len(SERIES)], MARKERS[place % len(MARKERS)]


def verdict_mark(verdict: Verdict) -> str:
    """The verdict as a style sheet names it, whatever words are added to it."""
    return verdict.name.lower().replace("_", "-")


def style_rules() -> str:
    """Rules of a style sheet that colour verdicts, on light and on dark paper."""
    rules = [f".v-{verdict_mark(verdict)} {{ color: {tone.light}; }}" for verdict, tone in VERDICTS.items()]
    dark = [f".v-{verdict_mark(verdict)} {{ color: {tone.dark}; }}" for verdict, tone in VERDICTS.items()]
    return "\n".join([*rules, "@media screen and (prefers-color-scheme: dark) {", *dark, "}"])
