"""A drop test, as parts of a report and of a certificate."""

from __future__ import annotations

from fitball.data.heights import BALL_TYPES, DRAG_COEFFICIENT, DROP_HEIGHT, SOURCE, TEST_TEMPERATURE
from fitball.inference.results.drop_test import DropTest, StandardRebound
from fitball.inference.results.quantiles import Spread
from fitball.report.form.document import Part, Row, Table, Words
from fitball.report.form.numbers import digits, inner, percent, ranged, significant

CM = 100.0
# Balls told one by one on a page.
MOST_BALLS = 72
# Probability from which a ball is said to pass without further words.
SURE = 0.95


def drop_parts(test: DropTest | None) -> list[Part]:
    """What there is to show of a drop test besides what comes first; nothing where balls were not dropped."""
    if test is None:
        return []
    if test.missing:
        return [Words([f"No restitution at the tested speeds: {test.missing}."], only="page")]
    limits = "Rebound from 254 cm within the limits of the ITF: probability"
    return [
        Table.of("Restitution at the tested speeds", speed_rows(test), only="page"),
        Table.of(limits, type_rows(test), ["limits"], only="page"),
        Table.of("Rebound of each ball", ball_rows(test), only="page"),
        Words(drop_remarks(test), "list"),
    ]


def speed_rows(test: DropTest) -> list[Row]:
    """The tested speeds; none where nothing can be said of them."""
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
        told = {head: "-" if value is None else percent(value) for head, value in chances.items()}
        rows.append({"ball": BALL_TYPES[name].words, "limits": limits_words(name), **told})
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
    return (f"Drop test: no restitution at the tested speeds: {test.missing}.",) if test.missing else drop_lead(test)


def drop_lead(test: DropTest) -> tuple[str, ...]:
    """Restitution at each tested speed, the rebound from 254 cm, whether it passes as what type of ball."""
    lines, rebound = [], test.rebound
    for item in test.speeds:
        among = f" at {item.lowest:.2f} to {item.highest:.2f} m/s" if item.highest - item.lowest > 0.005 else ""
        drops, mean = ("drops", "mean ") if item.impacts > 1 else ("drop", "")
        counted = f"{item.impacts} {drops}{among}, measured {mean}{item.measured:.4f}"
        lines.append(f"COR at {item.speed:.2f} m/s: {valued(item.cor)}; {counted}.")
    if rebound is None:
        return tuple(lines)
    lines.append(
        f"Rebound from {CM * DROP_HEIGHT:.0f} cm (100 in; landing at {rebound.speed:.2f} m/s, v = sqrt(2 g h)): "
        f"{valued(rebound.height, CM, 'cm')}."
    )
    name = test.ball_type
    passing, kind = rebound.passing[name], BALL_TYPES[name]
    head = f"ITF {kind.words}, {limits_words(name)}"
    head += "" if test.type_stated else " (no type is stated: ball.type in the scene)"
    if passing.mean is None:
        where = "within" if kind.lowest <= rebound.height.point <= kind.highest else "outside of"
        said = f"the best value lies {where} the limits; without draws there is no probability"
    else:
        who = "rebound" if passing.ball is None else "ball"
        said = f"the mean {who} passes with probability {percent(passing.mean)}"
        if passing.ball is not None:
            said += f", another ball of the same make with {percent(passing.ball)}"
        if passing.drop is not None:
            said += f", one more measured drop lies within them with {percent(passing.drop)}"
    return (*lines, f"{head}: {said}.")


