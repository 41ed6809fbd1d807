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
from fitball.base.values import FloatArray
from fitball.inference.density import cells
from fitball.inference.derived import Quantity
from fitball.inference.judgement import adequacy_words as words
from fitball.inference.judgement.first_order import FirstOrder, slopes_of_all
from fitball.inference.problem.camera import CAMERA_SPECS, LEVEL
from fitball.inference.problem.problem import Problem, base_of
from fitball.inference.schema import Adequacy, Answer, NoiseCheck, PointFit, ResidualTest
from fitball.models.types import regime_name

# Chances of a false objection, and of a false "does not describe"; stated noises have two fifths of
# them, patterns three.
EXCEPT = 0.05
FAILS = 0.01
OF_NOISE = 2.5
OF_PATTERNS = 5.0 / 3.0
# Kinds of tests with their shares; the `SMOOTH` ones are the model's own fault.
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
SMOOTH = ("trend", "bias", "row", "drift")
# A pattern smaller than this, in noises, is no exception; a model that misses HALF of the variance
# fails; a column is BLIND where a trend must explain more than that to be found.
SMALL = 0.1
HALF = 0.5
BLIND = 0.6
# What wear, temperature and the court change from impact to impact.
WEARING = ("mu", "cor_10")
# Rows that a bend or a drift takes, of a group, of growth, links and outliers; labels at most; the
# share of a pattern that a refit must leave; correlation from which patterns are one.
BENDS = 7
GROUP = 3
ENOUGH = 10
GROUPS = 40
LEFT = 0.02
SAME = 0.98
# The ratio to a stated noise that is an exception, that with which a model fails; to an expected
# one.
WORSE = 1.2
FAR = 2.0
EXPECTED = 3.0
# Power of the speed by which a noise may grow; one in how many rows may be far off, and at most;
# share of a variance that is not all; freedom that rounding leaves.
STEEPEST = 4.0
FEWER = 6
MOST_FAR = 20
WHOLE = 1.0 - 1e-12
ROUNDED = 1e-9


class _Residuals(NamedTuple):
    """Of a fit, long tables thinned: `even` are residuals (measurements,) in noises that they show
    themselves, `freedom` (columns,).
    """

    problem: Problem
    first: FirstOrder
    even: FloatArray
    freedom: FloatArray

    @property
    def studentised(self) -> FloatArray:
        """Residuals (measurements,) over their own sds; zero where a refit leaves none."""
        left = 1.0 - np.sum(self.first.basis**2, axis=1)
        return np.where(left > LEFT, self.even / np.sqrt(np.maximum(left, LEFT)), 0.0)


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
        return self.p < EXCEPT and self.size >= SMALL


def adequacy(
    problem: Problem,
    point: PointFit,
    first: FirstOrder,
    derived: Sequence[Quantity] = (),
) -> Adequacy:
    """Test the residuals of a fit, and see what the patterns move, `derived` quantities too. Above
    LONG rows those of `first`, which is thinned.
    """
    fit = _residuals(problem, first)
    alone = [*_patterns(fit), *_outliers(fit), *_growth(fit), *_linked(fit), *_camera(fit)]
    # Each with its chance among all of them, the surest first.
    fair = [one._replace(p=min(1.0, one.p * _times(alone, one.kind))) for one in alone]
    looks = sorted(fair, key=lambda one: (one.p, -one.explained))
    unseen = _unseen(fit, alone)
    noise = [*_noises(fit, point)]
    # Of long tables patterns are sure that are no exception; they move what is known all the same.
    moving = [one.direction for one in looks if one.p < EXCEPT and one.direction.size]
    moved = dict[str, float]()
    if moving:
        moves = fit.first.shifts(np.stack(moving, axis=1), slopes_of_all(problem, first, derived))
        names = (*first.names, *(one.spec.name for one in derived))
        moved = dict(zip(names, np.abs(moves).max(axis=1).tolist(), strict=True))
    tests = tuple(
        ResidualTest(one.kind, one.column, one.pattern, one.p, one.explained, one.found)
        for one in looks
    )
    checks = tuple(check for check, _ in noise)
    answer = _answer(fit, looks, noise, unseen)
    if answer == "undecided":
        counts = {
            name: int(np.isfinite(problem.rows.y[:, k]).sum())
            for k, name in enumerate(first.columns)
        }
        blind = {name: share for name, share in unseen.items() if share > BLIND}
        text = words.too_few(
            blind,
            counts,
            alike=not _covariates(fit.problem),
            impacts=len(problem.rows.y),
        )
    else:
        sure = [
            test for test in tests if (test.p < EXCEPT if answer == "describes" else test.found)
        ]
        text = words.described(answer, sure, checks, moved, len(problem.rows.y))
    return Adequacy(answer, f"{text} {words.noises(checks)}".strip(), tests, checks, moved, unseen)


