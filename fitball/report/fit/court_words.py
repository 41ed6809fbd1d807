"""The court pace rating of the ITF, as parts of a report and of a certificate."""

from __future__ import annotations

from collections.abc import Mapping

from fitball.inference.problem.level_names import heads_of
from fitball.inference.problem.pooling import FEW_LEVELS
from fitball.inference.results.lab import (
    PACE_CONSTANT,
    PER_DEGREE,
    PER_KELVIN,
    CourtMean,
    CourtPace,
    PaceRating,
    Reach,
)
from fitball.inference.results.lab import TEST_TEMPERATURE as PACE_TEMPERATURE
from fitball.inference.results.quantiles import Spread
from fitball.inference.results.results import Fit, Verdict
from fitball.report.fit.drop_words import spread_words
from fitball.report.fit.judged import conditional_words
from fitball.report.form.document import Part, Row, Table, Words
from fitball.report.form.numbers import INCIDENT, inner, listed, percent, ranged

# Difference of two ratings that does not show in a rating rounded to a whole number.
EQUAL = 0.05
# Probability from which it is said that the model is at its grip limit.
SATURATES = 0.05
# Probability below which a category of a court is not named.
LIKELY = 0.005
# Contraction from which data determine something of a friction that its prior dominates.
NARROWED = 0.2
QUANTITIES = {"v_y1": "vertical speed", "theta_1": "angle", "omega_1": "spin"}
PACE = (
    "The ITF court pace rating (CS 01/02) is 100 (1 - mu) + 150 (0.81 - e_T). Its test impact has 30 m/s, 16 degrees "
    "and little spin; here the model predicts the velocities. The mu of the rating is the apparent friction of that "
    'impact. It equals the coefficient of sliding friction if the ball slides throughout. The column "by fitted mu"'
    " has the rating with the fitted coefficient instead. A large rating is fast. "
    "Slow: up to 29; medium-slow: 30 to 34; medium: 35 to 39; medium-fast: 40 to 44; fast: from 45."
)


def pace_parts(fit: Fit) -> list[Part]:
    """The court as measured and the ratings by the model, besides the first lines; nothing where no motion along the
    court was measured.
    """
    pace = fit.court_pace
    if pace is None:
        return []
    parts: list[Part] = [
        Words(court_lines(pace)),
        Table.from_rows("Places on the court, as measured", place_rows(pace), only="page"),
    ]
    if pace.missing:
        return [*parts, Words([f"No ITF court pace rating by the model: {pace.missing}."], only="page")]
    left_out = () if fit.levels else (*level_heads(pace), "impacts")
    rows = [{head: cell for head, cell in row.items() if head not in left_out} for row in surface_rows(pace)]
    return [
        *parts,
        Words([PACE], only="page"),
        Table.from_rows("Court pace rating", rows, ["category", "contact there"], only="page"),
        Words([*rest_lines(fit), *pace_remarks(pace)], "list", "page"),
    ]


def pace_lines(fit: Fit) -> tuple[str, ...]:
    """One line a surface."""
    pace = fit.court_pace
    if pace is None:
        return ()
    lines = [*court_lines(pace, brief=True)]
    if pace.missing:
        return (*lines, f"ITF court pace rating by the model: none, {pace.missing}.")
    grouped: dict[tuple[str, str], list[str]] = {}
    for rating in pace.ratings:
        depends = rests(fit, rating)
        flags = [f"extrapolated: {reach_words(rating.reach)}"] if rating.reach.outside else []
        if rating.saturated > SATURATES:
            flags.append(f"at the grip limit of the model ({percent(rating.saturated)}): the interval is too narrow")
        words = "; ".join([rating_words(rating), *flags, *[depends] * bool(depends)])
        first, *others = rating.labels or ("",)
        grouped.setdefault((first, words), []).append(", ".join(others))
    for (first, words), rest in grouped.items():
        # Balls that do not differ in the test are in one line.
        where = f" ({listed(rest)})" if len(rest) > 1 else f", {rest[0]}" if rest[0] else ""
        lines.append(f"ITF court pace rating{f' of {first}' if first else ''}{where}: {words}.")
    return tuple(lines)


def rests(fit: Fit, rating: PaceRating) -> str:
    """What to add to a rating; empty where the data determine what it is made of."""
    known = {item.name: item for item in fit.reported}
    own = [
        "mu",
        *(item.level_name(name) for item in fit.fitted.levels for name in item.labels if name in rating.labels),
    ]
    friction = next((known[name] for name in own if name in known and name.startswith("mu")), None)
    if friction is None or friction.verdict is not Verdict.PRIOR_DOMINATED:
        return conditional_words(known, fit.adequacy)
    name = friction.name
    if (friction.contraction or 0.0) < NARROWED:
        return f"as uncertain as the prior of {name}: the data do not determine {name}"
    return f"prior-dominated, as {name} is"


