"""The court pace rating as sentences and rows of text, for page and terminal."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fitball.inference.results.pace_rating import PER_KELVIN, PaceRating, Reach, Spread
from fitball.inference.results.results import Fit
from fitball.report.fit.adequacy_rows import conditional_words
from fitball.report.form.rounding import decimals, fixed, interval

# Difference of two ratings below which nobody would see it in a rating rounded to a whole number.
EQUAL = 0.05
QUANTITIES = {"v_y1": ("vertical speed", 1.0, "m/s"), "theta_1": ("angle", 57.29577951308232, "deg")}
QUANTITIES["omega_1"] = ("spin", 1.0, "rad/s")


@dataclass(frozen=True)
class PaceRow:
    """One surface: every number as text."""

    surface: str
    impacts: str
    rating: str
    interval_68: str
    interval_95: str
    category: str
    categories: str
    friction: str
    sliding: str
    restitution: str
    contact: str
    reach: str


@dataclass(frozen=True)
class PaceTable:
    """All surfaces, remarks, and why there is no rating (empty where there is one)."""

    rows: tuple[PaceRow, ...]
    remarks: tuple[str, ...]
    missing: str
    sampled: bool


def pace_table(fit: Fit) -> PaceTable | None:
    """The ratings of a fit; None where no motion along the court was measured."""
    pace = fit.court_pace
    if pace is None:
        return None
    rows = tuple(_row(rating) for rating in pace.ratings)
    said = conditional_words(fit)
    remarks = ([f"The rating is {said}."] if said else []) + _remarks(pace.ratings)
    return PaceTable(rows, tuple(remarks), pace.missing, fit.posterior is not None)


def pace_lines(fit: Fit) -> tuple[str, ...]:
    """One line a surface for the terminal."""
    pace = fit.court_pace
    if pace is None:
        return ()
    if pace.missing:
        return (f"ITF court pace rating: none, {pace.missing}",)
    said = conditional_words(fit)
    rests = f"; {said}" if said else ""
    lines = []
    for rating in pace.ratings:
        row = _row(rating)
        name = f" of {row.surface}" if rating.labels else ""
        within = f" {row.interval_95} (95 %)" if rating.rating.median is not None else ""
        flag = f"; extrapolated: {row.reach}" if rating.reach.outside else ""
        lines.append(f"ITF court pace rating{name}: {row.rating}{within}, {row.category}{flag}{rests}")
    return tuple(lines)


def _row(rating: PaceRating) -> PaceRow:
    places = _places(rating.rating)
    name, share = max(rating.categories.items(), key=lambda pair: pair[1])
    sampled = rating.rating.median is not None
    return PaceRow(
        surface=", ".join(rating.labels) if rating.labels else "all impacts",
        impacts=str(rating.impacts),
        rating=_middle(rating.rating, places),
        interval_68=interval(rating.rating.q16, rating.rating.q84, places) if sampled else "-",
        interval_95=interval(rating.rating.q025, rating.rating.q975, places) if sampled else "-",
        category=f"{name} ({_percent(share)})" if sampled else name,
        categories=_shares(rating.categories, sampled),
        friction=_with_interval(rating.friction),
        sliding=_middle(rating.sliding_rating, places),
        restitution=_with_interval(rating.restitution),
        contact=_shares(rating.regimes, sampled),
        reach=reach_words(rating.reach),
    )


def _remarks(ratings: tuple[PaceRating, ...]) -> list[str]:
    remarks = []
    for rating in ratings:
        name = f"{', '.join(rating.labels)}: " if rating.labels else ""
        if rating.reach.outside:
            lines = f"; the line of {' and of '.join(rating.reach.lines)} is continued" if rating.reach.lines else ""
            remarks.append(f"{name}An extrapolation: the test impact lies {reach_words(rating.reach)}{lines}.")
        gap = abs(_number(rating.rating) - _number(rating.sliding_rating))
        if gap > EQUAL:
            remarks.append(
                f"{name}The apparent friction of the test impact and the fitted coefficient differ (the ball slides "
                f"throughout with probability {_percent(rating.slides)}): with the fitted one the rating would be "
                f"{_middle(rating.sliding_rating, _places(rating.sliding_rating))}."
            )
        if rating.failed > 0.0:
            remarks.append(
                f"{name}{_percent(rating.failed)} of the draws cannot be solved there: intervals are of the rest."
            )
    remarks.append(
        "No ball temperature is known, so e_T is the restitution as fitted, without adjustment. The method brings it "
        f"to 23 degrees Celsius: {PER_KELVIN} points of the rating more for each degree that the ball was warmer, "
        "less for each that it was colder."
    )
    return remarks


def reach_words(reach: Reach) -> str:
    """Where the test impact lies, seen from the impacts of the table."""
    parts = []
    for name, value in reach.beyond.items():
        words, factor, unit = QUANTITIES[name]
        side = "above" if value > 0.0 else "below"
        parts.append(f"{abs(value) * factor:.2g} {unit} {side} its range of {words}")
    if reach.distance > reach.slack:
        parts.append(f"{reach.distance:.1f} m/s from the nearest combination measured")
    return " and ".join(parts) if parts else "within what was measured"


def _number(spread: Spread) -> float:
    return spread.point if spread.median is None else spread.median


def _places(spread: Spread) -> int:
    """Decimals that a quarter of the 95 % interval supports; one without a posterior, as ratings are quoted."""
    if spread.q025 is None or spread.q975 is None:
        return 1
    return decimals(0.25 * (spread.q975 - spread.q025))


def _middle(spread: Spread, places: int) -> str:
    return fixed(_number(spread), places)


def _with_interval(spread: Spread) -> str:
    if spread.q025 is None:
        return fixed(spread.point, 3)
    places = _places(spread)
    return f"{_middle(spread, places)} {interval(spread.q025, spread.q975, places)}"


def _shares(shares: Mapping[str, float], sampled: bool) -> str:
    """Names with their probability; without a posterior there is one name and nothing to say of probability."""
    return ", ".join(f"{name} {_percent(part)}" if sampled else name for name, part in shares.items() if part > 0.0)


def _percent(share: float) -> str:
    if 0.0 < share < 0.005:
        return "< 1 %"
    if 0.995 < share < 1.0:
        return "> 99 %"
    return f"{np.round(100.0 * share):.0f} %"
