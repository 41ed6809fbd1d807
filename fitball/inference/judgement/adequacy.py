"""Does the model describe the data? Exact t tests of residuals, Bonferroni, nothing simulated.

Each test is of a pattern d in which residuals e would lie. With d~ what a refit leaves of it and f
degrees of freedom its share of the variance is r = (d~'e)^2/(|d~|^2 e'e), and t^2 = (f-1) r/(1-r):
the t test of one more column of a linear model, with a variance for each measured column. Each kind
of test has a share of the chance of a false alarm, divided among its tests.

Shapes of patterns over impacts are in `patterns`, the t test in `residuals`, tests of the noise in
`noise_tests`, sentences in `adequacy_words`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import fsum

import numpy as np
from scipy.special import chdtrc, stdtrit

from fitball.base.priors import parse_prior
from fitball.base.values import FloatArray
from fitball.inference.density import cells
from fitball.inference.derived import Quantity
from fitball.inference.judgement import adequacy_words as words
from fitball.inference.judgement.first_order import FirstOrder, slopes_of_all
from fitball.inference.judgement.noise_tests import growth_test, linked_tests, outlier_tests
from fitball.inference.judgement.patterns import (
    Drift,
    covariates,
    drifts,
    groups_of,
    slip_shape,
    trends,
)
from fitball.inference.judgement.residuals import (
    OBJECTION_CHANCE,
    FitResiduals,
    PatternTest,
    residuals_of,
    tested_pattern,
)
from fitball.inference.problem.camera import CAMERA_SPECS, WITHOUT_ERROR
from fitball.inference.problem.levels import MAY_DIFFER
from fitball.inference.problem.problem import Problem, base_of
from fitball.inference.schema import Adequacy, Answer, NoiseCheck, PointFit, ResidualTest

# Chance of a false "does not describe": it condemns the model, and must be rarer than an objection.
FAILURE_CHANCE = 0.01
# Factor on the chance of a stated noise: tests of these share two fifths of the chances.
NOISE_FACTOR = 2.5
# Factor on the chance of a pattern: tests of these share three fifths of the chances.
PATTERN_FACTOR = 5.0 / 3.0
# Kinds of tests of patterns with their shares of these chances, divided by the sum of those that a
# table has. Chosen by hand: trends, which a wrong model leaves, are the most tests.
KIND_SHARES = {
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
SMOOTH_KINDS = ("trend", "bias", "row", "drift")
# Share of the variance of a column from which a model fails that misses it: half of what deviates
# is then no noise. Chosen by hand.
FAILING_SHARE = 0.5
# A column is blind where a trend must explain more than this share of its variance to be found as
# often as not: a misfit with which the model fails would go unnoticed. Chosen by hand, a little
# above FAILING_SHARE.
BLIND_SHARE = 0.6
# Parameters that wear, temperature and the court change from impact to impact.
WEARING_PARAMETERS = ("mu", "cor_10")
# Ratio to a stated noise from which a larger one is an exception, if it is significant too. Chosen
# by hand: a smaller excess moves intervals by less than a fifth.
STATED_NOISE_OBJECTION = 1.2
# Ratio to a stated noise from which the model fails, if that is significant too. Chosen by hand.
STATED_NOISE_FAILURE = 2.0
# Ratio to an expected noise from which a larger one is an exception. Its usual prior, lognormal
# about that with an sd of 0.7, has 94 % of its mass below.
EXPECTED_NOISE_OBJECTION = 3.0
# Singular value of several patterns, over the largest, from which a direction is one of their own.
# Chosen by hand.
DISTINCT_DIRECTION = 0.02
# Factors of friction whose rebounds are compared to see its pattern: with less of it balls that
# grip begin to slide. Chosen by hand.
FRICTION_CHANGES = (0.8, 1.2)


def adequacy(
    problem: Problem,
    point: PointFit,
    first: FirstOrder,
    derived: Sequence[Quantity] = (),
) -> Adequacy:
    """Whether the model describes the data, by tests of the residuals of a fit, and how far the
    patterns move each quantity, `derived` ones too. Of more than LONG_ROWS it tests those of
    `first`, which is thinned.
    """
    fit = residuals_of(problem, first)
    by_themselves = [
        *_pattern_tests(fit),
        *outlier_tests(fit),
        *growth_test(fit),
        *linked_tests(fit),
        *_camera_tests(fit),
    ]
    among_all = _among_all(by_themselves)
    unseen = _unseen_shares(fit, by_themselves)
    noise = [*_noise_checks(fit, point)]
    tests = tuple(
        ResidualTest(test.kind, test.column, test.pattern, test.p, test.explained, test.found)
        for test in among_all
    )
    checks = tuple(check for check, _ in noise)
    moved = _shifts_of_patterns(problem, first, fit, among_all, derived)
    answer = _answer_of(fit, among_all, noise, unseen)
    if answer == "undecided":
        text = _too_few(problem, fit, unseen)
    else:
        named = [test for test in tests if test.found]
        if answer == "describes":
            named = [test for test in tests if test.p < OBJECTION_CHANCE]
        text = words.described(answer, named, checks, moved, len(problem.rows.y), fit.measured)
    sentence = f"{text} {words.noises(checks, fit.measured)}".strip()
    return Adequacy(answer, sentence, tests, checks, moved, unseen)


def _among_all(by_themselves: Sequence[PatternTest]) -> list[PatternTest]:
    """The tests, each with its chance among all of them, the surest first."""
    tests = []
    for test in by_themselves:
        p = min(1.0, test.p * _chance_factor(by_themselves, test.kind))
        tests.append(test._replace(p=p))
    return sorted(tests, key=lambda test: (test.p, -test.explained))


def _shifts_of_patterns(
    problem: Problem,
    first: FirstOrder,
    fit: FitResiduals,
    tests: Sequence[PatternTest],
    derived: Sequence[Quantity],
) -> dict[str, float]:
    """By how many of its sds each quantity moves with the significant pattern that moves it most;
    empty without such a pattern.
    """
    # In long tables patterns are significant that are no exception; they move values all the same.
    sure = [test.direction for test in tests if test.p < OBJECTION_CHANCE and test.direction.size]
    if not sure:
        return {}
    along = slopes_of_all(problem, first, derived)
    shifts = np.abs(fit.first.shifts(np.stack(sure, axis=1), along))
    names = (*first.names, *(quantity.spec.name for quantity in derived))
    return dict(zip(names, shifts.max(axis=1).tolist(), strict=True))


def _too_few(problem: Problem, fit: FitResiduals, unseen: Mapping[str, float]) -> str:
    """The sentence that the measurements of blind columns are too few to test the model."""
    measured = np.isfinite(problem.rows.y).sum(axis=0).tolist()
    return words.too_few(
        {fit.measured(name): share for name, share in unseen.items() if share > BLIND_SHARE},
        dict(zip(map(fit.measured, fit.first.columns), measured, strict=True)),
        alike=not covariates(fit.problem),
        impacts=len(problem.rows.y),
    )


# --- patterns


def _pattern_tests(fit: FitResiduals) -> Iterator[PatternTest]:
    """The t tests of the patterns that differ from parameters and from each other."""
    problem = fit.problem
    first = fit.first
    tested = list[FloatArray]()
    count = len(problem.rows.y)
    groups = list(groups_of(problem, first.proposal.centre))
    along_rows = list(drifts(problem))
    shapes = [
        *(("trend", text, shape) for text, shape in trends(problem)),
        ("bias", "bias in all rows", np.ones(count)),
        *(("row", drift.text, drift.shape) for drift in along_rows if not drift.column),
        *(("group", f"bias in {column} {label}", inside) for column, label, inside in groups),
        *(("group", drift.text, drift.shape) for drift in along_rows if drift.column),
    ]
    # A fitted slope of the restitution leaves nearly the same of a bias as of a bend.
    bent = "cor_slope" in map(base_of, first.names)
    for column in first.columns:
        measured = fit.measured(column)
        for kind, text, shape in shapes:
            if kind == "bias" and column == "v_y2" and bent:
                text = f"{text}, or a bend over v_y1"
            direction = first.direction(column, fit.sides(column) * shape)
            yield from tested_pattern(fit, kind, column, f"{measured}: {text}", direction, tested)
    yield from _parameter_tests(fit, along_rows, groups, tested)


def _parameter_tests(
    fit: FitResiduals,
    along_rows: Sequence[Drift],
    groups: Sequence[tuple[str, str, FloatArray]],
    tested: list[FloatArray],
) -> Iterator[PatternTest]:
    """The t tests of patterns of parameters: wear along the rows, friction with the slip speed,
    parameters that differ between groups.
    """
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
            slope = _friction_pattern(fit, slope)
        if parameter in WEARING_PARAMETERS:
            # Where labels have values of their own these may be in any order.
            drifting = [drift for drift in along_rows if not (drift.column and parameter in pooled)]
            yield from _drift_tests(fit, parameter, slope, drifting, tested)
        if parameter == "mu" and along_rows:
            direction = slope * slip_shape(problem)[first.rows]
            text = "mu: trend with the slip speed"
            yield from tested_pattern(fit, "law", "", text, direction, tested)
        if parameter in pooled:
            continue
        for label, level, inside in groups:
            if label != "regime":
                direction = slope * inside[first.rows]
                text = f"{parameter} differs for {label} {level}"
                if parameter in MAY_DIFFER:
                    text = f"{text} (--pool {parameter}={label})"
                yield from tested_pattern(fit, "parameter", "", text, direction, tested)


def _drift_tests(
    fit: FitResiduals,
    parameter: str,
    slope: FloatArray,
    along_rows: Sequence[Drift],
    tested: list[FloatArray],
) -> Iterator[PatternTest]:
    """The t tests of a parameter that changes along the rows, or from label to label as these are
    listed; `slope` (measurements,) is its pattern.
    """
    for drift in along_rows:
        direction = slope * drift.shape[fit.first.rows]
        text = f"{parameter}: {drift.text}"
        kind = "drift"
        if drift.column:
            kind = "parameter"
            text = f"{text} (--pool {parameter}={drift.column})"
        yield from tested_pattern(fit, kind, "", text, direction, tested)


def _friction_pattern(fit: FitResiduals, slope: FloatArray) -> FloatArray:
    """The pattern (measurements,) of friction by its FRICTION_CHANGES, with which balls that grip
    begin to slide; its `slope` (measurements,) where the model has no answer for one of them.
    """
    problem = fit.problem
    best = problem.prior.value(fit.first.proposal.centre[None])
    sides = np.repeat(best, 2, axis=0)
    sides[:, problem.free.index("mu")] *= FRICTION_CHANGES
    cell = cells(problem, problem.prior.coordinate(sides))
    if not cell.possible.all():
        return slope
    return fit.of_measurements(cell.z[0] - cell.z[1])


def _camera_tests(fit: FitResiduals) -> Iterator[PatternTest]:
    """The t tests of camera settings that nobody stated, each with the size that would explain the
    residuals. They need a column of what is between the flights, which only a film shows.
    """
    problem = fit.problem
    x = fit.first.proposal.centre[None]
    keys = () if problem.camera is None else problem.camera.keys
    if not any(observable.column.gap for observable in problem.observables):
        return
    for key, spec in CAMERA_SPECS.items():
        if key in keys or (key == "tilt" and not problem.forward.model.tangential):
            continue
        if key == "row_delay":
            # It moves rebounds as restitution and friction do: residuals do not show it.
            continue
        step = parse_prior(spec).width
        low = cells(problem.with_constant(key, WITHOUT_ERROR[key] - step), x)
        high = cells(problem.with_constant(key, WITHOUT_ERROR[key] + step), x)
        if not (low.possible.all() and high.possible.all()):
            continue
        direction = 0.5 * fit.of_measurements(low.z[0] - high.z[0])
        for test in tested_pattern(fit, "camera", "", "", direction, []):
            # The size of the pattern, in steps of the setting.
            steps = float(test.direction @ direction) / float(direction @ direction)
            yield test._replace(pattern=words.camera(key, WITHOUT_ERROR[key] + steps * step))


def _chance_factor(tests: Sequence[PatternTest], kind: str) -> float:
    """The factor from the chance of a test of a kind by itself to its chance among all tests
    (Bonferroni, weighted by kind).
    """
    kinds = [test.kind for test in tests]
    # A set has another order in each process: a plain sum would have other last digits.
    total = fsum(KIND_SHARES[name] for name in {*kinds})
    return PATTERN_FACTOR * kinds.count(kind) * total / KIND_SHARES[kind]


def _noise_checks(fit: FitResiduals, point: PointFit) -> Iterator[tuple[NoiseCheck, float]]:
    """The check of each column's noise, and the chance of so large a noise where all of it is
    stated; 1 elsewhere.
    """
    parameters = {parameter.spec.name: parameter for parameter in fit.problem.parameters}
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
            p = min(1.0, NOISE_FACTOR * len(fit.first.columns) * chance)
            exception = p < OBJECTION_CHANCE and ratio >= STATED_NOISE_OBJECTION
        else:
            # Beside stated errors it is a scatter, and residuals are in units of both.
            size = scatter if observable.stated else ratio * scatter
            reference = float(parameter.prior.quantile(np.array([0.5]))[0])
            exception = size >= EXPECTED_NOISE_OBJECTION * reference
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


def _unseen_shares(fit: FitResiduals, tests: Sequence[PatternTest]) -> dict[str, float]:
    """For each column the share of its variance from which a trend is found as often as not."""
    shares = dict.fromkeys(fit.first.columns, 1.0)
    with_trend = {test.column for test in tests if test.kind == "trend"}
    for column, freedom in zip(fit.first.columns, fit.freedom.tolist(), strict=True):
        if column not in with_trend or freedom <= 2.0:
            continue
        p = 0.5 * OBJECTION_CHANCE / _chance_factor(tests, "trend")
        square = float(stdtrit(freedom - 1.0, p)) ** 2
        shares[column] = square / (square + freedom - 1.0)
    return shares


def _answer_of(
    fit: FitResiduals,
    tests: Sequence[PatternTest],
    noise: Sequence[tuple[NoiseCheck, float]],
    unseen: Mapping[str, float],
) -> Answer:
    """The answer by the gravest objection that holds."""
    for check, p in noise:
        if (
            check.stated
            and p < FAILURE_CHANCE
            and check.size >= STATED_NOISE_FAILURE * check.reference
        ):
            return "does not describe"
    smooth = [test for test in tests if test.kind in SMOOTH_KINDS]
    for test in smooth:
        if test.p < FAILURE_CHANCE and _missed_share(fit, smooth, test) >= FAILING_SHARE:
            return "does not describe"
    if any(test.found for test in tests) or any(check.found for check, _ in noise):
        return "describes except"
    if any(share > BLIND_SHARE for share in unseen.values()):
        return "undecided"
    return "describes"


def _missed_share(fit: FitResiduals, smooth: Sequence[PatternTest], test: PatternTest) -> float:
    """The share of the variance of a test's column that the model misses: what its pattern
    explains, or what all smooth patterns of the column do together, beyond what as many
    meaningless ones would.
    """
    freedom = float(fit.freedom.sum())
    if test.column:
        freedom = float(fit.freedom[fit.first.columns.index(test.column)])
    units = []
    for other in smooth:
        if other.column == test.column:
            after = fit.first.after_refit(other.direction)
            units.append(after / np.linalg.norm(after))
    basis, sizes, _ = np.linalg.svd(np.stack(units, axis=1), full_matrices=False)
    basis = basis[:, sizes > DISTINCT_DIRECTION * sizes[0]]
    rank = basis.shape[1]
    if freedom <= rank + 1.0:
        return test.explained
    square = float(np.sum((basis.T @ fit.scaled) ** 2))
    share = min(square / freedom, 1.0)
    together = 1.0 - (1.0 - share) * freedom / (freedom - rank)
    return float(max(test.explained, together))
