"""Fisher information of the table at the point estimate: the information of the measurements alone, to first order;
its stiff and sloppy directions in words (Gutenkunst et al. 2007); draws of a posterior by it, where there are none of
a sampler.

Eigenvectors of the information in sds of the priors: as a combination of parameters one is known to one over the root
of its eigenvalue; as a movement it is how parameters can go together unnoticed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fitball.errors import FitError
from fitball.inference.likelihood.cells import cells
from fitball.inference.likelihood.force import force_information
from fitball.inference.likelihood.posterior import densities
from fitball.inference.problem.observables import beyond_stated
from fitball.inference.problem.parameters import NOISE_SPECS, Parameter
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.subsample import LOOKED_AT, spanning_part, thinned_problem
from fitball.inference.results import sentences
from fitball.inference.results.evidence import Direction, Eigendirections, InformationEvidence
from fitball.inference.results.results import PointFit
from fitball.inference.sampling.importance import importance_posterior
from fitball.inference.sampling.moves import StudentProposal
from fitball.values import FloatArray

# Optima of a fit about which its posterior is drawn.
DRAWN_ABOUT = 2
# Standard errors above this many sds of the prior are no knowledge at all.
UNINFORMED = 1e3
# A parameter that cannot move so far either way, in widths of its prior, is so close to where the model ends that its
# derivative says nothing of the table.
LEAST_ROOM = 1e-5
# Components below this share of an eigenvector's length are left out of its words: together a sixteenth of its
# square.
NAMED = 0.25
# Loss by rounding exponents, as a ratio of standard errors, at which the rounded combination no longer stands for it.
FAITHFUL = 1.25


def inverse(information: FloatArray, ridge: float) -> FloatArray:
    """Inverse (n, n) of a symmetric matrix without negative eigenvalues, `ridge` added to its diagonal.

    Eigenvalues that rounding left below zero count as zero. Rows that are not finite stand for parameters of which
    there is no derivative: the inverse is that of the others, with NaN in those rows and columns.
    """
    inverted = np.full(information.shape, np.nan)
    finite = np.flatnonzero(np.isfinite(np.diag(information)))
    if finite.size:
        eigenvalues, vectors = np.linalg.eigh(information[np.ix_(finite, finite)])
        inverted[np.ix_(finite, finite)] = (vectors / (np.maximum(eigenvalues, 0.0) + ridge)) @ vectors.T
    return inverted


def fisher_information(problem: Problem, coordinates: FloatArray, *, scene: bool) -> FloatArray:
    """Expected information (free, free) of the measurements at `coordinates` (free,), in coordinates counted in sds
    of the priors; with `scene` the scene's contact time counts as a measurement.
    """
    return informations(problem, coordinates)[not scene]


def informations(problem: Problem, coordinates: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The `fisher_information` with, and without, the scene's contact time.

    Where a spread depends on a parameter, twice the squared slope of its logarithm adds to that of the prediction: so
    it is with a fitted noise and with an angle, whose spread falls with the rebound speed. Uncertain incidence is a
    covariance of the columns of an impact, and the information on their noises is taken within it (see `cells`); that
    this covariance moves with the parameters too is left out. Of heavy tails it is the information on their scale and
    their shape. Of a large table a part is used and scaled up. Rows and columns of a parameter that
    has no room to either side (LEAST_ROOM) are NaN.
    """
    whole, problem = problem, thinned_problem(problem, LOOKED_AT)
    coordinates = _off_zero(problem, coordinates)
    share = len(whole.impacts) / len(problem.impacts)
    # Of columns with gaps other shares may be left.
    own = np.array([
        len(all_of.observed) / len(some.observed) / share
        for all_of, some in zip(whole.observables, problem.observables, strict=True)
    ])  # fmt: skip
    made, width = cells(problem, coordinates[None, :], slopes=True), problem.prior.width
    kinds = [parameter.name for parameter in problem.noise.parameters]
    sizes = {name: float(made.columns[name][0]) for name in kinds}
    weight = np.sqrt(own)[made.column]
    rows = made.slope[0] * weight[:, None] * width * np.sqrt(problem.noise.information(sizes))
    told = problem.noise.shape_information(sizes)
    by_cell = np.zeros((weight.size, 1 + len(kinds), width.size))
    by_cell[:, 0] = made.growth[0]
    for row, name in enumerate(kinds, start=1):
        if name in problem.free_names:
            k = problem.free_names.index(name)
            by_cell[:, row, k] = sizes[name] if problem.free[k].prior.log else 1.0
    by_cell *= weight[:, None, None] * width
    information = rows.T @ rows + np.einsum("cki,kl,clj->ij", by_cell, told, by_cell, optimize=True)
    if problem.errors is not None:
        below, above = np.tril_indices(own.size, -1)
        turn = (made.turn[0] * (own[below] * own[above])[:, None] ** 0.25 * width).reshape(-1, width.size)
        information += told[0, 0] * (turn.T @ turn)
    information *= share
    if whole.force is not None:
        information += force_information(whole, whole.force, coordinates) * np.outer(width, width)
    # Of a model without a time axis there is no contact time to tell anything.
    timed = np.zeros(width.size)
    if problem.contact_time is not None:
        timed = made.pace[0] * width / problem.contact_time[1]
    scale, ended = prior_sds(problem), _without_room(problem, coordinates)
    found = []
    for whole_of in (information + np.outer(timed, timed), information):
        scaled = whole_of * np.outer(scale, scale)
        scaled[ended], scaled[:, ended] = np.nan, np.nan
        found.append(scaled)
    return found[0], found[1]


