"""Are centre and spread over tables found? `python scripts/validation/populations.py [populations,
200]`.

Tables of known populations are fitted one by one, under priors beside the population. The study
counts how often 95 % intervals contain them, a new table and the tables: with the interim priors
divided out, and left in, a control. Exit code 1 if the one is not within binomial limits, or the
control is for every quantity (data outweigh the prior of mu).
"""

import sys
from collections.abc import Mapping

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

TABLES = 8
ROWS = 8
DRAWS = 400
# In coordinates: centre of a population and its sd, scale of the half-normal prior of its spread.
POPULATIONS: Mapping[str, tuple[float, float, float]] = {
    "mu": (float(np.log(0.62)), 0.1, 0.1),
    "cor_10": (0.76, 0.02, 0.02),
}
# Beside the populations, as of who has read of other courts; the others are drawn from theirs.
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
LEFT = ("divided out", "left in")
ASKED = ("centre", "spread", "new table", "tables")


def spread_prior(scale: float) -> Prior:
    """Of a population."""
    return parse_prior(ParameterSpec("spread", "", 0.0, np.inf, f"half-normal({scale})", "", ""))


def groups_of(true: Mapping[str, float], rng: np.random.Generator) -> dict[str, Group]:
    """A table with these values, made and fitted: its groups by quantity. Shallow impacts slide,
    which shows mu.
    """
    angle = np.radians(rng.uniform(10.0, 24.0, ROWS))
    speed = rng.uniform(14.0, 25.0, ROWS)
    states = fitball.impacts(
        speed * np.cos(angle),
        speed * np.sin(angle),
        rng.uniform(-150.0, 150.0, ROWS),
    )
    columns = {name: getattr(states, name) for name in ("v_x1", "v_y1", "omega_1")}
    made = fitball.model("grip-slip").rebound(
        {name: true[name] for name in list(PRIORS)[:5]},
        states,
    )
    for name, noise in (("v_x2", "v_x_sd"), ("v_y2", "v_y_sd"), ("omega_2", "spin_sd")):
        columns[name] = getattr(made, name) + true[noise] * rng.standard_normal(ROWS)
    table = ImpactTable("made", columns, {}, {}, {"id": tuple(map(str, range(ROWS)))})
    problem = build_problem(table, Scene(), Choices("grip-slip", prior=dict(PRIORS)))
    begin = first_order(problem, best_fit(problem, rng)).proposal
    x, log_weights, _ = importance(lambda q: log_posterior(problem, q), [begin], rng, DRAWS)
    chosen = x[rng.choice(len(x), DRAWS, p=np.exp(log_weights - np.logaddexp.reduce(log_weights)))]
    places = [(name, problem.free.index(name), problem.prior.parameters) for name in POPULATIONS]
    found = (
        (name, drawn_group(chosen[:, k], known[k].prior.log_density)) for name, k, known in places
    )
    return {name: group for name, group in found if group is not None}


def missed(seed: int) -> FloatArray:
    """Of one population which intervals miss, (quantities, left, asked); of the tables the
    share.
    """
    rng = np.random.default_rng([seed, 7])
    truth = {}
    tables = []
    low = {name: 1e-9 if name.endswith("_sd") else -np.inf for name in PRIORS}
    own = {
        key: parse_prior(ParameterSpec(key, "", low[key], np.inf, text, "", ""))
        for key, text in PRIORS.items()
    }
    for name, (centre, sd, scale) in POPULATIONS.items():
        truth[name] = (
            centre + sd * rng.standard_normal(),
            float(spread_prior(scale).quantile(rng.uniform(size=()))),
        )
    values = {name: m + tau * rng.standard_normal(TABLES + 1) for name, (m, tau) in truth.items()}
    for k in range(TABLES):
        true = {name: float(prior.quantile(rng.uniform(size=()))) for name, prior in own.items()}
        true |= {"mu": float(np.exp(values["mu"][k])), "cor_10": float(values["cor_10"][k])}
        tables.append(groups_of(true, rng))
    out = np.empty((len(POPULATIONS), 2, len(ASKED)))
    for j, (name, (_, _, scale)) in enumerate(POPULATIONS.items()):
        for k in range(2):
            groups = [
                one[name] if k == 0 else one[name]._replace(interim=np.zeros(DRAWS))
                for one in tables
            ]
            found = hierarchy(groups, spread_prior(scale), rng)
            pairs = zip(
                (*found[:3], *found.each),
                (*truth[name], values[name][-1], *values[name]),
                strict=False,
            )
            miss = np.array([abs(np.mean(draws < true) - 0.5) > 0.475 for draws, true in pairs])
            out[j, k] = *miss[:3], miss[3:].mean()
    return out


if __name__ == "__main__":
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    made = [
        one for _, one in as_completed(missed, range(count)) if not isinstance(one, FitballError)
    ]
    rates = np.mean(made, axis=0)
    low, high = (1.0 - binom.ppf(share, count, 0.05) / count for share in (0.9995, 0.0005))
    print(f"{len(made)} of {count} populations of {TABLES} tables; limits {low:.3f} to {high:.3f}")
    for j, name in enumerate(POPULATIONS):
        for k, how in enumerate(LEFT):
            print(
                name,
                how,
                *(
                    f"{asked} {1 - rate:.3f}"
                    for asked, rate in zip(ASKED, rates[j, k], strict=True)
                ),
            )
    held = (low <= 1.0 - rates) & (rates <= 1.0 - low)
    sys.exit(int(len(made) < count or not held[:, 0, :3].all() or bool(held[:, 1, 0].all())))
