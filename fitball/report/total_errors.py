"""Total errors of what a film shows: those of each impact, and those that all impacts share with
the camera, which a table of impacts does not have.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fitball.base.values import FloatArray, Impacts
from fitball.data.scene import CameraSection, ValueWithSd
from fitball.inference.problem.camera import CAMERA_SPECS, WITHOUT_ERROR, CameraModel
from fitball.models.types import Rebound

# Columns that a camera shows, incident ones first.
_INCIDENT = ("v_x1", "v_y1", "omega_1")
_REBOUND = ("v_x2", "v_y2", "omega_2", "gap_time", "gap_path", "gap_turn")


def shared_sds(
    values: Mapping[str, FloatArray], camera: CameraSection
) -> dict[str, dict[str, FloatArray]]:
    """The sds (impacts,) that each error of a camera gives to each column of `values` (impacts,),
    SI, by the name of the error and the column: half of the difference between both sides of one
    sd.
    """
    count = len(next(iter(values.values())))
    nothing = np.zeros(count)
    measured = {name: np.nan_to_num(values.get(name, nothing)) for name in (*_INCIDENT, *_REBOUND)}
    states = Impacts(*(measured[name] for name in _INCIDENT))
    rebound = Rebound(
        **{name: measured[name][None] for name in _REBOUND},
        contact_time=nothing[None],
        regime=np.zeros((1, count), dtype=np.int64),
        status=np.zeros((1, count), dtype=np.int64),
    )
    sds = dict[str, dict[str, FloatArray]]()
    for key in CAMERA_SPECS:
        stated = getattr(camera, key)
        if not isinstance(stated, ValueWithSd):
            continue
        model = CameraModel((key,), ("",), np.zeros(count, dtype=np.int64))
        sides = [
            _columns_of(
                model, {key: np.array([WITHOUT_ERROR[key] + sign * stated.sd])}, states, rebound
            )
            for sign in (1.0, -1.0)
        ]
        sds[key] = {name: 0.5 * np.abs(sides[0][name] - sides[1][name]) for name in values}
    return sds


def _columns_of(
    model: CameraModel, settings: Mapping[str, FloatArray], states: Impacts, rebound: Rebound
) -> dict[str, FloatArray]:
    """All columns (impacts,) at settings of a camera: true incident ones, and rebounds as it would
    show them, which change by as much.
    """
    true = model.true_states(settings, states)
    seen = model.measured_rebounds(settings, states, rebound)
    columns = {name: np.ravel(getattr(true, name)) for name in _INCIDENT}
    return columns | {name: np.ravel(getattr(seen, name)) for name in _REBOUND}


def total_sds(
    values: Mapping[str, FloatArray],
    own: Mapping[str, FloatArray],
    camera: CameraSection,
) -> dict[str, FloatArray]:
    """The total sds (impacts,) of columns: `own` ones of each impact with those that all impacts
    share.
    """
    shared = shared_sds(values, camera)
    return {
        name: np.sqrt(own[name] ** 2 + sum(of_key[name] ** 2 for of_key in shared.values()))
        for name in values
    }