def _off_zero(problem: Problem, coordinates: FloatArray) -> FloatArray:
    """The coordinates (free,) with no scatter beyond stated errors so small that its information, which is that about
    its square, says nothing of how far it may go. With `n` stated sds `s` its square is known to
    `sqrt(2/sum(s^-4))`; half of the root of that is large enough.
    """
    moved = coordinates.copy()
    values = problem.to_values(coordinates[None, :])
    for name in beyond_stated(problem.observables).keys() & set(problem.free_names):
        k = problem.free_names.index(name)
        if not problem.free[k].prior.log:
            rebound = problem.rebound(values)
            weights = [
                np.sum((item.scatter(1.0, rebound) / np.asarray(item.sd)) ** 4)
                for item in problem.observables
                if item.noise == name
            ]
            moved[k] = max(moved[k], 0.5 * (2.0 / float(sum(weights))) ** 0.25)
    return moved


def _without_room(problem: Problem, coordinates: FloatArray) -> NDArray[np.bool_]:
    """Which free parameters the model cannot evaluate a step up nor a step down from `coordinates` (free,)."""
    steps = LEAST_ROOM * np.diag(problem.prior.width)
    around = np.concatenate([coordinates + steps, coordinates - steps])
    failed = np.any(problem.rebound(problem.to_values(around)).status, axis=1)
    return np.asarray(np.all(failed.reshape(2, -1), axis=0))


def prior_sds(problem: Problem) -> FloatArray:
    """Sds of the priors (free,) in their widths: 1 for a bell, the root of 1/12 for a uniform one."""
    return np.array([1.0 if parameter.prior.bell else 12.0**-0.5 for parameter in problem.free])


def information_evidence(problem: Problem, coordinates: FloatArray) -> dict[str, InformationEvidence]:
    """The information about the free parameters at `coordinates` (free,), but for those without a derivative."""
    with_scene, without = informations(problem, coordinates)
    errors, errors_without = standard_errors(with_scene), standard_errors(without)
    # What the scene knows stands before the table, as in the contraction of a posterior.
    shares = 1.0 - (1.0 - _contraction(with_scene)) / (1.0 - _contraction(with_scene - without))
    shares_without = _contraction(without)
    return {
        name: InformationEvidence(
            None if errors[k] > UNINFORMED else float(errors[k]),
            None if errors_without[k] > UNINFORMED else float(errors_without[k]),
            float(shares[k]),
            float(shares_without[k]),
        )
        for k, name in enumerate(problem.free_names)
        if np.isfinite(errors[k])
    }


