"""The tests of the ITF, a drop test and the court pace rating, as parts of a report and of a certificate."""

from __future__ import annotations

from collections.abc import Mapping

from fitball.data.heights import BALL_TYPES, DRAG_COEFFICIENT, DROP_HEIGHT, SOURCE, TEST_TEMPERATURE
from fitball.inference.problem.level_names import heads_of
from fitball.inference.problem.pooling import FEW_LEVELS
from fitball.inference.results.lab import (
    PACE_CONSTANT,
    PER_DEGREE,
    PER_KELVIN,
    CourtMean,
    CourtPace,
    DropTest,
    PaceRating,
    Reach,
    StandardRebound,
)
from fitball.inference.results.lab import TEST_TEMPERATURE as PACE_TEMPERATURE
from fitball.inference.results.quantiles import Spread
from fitball.inference.results.results import Fit, Verdict
from fitball.report.fit.judged import conditional_words
from fitball.report.form.document import Part, Row, Table, Words
from fitball.report.form.numbers import INCIDENT, digits, inner, listed, percent, ranged, significant

CM = 100.0
# Balls that a page lists.
MOST_BALLS = 72
# Probability from which a ball is said to pass without further words.
SURE = 0.95
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


def drop_parts(test: DropTest | None) -> list[Part]:
    """Tables and remarks of a drop test, besides its first lines; nothing where balls were not dropped."""
    if test is None:
        return []
    if test.missing:
        return [Words([f"No coefficient of restitution at the tested speeds: {test.missing}."], only="page")]
    limits = "Probability that the rebound from 254 cm is within the ITF limits"
    return [
        Table.from_rows("Coefficient of restitution (COR) at the tested speeds", speed_rows(test), only="page"),
        Table.from_rows(limits, type_rows(test), ["limits"], only="page"),
        Table.from_rows("Rebound of each ball", ball_rows(test), only="page"),
        Words(drop_remarks(test), "list"),
    ]


def speed_rows(test: DropTest) -> list[Row]:
    """The tested speeds; none where they have no result."""
    rows = []
    for item in test.speeds if not test.missing else ():
        value, ends = ranged(item.cor)
        row = {"speed [m/s]": f"{item.speed:.2f}", "drops": str(item.impacts), "COR": value}
        row |= {"68 %": inner(item.cor), "95 %": ends} if ends != "-" else {}
        row["measured mean"] = f"{item.measured:.4f}"
        rows.append(row | {"sd of one drop": "-" if item.scatter is None else digits(item.scatter, 2)})
    return rows


def type_rows(test: DropTest) -> list[Row]:
    """The types of balls with the probability to pass as one of them, where there are draws."""
    rebound = test.rebound
    if rebound is None or rebound.height.median is None or test.missing:
        return []
    rows = []
    for name, passing in rebound.passing.items():
        chances = {"mean": passing.mean} | ({"another ball": passing.ball} if test.balls else {})
        chances["one more measured drop"] = passing.drop
        cells = {head: "-" if value is None else percent(value) for head, value in chances.items()}
        rows.append({"ball": BALL_TYPES[name].words, "limits": limits_words(name), **cells})
    return rows


def ball_rows(test: DropTest) -> list[Row]:
    """The balls one by one, as many as a page has."""
    heads = ("ball", "drops", "rebound from 254 cm [cm]", "95 %", "passes")
    return [
        dict(zip(heads, (it.label, str(it.impacts), *ranged(it.height, CM), percent(it.passes)), strict=True))
        for it in test.balls[:MOST_BALLS]
        if not test.missing
    ]


def lead_lines(test: DropTest | None) -> tuple[str, ...]:
    """What comes first; nothing where balls were not dropped."""
    if test is None:
        return ()
    return (f"Drop test: no coefficient of restitution, {test.missing}.",) if test.missing else drop_lead(test)


def drop_class(test: DropTest) -> tuple[str, ...]:
    """Whether the balls are within the limits of their type, with the probability; nothing of other balls."""
    rebound = test.rebound
    if rebound is None:
        return ()
    chance = rebound.passing[test.ball_type].mean
    kind = BALL_TYPES[test.ball_type]
    within = kind.lowest <= rebound.height.point <= kind.highest if chance is None else chance >= 0.5
    share = 0.0 if chance is None else chance if within else 1.0 - chance
    known = "" if chance is None else f" (probability {percent(share)})"
    who = "rebound" if rebound.passing[test.ball_type].ball is None else "ball"
    stated = "" if test.type_stated else "; the type is assumed"
    where = f"{'within' if within else 'outside'} the limits of ITF {kind.words}, {limits_words(test.ball_type)}"
    return (f"Classification: the mean {who} is {where}{known}{stated}.",)


def drop_lead(test: DropTest, stated: bool = False) -> tuple[str, ...]:
    """COR at each tested speed, the rebound from 254 cm, and, unless it is `stated` already, whether that is within
    the limits of a type of ball.
    """
    lines, rebound = [], test.rebound
    for item in test.speeds:
        among = f" at {item.lowest:.2f} to {item.highest:.2f} m/s" if item.highest - item.lowest > 0.005 else ""
        drops, mean = ("drops", "mean ") if item.impacts > 1 else ("drop", "")
        counted = f"{item.impacts} {drops}{among}, measured {mean}{item.measured:.4f}"
        lines.append(f"COR at {item.speed:.2f} m/s: {valued(item.cor)}; {counted}.")
    if rebound is None:
        return tuple(lines)
    lines.append(
        f"Rebound from {CM * DROP_HEIGHT:.0f} cm (100 in, {rebound.speed:.2f} m/s): "
        f"{valued(rebound.height, CM, 'cm')}."
    )
    if stated:
        return tuple(lines)
    name = test.ball_type
    passing, kind = rebound.passing[name], BALL_TYPES[name]
    head = f"ITF {kind.words}, {limits_words(name)}"
    head += "" if test.type_stated else " (assumed; state ball.type in the scene)"
    if passing.mean is None:
        where = "within" if kind.lowest <= rebound.height.point <= kind.highest else "outside"
        result = f"the best value is {where} the limits (no probability without a posterior)"
    else:
        who = "rebound" if passing.ball is None else "ball"
        result = f"the mean {who} passes with probability {percent(passing.mean)}"
        if passing.ball is not None:
            result += f", another ball of this make with {percent(passing.ball)}"
        if passing.drop is not None:
            result += f", one more measured drop with {percent(passing.drop)}"
    return (*lines, f"{head}: {result}.")


