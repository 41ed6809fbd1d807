"""Drop tests by ITF TB 04/01 as measured, straight from the table. `report.lab` has the columns."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from fitball.base import air, itf
from fitball.base.prior_families import Prior
from fitball.base.values import DataFrame, FloatArray, IntArray
from fitball.data.kinematics import AnalyticArray, AnalyticColumns, velocity
from fitball.data.scene import Scene
from fitball.data.table import ImpactTable
from fitball.inference.effort import PREDICTION_DRAWS, Effort
from fitball.inference.problem.fall import DRAG_SPEC, fall_of
from fitball.uses.lab import (
    NO_PRIORS,
    groups_of,
    labels_of,
    prior_of_spread,
    with_errors,
    with_interval,
)
from fitball.uses.means import Means, means
from fitball.uses.outlying import outlying

# Landing speeds nearer to the next one than this share were meant to be the same.
SAME_SPEED = 0.03
# Settings of a machine: more speeds than so many are a range,
MOST_SPEEDS = 6
# unless each was repeated so often.
REPEATED = 3
# Share of the slowest landing speed of a setting over which its speeds may spread: one that spreads
# further is a range, too.
WIDEST_SETTING = 0.15
# Step of COR over which the change of a rebound is taken.
_STEP = 1e-4
# Share of the vertical speed below which a horizontal one is none.
_NO_MOTION = 1e-9
# The limits of balls hold on a smooth rigid surface: these words name one, and other surfaces are
# compared with it.
RIGID = re.compile(r"\b(concrete|granite|rigid|reference)\b", re.IGNORECASE)


def _restitution_of(columns: AnalyticColumns) -> AnalyticArray:
    """The vertical restitution (impacts,) of columns of a table."""
    return np.asarray(velocity(columns, "2")["v_y2"] / columns["v_y1"])


class Air(NamedTuple):
    """The air of drops: the `usual` braking [1/m] and `draws` (draws,) of it; whether all of v_y1
    and of v_y2 were heights, `dropped` and `risen`, or times of flights, `flown_in` and
    `flown_out`.
    """

    usual: float
    draws: FloatArray
    dropped: bool = False
    risen: bool = False
    flown_in: bool = False
    flown_out: bool = False

    @classmethod
    def of(cls, table: ImpactTable, scene: Scene) -> Air:
        """The air of a table's drops."""
        drag = scene.slow_drag()
        per_drag = air.braking_per_drag(scene.ball_value(), scene.air)
        fall = fall_of(table, scene)
        drags = drag.value + drag.sd * Effort().stream("drag").standard_normal(PREDICTION_DRAWS)
        through = cls(drag.value * per_drag, np.maximum(drags, DRAG_SPEC.lower) * per_drag)
        if fall is None:
            return through
        return through._replace(
            dropped=bool(fall.dropped.all()),
            risen=bool(fall.risen.all()),
            flown_in=bool(fall.flown_in.all()),
            flown_out=bool(fall.flown_out.all()),
        )

    @property
    def test_speed(self) -> float:
        """Landing speed [m/s] of the drop of TB 04/01."""
        return float(air.landing_speed(itf.DROP_HEIGHT, self.usual))

    def rebound(self, cor: float) -> float:
        """Rebound [m] of that drop by a COR, at the usual braking."""
        return float(air.rebound_height(cor * self.test_speed, self.usual))

    def restitution(self, rebound: float) -> float:
        """The COR of a drop of the test that rebounds to a height [m], at the usual braking."""
        return float(air.launch_speed(rebound, self.usual) / self.test_speed)

    def rebounds(self, cor: FloatArray) -> FloatArray:
        """Rebounds [m] of that drop by draws (draws,) of COR, with the error of the drag."""
        return self.rebounds_at(cor, self.draws[: len(cor)])

    def rebounds_at(self, cor: FloatArray, braking: FloatArray) -> FloatArray:
        """Rebounds [m] of that drop by COR (draws,) and a braking [1/m] (draws,), on which they do
        not depend where both ends were heights.
        """
        if self.dropped and self.risen:
            return air.rebound_height(cor * self.test_speed, self.usual)
        landing = air.landing_speed(itf.DROP_HEIGHT, braking)
        return air.rebound_height(cor * landing, braking)

    def restitutions(self, cor: FloatArray, speed: float) -> FloatArray:
        """Draws of COR (draws,) at a landing speed [m/s] with the error of the drag, which all
        heights and times share.
        """
        return self.restitutions_at(cor, speed, self.draws[: len(cor)])

    def restitutions_at(self, cor: FloatArray, speed: float, braking: FloatArray) -> FloatArray:
        """COR (draws,) at a landing speed [m/s] by those at the usual braking, if the braking [1/m]
        (draws,) of heights and times is another.
        """
        before = np.full(len(cor), speed)
        after = cor * speed
        if self.dropped:
            before = air.landing_speed(air.drop_height(before, self.usual), braking)
        if self.flown_in:
            before = air.landing_of_same_time(before, self.usual, braking)
        if self.risen:
            after = air.launch_speed(air.rebound_height(after, self.usual), braking)
        if self.flown_out:
            after = air.launch_of_same_time(after, self.usual, braking)
        return np.asarray(after / before)


