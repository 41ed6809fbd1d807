"""The drop test of the ITF, as parts of a report and of a certificate."""

from __future__ import annotations

from fitball.data.heights import BALL_TYPES, DRAG_COEFFICIENT, DROP_HEIGHT, SOURCE, TEST_TEMPERATURE
from fitball.inference.problem.pooling import FEW_LEVELS
from fitball.inference.results.lab import (
    DropTest,
    StandardRebound,
)
from fitball.inference.results.quantiles import Spread
from fitball.report.form.document import Part, Row, Table, Words
from fitball.report.form.numbers import digits, inner, listed, percent, ranged, significant
from fitball.wording import spoken

CM = 100.0
# Balls that a page lists.
MOST_BALLS = 72
# Probability from which a ball is said to pass without further words.
SURE = 0.95


def spread_words(quantity: str, prior: str) -> str:
    """The prior of a spread, and how to choose another."""
    name = f"{quantity}_spread"
    return f"{prior} ({spoken(f'--prior {name}=...', f'priors={{{name!r}: ...}}')} replaces it)"


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
            f"{len(found.levels)} balls hardly determine the sd between balls. It depends on its prior, "
            f"{spread_words('cor_10', found.prior)}, and so does the probability of another ball."
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
