"""Would a camera that is off explain what the model does not? What nobody stated of it is scored to first order, as
parameters by label are (see `by_label`).
"""

from __future__ import annotations

from dataclasses import replace

from fitball.inference.adequacy.by_label import SURE, Block, probability, score_of
from fitball.inference.adequacy.refit import refit, slopes_of
from fitball.inference.problem.build import as_if_filmed
from fitball.inference.problem.camera import CAMERA_SPECS, CLOCK, HEIGHT, LEVEL, TILT
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.subsample import LOOKED_AT, thinned_problem
from fitball.inference.results import sentences
from fitball.inference.results.results import PointFit


def camera_notes(problem: Problem, point: PointFit) -> tuple[str, ...]:
    """A sentence on the setting of the camera that would explain most of the residuals, where one is found; only of
    tables that show what is between the flights, which film alone does. Of a long table some rows are looked at.
    """
    if problem.model.needs_cor or not any(item.column.gap for item in problem.observables):
        return ()
    part = thinned_problem(problem, LOOKED_AT)
    known = () if part.camera is None else part.camera.keys
    if part.camera is not None and len(part.camera.sessions) > 1:
        return ()
    keys = [key for key in CAMERA_SPECS if key not in known and (key != TILT or part.table.has_tangential)]
    fit, found = refit(part, point), {}
    for key in keys:
        wider = as_if_filmed(part, key, LEVEL[key], free=True)
        values = {**point.values, key: LEVEL[key]}
        slopes = slopes_of(wider, replace(point, values=values))[: fit.measured.size]
        score = score_of(fit, Block(key, slopes[:, [wider.free_names.index(key)]]))
        if score is not None:
            shifts, covariance, gain, rank = score
            p = min(1.0, len(keys) * probability(fit, gain, rank))
            found[key] = (p, float(shifts[0]), float(covariance[0, 0]) ** 0.5, gain)
    if not found or min(found.values())[0] >= SURE:
        return ()
    key = min(found, key=lambda name: found[name])
    _p, size, sd, gain = found[key]
    spec = CAMERA_SPECS[key]
    unit, factor = spec.handy or (spec.unit, 1.0)
    share = gain / float(fit.measured @ fit.measured)
    text = sentences.CAMERA_EXPLAINS.format(
        key=key,
        value=f"{(LEVEL[key] + size) * factor:.3g} {unit}".rstrip(),
        sd=f"{sd * factor:.1g}",
        share=100.0 * share,
    )
    return (f"{text} {sentences.HEIGHT_OR_TIME}",) if key in (HEIGHT, CLOCK) else (text,)