class Drops(NamedTuple):
    """The drops on a `surface`: landing `speeds` [m/s], `cor` with stated errors `sds` (drops,),
    names of balls and the `ball` (drops,) among them; the `means` of COR at a `speed`, that of the
    test if it is among the speeds, or as near to a range of them as they are to each other;
    `judged`: whether these are balls of their type at that speed, whose rebounds are limited.
    """

    surface: str
    speeds: FloatArray
    cor: FloatArray
    sds: FloatArray
    names: list[str]
    ball: IntArray
    speed: float
    means: Means
    judged: bool
    air: Air


class Restitution(NamedTuple):
    """A COR of the drop test: `kind` of row, `label` of a ball, how many `drops`, landing `speed`
    [m/s]; `cor` with `draws` (draws,), which may be none.
    """

    kind: str
    label: str
    drops: float
    speed: float
    cor: float
    draws: FloatArray


def _drops_on(
    surface: str,
    table: ImpactTable,
    rows: IntArray,
    cor: FloatArray,
    sds: FloatArray,
    of_type: bool,
    prior: Prior,
    rng: np.random.Generator,
    through: Air,
) -> Drops:
    """The drops of these rows of a table `through` air, with `cor` and its stated errors `sds`
    (impacts,); `of_type`: mass and size are those of the type of the ball.
    """
    speeds = table.impacts.v_y1[rows]
    test = through.test_speed
    settings = _settings(speeds)
    slowest = speeds.min() * (1.0 - SAME_SPEED)
    fastest = speeds.max() * (1.0 + SAME_SPEED)
    if not settings:
        # The line of a range leads on by as much as from drop to drop.
        spacing = np.ptp(speeds) / (len(speeds) - 1)
        slowest = min(slowest, speeds.min() - spacing)
        fastest = max(fastest, speeds.max() + spacing)
    near = slowest <= test <= fastest
    speed = test if near else float(np.median(speeds))
    names, ball = groups_of(labels_of(table, "ball"), rows)
    away = np.zeros(len(rows))
    if len(settings) != 1:
        away = speeds - speed
    return Drops(
        surface=surface,
        speeds=speeds,
        cor=cor[rows],
        sds=sds[rows],
        names=names,
        ball=ball,
        speed=speed,
        means=means(cor[rows], ball, prior, rng, away, sds[rows]).within(0.0, 1.0, rng),
        judged=of_type and near,
        air=through,
    )


def _settings(speeds: FloatArray) -> list[IntArray]:
    """Which drops have each tested speed, by their landing speeds (drops,); none of a range."""
    order = np.argsort(speeds, kind="stable")
    ascending = speeds[order]
    gaps = np.diff(ascending) > SAME_SPEED * ascending[:-1]
    settings = np.split(order, np.flatnonzero(gaps) + 1)
    fewest = min(map(len, settings), default=0)
    if len(settings) > MOST_SPEEDS and fewest < REPEATED:
        return []
    for drops in settings:
        if np.ptp(speeds[drops]) > WIDEST_SETTING * speeds[drops].min():
            return []
    return settings


