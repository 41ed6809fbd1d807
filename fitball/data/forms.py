"""Forms in which restitution is measured become velocities of impacts.

Series of bounces -> flights and heights -> speeds -> those that a moving surface sees -> rebounds
by coefficients of restitution. Each form has a module of its own.
"""

from __future__ import annotations

from typing import NamedTuple

from fitball.base.values import FloatArray
from fitball.data.cells import TableCells
from fitball.data.header import Header
from fitball.data.heights import heights_read, speeds_of_heights, usual_braking
from fitball.data.kinematics import Columns
from fitball.data.ratios import heights_of_ratios, speeds_of_ratios
from fitball.data.scene import Scene
from fitball.data.series import single_bounces
from fitball.data.surface import seen_by_surface


class Velocities(NamedTuple):
    """Columns (rows,) in SI with velocities in place of other forms, correlations of their errors
    by pair, and what a table keeps of how they were read.
    """

    columns: dict[str, FloatArray]
    corr: dict[str, FloatArray]
    read: dict[str, str]


def velocities_of_forms(
    cells: TableCells,
    header: Header,
    columns: Columns,
    corr: Columns,
    scene: Scene,
    names_cor: bool,
) -> Velocities:
    """The velocities that columns (rows,) in SI say in any form. `corr` are stated correlations by
    pair, `names_cor` says whether the user names the column `cor`. Notes and faults go to `cells`.
    """
    single, shared = single_bounces(cells, header.labels, columns, usual_braking(scene))
    correlations = {**corr, **shared}
    their_cor = ""
    if "cor" in single and not names_cor:
        their_cor = cells.names[header.numbers["cor"]]
    heights = heights_of_ratios(cells, single, their_cor, scene.ball_value())
    speeds = speeds_of_heights(cells, heights, scene)
    seen = seen_by_surface(cells, speeds, correlations)
    velocities = speeds_of_ratios(cells, seen, correlations, heights)
    # What a surface sees, or follows from a measured ratio, is no height: the drag moves it little.
    by_ratio = "v_y2" in velocities and "v_y2" not in seen
    kept = {} if by_ratio or "surface_speed" in columns else heights_read(heights, scene)
    return Velocities(velocities, correlations, kept)
