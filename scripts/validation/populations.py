"""Are centre and spread over tables right? `populations.py [COUNT --friction 0.62]`, of 200
populations by default. Where friction is high no ball slides in most tables: their friction is
one-sided.

Tables of simulated populations are fitted one by one, under interim priors that are off the
population. The study counts how often 95 % intervals contain the centre and the spread of the
population, a new table and the tables: with the interim priors divided out, and left in, a negative
control. Exit code 1 if the first are not within binomial limits, or if the control is for every
quantity (data outweigh the prior of mu).
"""

import argparse
import sys
from collections.abc import Mapping
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.stats import binom

import fitball
from fitball.base.errors import FitballError
from fitball.base.prior_families import Prior
from fitball.base.priors import ParameterSpec, parse_prior
from fitball.base.scheduling import as_completed
from fitball.base.values import FloatArray
from fitball.data.scene import Scene
from fitball.data.table import ImpactTable
from fitball.inference.density import log_posterior
from fitball.inference.judgement.first_order import first_order
from fitball.inference.problem.build import build_problem
from fitball.inference.problem.problem import Choices
from fitball.inference.sampling.importance import importance
from fitball.inference.search.best_fit import best_fit
from fitball.uses.hierarchy import Group, drawn_group, hierarchy

# Tables of a population.
TABLES = 8
# Impacts of a table.
ROWS = 8
# Draws of the fit of a table that a population takes.
DRAWS = 400
# Miss of a 95 % interval: the truth is farther than this from the median, as a share of draws.
MISS = 0.475
# Probabilities between which the count of misses is, if intervals are right.
LIMITS = (0.0005, 0.9995)


class Population(NamedTuple):
    """The truth of populations of a quantity, in its coordinate: mean and sd of their centres, and
    the scale of the half-normal prior of their spread.
    """

    centre: float
    sd: float
    scale: float


# Quantities that have a population.
QUANTITIES = ("mu", "cor_10")
# Interim priors of the fits: of mu and cor_10 off the populations, as of a user who has read of
# other courts; true values of the other parameters are drawn from theirs.
PRIORS = {
    "mu": "lognormal(0.45, 0.12)",
    "cor_10": "normal(0.7, 0.03)",
    "e_x": "normal(0.1, 0.15)",
    "offset": "normal(0.002, 0.001)",
    "cor_slope": "normal(-0.012, 0.004)",
    "v_x_sd": "lognormal(0.3, 0.2)",
    "v_y_sd": "lognormal(0.3, 0.2)",
    "spin_sd": "lognormal(10, 0.2)",
}
# What happens to the interim priors; the second is the control.
WAYS = ("divided out", "left in")
# Quantities of a population whose intervals are counted.
COUNTED = ("centre", "spread", "new table", "tables")


def populations_of(friction: float) -> Mapping[str, Population]:
    """The populations of QUANTITIES, of which that of mu is about this friction."""
    return {
        "mu": Population(float(np.log(friction)), 0.1, 0.1),
        "cor_10": Population(0.76, 0.02, 0.02),
    }


def spread_prior(scale: float) -> Prior:
    """The prior of the spread of a population, half-normal with this scale."""
    return parse_prior(ParameterSpec("spread", "", 0.0, np.inf, f"half-normal({scale})", "", ""))


def groups_of(true: Mapping[str, float], rng: np.random.Generator) -> dict[str, Group]:
    """Simulate a table with the `true` values and fit it: its groups of draws by quantity. Shallow
    impacts slide, which shows mu.
    """
    angle = np.radians(rng.uniform(10.0, 24.0, ROWS))
    speed = rng.uniform(14.0, 25.0, ROWS)
    states = fitball.impacts(
        speed * np.cos(angle),
        speed * np.sin(angle),
        rng.uniform(-150.0, 150.0, ROWS),
    )
    columns = {name: getattr(states, name) for name in ("v_x1", "v_y1", "omega_1")}
    model = fitball.model("grip-slip", ball=Scene().ball_value())
    rebound = model.rebound({spec.name: true[spec.name] for spec in model.parameters}, states)
    for name, noise in (("v_x2", "v_x_sd"), ("v_y2", "v_y_sd"), ("omega_2", "spin_sd")):
        columns[name] = getattr(rebound, name) + true[noise] * rng.standard_normal(ROWS)
    table = ImpactTable("simulated", columns, {}, {}, {"id": tuple(map(str, range(ROWS)))})
    problem = build_problem(table, Scene(), Choices("grip-slip", prior=dict(PRIORS)))
    begin = first_order(problem, best_fit(problem, rng)).proposal
    q, log_weights, _ = importance(lambda q: log_posterior(problem, q), [begin], rng, DRAWS)
    weights = np.exp(log_weights - np.logaddexp.reduce(log_weights))
    chosen = q[rng.choice(len(q), DRAWS, p=weights)]
    groups = {}
    for name in QUANTITIES:
        k = problem.free.index(name)
        interim = problem.prior.parameters[k].prior
        group = drawn_group(chosen[:, k], interim.log_density)
        if group is not None:
            groups[name] = group
    return groups


