"""Rebounds as they were measured: as a camera shows them, or as heights read."""

from __future__ import annotations

from typing import Annotated

from fitball.base.values import Impacts, IntArray
from fitball.inference.forward import ForwardModel, Values
from fitball.inference.problem.camera import CameraModel
from fitball.inference.problem.fall import FallModel
from fitball.models.types import Rebound


def measured_rebounds(
    camera: CameraModel | None,
    fall: FallModel | None,
    forward: ForwardModel,
    values: Values,
    measured: Impacts,
    index: Annotated[IntArray, "impacts levels"] | None,
) -> Rebound:
    """Rebounds (draws, impacts) of measured states, as they would be measured; true rebounds where
    there are neither a camera nor heights. `index` says which level each impact has; it is not
    needed without levels.
    """
    states = measured
    if camera is not None:
        states = camera.true_states(values, measured)
    if fall is not None:
        states = fall.true_states(values, states)
    rebound = forward.rebound(values, states, index)
    if fall is not None:
        rebound = fall.measured_rebounds(values, rebound)
    if camera is not None:
        rebound = camera.measured_rebounds(values, measured, rebound)
    return rebound