def _restitutions(test: Drops, prior: Prior, rng: np.random.Generator) -> Iterator[Restitution]:
    """The COR of all drops on a surface, of another ball, of each ball, at each tested speed."""
    cor = test.means
    yield Restitution("mean", "", len(test.cor), test.speed, cor.point, cor.mean)
    if cor.another.size:
        point = float(np.median(cor.another))
        yield Restitution("another", "", np.nan, test.speed, point, cor.another)
    for k, level in enumerate(cor.levels.tolist() if test.ball.any() else []):
        count = int(np.sum(test.ball == k))
        # Balls dropped once are no better known than by their drop.
        draws = cor.each[k] if len(cor.each) else cor.mean[:0]
        point = float(np.median(draws)) if draws.size else level
        yield Restitution("ball", test.names[k], count, test.speed, point, draws)
    settings = _settings(test.speeds)
    if len(settings) < 2:
        return
    for drops in settings:
        if len(drops) > 1:
            _, ball = np.unique(test.ball[drops], return_inverse=True)
            still = np.zeros(len(drops))
            here = means(test.cor[drops], ball, prior, rng, still, test.sds[drops])
            here = here.within(0.0, 1.0, rng)
            speed = float(test.speeds[drops].mean())
            yield Restitution("speed", "", len(drops), speed, here.point, here.mean)


def _drop_row(
    test: Drops,
    reference: Drops | None,
    limits: tuple[float, float],
    surface: str,
    restitution: Restitution,
) -> dict[str, object]:
    """A row of the drop test: a COR of a `test`, beside that on the `reference` surface; rebounds
    within `limits` [m] pass.
    """
    kind, label, drops, speed, cor, draws = restitution
    low, high = limits
    rigid = not test.surface or RIGID.search(test.surface) is not None
    rebound = np.nan
    heights = draws[:0]
    if test.judged and kind != "speed":
        rebound = test.air.rebound(cor)
        heights = test.air.rebounds(draws)
    passes = np.nan
    if heights.size and rigid:
        passes = float(np.mean((low <= heights) & (heights <= high)))
    ratio = np.nan
    ratios = draws[:0]
    if kind == "mean" and reference is not None and reference is not test:
        ratio, ratios = _ratio(test, reference)
    return {
        "kind": kind,
        "surface": surface,
        "label": label,
        "drops": drops,
        "speed": speed,
        **with_interval("cor", cor, test.air.restitutions(draws, speed)),
        **with_interval("rebound", rebound, heights),
        "passes": passes,
        **with_interval("ratio", ratio, ratios),
        **_of_balls(test, limits, kind, label),
    }


def _ratio(test: Drops, reference: Drops) -> tuple[float, FloatArray]:
    """The rebound height over that on the `reference` surface, and draws (draws,) of it, both from
    the drop of the test; NaN where speeds differ.
    """
    there = reference.means
    none = there.mean[:0]
    if abs(test.speed / reference.speed - 1.0) > SAME_SPEED:
        return np.nan, none
    braking = test.air.usual

    def height(cor: FloatArray | float) -> FloatArray:
        """Rebound heights [m] of restitutions."""
        return air.rebound_height(np.multiply(cor, test.speed), braking)

    ratio = float(height(test.means.point) / height(there.point))
    if not (test.means.mean.size and there.mean.size):
        return ratio, none
    return ratio, np.asarray(height(test.means.mean) / height(there.mean))