def interim_priors() -> dict[str, Prior]:
    """The priors of PRIORS by parameter; sds are positive."""
    priors = {}
    for name, text in PRIORS.items():
        low = 1e-9 if name.endswith("_sd") else -np.inf
        priors[name] = parse_prior(ParameterSpec(name, "", low, np.inf, text, "", ""))
    return priors


def misses(seed: int, friction: float) -> FloatArray:
    """Misses (quantities, ways, counted) of the intervals of a simulated population, 1 or 0; of its
    tables the share.
    """
    populations = populations_of(friction)
    rng = np.random.default_rng([seed, 7])
    truth = {}
    tables = []
    priors = interim_priors()
    for name, population in populations.items():
        centre = population.centre + population.sd * rng.standard_normal()
        spread = float(spread_prior(population.scale).quantile(rng.uniform(size=())))
        truth[name] = (centre, spread)
    # The last one is the new table.
    values = {name: m + tau * rng.standard_normal(TABLES + 1) for name, (m, tau) in truth.items()}
    for k in range(TABLES):
        true = {name: float(prior.quantile(rng.uniform(size=()))) for name, prior in priors.items()}
        true |= {"mu": float(np.exp(values["mu"][k])), "cor_10": float(values["cor_10"][k])}
        tables.append(groups_of(true, rng))
    out = np.empty((len(populations), len(WAYS), len(COUNTED)))
    for j, (name, population) in enumerate(populations.items()):
        for k in range(len(WAYS)):
            groups = [groups_of_table[name] for groups_of_table in tables]
            if WAYS[k] == "left in":
                groups = [group._replace(interim=np.zeros(DRAWS)) for group in groups]
            draws = hierarchy(groups, spread_prior(population.scale), rng)
            true_values = (*truth[name], values[name][-1], *values[name])
            pairs = zip((*draws[:3], *draws.each), true_values, strict=False)
            miss = [abs(np.mean(of_draws < true) - 0.5) > MISS for of_draws, true in pairs]
            out[j, k] = *miss[:3], np.mean(miss[3:])
    return out


def main() -> int:
    """Fit the populations and print how often intervals hold; 1 if that is not as it must be."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", type=int, nargs="?", default=200)
    parser.add_argument("--friction", type=float, default=0.62)
    asked = parser.parse_args()
    count = asked.count
    counted = partial(misses, friction=asked.friction)
    results = [result for _, result in as_completed(counted, range(count))]
    fitted = [result for result in results if not isinstance(result, FitballError)]
    rates = np.mean(fitted, axis=0)
    low, high = (1.0 - binom.ppf(share, count, 0.05) / count for share in LIMITS[::-1])
    print(
        f"{len(fitted)} of {count} populations of {TABLES} tables; limits {low:.3f} to {high:.3f}"
    )
    for j, name in enumerate(QUANTITIES):
        for k, way in enumerate(WAYS):
            pairs = zip(COUNTED, rates[j, k], strict=True)
            print(name, way, *(f"{quantity} {1 - rate:.3f}" for quantity, rate in pairs))
    within = (low <= 1.0 - rates) & (rates <= 1.0 - low)
    is_right = bool(within[:, 0, :3].all())
    control_holds = bool(within[:, 1, 0].all())
    return int(len(fitted) < count or not is_right or control_holds)


if __name__ == "__main__":
    sys.exit(main())
