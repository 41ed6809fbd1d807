"""Does the model describe the data? Exact t tests of residuals, Bonferroni, nothing simulated.

Each test is of a pattern d in which residuals e would lie. With d~ what a refit leaves of it and f
degrees of freedom its share of the variance is r = (d~'e)^2/(|d~|^2 e'e), and t^2 = (f-1) r/(1-r):
the t test of one more column of a linear model, with a variance for each measured column. Each kind
has a share of the chance of a false alarm, divided among its tests.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from math import fsum
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import betainc, chdtrc, gammaln, ndtr, stdtr, stdtrit

from fitball.base.priors import parse_prior
from fitball.base.values import FloatArray, IntArray
from fitball.inference.density import cells
from fitball.inference.derived import Quantity
from fitball.inference.judgement import adequacy_words as words
from fitball.inference.judgement.first_order import FirstOrder, slopes_of_all
from fitball.inference.judgement.patterns import covariates, drifts, groups_of, slip_shape, trends
from fitball.inference.problem.camera import CAMERA_SPECS, LEVEL
from fitball.inference.problem.problem import Problem, base_of
from fitball.inference.schema import Adequacy, Answer, NoiseCheck, PointFit, ResidualTest

# Chance of a false objection, as usual.
EXCEPT = 0.05
# Chance of a false "does not describe": it condemns the model, and must be rarer than an objection.
FAILS = 0.01
# What a chance of a stated noise is multiplied by: these tests have two fifths of the chances.
OF_NOISE = 2.5
# What a chance of a pattern is multiplied by: these tests have three fifths of the chances.
OF_PATTERNS = 5.0 / 3.0
# Kinds of tests of patterns with their shares of these chances.
SHARES = {
    "trend": 0.25,
    "drift": 0.15,
    "bias": 0.1,
    "row": 0.1,
    "group": 0.1,
    "parameter": 0.1,
    "growth": 0.1,
    "outlier": 0.05,
    "linked": 0.05,
    "camera": 0.05,
    "law": 0.05,
}
# Kinds of patterns that are the model's own fault: they follow the state, or are in all rows.
SMOOTH = ("trend", "bias", "row", "drift")
# A pattern smaller than this, in noises, is no exception: it hides below what was measured.
SMALL = 0.1
# Share of the variance of a column from which a model fails that misses it: most of what deviates
# is then no noise.
HALF = 0.5
# A column is blind where a trend must explain more than this share of the variance to be found: a
# model that fails could go unnoticed.
BLIND = 0.6
# Parameters that wear, temperature and the court change from impact to impact.
WEARING = ("mu", "cor_10")
# Rows from which growth, links and outliers are tested: they need a noise that is known.
ENOUGH = 10
# Share of the square of a pattern that a refit must leave: what remains of less is rounding, and
# what the linearisation neglects.
LEFT = 0.02
# Correlation from which two patterns are one.
SAME = 0.98
# Ratio to a stated noise that is an exception: errors are rarely stated better.
WORSE = 1.2
# Ratio to a stated noise with which a model fails: nobody states errors that wrong.
FAR = 2.0
# Ratio to an expected noise that is an exception: it is known to a factor only.
EXPECTED = 3.0
# Power of the speed by which a noise may grow or shrink: errors of measurements have one or two.
STEEPEST = 4.0
# One in so many rows may be far off: with more of them nothing says which ones are.
FEWER = 6
# Rows that may be far off, at most: each takes a fit to all others.
MOST_FAR = 20
# Share of a variance that is taken for all of it: a ratio to the rest stays finite.
WHOLE = 1.0 - 1e-12
# Degrees of freedom that rounding leaves: a ratio to them stays finite.
ROUNDED = 1e-9
# Changes of friction by which its pattern is seen, a fifth either way: balls that grip begin to
# slide.
FRICTION = (0.8, 1.2)
# A chance below which its logarithm is not taken: it is smaller than any that is told apart.
NEVER = 1e-300


class _Residuals(NamedTuple):
    """Of a fit, long tables thinned: `even` are residuals (measurements,) in noises that they show
    themselves, `freedom` (columns,).
    """

    problem: Problem
    first: FirstOrder
    even: FloatArray
    freedom: FloatArray

    def of_measurements(self, cell_values: FloatArray) -> FloatArray:
        """Those of cells (impacts, columns) that were measured (measurements,)."""
        return np.asarray(cell_values[self.first.rows, self.first.column])

    @property
    def studentised(self) -> FloatArray:
        """Residuals (measurements,) over their own sds; zero where a refit leaves none."""
        variance = 1.0 - np.sum(self.first.basis**2, axis=1)
        studentised = self.even / np.sqrt(np.maximum(variance, LEFT))
        return np.where(variance > LEFT, studentised, 0.0)


class _Look(NamedTuple):
    """A test, its `p` alone or of all; root mean square `size` of the pattern in noises, its
    deviations, if any.
    """

    kind: str
    column: str
    pattern: str
    p: float
    explained: float = 0.0
    size: float = 1.0
    direction: FloatArray = np.empty(0)

    @property
    def found(self) -> bool:
        """Whether the pattern is an exception: surely there, and not small."""
        return self.p < EXCEPT and self.size >= SMALL


def adequacy(
    problem: Problem,
    point: PointFit,
    first: FirstOrder,
    derived: Sequence[Quantity] = (),
) -> Adequacy:
    """Test the residuals of a fit, and see what the patterns move, `derived` quantities too. Above
    LONG_ROWS those of `first`, which is thinned.
    """
    fit = _residuals(problem, first)
    alone = [
        *_patterns(fit),
        *_outliers(fit),
        *_growth(fit),
        *_linked(fit),
        *_camera(fit),
    ]
    looks = _among_all(alone)
    unseen = _unseen(fit, alone)
    noise = [*_noises(fit, point)]
    tests = tuple(
        ResidualTest(look.kind, look.column, look.pattern, look.p, look.explained, look.found)
        for look in looks
    )
    checks = tuple(check for check, _ in noise)
    # Of long tables patterns are sure that are no exception; they move what is known all the same.
    sure = [look.direction for look in looks if look.p < EXCEPT and look.direction.size]
    moved = dict[str, float]()
    if sure:
        along = slopes_of_all(problem, first, derived)
        shifts = np.abs(fit.first.shifts(np.stack(sure, axis=1), along))
        names = (*first.names, *(quantity.spec.name for quantity in derived))
        moved = dict(zip(names, shifts.max(axis=1).tolist(), strict=True))
    answer = _answer(fit, looks, noise, unseen)
    if answer == "undecided":
        text = _too_few(problem, fit, unseen)
    else:
        named = [test for test in tests if test.found]
        if answer == "describes":
            named = [test for test in tests if test.p < EXCEPT]
        text = words.described(answer, named, checks, moved, len(problem.rows.y))
    sentence = f"{text} {words.noises(checks)}".strip()
    return Adequacy(answer, sentence, tests, checks, moved, unseen)


def _among_all(alone: Sequence[_Look]) -> list[_Look]:
    """The tests, each with its chance among all of them, the surest first."""
    looks = []
    for look in alone:
        p = min(1.0, look.p * _times(alone, look.kind))
        looks.append(look._replace(p=p))
    return sorted(looks, key=lambda look: (look.p, -look.explained))


def _too_few(problem: Problem, fit: _Residuals, unseen: Mapping[str, float]) -> str:
    """That columns are blind, in words."""
    measured = np.isfinite(problem.rows.y).sum(axis=0).tolist()
    return words.too_few(
        {name: share for name, share in unseen.items() if share > BLIND},
        dict(zip(fit.first.columns, measured, strict=True)),
        alike=not covariates(fit.problem),
        impacts=len(problem.rows.y),
    )


def _residuals(problem: Problem, first: FirstOrder) -> _Residuals:
    """The residuals of a linearisation, over the noise that those of each column show."""
    impacts, rows = np.unique(first.rows, return_inverse=True)
    count = len(first.columns)
    variance = 1.0 - np.sum(first.basis**2, axis=1)
    freedom = np.maximum(np.bincount(first.column, variance, count), ROUNDED)
    square = np.bincount(first.column, first.residual**2, count)
    scale = np.sqrt(square / freedom)
    even = first.residual / np.where(scale > 0.0, scale, 1.0)[first.column]
    return _Residuals(problem.take(impacts), first._replace(rows=rows), even, freedom)


# --- patterns


def _patterns(fit: _Residuals) -> Iterator[_Look]:
    """The patterns that differ from parameters and from each other, each with its t test."""
    problem = fit.problem
    first = fit.first
    tested = list[FloatArray]()
    count = len(problem.rows.y)
    groups = list(groups_of(problem, first.proposal.centre))
    along_rows = list(drifts(problem))
    shapes = [
        *(("trend", text, shape) for text, shape in trends(problem)),
        ("bias", "bias in all rows", np.ones(count)),
        *(("row", text, shape) for text, shape in along_rows),
        *(("group", f"bias in {column} {label}", inside) for column, label, inside in groups),
    ]
    # A fitted slope of the restitution leaves nearly the same of a bias as of a bend.
    bent = "cor_slope" in map(base_of, first.names)
    for column in first.columns:
        for kind, text, shape in shapes:
            if kind == "bias" and column == "v_y2" and bent:
                text = f"{text}, or a bend over v_y1"
            direction = first.direction(column, shape)
            yield from _pattern(fit, kind, column, f"{column}: {text}", direction, tested)
    yield from _parameter_patterns(fit, along_rows, groups, tested)


def _parameter_patterns(
    fit: _Residuals,
    along_rows: Sequence[tuple[str, FloatArray]],
    groups: Sequence[tuple[str, str, FloatArray]],
    tested: list[FloatArray],
) -> Iterator[_Look]:
    """Patterns of parameters: wear along the rows, friction with the slip speed, groups."""
    problem = fit.problem
    first = fit.first
    pooled = {level.parameter for level in problem.forward.levels}
    for spec in problem.forward.model.parameters:
        parameter = spec.name
        levels = [k for k, name in enumerate(first.names) if base_of(name) == parameter]
        if not levels:
            continue
        slope = first.slopes[: first.residual.size, levels].sum(axis=1)
        if [first.names[k] for k in levels] == ["mu"]:
            slope = _friction(fit, slope)
        if parameter in WEARING:
            for text, shape in along_rows:
                direction = slope * shape[first.rows]
                text = f"{parameter}: {text}"
                yield from _pattern(fit, "drift", "", text, direction, tested)
        if parameter == "mu" and along_rows:
            direction = slope * slip_shape(problem)[first.rows]
            text = "mu: trend with the slip speed"
            yield from _pattern(fit, "law", "", text, direction, tested)
        if parameter in pooled:
            continue
        for label, level, inside in groups:
            if label != "regime":
                direction = slope * inside[first.rows]
                text = f"{parameter} differs for {label} {level} (--pool {parameter}={label})"
                yield from _pattern(fit, "parameter", "", text, direction, tested)


def _friction(fit: _Residuals, slope: FloatArray) -> FloatArray:
    """What a change of friction by a fifth either way does: balls that grip then begin to slide."""
    problem = fit.problem
    best = problem.prior.value(fit.first.proposal.centre[None])
    sides = np.repeat(best, 2, axis=0)
    sides[:, problem.free.index("mu")] *= FRICTION
    cell = cells(problem, problem.prior.coordinate(sides))
    if not cell.possible.all():
        return slope
    return fit.of_measurements(cell.z[0] - cell.z[1])


def _pattern(
    fit: _Residuals,
    kind: str,
    column: str,
    text: str,
    direction: FloatArray,
    tested: list[FloatArray],
) -> Iterator[_Look]:
    """The t test of a pattern `direction` (measurements,); none where a refit leaves too little of
    it, or where it is one that was `tested`, to which it is added.
    """
    first = fit.first
    after = first.after_refit(direction)
    before = float(np.linalg.norm(direction))
    length = float(np.linalg.norm(after))
    if before <= 0.0 or length**2 < LEFT * before**2:
        return
    unit = after / length
    # A refit spreads a pattern over columns, each of a noise that is known to its own degree (Welch
    # 1947).
    along = float(unit @ fit.even)
    weight = np.bincount(first.column, unit**2, fit.freedom.size)
    others = np.maximum(fit.freedom - weight, ROUNDED)
    freedom = float(1.0 / np.sum(weight**2 / others))
    if freedom <= 1.0:
        return
    if tested and float(np.abs(np.stack(tested) @ unit).max()) > SAME:
        return
    tested.append(unit)
    rest = np.bincount(first.column, (fit.even - unit * along) ** 2, fit.freedom.size)
    variance = float(np.sum(weight * rest / others))
    square = along**2 / max(variance, np.finfo(float).tiny)
    p = 2.0 * float(stdtr(freedom, -np.sqrt(square)))
    share = square / (square + freedom)
    # As many rows as a pattern has, in which it is large.
    rows = np.sum(direction**2) ** 2 / np.sum(direction**4)
    size = abs(along) / float(rows) ** 0.5
    scaled = direction * (float(unit @ first.residual) / length)
    yield _Look(kind, column, text, p, share, size, scaled)


def _camera(fit: _Residuals) -> Iterator[_Look]:
    """Settings of the camera that nobody stated, each with the size that would explain the
    residuals; only of what is between the flights, which film alone shows.
    """
    problem = fit.problem
    x = fit.first.proposal.centre[None]
    keys = () if problem.camera is None else problem.camera.keys
    if not any(item.column.gap for item in problem.observables):
        return
    for key, spec in CAMERA_SPECS.items():
        if key in keys or (key == "tilt" and not problem.forward.model.tangential):
            continue
        step = parse_prior(spec).width
        low = cells(problem.with_constant(key, LEVEL[key] - step), x)
        high = cells(problem.with_constant(key, LEVEL[key] + step), x)
        if not (low.possible.all() and high.possible.all()):
            continue
        direction = 0.5 * fit.of_measurements(low.z[0] - high.z[0])
        for look in _pattern(fit, "camera", "", "", direction, []):
            # The size of the pattern, in steps of it.
            steps = float(look.direction @ direction) / float(direction @ direction)
            yield look._replace(pattern=words.camera(key, LEVEL[key] + steps * step))


# --- other tests


def farthest(share: FloatArray, count: int, freedom: float) -> tuple[int, float]:
    """How many of the `count` residuals of a column lie farthest off together, and a bound on the
    chance that any so many have as large a share of the variance: looked at together they do not
    hide each other (Rosner 1983). `share` (k,) is that of the farthest 1, 2, ... of them.
    """
    k = np.arange(1, share.size + 1)
    ways = gammaln(count + 1) - gammaln(k + 1) - gammaln(count - k + 1)
    remaining = 1.0 - np.minimum(share, WHOLE)
    chance = betainc(0.5 * (freedom - k), 0.5 * k, remaining)
    logs = ways + np.log(np.maximum(chance, NEVER))
    best = int(np.argmin(logs))
    log_bound = min(logs[best] + np.log(k.size), 0.0)
    return best + 1, float(np.exp(log_bound))


def _outliers(fit: _Residuals) -> Iterator[_Look]:
    """The impacts of each column that are far off, by one test."""
    ids = fit.problem.table.labels["id"]
    studentised = fit.studentised
    for column_index, column in enumerate(fit.first.columns):
        freedom = float(fit.freedom[column_index])
        # Student's t allows them; in few rows a share of one column is none of its freedom, which
        # others take up.
        if freedom <= 2.0 or len(ids) < ENOUGH or fit.problem.forward.noise.parameters:
            continue
        measurements = np.flatnonzero(fit.first.column == column_index)
        order = measurements[np.argsort(-np.abs(studentised[measurements]))]
        most = np.clip(measurements.size // FEWER, 1, min(MOST_FAR, freedom - 1.0))
        shares = []
        deviations = []
        for k in range(1, int(most) + 1):
            share, deviation = _without(fit.first, order[:k], order[k:])
            shares.append(share)
            deviations.append(deviation)
        count, p = farthest(np.array(shares), measurements.size, freedom)
        far = order[:count]
        direction = np.zeros(fit.even.size)
        direction[far] = deviations[count - 1]
        text = words.outliers(column, [ids[row] for row in fit.first.rows[far]])
        yield _Look("outlier", column, text, p, direction=direction)


def _without(first: FirstOrder, far: IntArray, others: IntArray) -> tuple[float, FloatArray]:
    """The share of the variance of measurements of a column that those `far` off have, and how far
    off a fit to all but them has them (far,).
    """
    residual = first.residual[far]
    basis = first.basis[far]
    off = np.linalg.pinv(np.eye(far.size) - basis @ basis.T) @ residual
    of_others = first.residual[others] + first.basis[others] @ (basis.T @ off)
    taken = float(off @ residual)
    rest = float(of_others @ of_others)
    share = taken / (taken + rest) if rest > 0.0 else 0.0
    return share, np.asarray(off)


def _growth(fit: _Residuals) -> Iterator[_Look]:
    """Whether all noises grow as one power of the speed: the likelihood ratio (Harvey 1976) less
    what a fit takes.
    """
    speeds_differ = not {"v_1", "v_y1"}.isdisjoint(covariates(fit.problem))
    if len(fit.problem.rows.y) < ENOUGH or not speeds_differ:
        return
    column = fit.first.column
    speed, _ = fit.problem.rows.states.polar()
    along = np.log(speed)[fit.first.rows]
    count = np.bincount(column)
    mean = np.bincount(column, along) / count
    centred = along - mean[column]
    square = fit.studentised**2

    def misfit(power: float) -> float:
        """Twice minus the log likelihood of noises that grow by that power, but for a constant."""
        scaled = square * np.exp(-2.0 * power * centred)
        variance = np.bincount(column, scaled) / count
        return float(count @ np.log(variance))

    limits = (-STEEPEST, STEEPEST)
    power = float(minimize_scalar(misfit, bounds=limits, method="bounded").x)
    ratio = (misfit(0.0) - misfit(power)) * fit.freedom.sum() / column.size
    p = 2.0 * float(ndtr(-np.sqrt(max(ratio, 0.0))))
    verb = "increases" if power > 0.0 else "decreases"
    yield _Look("growth", "", f"the noise {verb} with v_1", p)


def _linked(fit: _Residuals) -> Iterator[_Look]:
    """Whether two columns deviate together, as they do where the incident state has errors."""
    first = fit.first
    for k, m in combinations(range(len(first.columns)), 2):
        of_k = np.flatnonzero(first.column == k)
        of_m = np.flatnonzero(first.column == m)
        both, i, j = np.intersect1d(first.rows[of_k], first.rows[of_m], return_indices=True)
        freedom = float(min(fit.freedom[k], fit.freedom[m]))
        if both.size < ENOUGH or freedom <= 2.0:
            continue
        a = fit.even[of_k[i]]
        b = fit.even[of_m[j]]
        share = min(float(a @ b) ** 2 / float((a @ a) * (b @ b)), WHOLE)
        square = share * (freedom - 1.0) / (1.0 - share)
        p = 2.0 * float(stdtr(freedom - 1.0, -np.sqrt(square)))
        text = f"{first.columns[k]} and {first.columns[m]} deviate together"
        yield _Look("linked", "", text, p)


def _times(looks: Sequence[_Look], kind: str) -> float:
    """How many times as probable any of the tests finds something as one of a kind alone."""
    kinds = [look.kind for look in looks]
    # A set has another order in each process: a plain sum would have other last digits.
    total = fsum(SHARES[name] for name in {*kinds})
    return OF_PATTERNS * kinds.count(kind) * total / SHARES[kind]


def _noises(fit: _Residuals, point: PointFit) -> Iterator[tuple[NoiseCheck, float]]:
    """The noise of each column, and how probable so large a one is, where all of it is stated."""
    parameters = {item.spec.name: item for item in fit.problem.parameters}
    for k, observable in enumerate(fit.problem.observables):
        in_column = fit.first.column == k
        freedom = float(fit.freedom[k])
        if freedom < 1.0:
            continue
        square = float(np.sum(fit.first.residual[in_column] ** 2))
        ratio = (square / freedom) ** 0.5
        scatter = point.optima[0][observable.noise]
        parameter = parameters[observable.noise]
        stated = parameter.fixed is not None
        p = 1.0
        if stated:
            reference = float(np.mean(fit.first.whitening[in_column, k] ** -2.0)) ** 0.5
            size = ratio * reference
            chance = float(chdtrc(freedom, square))
            p = min(1.0, OF_NOISE * len(fit.first.columns) * chance)
            exception = p < EXCEPT and ratio >= WORSE
        else:
            # Beside stated errors it is a scatter, and residuals are in units of both.
            size = scatter if observable.stated else ratio * scatter
            reference = float(parameter.prior.quantile(np.array([0.5]))[0])
            exception = size >= EXPECTED * reference
        check = NoiseCheck(
            observable.column.name,
            size,
            reference,
            stated,
            exception,
            beyond=observable.stated and not stated,
        )
        yield check, p


# --- the answer


def _unseen(fit: _Residuals, looks: Sequence[_Look]) -> dict[str, float]:
    """By column the share of the variance from which a trend is found as often as not."""
    shares = dict.fromkeys(fit.first.columns, 1.0)
    with_trend = {look.column for look in looks if look.kind == "trend"}
    for column, freedom in zip(fit.first.columns, fit.freedom.tolist(), strict=True):
        if column not in with_trend or freedom <= 2.0:
            continue
        p = 0.5 * EXCEPT / _times(looks, "trend")
        square = float(stdtrit(freedom - 1.0, p)) ** 2
        shares[column] = square / (square + freedom - 1.0)
    return shares


def _answer(
    fit: _Residuals,
    looks: Sequence[_Look],
    noise: Sequence[tuple[NoiseCheck, float]],
    unseen: Mapping[str, float],
) -> Answer:
    """The answer by the surest objection."""
    for check, p in noise:
        if check.stated and p < FAILS and check.size >= FAR * check.reference:
            return "does not describe"
    smooth = [look for look in looks if look.kind in SMOOTH]
    for look in smooth:
        if look.p < FAILS and _missed(fit, smooth, look) >= HALF:
            return "does not describe"
    if any(look.found for look in looks) or any(check.found for check, _ in noise):
        return "describes except"
    if any(share > BLIND for share in unseen.values()):
        return "undecided"
    return "describes"


def _missed(fit: _Residuals, smooth: Sequence[_Look], look: _Look) -> float:
    """The share of the variance of a column that the model misses: what one pattern explains, or
    all smooth ones of it together, beyond what as many meaningless ones would.
    """
    freedom = float(fit.freedom.sum())
    if look.column:
        freedom = float(fit.freedom[fit.first.columns.index(look.column)])
    units = []
    for pattern in smooth:
        if pattern.column == look.column:
            after = fit.first.after_refit(pattern.direction)
            units.append(after / np.linalg.norm(after))
    basis, sizes, _ = np.linalg.svd(np.stack(units, axis=1), full_matrices=False)
    basis = basis[:, sizes > LEFT * sizes[0]]
    rank = basis.shape[1]
    if freedom <= rank + 1.0:
        return look.explained
    square = float(np.sum((basis.T @ fit.even) ** 2))
    share = min(square / freedom, 1.0)
    together = 1.0 - (1.0 - share) * freedom / (freedom - rank)
    return float(max(look.explained, together))