def drop_remarks(test: DropTest) -> tuple[str, ...]:
    """What the numbers rest on and what they leave out."""
    if test.missing:
        return ()
    rebound = test.rebound
    lines = [*([] if rebound is None else _reach(test, rebound)), *_ball_remarks(test)]
    lines += [] if rebound is None else [_air(test, rebound)]
    if test.shared_error:
        lines.append(
            "The stated error of v_y1 counts as another one in each drop. If it is the same in all (one height, one "
            f"gauge), restitutions are off by {significant(test.shared_error, 2)} (one sd) besides."
        )
    if rebound is None:
        return (*lines, "The ITF's drop from 254 cm and its limits are those of tennis balls, which this is not.")
    asked, warm = f"{TEST_TEMPERATURE:.0f} degrees Celsius", test.temperature
    if warm is None:
        lines.append(
            f"The ITF tests balls that lay at {asked}; no ball temperature is stated (ball.temperature in the scene)."
        )
    elif abs(warm - TEST_TEMPERATURE) <= 2.0:
        lines.append(f"The ball had {warm:g} degrees Celsius; the ITF's test asks for {asked}.")
    else:
        lines.append(f"The ball had {warm:g} degrees Celsius, but the ITF tests at {asked}; nothing is adjusted.")
    return (*lines, f"Limits: {SOURCE}.")


def _air(test: DropTest, rebound: StandardRebound) -> str:
    """What v = sqrt(2 g h) leaves out."""
    if test.from_heights:
        return (
            "Speeds are those of the heights without air, v = sqrt(2 g h): the rebound from 254 cm is what the "
            f"heights say; the restitution of the impact alone, with air drag (c_d = {DRAG_COEFFICIENT}), is some "
            f"{100.0 * rebound.air_share:.1f} % larger."
        )
    chance = rebound.passing_with_air
    passes = "" if chance is None else f"; it passes with probability {percent(chance)}"
    return (
        "v = sqrt(2 g h) leaves out the air. Rebound heights that were turned into speeds by it come out as they "
        f"were measured. If the speeds were measured at the floor, air drag (c_d = {DRAG_COEFFICIENT}) makes the "
        f"rebound from 254 cm {valued(rebound.with_air, CM, 'cm')}{passes}."
    )


def _reach(test: DropTest, rebound: StandardRebound) -> list[str]:
    """How far the landing speed from 254 cm lies from the tested ones, and what one speed cannot tell."""
    single = len(test.speeds) == 1
    if rebound.beyond:
        side = "above" if rebound.beyond > 0.0 else "below"
        how = "is known from priors alone" if single else "is the line through them, continued"
        return [
            f"The landing speed from 254 cm lies {abs(rebound.beyond):.2g} m/s {side} the tested ones: how "
            f"restitution changes with speed {how}."
        ]
    one = (
        "One speed tells the restitution there, not how it changes with speed: what is said of cor_10 and cor_slope "
        "rests on their priors."
    )
    return [one] * single


def _ball_remarks(test: DropTest) -> list[str]:
    found = test.variation
    if found is None:
        return ["No column says which ball was dropped: differences between balls count as measurement noise."]
    if found.between is None or found.within is None:
        return [f"Differences between balls are not told from measurement noise: {found.missing}."]
    lines = [
        f"COR differs between balls by one sd of {valued(found.between)}, between drops of one ball by "
        f"{valued(found.within)}; intervals take the {len(found.levels)} balls as a sample of their make."
    ]
    doubtful = [ball.label for ball in test.balls if ball.passes < SURE]
    if doubtful:
        told = ", ".join(doubtful[:8]) + (f" and {len(doubtful) - 8} more" if len(doubtful) > 8 else "")
        lines.append(f"Balls that pass with a probability below {percent(SURE)}: {told}.")
    return lines


def limits_words(name: str) -> str:
    """The limits of a type."""
    kind = BALL_TYPES[name]
    return f"{CM * kind.lowest:.0f} to {CM * kind.highest:.0f} cm"


def valued(spread: Spread, factor: float = 1.0, unit: str = "") -> str:
    """A number with its 95 % interval, rounded to what that supports."""
    value, ends = ranged(spread, factor)
    space = f" {unit}" if unit else ""
    return f"{value}{space} (best value)" if ends == "-" else f"{value}{space} {ends}{space} (95 %)"