def standard_errors(information: FloatArray) -> FloatArray:
    """Standard errors (free,) in sds of the priors; those of directions the table does not see are very large, and
    those of parameters without a derivative NaN.
    """
    # A millionth of a prior's sd to the minus two stands for nothing: errors reach a thousand sds of a prior.
    errors: FloatArray = np.sqrt(np.diag(inverse(information, 1e-2 / UNINFORMED**2)))
    return errors


def _contraction(information: FloatArray) -> FloatArray:
    """First-order contraction (free,) by measurements and priors; NaN without a derivative."""
    shares: FloatArray = 1.0 - np.diag(inverse(information, 1.0))
    return shares


def about(problem: Problem, optimum: FloatArray) -> StudentProposal:
    """The proposal by the information of table and priors at an optimum (free,)."""
    information = np.nan_to_num(fisher_information(problem, optimum, scene=True))
    width = problem.prior.width * prior_sds(problem)
    covariance = inverse(information, 1.0) * np.outer(width, width)
    return StudentProposal(optimum, np.asarray(np.linalg.cholesky(covariance), dtype=np.float64))


def first_order_draws(problem: Problem, point: PointFit, count: int, rng: np.random.Generator) -> FloatArray:
    """Free values (count, free) in SI of the normal distribution about a point that the information of table, scene
    and priors promises, within the bounds. Levels are normal in their own coordinate: a spread times a place is not
    linear, and draws of both would leave the data by far.
    """
    at, moves = first_order_moves(problem, point, count, rng)
    for pooling in problem.pooling:
        names = [name for name in pooling.hidden if name in problem.free_names]
        spread = point.values[pooling.spread_name]
        if pooling.spread_name not in names or not spread > 0.0:
            continue
        wide, *places = map(problem.free_names.index, names)
        logarithmic = problem.free[wide].prior.log
        relative = moves[:, [wide]] / (1.0 if logarithmic else spread)
        stretch = np.clip(relative, -1.0, 1.0)
        moves[:, [wide]] = stretch if logarithmic else spread * np.expm1(stretch)
        moves[:, places] = (at[places] * (1.0 + relative) + moves[:, places]) * np.exp(-stretch) - at[places]
    return problem.to_values(np.clip(at + moves, *problem.prior.limits))


