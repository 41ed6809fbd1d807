"""The court pace rating, as parts of a report and of a certificate."""

from __future__ import annotations

from collections.abc import Mapping

from fitball.inference.results.adequacy import Adequacy
from fitball.inference.results.pace_rating import (
    PACE_CONSTANT,
    PER_DEGREE,
    PER_KELVIN,
    TEST_TEMPERATURE,
    CourtMean,
    CourtPace,
    PaceRating,
    Reach,
)
from fitball.inference.results.quantiles import Spread
from fitball.inference.results.results import Estimate, Fit, Verdict
from fitball.report.fit.judged import conditional_words
from fitball.report.form.document import Part, Row, Table, Words
from fitball.report.form.numbers import INCIDENT, inner, percent, ranged

# Difference of two ratings below which nobody would see it in a rating rounded to a whole number.
EQUAL = 0.05
# Probability from which it is said that the model is at its grip limit.
SATURATES = 0.05
# Probability below which a category of a court is not worth a word.
LIKELY = 0.005
# Contraction from which the table narrows a friction that priors decide, as where they keep it from its best values.
NARROWED = 0.2
QUANTITIES = {"v_y1": "vertical speed", "theta_1": "angle", "omega_1": "spin"}
PACE = (
    "What the court pace test of the ITF (CS 01/02: a ball at 30 m/s and 16 degrees with hardly any spin) would find "
    "on this surface: 100 (1 - mu) + 150 (0.81 - e_T), from the velocities that the model predicts for that impact. "
    "There mu is the apparent friction of that one impact, which is the coefficient of sliding friction only if the "
    'ball slides throughout; "by fitted mu" is the rating with the fitted coefficient instead. Large is fast. '
    "Slow: up to 29; medium-slow: 30 to 34; medium: 35 to 39; medium-fast: 40 to 44; fast: from 45."
)


def pace_parts(fit: Fit) -> list[Part]:
    """The court as measured and the ratings by the model, one line a surface on a terminal; nothing where no motion
    along the court was measured.
    """
    pace = fit.court_pace
    if pace is None:
        return []
    parts: list[Part] = [
        Words(pace_lines(fit), only="terminal"),
        Words(court_lines(pace), only="page"),
        Table.of("Places on the court, as measured", place_rows(pace), only="page"),
    ]
    if pace.missing:
        return [*parts, Words([f"No ITF court pace rating by the model: {pace.missing}."], only="page")]
    left_out = () if fit.levels else ("surface", "impacts")
    rows = [{head: cell for head, cell in row.items() if head not in left_out} for row in surface_rows(pace)]
    said = rests(fit.parameters, fit.adequacy)
    return [
        *parts,
        Words([PACE], only="page"),
        Table.of("Court pace rating", rows, ["category", "contact there"], only="page"),
        Words([*[f"The rating is {said}."] * bool(said), *pace_remarks(pace)], "list", "page"),
    ]


def pace_lines(fit: Fit) -> tuple[str, ...]:
    """One line a surface for the terminal."""
    pace = fit.court_pace
    if pace is None:
        return ()
    lines = [*court_lines(pace)]
    if pace.missing:
        return (*lines, f"ITF court pace rating by the model: none, {pace.missing}")
    said = rests(fit.parameters, fit.adequacy)
    for rating in pace.ratings:
        name = f" of {surface_words(rating)}" if rating.labels else ""
        flags = [f"extrapolated: {reach_words(rating.reach)}"] if rating.reach.outside else []
        if rating.saturated > SATURATES:
            flags.append(f"at the grip limit of the model ({percent(rating.saturated)}), so surer than the data")
        told = "; ".join([rating_words(rating), *flags, *[said] * bool(said)])
        lines.append(f"ITF court pace rating{name}: {told}")
    return tuple(lines)


def rests(parameters: Mapping[str, Estimate], adequacy: Adequacy | None) -> str:
    """What to add to a rating; empty where the table tells what it is made of."""
    friction = parameters.get("mu")
    if friction is None or friction.verdict is not Verdict.PRIOR_DOMINATED:
        return conditional_words(parameters, adequacy)
    if (friction.contraction or 0.0) < NARROWED:
        return "as uncertain as the prior of mu, of which the table tells nothing"
    return "decided by priors, as mu is"


def court_lines(pace: CourtPace) -> tuple[str, ...]:
    """The court as a whole: as measured, and by the model where it tells places apart."""
    lines = []
    measured = pace.measured
    if measured is not None:
        some = f"{measured.impacts} of {measured.of}" if measured.impacts < measured.of else str(measured.of)
        head = f"ITF court pace as measured, no model between ({some} impacts are those of the test)"
        lines.append(f"{head}: {_court_words(measured.court)}.")
        if measured.remark:
            lines.append(measured.remark[:1].upper() + measured.remark[1:] + ".")
    if pace.court is not None:
        lines.append(f"ITF court pace of the court by the model: {_court_words(pace.court)}.")
    return tuple(lines)


def _court_words(court: CourtMean) -> str:
    likely = {name: share for name, share in court.categories.items() if share >= LIKELY}
    (value, ends), known = ranged(court.rating, places=1), court.rating.q025 is not None
    parts = [f"{value}{f' {ends} (95 %)' * known}, {_shares(likely, known)}"]
    if court.places > 1:
        parts[0] += f"; mean of {court.places} places ({court.column})"
        # Of a make of places where repeats tell it, else of those that were tested.
        between = "sd between places" if court.elsewhere is not None else "sd of these places"
        spreads = (
            (between, court.between),
            ("sd within one", court.within),
            ("a place that was not tested", court.elsewhere),
        )
        parts += [f"{words} {_with_interval(spread)}" for words, spread in spreads if spread is not None]
        if court.largest_difference is not None:
            parts.append(f"largest difference {court.largest_difference:.1f}")
    elif court.within is not None:
        parts.append(f"sd of one impact {_with_interval(court.within)}")
    return ", ".join(parts)