def rest_lines(fit: Fit) -> list[str]:
    """The same as sentences, one for all ratings where it is the same."""
    ratings = () if fit.court_pace is None else fit.court_pace.ratings
    found = [(rating, words) for rating in ratings if (words := rests(fit, rating))]
    if len({words for _, words in found}) == 1 and len(found) == len(ratings):
        return [f"The rating by the model is {found[0][1]}."]
    return [f"{surface_words(rating)}: the rating by the model is {words}." for rating, words in found]


def court_lines(pace: CourtPace, brief: bool = False, shares: bool = True) -> tuple[str, ...]:
    """The court as a whole: as measured, and by the model where it has several places; in `brief` the mean alone,
    without `shares` no probabilities of categories.
    """
    lines = []
    for one in pace.measured:
        some = f"{one.impacts} of {one.total}" if one.impacts < one.total else str(one.total)
        where = f" of {one.surface}" if one.surface else ""
        head = f"ITF court pace{where} as measured, without a model ({some} test impacts)"
        lines.append(f"{head}: {_court_words(one.court, brief, shares)}.")
        if not brief:
            lines += [f"{one.remark[:1].upper()}{one.remark[1:]}."] * bool(one.remark) + _few_places(one.court)
    if pace.court is not None:
        lines.append(f"ITF court pace of the court by the model: {_court_words(pace.court, brief, shares)}.")
    return tuple(lines)


def _few_places(court: CourtMean) -> list[str]:
    """That a place that was not tested is not predicted; nothing where it is, or where no places are separated."""
    if court.elsewhere is not None or court.between is None:
        return []
    return [
        f"{court.places} places are too few to predict a place that was not tested: "
        f"at least {FEW_LEVELS} are needed.",
        f"The sd between places depends on its prior, {spread_words('rating', court.prior)}.",
    ]


def _court_words(court: CourtMean, brief: bool, shares: bool) -> str:
    likely = {name: share for name, share in court.categories.items() if share >= LIKELY}
    (value, ends), known = ranged(court.rating, places=1), court.rating.q025 is not None
    parts = [f"{value}{f' {ends} (95 %)' * known}", *[_shares(likely, known)] * shares]
    if brief:
        return f"{', '.join(parts)}{f'; mean of {court.places} places' * (court.places > 1)}"
    if court.places > 1:
        parts[-1] += f"; mean of {court.places} places ({court.column})"
        # Of a make of places where repeats determine it, else of those that were tested.
        between = "sd between places" if court.within is not None else "sd of these places"
        spreads = (
            (between, court.between),
            ("sd within one", court.within),
            ("an untested place", court.elsewhere),
        )
        parts += [f"{words} {_with_interval(spread)}" for words, spread in spreads if spread is not None]
        if court.largest_difference is not None:
            parts.append(f"largest difference {court.largest_difference:.1f}")
    elif court.within is not None:
        parts.append(f"sd of one impact {_with_interval(court.within)}")
    return ", ".join(parts)


def class_lines(pace: CourtPace) -> tuple[str, ...]:
    """The one classification of each surface."""
    lines = []
    for one in pace.classes:
        chance = "" if one.probability is None else f" (probability {percent(one.probability)})"
        basis = "the test impacts as measured" if one.measured else "the rating by the model"
        where = f" of {one.surface}" if one.surface else ""
        lines.append(f"Classification{where}: {one.category}{chance}, from {basis}.")
    return tuple(lines)


def place_rows(pace: CourtPace) -> list[Row]:
    """The places of a court, as measured."""
    heads = ("place", "impacts", "mean rating", "beyond noise", "95 %", "mu", "restitution")
    rows = []
    for one in pace.measured:
        for place in one.places:
            beyond = ("-", "-") if place.rating is None else ranged(place.rating, places=1)
            means = (f"{place.friction:.3f}", f"{place.restitution:.3f}")
            cells = (place.label, str(place.impacts), f"{place.mean:.1f}", *beyond, *means)
            surface = {"surface": one.surface} if one.surface else {}
            rows.append(surface | dict(zip(heads, cells, strict=True)))
    return rows


def level_heads(pace: CourtPace) -> tuple[str, ...]:
    """What the labels of a rating name; of a rating of all impacts the surface."""
    return heads_of(pace.columns) or ("surface",)


