"""Whether the files of one result agree with each other: a number changed by hand shows even where a repetition has
other draws.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from fitball.inference.sampling.convergence import summaries
from fitball.repeat.kept import Kept

# Shares by which rounding may differ: of a summary of many draws, and of one draw (an exponential).
SUMMARY, DRAW = 1e-9, 1e-12

Contradiction = tuple[str, float, float, str]


def contradictions(kept: Kept) -> Iterator[Contradiction]:
    """What is said, the number there, the number that follows from the other file, and which file that is."""
    yield from _summaries(kept)
    yield from _draws(kept)


def _summaries(kept: Kept) -> Iterator[Contradiction]:
    if kept.posterior is None:
        return
    for k, name in enumerate(kept.posterior.names):
        item = kept.content["parameters"].get(name)
        if item is None:
            continue
        recomputed = summaries(kept.posterior.values[..., k])
        for number, value in recomputed.items():
            if item[number] is None or not abs(item[number] - value) <= SUMMARY * (abs(value) + recomputed["sd"]):
                yield f"{name} {number}", item[number], value, "what its own draws in posterior.nc give"


def _draws(kept: Kept) -> Iterator[Contradiction]:
    """Draws of `posterior.nc` that are not those of `posterior.h5`: the first of each parameter."""
    if kept.posterior is None or kept.chains is None:
        return
    warm_up, steps = (kept.content["diagnostics"][name] for name in ("warm_up", "steps"))
    parts = [ensemble.chain[warm_up:steps] for ensemble in kept.chains]
    ensembles, *shape = kept.posterior.values.shape
    if [list(part.shape) for part in parts] != [shape] * ensembles:
        size = sum(part.size for part in parts)
        yield "number of draws", float(kept.posterior.values.size), float(size), "posterior.h5"
        return
    chains = np.stack(parts)
    for k, name in enumerate(kept.posterior.names):
        log = kept.saved.parameters[name].prior.lower().startswith("log")
        chain = np.exp(chains[..., k]) if log else chains[..., k]
        values = kept.posterior.values[..., k]
        apart = np.argwhere(~(np.abs(values - chain) <= DRAW * np.abs(chain)))
        if apart.size:
            at = tuple(int(i) for i in apart[0])
            what = f"{name} draw (ensemble {at[0]}, step {at[1] + warm_up}, walker {at[2]})"
            yield what, float(values[at]), float(chain[at]), f"posterior.h5, {len(apart)} draws in all"