def place_rows(pace: CourtPace) -> list[Row]:
    """The places of a court, as measured."""
    heads = ("place", "impacts", "mean rating", "beyond noise", "95 %", "mu", "restitution")
    rows = []
    for place in () if pace.measured is None else pace.measured.places:
        beyond = ("-", "-") if place.rating is None else ranged(place.rating, places=1)
        means = (f"{place.friction:.3f}", f"{place.restitution:.3f}")
        cells = (place.label, str(place.impacts), f"{place.mean:.1f}", *beyond, *means)
        rows.append(dict(zip(heads, cells, strict=True)))
    return rows


def surface_rows(pace: CourtPace) -> list[Row]:
    """Every surface, by the model."""
    rows = []
    for rating in pace.ratings:
        value, ends = ranged(rating.rating, places=1)
        row, sampled = (
            {"surface": surface_words(rating), "impacts": str(rating.impacts), "rating": value},
            ends != "-",
        )
        row |= {"68 %": inner(rating.rating), "95 %": ends} if sampled else {}
        row |= {"category": _shares(rating.categories, sampled), "mu of the test": _with_interval(rating.friction)}
        row |= {"by fitted mu": ranged(rating.sliding_rating, places=1)[0]}
        row |= {"restitution": _with_interval(rating.restitution), "contact there": _shares(rating.regimes, sampled)}
        rows.append(row)
    return rows


def rating_words(rating: PaceRating) -> str:
    """A rating with its interval and its most probable category."""
    value, ends = ranged(rating.rating, places=1)
    return f"{value}{'' if ends == '-' else f' {ends} (95 %)'}, {category_words(rating)}"


def category_words(rating: PaceRating) -> str:
    """The most probable category, with its probability where there are draws."""
    name, share = max(rating.categories.items(), key=lambda pair: pair[1])
    return name if rating.rating.median is None else f"{name} ({percent(share)})"


def surface_words(rating: PaceRating) -> str:
    """What the rating is of."""
    return ", ".join(rating.labels) if rating.labels else "all impacts"


def pace_remarks(pace: CourtPace) -> list[str]:
    """What the ratings rest on, and how far they reach."""
    remarks = []
    for rating in pace.ratings:
        said = []
        if rating.reach.outside:
            lines = f"; the line of {' and of '.join(rating.reach.lines)} is continued" if rating.reach.lines else ""
            said.append(f"An extrapolation: the test impact lies {reach_words(rating.reach)}{lines}.")
        one, other = (it.point if it.median is None else it.median for it in (rating.rating, rating.sliding_rating))
        if abs(one - other) > EQUAL:
            said.append(
                "The apparent friction of the test impact and the fitted coefficient differ (the ball slides "
                f"throughout with probability {percent(rating.slides)}): with the fitted one the rating would be "
                f"{ranged(rating.sliding_rating, places=1)[0]}."
            )
        if rating.saturated > SATURATES:
            said.append(
                "The model is at its grip limit in the test impact, or within 5 % of it (probability "
                f"{percent(rating.saturated)}): there it rates all rougher courts alike, and its interval and its "
                "category are surer than the data. Models that fit how a ball grips, two-mass and grip-slip, have no "
                "such limit."
            )
        if rating.failed > 0.0:
            said.append(f"{percent(rating.failed)} of the draws cannot be solved there: intervals are of the rest.")
        name = f"{', '.join(rating.labels)}: " if rating.labels else ""
        remarks += [f"{name}{text}" for text in said]
    return [*remarks, warmth_words(pace)]


def warmth_words(pace: CourtPace) -> str:
    """What was done about the temperature of the ball."""
    if pace.temperature is None:
        return (
            "No ball temperature is known (ball.temperature in the scene), so e_T is the restitution as it is. The "
            f"method brings it to {TEST_TEMPERATURE:.0f} degrees Celsius: {PER_KELVIN} points of the "
            "rating more for each degree that the ball was warmer, less for each that it was colder."
        )
    error = "" if pace.temperature_sd is None else f" +- {pace.temperature_sd:g}"
    shift = PER_DEGREE * (TEST_TEMPERATURE - pace.temperature)
    sign = "-" if shift < 0.0 else "+"
    return (
        f"The ball had {pace.temperature:g}{error} degrees Celsius: e_T = e + {PER_DEGREE} "
        f"({TEST_TEMPERATURE:.0f} - T) = e {sign} {abs(shift):.3f}, {-PACE_CONSTANT * shift:+.1f} points of the "
        "rating (ITF CS 01/02). Restitutions are shown as they are."
    )


def reach_words(reach: Reach) -> str:
    """Where the test impact lies, seen from the impacts of the table."""
    parts = []
    for name, value in reach.beyond.items():
        scale, side = INCIDENT[name], "above" if value > 0.0 else "below"
        parts.append(f"{abs(value) * scale.factor:.2g} {scale.unit} {side} its range of {QUANTITIES[name]}")
    if reach.distance > reach.slack:
        parts.append(f"{reach.distance:.1f} m/s from the nearest combination measured")
    return " and ".join(parts) if parts else "within what was measured"


def _with_interval(spread: Spread) -> str:
    value, ends = ranged(spread, places=3)
    return value if ends == "-" else f"{value} {ends}"


def _shares(shares: Mapping[str, float], sampled: bool) -> str:
    """Names with their probability; without a posterior there is one name and nothing to say of probability."""
    return ", ".join(f"{name} {percent(part)}" if sampled else name for name, part in shares.items() if part > 0.0)
