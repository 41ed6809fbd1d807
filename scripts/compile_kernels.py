"""Compiles all kernels once, so that processes that start together find them on disk."""

import numpy as np

import fitball
from fitball.inference.whitening import whitened

if __name__ == "__main__":
    for text in ("brody", "two-mass"):
        model = fitball.model(text)
        impact = fitball.impacts(15.0, 8.0)
        values = {spec.name: spec.typical for spec in model.parameters if spec.typical is not None}
        model.rebound(values, impact)
    model.history(values, impact, np.zeros(1))
    one = np.ones((1, 1))
    whitened(one[None, None], np.ones((1, 1, 1), np.bool_), one[None], one, one[None])
