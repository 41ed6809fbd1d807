"""Parameters as text, a row each: what terminal, page, paper, certificate and notebook show; their symbols."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from markupsafe import Markup, escape

from fitball.inference.results.evidence import Profile
from fitball.inference.results.quantiles import ESSENTIALS
from fitball.inference.results.results import Estimate, Verdict
from fitball.report.form.document import Cell, Row, judged
from fitball.report.form.numbers import Scale, decimals, fixed, handy, interval, significant

# Ratio of the ends of an interval from which each has digits of its own.
WIDE = 20.0


@dataclass(frozen=True)
class ParameterRow:
    """One parameter as text, in the unit of its row; "-" for what a run without posterior has not. `told` is its
    verdict without and, on a page, with the assumptions that it rests on.
    """

    name: str
    unit: str
    median: str
    sd: str
    interval_68: str
    interval_95: str
    point: str
    prior: str = ""
    contraction: str = "-"
    told: str = ""
    verdict: str = ""
    reason: str = ""

    @property
    def best(self) -> str:
        """The median, or the point estimate where there is none."""
        return self.point if self.median == "-" else self.median

    @property
    def within(self) -> str:
        """The best value with its 95 % interval, where there is one."""
        return self.best if self.median == "-" else f"{self.median} {self.interval_95}"

    @property
    def plus_minus(self) -> str:
        """The best value with its sd, where there is one, and its unit."""
        return f"{self.best if self.median == '-' else f'{self.median} +- {self.sd}'} {self.unit}".rstrip()

    def numbers(self, sampled: bool = True) -> Row:
        """Median and intervals, where there is a posterior, and the point estimate, by their heads."""
        spread = {"median": self.median, "68 %": self.interval_68, "95 %": self.interval_95} if sampled else {}
        return spread | {"point": self.point}


def rounded(numbers: Mapping[str, Any], factor: float) -> dict[str, str]:
    """Point, median, sd and intervals, times a factor, as text to the places that the sd tells."""
    scaled = {name: None if numbers[name] is None else numbers[name] * factor for name in ("point", *ESSENTIALS)}
    if scaled["median"] is None or scaled["sd"] is None:
        absent = dict.fromkeys(("median", "sd", "interval_68", "interval_95"), "-")
        return absent | {"point": significant(scaled["point"], 4)}
    places = decimals(scaled["sd"])
    return {
        **{name: fixed(scaled[name], places) for name in ("median", "sd", "point")},
        "interval_68": interval(scaled["q16"], scaled["q84"], places),
        "interval_95": interval(scaled["q025"], scaled["q975"], places),
    }


def parameter_row(estimate: Estimate, scale: Scale | None = None) -> ParameterRow:
    """One parameter in handy multiples of SI, or as `scale` has it; its prior is quoted in SI itself."""
    scale = scale or handy(estimate.name, estimate.unit)
    contraction = None if estimate.median is None else estimate.contraction
    return ParameterRow(
        name=estimate.name,
        unit=scale.unit,
        prior=estimate.prior,
        contraction="-" if contraction is None else f"{contraction:.2f}",
        told=verdict_cell(estimate),
        verdict=estimate.verdict_words,
        reason=estimate.reason,
        **rounded(vars(estimate), scale.factor),
    )


def verdict_cell(estimate: Estimate) -> Cell:
    """The verdict of a parameter: on a page with what it is given, for which a terminal has no room."""
    return Cell(estimate.verdict, judged(estimate.verdict, estimate.verdict_words, estimate.reason).html)


def told_line(estimate: Estimate) -> Cell:
    """What is said of a parameter, in a line: its value where the table tells it, its verdict and the reason."""
    row, known = parameter_row(estimate), ""
    if estimate.verdict in (*TOLD, Verdict.FIXED):
        # A unit such as 1e-3 s/m is a factor to a reader.
        unit = f"{' x' * row.unit[:1].isdigit()} {row.unit}".rstrip()
        known = f" = {row.best}{unit}{'' if row.median == '-' else f' {row.interval_95} (95 %)'}"
    coloured = judged(estimate.verdict, row.verdict).html
    html = Markup("<b>{}</b>{}: {}; {}").format(row.name, known, coloured, row.reason.replace("+-", "\u00b1"))
    return Cell(f"{row.name}{known}: {row.verdict}; {row.reason}", html)


TOLD = (Verdict.IDENTIFIED, Verdict.GIVEN, Verdict.UNEXAMINED, Verdict.CONDITIONAL)
NOT_TOLD = (Verdict.EXTRAPOLATED, Verdict.ONE_SIDED, Verdict.PRIOR_DOMINATED, Verdict.NOT_JUDGED)


def profile_interval(profile: Profile | None, scale: Scale) -> str:
    """The 95 % interval of a profile with the decimals a quarter of it supports; an open end is said to be open."""
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


# A command, a brace, a mark of height, or one character.
_TOKEN = re.compile(r"\\[A-Za-z]+|[{}^_]|.")
_TAGS = {"_": "sub", "^": "sup"}
# Commands that are not the name of a Greek letter; of the two epsilons figures use the curly one.
_LETTERS = {"\\mathrm": "", "\\varepsilon": "\u03b5", "\\nu": "\u03bd"}


def symbol_cell(mathtext: str) -> Cell:
    """A symbol for a page; for who has no such letters nothing."""
    return Cell("", symbol_html(mathtext))


def symbol_html(mathtext: str) -> Markup:
    """Letters, Greek letters, indices and powers of `mathtext` as HTML; the empty text stays empty.

    Raises ValueError for a command it does not know.
    """
    tokens = _TOKEN.findall(mathtext.replace("$", "").replace(" ", ""))
    made = _group(tokens)
    if tokens:
        raise ValueError(f"{mathtext}: a brace too many")
    return made


def _group(tokens: list[str]) -> Markup:
    """Everything up to the brace that closes, which is taken too."""
    made = Markup("")
    while tokens and tokens[0] != "}":
        made += _one(tokens)
    if tokens and tokens[0] == "}":
        tokens.pop(0)
    return made


def _one(tokens: list[str]) -> Markup:
    """The next letter, group or index."""
    token = tokens.pop(0)
    if token in _TAGS:
        return Markup("<{0}>{1}</{0}>").format(Markup(_TAGS[token]), _one(tokens))
    if token == "{":
        return _group(tokens)
    if token == "'":
        return Markup("\u2032")
    return escape(_letter(token) if token.startswith("\\") else token)


def _letter(command: str) -> str:
    """The character that a command stands for."""
    if command in _LETTERS:
        return _LETTERS[command]
    try:
        return unicodedata.lookup(f"GREEK SMALL LETTER {command[1:].upper()}")
    except KeyError:
        raise ValueError(f"{command}: no such letter") from None