def _of_balls(
    test: Drops,
    limits: tuple[float, float],
    kind: str,
    label: str,
) -> dict[str, object]:
    """Cells on how balls differ: of the mean their number, the sds of balls and of repeats, and
    whether they `agree`; of a ball whether it is `outlying`.
    """
    apart = outlying(test.means.levels) if test.ball.any() else np.zeros(1, np.bool_)
    is_apart = kind == "ball" and bool(apart[test.names.index(label)])
    cells: dict[str, object] = {"outlying": is_apart}
    if kind != "mean":
        none = test.means.mean[:0]
        rest: dict[str, object] = {"balls": np.nan, "agree": True, "by_chance": np.nan}
        for name in ("sd_balls", "sd_repeats"):
            rest |= with_interval(name, np.nan, none)
        return {**rest, **cells}
    # By one of COR rebounds change by so much [m].
    per_cor = 1.0
    if test.judged:
        low, high = (test.air.rebound(test.means.point + side * _STEP) for side in (-1.0, 1.0))
        per_cor = (high - low) / (2.0 * _STEP)
    for name, draws in (("sd_balls", test.means.between), ("sd_repeats", test.means.repeats)):
        sds = per_cor * draws
        cells |= with_interval(name, float(np.median(sds)) if sds.size else np.nan, sds)
    usual = [test.air.restitution(height) for height in limits]
    alike = test.means.levels[~apart] if test.ball.any() else test.means.levels
    return {
        "balls": len(test.names) if test.ball.any() else 1,
        "agree": bool(np.ptp(alike) <= usual[1] - usual[0]),
        "by_chance": test.means.by_chance,
        **cells,
    }


def drops_of(
    table: ImpactTable,
    scene: Scene,
    priors: Mapping[str, str] = NO_PRIORS,
) -> list[tuple[Drops, list[Restitution]]]:
    """The drops on each surface with what they say of its restitution; none where balls were not
    dropped. Raises ParameterError as `drop_test` does.
    """
    v_y2 = velocity(table.values, "2").get("v_y2")
    impacts = table.impacts
    if v_y2 is None or table.has_tangential:
        return []
    if np.any(np.abs(impacts.v_x1) > _NO_MOTION * impacts.v_y1):
        return []
    prior = prior_of_spread("cor_10_spread", "ball", scene, priors)
    rng = Effort().stream("drops")
    of_type = itf.is_ball_of_type(scene.ball_value(), scene.ball_type())
    rebounded = np.flatnonzero(np.isfinite(v_y2))
    names, surface = groups_of(labels_of(table, "surface"), rebounded)
    cor, sds = with_errors(table, _restitution_of)
    through = Air.of(table, scene)
    tests = list[Drops]()
    for k, name in enumerate(names):
        title = name or str(scene.surface.get("name", ""))
        drops = rebounded[surface == k]
        tests.append(_drops_on(title, table, drops, cor, sds, of_type, prior, rng, through))
    return [(test, list(_restitutions(test, prior, rng))) for test in tests]


def drop_test(
    table: ImpactTable,
    scene: Scene,
    priors: Mapping[str, str] = NO_PRIORS,
) -> DataFrame:
    """Drops by ITF TB 04/01: of each surface a row a tested speed, ball, the mean and another ball
    of the make: COR, rebound from 254 cm [m], chance to pass as the type of the scene's ball, ratio
    of rebounds to the reference surface, sds of balls and repeats, balls that are outlying. Balls
    are a hierarchy whose spread has the prior `cor_10_spread`. They agree where, without outlying
    ones, they differ by no more than balls of one type may. Empty where balls were not dropped.

    Raises:
        ParameterError: the prior of `cor_10_spread` cannot be read (`prior`, `unknown-key`).
    """
    import pandas as pd

    limits = itf.BALL_TYPES[scene.ball_type()]
    found = drops_of(table, scene, priors)
    reference = next((test for test, _ in found if RIGID.search(test.surface)), None)
    rows = [
        _drop_row(test, reference, limits, test.surface if len(found) > 1 else "", restitution)
        for test, restitutions in found
        for restitution in restitutions
    ]
    ends = ("", "_q025", "_q975")
    lead = ["kind", "surface", "label", "drops", "speed"]
    results = [f"{name}{end}" for name in ("cor", "rebound") for end in ends]
    ratio = [f"ratio{end}" for end in ends]
    of_balls = [f"{name}{end}" for name in ("sd_balls", "sd_repeats") for end in ends]
    of_balls = ["balls", "agree", "by_chance", *of_balls, "outlying"]
    return pd.DataFrame(rows, columns=[*lead, *results, "passes", *ratio, *of_balls])