def _residuals(problem: Problem, first: FirstOrder) -> _Residuals:
    kept, rows = np.unique(first.rows, return_inverse=True)
    count = len(first.columns)
    freedom = np.maximum(
        np.bincount(first.column, 1.0 - np.sum(first.basis**2, axis=1), count),
        ROUNDED,
    )
    scale = np.sqrt(np.bincount(first.column, first.residual**2, count) / freedom)
    even = first.residual / np.where(scale > 0.0, scale, 1.0)[first.column]
    return _Residuals(problem.take(kept), first._replace(rows=rows), even, freedom)


# --- patterns: what could be off


def _covariates(problem: Problem) -> dict[str, FloatArray]:
    """The incident state of each impact by name, (impacts,), where it differs between impacts."""
    given = problem.rows.states
    known = {"v_y1": given.v_y1}
    if problem.forward.model.tangential:
        speed, angle = given.polar()
        known = {"theta_1": angle, "v_1": speed, "omega_1": given.omega_1}
    # Beyond rounding of units.
    return {name: one for name, one in known.items() if np.ptp(one) > 1e-9 * np.abs(one).max()}


def _trends(problem: Problem) -> Iterator[tuple[str, FloatArray]]:
    """Lines, bends and products of the incident state (impacts,), each without those before it."""
    count = len(problem.rows.y)
    straight = dict[str, FloatArray]()
    for name, values in _covariates(problem).items():
        scaled = (values - values.mean()) / np.ptp(values)
        degree = min(np.unique(scaled.round(6)).size - 1, 1 + (count >= BENDS))
        powers = np.linalg.qr(np.vander(scaled, degree + 1, increasing=True))[0]
        straight[name] = powers[:, 1]
        yield from (
            (f"{'curved ' * (k > 1)}trend with {name}", powers[:, k]) for k in range(1, degree + 1)
        )
    for one, other in combinations(straight, 2) if count >= 2 * BENDS else ():
        yield f"interaction of {one} and {other}", straight[one] * straight[other]


def _groups(fit: _Residuals) -> Iterator[tuple[str, str, FloatArray]]:
    """Column and label of each group, and which impacts are in it; kinds of contact too. Empty
    cells are no group.
    """
    labels = {
        name: np.array(texts) for name, texts in fit.problem.table.labels.items() if name != "id"
    }
    if fit.problem.forward.model.tangential:
        best = fit.problem.values(fit.first.proposal.centre[None])
        codes, which = np.unique(fit.problem.seen(best).regime[0], return_inverse=True)
        labels["regime"] = np.array([regime_name(int(code)) for code in codes])[which]
    for column, texts in labels.items():
        names, sizes = np.unique(texts, return_counts=True)
        for name, size in zip(names, sizes, strict=True) if 2 <= names.size <= GROUPS else ():
            if name and GROUP <= size <= texts.size - GROUP:
                yield column, str(name), (texts == name).astype(np.float64)


def _patterns(fit: _Residuals) -> Iterator[_Look]:
    """The patterns that differ from parameters and from each other, each with its t test."""
    problem = fit.problem
    first = fit.first
    kept = list[FloatArray]()
    count = len(problem.rows.y)
    groups = list(_groups(fit))
    row = (
        [("drift along the rows", np.arange(float(count)) - 0.5 * (count - 1))]
        if count >= BENDS
        else []
    )
    single = [
        *(("trend", text, shape) for text, shape in _trends(problem)),
        ("bias", "bias in all rows", np.ones(count)),
        *(("row", text, shape) for text, shape in row),
        *(("group", f"bias in {column} {label}", inside) for column, label, inside in groups),
    ]
    # A fitted slope of the restitution leaves nearly the same of a bias as of a bend.
    bent = "cor_slope" in map(base_of, first.names)
    for column in first.columns:
        for kind, text, shape in single:
            if kind == "bias" and column == "v_y2" and bent:
                text = f"{text}, or a bend over v_y1"
            yield from _pattern(
                fit,
                kind,
                column,
                f"{column}: {text}",
                first.direction(column, shape),
                kept,
            )
    yield from _parameter_patterns(fit, row, groups, kept)


