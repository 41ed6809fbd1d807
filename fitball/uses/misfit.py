"""How far a fit misses what it was fitted to, of each column: the width that predictions need."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fitball.inference.fitted import Fitted

# Kinds of residual tests that find a misfit of the mean: others find rows, or the form of noise.
_OF_THE_MEAN = ("bias", "trend", "row", "group", "parameter", "drift", "law", "camera")


def misfit_sds(fit: Fitted) -> Mapping[str, float]:
    """By measured column the sd [SI] of the model's misfit, where the fit does not describe its
    data, or with exceptions: of the scatter beyond stated errors the share of variance that the
    patterns together explain which residual tests found; all of it where the noise is larger than
    stated.
    """
    adequacy = fit.adequacy
    if adequacy.answer not in ("describes except", "does not describe"):
        return {}
    columns = [observable.column.name for observable in fit.problem.observables]
    shares = dict.fromkeys(columns, 0.0)
    for test in adequacy.tests:
        if test.found and test.kind in _OF_THE_MEAN:
            for column in [test.column] if test.column else columns:
                shares[column] += test.explained
    for check in adequacy.noise:
        if check.found and check.stated:
            shares[check.column] += 1.0
    best = fit.draws.best
    sds = {}
    for observable in fit.problem.observables:
        name = observable.column.name
        if shares[name] > 0.0:
            share = min(shares[name], 1.0)
            sds[name] = float(np.sqrt(share) * best[observable.noise][0])
    return sds