def drop_remarks(test: DropTest) -> tuple[str, ...]:
    """What the numbers assume and what they leave out."""
    if test.missing:
        return ()
    rebound = test.rebound
    lines = [*([] if rebound is None else _reach(test, rebound)), *_ball_remarks(test)]
    lines += [] if rebound is None else [_air(test, rebound)]
    if test.shared_error:
        lines.append(
            "The stated error of v_y1 is taken as independent between drops. An error common to all drops (one "
            f"height, one gauge) adds an sd of {significant(test.shared_error, 2)} to each COR."
        )
    if rebound is None:
        return (*lines, "This is no tennis ball: the ITF's drop from 254 cm and its limits do not apply.")
    asked, warm = f"{TEST_TEMPERATURE:.0f} degrees Celsius", test.temperature
    if warm is None:
        lines.append(f"The ITF tests balls at {asked}. The scene states no ball temperature (ball.temperature).")
    elif abs(warm - TEST_TEMPERATURE) <= 2.0:
        lines.append(f"The ball was at {warm:g} degrees Celsius; the ITF tests balls at {asked}.")
    else:
        lines.append(
            f"The ball was at {warm:g} degrees Celsius, but the ITF tests balls at {asked}. Results are not adjusted."
        )
    return (*lines, f"Limits: {SOURCE}.")


def _air(test: DropTest, rebound: StandardRebound) -> str:
    """What v = sqrt(2 g h) leaves out."""
    if test.from_heights:
        return (
            "Speeds were computed from heights without air drag, v = sqrt(2 g h). The rebound from 254 cm needs no "
            f"correction. With drag (c_d = {DRAG_COEFFICIENT}) the COR of the impact is about "
            f"{100.0 * rebound.air_share:.1f} % larger."
        )
    chance = rebound.passing_with_air
    passes = "" if chance is None else f", and it passes with probability {percent(chance)}"
    return (
        "v = sqrt(2 g h) neglects air drag. This is right for speeds that were computed from heights. For speeds "
        f"measured at the floor, drag (c_d = {DRAG_COEFFICIENT}) changes the rebound from 254 cm: it is "
        f"{valued(rebound.with_air, CM, 'cm')}{passes}."
    )


def _reach(test: DropTest, rebound: StandardRebound) -> list[str]:
    """How far the landing speed from 254 cm is from the tested ones, and what one speed does not determine."""
    single = len(test.speeds) == 1
    if rebound.beyond:
        side = "above" if rebound.beyond > 0.0 else "below"
        how = "follows from the prior" if single else "is the fitted line, extrapolated"
        return [
            f"The landing speed from 254 cm is {abs(rebound.beyond):.2g} m/s {side} the tested ones. The change of "
            f"COR with speed {how}."
        ]
    one = (
        "One speed determines the COR there, but not its change with speed. cor_10 and cor_slope depend on their "
        "priors."
    )
    return [one] * single


def _ball_remarks(test: DropTest) -> list[str]:
    found = test.variation
    if found is None:
        return ["No column names the ball that was dropped. Differences between balls count as measurement noise."]
    if found.between is None or found.within is None:
        return [f"Differences between balls cannot be separated from measurement noise: {found.missing}."]
    lines = [
        f"Sd of COR between balls: {valued(found.between)}; between drops of one ball: {valued(found.within)}. "
        f"Intervals take the {len(found.levels)} balls as a sample of their make."
    ]
    if len(found.levels) < FEW_LEVELS:
        lines.append(
            f"{len(found.levels)} balls hardly determine the sd between balls. It depends on its prior, and so does "
            "the probability of another ball."
        )
    doubtful = [ball.label for ball in test.balls if ball.passes < SURE]
    if doubtful:
        lines.append(f"Balls that pass with a probability below {percent(SURE)}: {listed(doubtful, 8)}.")
    return lines


def limits_words(name: str) -> str:
    """The limits of a type."""
    kind = BALL_TYPES[name]
    return f"{CM * kind.lowest:.0f} to {CM * kind.highest:.0f} cm"


def valued(spread: Spread, factor: float = 1.0, unit: str = "") -> str:
    """A number with its 95 % interval, rounded to what that supports."""
    value, ends = ranged(spread, factor)
    space = f" {unit}" if unit else ""
    return f"{value}{space} (best value)" if ends == "-" else f"{value} {ends}{space} (95 %)"


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
    for rating in pace.ratings:
        depends = rests(fit, rating)
        name = f" of {surface_words(rating)}" if rating.labels else ""
        flags = [f"extrapolated: {reach_words(rating.reach)}"] if rating.reach.outside else []
        if rating.saturated > SATURATES:
            flags.append(f"at the grip limit of the model ({percent(rating.saturated)}): the interval is too narrow")
        words = "; ".join([rating_words(rating), *flags, *[depends] * bool(depends)])
        lines.append(f"ITF court pace rating{name}: {words}.")
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
        f"{court.places} places are too few to predict a place that was not tested: at least {FEW_LEVELS} are needed."
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