def _parameter_patterns(
    fit: _Residuals,
    row: Sequence[tuple[str, FloatArray]],
    groups: Sequence[tuple[str, str, FloatArray]],
    kept: list[FloatArray],
) -> Iterator[_Look]:
    """Patterns of parameters: wear along the rows, friction with the slip speed, groups."""
    problem = fit.problem
    first = fit.first
    levels = {level.parameter for level in problem.forward.levels}
    for spec in problem.forward.model.parameters:
        mine = [k for k, name in enumerate(first.names) if base_of(name) == spec.name]
        if not mine:
            continue
        slope = first.slopes[: first.residual.size, mine].sum(axis=1)
        if [first.names[k] for k in mine] == ["mu"]:
            slope = _friction(fit, slope)
        for text, shape in row if spec.name in WEARING else ():
            yield from _pattern(
                fit,
                "drift",
                "",
                f"{spec.name}: {text}",
                slope * shape[first.rows],
                kept,
            )
        if spec.name == "mu" and row:
            given = problem.rows.states
            root = np.sqrt(np.abs(given.v_x1 - problem.forward.model.ball.radius * given.omega_1))
            shape = (root - root.mean())[first.rows]
            yield from _pattern(
                fit,
                "law",
                "",
                "mu: trend with the slip speed",
                slope * shape,
                kept,
            )
        for label, level, inside in groups if spec.name not in levels else ():
            if label != "regime":
                text = f"{spec.name} differs for {label} {level} (--pool {spec.name}={label})"
                yield from _pattern(fit, "parameter", "", text, slope * inside[first.rows], kept)


def _friction(fit: _Residuals, slope: FloatArray) -> FloatArray:
    """What a change of friction by a fifth either way does: balls that grip then begin to slide."""
    k = fit.problem.free.index("mu")
    at = np.repeat(fit.problem.prior.value(fit.first.proposal.centre[None]), 2, axis=0)
    at[:, k] *= (0.8, 1.2)
    made = cells(fit.problem, fit.problem.prior.coordinate(at))
    return (
        (made.z[0] - made.z[1])[fit.first.rows, fit.first.column] if made.possible.all() else slope
    )


def _pattern(
    fit: _Residuals,
    kind: str,
    column: str,
    text: str,
    direction: FloatArray,
    kept: list[FloatArray],
) -> Iterator[_Look]:
    left = fit.first.after_refit(direction)
    whole = float(np.linalg.norm(direction))
    length = float(np.linalg.norm(left))
    if whole <= 0.0 or length**2 < LEFT * whole**2:
        return
    left = left / length
    # A refit spreads a pattern over columns, each of a noise that is known to its own degree (Welch
    # 1947).
    along = float(left @ fit.even)
    parts = np.bincount(fit.first.column, left**2, fit.freedom.size)
    others = np.maximum(fit.freedom - parts, ROUNDED)
    freedom = float(1.0 / np.sum(parts**2 / others))
    if freedom <= 1.0 or (kept and float(np.abs(np.stack(kept) @ left).max()) > SAME):
        return
    kept.append(left)
    rest = np.bincount(fit.first.column, (fit.even - left * along) ** 2, fit.freedom.size)
    square = along**2 / max(float(np.sum(parts * rest / others)), np.finfo(float).tiny)
    p = 2.0 * float(stdtr(freedom, -np.sqrt(square)))
    share = square / (square + freedom)
    # As many rows as a pattern has, in which it is large.
    rows = np.sum(direction**2) ** 2 / np.sum(direction**4)
    scaled = direction * (float(left @ fit.first.residual) / length)
    yield _Look(kind, column, text, p, share, abs(along) / float(rows) ** 0.5, scaled)


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
        sides = [cells(problem.holding(key, LEVEL[key] + one), x) for one in (-step, step)]
        if all(one.possible.all() for one in sides):
            direction = 0.5 * (sides[0].z[0] - sides[1].z[0])[fit.first.rows, fit.first.column]
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
    logs = ways + np.log(
        np.maximum(betainc(0.5 * (freedom - k), 0.5 * k, 1.0 - np.minimum(share, WHOLE)), 1e-300)
    )
    best = int(np.argmin(logs))
    return best + 1, float(np.exp(min(logs[best] + np.log(k.size), 0.0)))