def surface_rows(pace: CourtPace) -> list[Row]:
    """Every surface, by the model."""
    rows = []
    for rating in pace.ratings:
        value, ends = ranged(rating.rating, places=1)
        sampled = ends != "-"
        row = dict(zip(level_heads(pace), rating.labels or (surface_words(rating),), strict=True))
        row |= {"impacts": str(rating.impacts), "rating": value}
        row |= {"68 %": inner(rating.rating), "95 %": ends} if sampled else {}
        row |= {"category": _shares(rating.categories, sampled), "mu of the test": _with_interval(rating.friction)}
        row |= {"by fitted mu": ranged(rating.sliding_rating, places=1)[0]}
        row |= {"restitution": _with_interval(rating.restitution), "contact there": _shares(rating.regimes, sampled)}
        rows.append(row)
    return rows


def rating_words(rating: PaceRating) -> str:
    """A rating with its interval and its most probable category."""
    return f"{rating_value(rating)}, {category_words(rating)}"


def rating_value(rating: PaceRating) -> str:
    """A rating with its interval."""
    value, ends = ranged(rating.rating, places=1)
    return f"{value}{'' if ends == '-' else f' {ends} (95 %)'}"


def category_words(rating: PaceRating) -> str:
    """The most probable category, with its probability where there are draws."""
    name, share = max(rating.categories.items(), key=lambda pair: pair[1])
    return name if rating.rating.median is None else f"{name} (probability {percent(share)})"


def surface_words(rating: PaceRating) -> str:
    """What the rating is of."""
    return ", ".join(rating.labels) if rating.labels else "all impacts"


def pace_remarks(pace: CourtPace) -> list[str]:
    """What the ratings depend on, and whether they are extrapolated."""
    remarks = []
    for rating in pace.ratings:
        texts = []
        if rating.reach.outside:
            lines = f"; so is the line of {' and of '.join(rating.reach.lines)}" if rating.reach.lines else ""
            texts.append(f"Extrapolated: {reach_words(rating.reach)}{lines}.")
        one, other = (it.point if it.median is None else it.median for it in (rating.rating, rating.sliding_rating))
        if abs(one - other) > EQUAL:
            texts.append(
                f"The ball slides throughout the test impact with probability {percent(rating.slides)}. With the "
                f"fitted mu instead of the apparent one the rating is {ranged(rating.sliding_rating, places=1)[0]}."
            )
        if rating.saturated > SATURATES:
            texts.append(
                "The model is at its grip limit in the test impact, or within 5 % of it (probability "
                f"{percent(rating.saturated)}). It then gives all rougher courts the same rating, and the interval "
                "is too narrow. The models two-mass and grip-slip have no such limit."
            )
        if rating.failed > 0.0:
            texts.append(f"{percent(rating.failed)} of the draws have no solution there; intervals use the others.")
        name = f"{', '.join(rating.labels)}: " if rating.labels else ""
        remarks += [f"{name}{text}" for text in texts]
    return [*remarks, warmth_words(pace)]


def warmth_words(pace: CourtPace) -> str:
    """How the temperature of the ball enters the rating."""
    if pace.temperature is None:
        return (
            "The scene states no ball temperature (ball.temperature), so e_T is not corrected. The method "
            f"corrects it to {PACE_TEMPERATURE:.0f} degrees Celsius: {PER_KELVIN:+} points of the rating for each "
            "degree that the ball was warmer."
        )
    error = "" if pace.temperature_sd is None else f" +- {pace.temperature_sd:g}"
    shift = PER_DEGREE * (PACE_TEMPERATURE - pace.temperature)
    sign = "-" if shift < 0.0 else "+"
    return (
        f"The ball was at {pace.temperature:g}{error} degrees Celsius: e_T = e + {PER_DEGREE} "
        f"({PACE_TEMPERATURE:.0f} - T) = e {sign} {abs(shift):.3f}, {-PACE_CONSTANT * shift:+.1f} points of the "
        "rating (ITF CS 01/02). The table has restitutions without this correction."
    )


def reach_words(reach: Reach) -> str:
    """How far the test impact is from the measured impacts."""
    parts = []
    for name, value in reach.beyond.items():
        scale, side = INCIDENT[name], "above" if value > 0.0 else "below"
        parts.append(
            f"the test's {QUANTITIES[name]} is {abs(value) * scale.factor:.2g} {scale.unit} {side} the measured range"
        )
    if reach.distance > reach.slack:
        parts.append(f"the test is {reach.distance:.1f} m/s away from the measured range")
    return " and ".join(parts) if parts else "within the measured range"


def _with_interval(spread: Spread) -> str:
    value, ends = ranged(spread, places=3)
    return value if ends == "-" else f"{value} {ends}"


def _shares(shares: Mapping[str, float], sampled: bool) -> str:
    """Names with their probability; without a posterior one name alone."""
    return ", ".join(f"{name} {percent(part)}" if sampled else name for name, part in shares.items() if part > 0.0)