def first_order_moves(
    problem: Problem, point: PointFit, count: int, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """The coordinates (free,) of a point and such draws less these (count, free), bounds or not."""
    at = problem.to_coordinates(np.array([[point.values[name] for name in problem.free_names]]))[0]
    return at, rng.standard_normal((count, at.size)) @ about(problem, at).factor.T


# --- draws from all that was known before the table: priors, what the model can evaluate, what the scene says

BATCH, AT_ONCE = 4000, 500
WANTED = 1500
# Batches after which fewer accepted draws must do; scenes that know much accept few prior draws.
MOST_BATCHES = 12
# Impacts that are looked at.
SPANNING = 1000


def prior_draws(problem: Problem, rng: np.random.Generator, wanted: int = WANTED, batch: int = BATCH) -> FloatArray:
    """Independent draws (draws, free) in SI by rejection from the priors, at most `wanted`. Of a large table some
    impacts stand for all: their mean contact time for that of all, and those farthest out for what is possible.
    """
    problem = spanning_part(problem, SPANNING)
    accepted: list[FloatArray] = []
    # The scene's knowledge is a normal density: its peak bounds it.
    value_sd = problem.contact_time
    peak = 0.0 if value_sd is None else -0.5 * float(np.log(2.0 * np.pi)) - float(np.log(value_sd[1]))
    for _ in range(MOST_BATCHES):
        values, luck = problem.prior.draw(rng, batch), rng.uniform(size=batch)
        # Looked at a part at a time: most tables take what they want of the first parts.
        for first in range(0, batch, AT_ONCE):
            some = slice(first, first + AT_ONCE)
            density = densities(problem, values[some], measured=False)
            chance = np.where(density.possible, np.exp(density.scene - peak), 0.0)
            accepted.append(values[some][luck[some] < chance])
            if sum(map(len, accepted)) >= wanted:
                return np.concatenate(accepted)[:wanted]
    return np.concatenate(accepted)


# Draws by rejection that tell how wide each parameter was; and draws in their place where they are fewer.
LEAST, DRAWN = 300, 1500


def known_before(problem: Problem, optimum: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Draws (draws, free) in SI: by rejection from the priors, or, where these hardly ever have the scene's contact
    time, as of another ball than their own, by weights. The `optimum` (free,), in coordinates, has it.

    Raises FitError where no weighted draws are found either.
    """
    drawn = prior_draws(problem, rng)
    if len(drawn) >= LEAST or problem.contact_time is None:
        return drawn
    part = spanning_part(problem, SPANNING)
    weighed = importance_posterior(part, [_about_scene(part, optimum)], rng, density=_log_density)
    if not weighed.settled:
        raise FitError(
            f"the priors contradict {scene_words(problem)}: state priors of this ball, such as that of "
            "k_y, or leave the contact time out"
        )
    return weighed.values[rng.choice(len(weighed.values), DRAWN, p=np.exp(weighed.log_weights))]


def _log_density(problem: Problem, coordinates: FloatArray) -> FloatArray:
    """Log density of priors, scene and what the model can evaluate (draws,), but for a constant."""
    total = problem.prior.log_density(coordinates)
    inside = np.flatnonzero(np.isfinite(total))
    known = densities(problem, problem.to_values(coordinates[inside]), measured=False)
    total[inside] += np.where(known.possible, known.scene, -np.inf)
    return total


def _about_scene(problem: Problem, optimum: FloatArray) -> StudentProposal:
    """The priors where the scene leaves them, to first order about a point that has its contact time."""
    with_scene, without = informations(problem, optimum)
    width = problem.prior.width * prior_sds(problem)
    covariance = inverse(np.nan_to_num(with_scene - without), 1.0)
    half = np.array([0.5])
    middle = np.array([float(item.prior.coordinate(item.prior.quantile(half))[0]) for item in problem.free])
    centre = optimum + width * (covariance @ ((middle - optimum) / width))
    factor = np.linalg.cholesky(covariance * np.outer(width, width))
    return StudentProposal(centre, np.asarray(factor, dtype=np.float64))


def scene_words(problem: Problem) -> str:
    """What the scene states of the contact time."""
    if problem.contact_time is None:
        return sentences.SCENE
    value, sd = problem.contact_time
    return sentences.CONTACT_TIME.format(value=1e3 * value, sd=1e3 * sd)


# --- directions in words


def eigendirections(problem: Problem, coordinates: FloatArray) -> Eigendirections:
    """Directions from stiff to sloppy of the parameters that are not noise, at `coordinates` (free,).

    Parameters so close to where the model ends that no derivative exists are held, and named.
    """
    informed, alone = informations(problem, coordinates)
    fitted = [k for k, parameter in enumerate(problem.free) if parameter.name not in NOISE_SPECS]
    columns = [k for k in fitted if np.isfinite(informed[k, k])]
    parameters = [problem.free[k] for k in columns]
    block = np.ix_(columns, columns)
    informed, alone = informed[block], alone[block]
    sds = (prior_sds(problem) * problem.prior.width)[columns]
    return Eigendirections(
        directions=_directions(parameters, sds, informed),
        directions_without_scene=_directions(parameters, sds, alone),
        held=tuple(problem.free[k].name for k in fitted if k not in columns),
    )


def _directions(parameters: Sequence[Parameter], sds: FloatArray, information: FloatArray) -> tuple[Direction, ...]:
    # Directions that the table does not see get a huge variance.
    covariance = inverse(information, 1.0 / (10.0 * UNINFORMED) ** 2)
    eigenvalues, vectors = np.linalg.eigh(information)
    directions = []
    for k in np.argsort(-eigenvalues, kind="stable"):
        words, known_to = combination(parameters, vectors[:, k], sds, covariance)
        components = {parameter.name: float(part) for parameter, part in zip(parameters, vectors[:, k], strict=True)}
        directions.append(Direction(components, words, known_to))
    return tuple(directions)


def combination(
    parameters: Sequence[Parameter], vector: FloatArray, sds: FloatArray, covariance: FloatArray
) -> tuple[str, str]:
    """An eigenvector in words, and the standard error of that combination.

    Logarithms become a product with simple exponents where rounding them costs little, values a sum in SI; a mixture
    of both is only listed, and counted in sds of the priors.
    """
    exact = math.sqrt(float(vector @ covariance @ vector))
    kept = np.abs(vector) >= NAMED
    main = int(np.argmax(np.abs(vector)))
    logs = np.array([parameter.prior.log for parameter in parameters])
    weights = np.where(kept, vector / sds, 0.0)
    weights = weights / weights[main]
    if np.all(logs[kept]):
        for grid in (1.0, 2.0, 10.0):
            rounded = np.round(grid * weights) / grid
            error = _error(rounded * sds, covariance)
            lost = np.any(kept & (rounded == 0.0))
            if (error <= FAITHFUL * exact * float(np.linalg.norm(rounded * sds)) and not lost) or grid > 2.0:
                return product(parameters, rounded), relative(error)
    if not np.any(logs[kept]):
        error = _error(weights * sds, covariance)
        unseen = error > UNINFORMED * float(np.linalg.norm(weights * sds))
        size = "unknown" if unseen else f"{error:.2g} {parameters[main].spec.unit}".rstrip()
        return _sum(parameters, weights, main), size
    order = [int(k) for k in np.argsort(-np.abs(vector)) if kept[k]]
    return "a mixture of " + _and([parameters[k].name for k in order]), (
        f"{exact:.2g} sd of the priors" if exact <= UNINFORMED else "unknown"
    )


def _error(weights: FloatArray, covariance: FloatArray) -> float:
    return math.sqrt(float(weights @ covariance @ weights))


def _sum(parameters: Sequence[Parameter], weights: FloatArray, main: int) -> str:
    """A sum such as `eps_10 + 4.1 eps_slope`, in SI."""
    words = parameters[main].name
    for k in np.argsort(-np.abs(weights), kind="stable"):
        if k != main and weights[k] != 0.0:
            words += f" {'+' if weights[k] > 0.0 else '-'} {abs(weights[k]):.2g} {parameters[k].name}"
    return words


def product(parameters: Sequence[Parameter], exponents: FloatArray) -> str:
    """A product of powers, such as `k_theta/k_y^0.5`."""

    def factors(sign: float) -> list[str]:
        powers = [(parameter.name, sign * power) for parameter, power in zip(parameters, exponents, strict=True)]
        return [name if abs(power - 1.0) < 1e-9 else f"{name}^{power:g}" for name, power in powers if power > 0.0]

    above, below = factors(1.0), factors(-1.0)
    head = " ".join(above) or "1"
    if not below:
        return head
    return f"{head}/({' '.join(below)})" if len(below) > 1 else f"{head}/{below[0]}"


def relative(error: float) -> str:
    """A standard error of a logarithm in words."""
    if error < 0.3:
        return f"{100.0 * error:.2g} %"
    # Beyond a hundred sds of any prior in use a factor has no meaning.
    return f"a factor of {math.exp(error):.2g}" if error < 10.0 else "unknown"


def _and(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else ", ".join(words[:-1]) + " and " + words[-1]