def _outliers(fit: _Residuals) -> Iterator[_Look]:
    first = fit.first
    ids = fit.problem.table.labels["id"]
    studentised = fit.studentised
    for place, column in enumerate(first.columns):
        freedom = float(fit.freedom[place])
        # Student's t allows them; in few rows a share of one column is none of its freedom, which
        # others take up.
        if freedom <= 2.0 or len(ids) < ENOUGH or fit.problem.forward.noise.parameters:
            continue
        own = np.flatnonzero(first.column == place)
        order = own[np.argsort(-np.abs(studentised[own]))]
        shares = []
        fits = []
        for k in range(1, int(np.clip(own.size // FEWER, 1, min(MOST_FAR, freedom - 1.0))) + 1):
            far = order[:k]
            others = order[k:]
            basis = first.basis[far]
            # How far a fit to all others has them off, and what it leaves of these.
            off = np.linalg.pinv(np.eye(k) - basis @ basis.T) @ first.residual[far]
            left = first.residual[others] + first.basis[others] @ (basis.T @ off)
            taken = float(off @ first.residual[far])
            whole = float(left @ left)
            shares.append(taken / (taken + whole) if whole > 0.0 else 0.0)
            fits.append(off)
        count, p = farthest(np.array(shares), own.size, freedom)
        far = order[:count]
        direction = np.zeros(fit.even.size)
        direction[far] = fits[count - 1]
        yield _Look(
            "outlier",
            column,
            words.outliers(column, [ids[k] for k in first.rows[far]]),
            p,
            direction=direction,
        )


def _growth(fit: _Residuals) -> Iterator[_Look]:
    """Whether all noises grow as one power of the speed: the likelihood ratio (Harvey 1976) less
    what a fit takes.
    """
    if len(fit.problem.rows.y) < ENOUGH or not {"v_1", "v_y1"} & {*_covariates(fit.problem)}:
        return
    column = fit.first.column
    along = np.log(fit.problem.rows.states.polar()[0])[fit.first.rows]
    count = np.bincount(column)
    centred = along - (np.bincount(column, along) / count)[column]
    square = fit.studentised**2

    def misfit(power: float) -> float:
        return float(
            count @ np.log(np.bincount(column, square * np.exp(-2.0 * power * centred)) / count)
        )

    power = float(minimize_scalar(misfit, bounds=(-STEEPEST, STEEPEST), method="bounded").x)
    ratio = (misfit(0.0) - misfit(power)) * fit.freedom.sum() / column.size
    text = f"the noise {'in' if power > 0.0 else 'de'}creases with v_1"
    yield _Look("growth", "", text, 2.0 * float(ndtr(-np.sqrt(max(ratio, 0.0)))))


def _linked(fit: _Residuals) -> Iterator[_Look]:
    """Whether two columns deviate together, as they do where the incident state has errors."""
    first = fit.first
    for one, other in combinations(range(len(first.columns)), 2):
        mine, its = (np.flatnonzero(first.column == k) for k in (one, other))
        both, i, j = np.intersect1d(first.rows[mine], first.rows[its], return_indices=True)
        freedom = float(min(fit.freedom[one], fit.freedom[other]))
        if both.size >= ENOUGH and freedom > 2.0:
            a = fit.even[mine[i]]
            b = fit.even[its[j]]
            share = min(float(a @ b) ** 2 / float((a @ a) * (b @ b)), WHOLE)
            p = 2.0 * float(stdtr(freedom - 1.0, -np.sqrt(share * (freedom - 1.0) / (1.0 - share))))
            yield _Look(
                "linked",
                "",
                f"{first.columns[one]} and {first.columns[other]} deviate together",
                p,
            )


def _times(looks: Sequence[_Look], kind: str) -> float:
    """How many times as probable any of the tests finds something as one of a kind alone."""
    kinds = [one.kind for one in looks]
    # A set has another order in each process: a plain sum would have other last digits.
    return OF_PATTERNS * kinds.count(kind) * fsum(SHARES[name] for name in {*kinds}) / SHARES[kind]


def _noises(fit: _Residuals, point: PointFit) -> Iterator[tuple[NoiseCheck, float]]:
    """The noise of each column, and how probable so large a one is, where all of it is stated."""
    known = {item.spec.name: item for item in fit.problem.parameters}
    for k, item in enumerate(fit.problem.observables):
        own = fit.first.column == k
        freedom = float(fit.freedom[k])
        if freedom < 1.0:
            continue
        square = float(np.sum(fit.first.residual[own] ** 2))
        parameter = known[item.noise]
        ratio = (square / freedom) ** 0.5
        scatter = point.optima[0][item.noise]
        if parameter.fixed is not None:
            reference = float(np.mean(fit.first.whitening[own, k] ** -2.0)) ** 0.5
            p = min(1.0, OF_NOISE * len(fit.first.columns) * float(chdtrc(freedom, square)))
            found = p < EXCEPT and ratio >= WORSE
            yield (
                NoiseCheck(
                    item.column.name,
                    ratio * reference,
                    reference,
                    stated=True,
                    found=found,
                ),
                p,
            )
        else:
            # Beside stated errors it is a scatter, and residuals are in units of both.
            size = scatter if item.stated else ratio * scatter
            reference = float(parameter.prior.quantile(np.array([0.5]))[0])
            found = size >= EXPECTED * reference
            check = NoiseCheck(
                item.column.name,
                size,
                reference,
                stated=False,
                found=found,
                beyond=item.stated,
            )
            yield check, 1.0


# --- the answer


def _unseen(fit: _Residuals, looks: Sequence[_Look]) -> dict[str, float]:
    """By column the share of the variance from which a trend is found as often as not."""
    shares = dict.fromkeys(fit.first.columns, 1.0)
    for column, whole in zip(fit.first.columns, fit.freedom.tolist(), strict=True):
        if any(one.kind == "trend" and one.column == column for one in looks) and whole > 2.0:
            square = float(stdtrit(whole - 1.0, 0.5 * EXCEPT / _times(looks, "trend"))) ** 2
            shares[column] = square / (square + whole - 1.0)
    return shares


def _answer(
    fit: _Residuals,
    looks: Sequence[_Look],
    noise: Sequence[tuple[NoiseCheck, float]],
    unseen: Mapping[str, float],
) -> Answer:
    smooth = [one for one in looks if one.kind in SMOOTH]
    sure = [one for one in smooth if one.p < FAILS]
    far = any(
        check.stated and p < FAILS and check.size >= FAR * check.reference for check, p in noise
    )
    if far or any(_missed(fit, smooth, one) >= HALF for one in sure):
        return "does not describe"
    if any(one.found for one in looks) or any(check.found for check, _ in noise):
        return "describes except"
    return "undecided" if any(share > BLIND for share in unseen.values()) else "describes"


def _missed(fit: _Residuals, smooth: Sequence[_Look], look: _Look) -> float:
    """The share of the variance of a column that the model misses: what one pattern explains, or
    all smooth ones of it together, beyond what as many meaningless ones would.
    """
    own = [fit.first.after_refit(one.direction) for one in smooth if one.column == look.column]
    left, sizes, _ = np.linalg.svd(
        np.stack([one / np.linalg.norm(one) for one in own], axis=1),
        full_matrices=False,
    )
    left = left[:, sizes > LEFT * sizes[0]]
    whole = float(
        fit.freedom[fit.first.columns.index(look.column)] if look.column else fit.freedom.sum()
    )
    part = min(float(np.sum((left.T @ fit.even) ** 2)) / whole, 1.0)
    rank = left.shape[1]
    together = 1.0 - (1.0 - part) * whole / (whole - rank) if whole > rank + 1.0 else 0.0
    return max(look.explained, together)
