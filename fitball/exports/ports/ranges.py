"""What was measured, as ports have it: limits and the hull of impacts, so that a port says
`extrapolated` where `CalibratedRange` does.

Functions here are in the kernels' restricted Python and are never run here; names and docstrings of
functions stand in the files that users see.
"""

import itertools
import math
from typing import NamedTuple

import numpy as np

from fitball.base.values import FloatArray, Impacts
from fitball.inference.forward import HULL_SLACK, LIMIT_ROUNDING, hull_points

# A hull that is flatter than this share of its size has no inside: far below the slack, 5 %.
_FLAT = 1e-6


class Range(NamedTuple):
    """Limits of angle [rad] and spin [rad/s], and the hull of measured impacts: the radius [m] that
    makes speeds of spins, the distance [m/s] at which an impact is extrapolated, the first face
    and the end of its faces, and whether it has an inside.
    """

    angle_low: float
    angle_high: float
    spin_low: float
    spin_high: float
    radius: float
    slack: float
    first: int
    end: int
    solid: bool


class Face(NamedTuple):
    """A triangle of a hull [m/s]: its outward normal, of no length where it is a line or a point,
    and its corners.
    """

    n_x: float
    n_y: float
    n_z: float
    a_x: float
    a_y: float
    a_z: float
    b_x: float
    b_y: float
    b_z: float
    c_x: float
    c_y: float
    c_z: float


# Those of a port.
RANGES: list[Range] = []
FACES: list[Face] = []


def beyond(measured: Range, v_x: float, v_y: float, omega: float) -> bool:
    """Whether an impact lies outside of the measured angles and spins, or far from all impacts."""
    if v_x < 0.0 or (v_x == 0.0 and omega < 0.0):
        v_x = -v_x
        omega = -omega
    angle = math.atan2(v_y, v_x)
    if not (measured.angle_low <= angle <= measured.angle_high):
        return True
    if not (measured.spin_low <= omega <= measured.spin_high):
        return True
    z = measured.radius * omega
    most = -math.inf
    for k in range(measured.first, measured.end):
        most = max(most, above(FACES[k], v_x, v_y, z))
    if most > measured.slack:
        return True
    if measured.solid and most <= 0.0:
        return False
    least_squared = math.inf
    for k in range(measured.first, measured.end):
        least_squared = min(least_squared, distance_squared(FACES[k], v_x, v_y, z))
    return least_squared > measured.slack * measured.slack


def above(face: Face, x: float, y: float, z: float) -> float:
    """The distance of a point from the plane of a face, outwards."""
    return face.n_x * (x - face.a_x) + face.n_y * (y - face.a_y) + face.n_z * (z - face.a_z)


def distance_squared(face: Face, x: float, y: float, z: float) -> float:
    """The square of the distance of a point from a triangle."""
    p_x = x - face.a_x
    p_y = y - face.a_y
    p_z = z - face.a_z
    u_x = face.b_x - face.a_x
    u_y = face.b_y - face.a_y
    u_z = face.b_z - face.a_z
    w_x = face.c_x - face.a_x
    w_y = face.c_y - face.a_y
    w_z = face.c_z - face.a_z
    uu = u_x * u_x + u_y * u_y + u_z * u_z
    uw = u_x * w_x + u_y * w_y + u_z * w_z
    ww = w_x * w_x + w_y * w_y + w_z * w_z
    pu = p_x * u_x + p_y * u_y + p_z * u_z
    pw = p_x * w_x + p_y * w_y + p_z * w_z
    # The nearest point of the plane is a + (s u + t w)/area where that is inside.
    area = uu * ww - uw * uw
    s = pu * ww - pw * uw
    t = pw * uu - pu * uw
    height = above(face, x, y, z)
    inside = area > 0.0 and s >= 0.0 and t >= 0.0 and s + t <= area
    if inside:
        return height * height
    one = from_edge(p_x, p_y, p_z, u_x, u_y, u_z)
    two = from_edge(p_x, p_y, p_z, w_x, w_y, w_z)
    three = from_edge(p_x - u_x, p_y - u_y, p_z - u_z, w_x - u_x, w_y - u_y, w_z - u_z)
    return min(one, min(two, three))


def from_edge(p_x: float, p_y: float, p_z: float, u_x: float, u_y: float, u_z: float) -> float:
    """The square of the distance of a point `p` from the line that ends at zero and `u`."""
    length = u_x * u_x + u_y * u_y + u_z * u_z
    along = p_x * u_x + p_y * u_y + p_z * u_z
    share = min(max(along / length, 0.0), 1.0) if length > 0.0 else 0.0
    d_x = p_x - share * u_x
    d_y = p_y - share * u_y
    d_z = p_z - share * u_z
    return d_x * d_x + d_y * d_y + d_z * d_z


def widened(low: float, high: float) -> tuple[float, float]:
    """Limits with the rounding that `CalibratedRange` allows."""
    rounding = LIMIT_ROUNDING * max(abs(low), abs(high))
    return low - rounding, high + rounding


def range_of(impacts: Impacts, radius: float, first: int) -> tuple[Range, list[Face]]:
    """The range of measured impacts (impacts,), and its faces, which begin at number `first`."""
    forwards = impacts.forwards
    speed, angle = forwards.polar()
    points = np.stack([forwards.v_x1, forwards.v_y1, radius * forwards.omega_1], axis=1)
    faces, solid = _faces(hull_points(points))
    angles = widened(float(angle.min()), float(angle.max()))
    spins = widened(float(forwards.omega_1.min()), float(forwards.omega_1.max()))
    slack = HULL_SLACK * float(np.median(speed))
    end = first + len(faces)
    return Range(*angles, *spins, float(radius), slack, first, end, solid), faces


def _faces(points: FloatArray) -> tuple[list[Face], bool]:
    """The triangles of the hull of points (points, 3), and whether it has an inside."""
    from scipy.spatial import ConvexHull

    middle = points.mean(axis=0)
    _, sizes, axes = np.linalg.svd(points - middle, full_matrices=True)
    dimensions = int(np.sum(sizes > _FLAT * sizes[0])) if sizes[0] > 0.0 else 0
    along = (points - middle) @ axes.T
    if dimensions == 3:
        hull = ConvexHull(points)
        triangles = points[hull.simplices]
        normals = hull.equations[:, :3]
    elif dimensions == 2:
        # A fan of triangles over the polygon.
        corners = points[ConvexHull(along[:, :2]).vertices]
        triangles = np.array([[corners[0], *pair] for pair in itertools.pairwise(corners)])
        normals = np.tile(axes[2], (len(triangles), 1))
    else:
        ends = points[[along[:, 0].argmin(), along[:, 0].argmax()]]
        triangles = np.array([[ends[0], ends[1], ends[1]]])
        normals = np.zeros((1, 3))
    rows = np.concatenate([normals, triangles.reshape(-1, 9)], axis=1)
    return [Face(*row) for row in rows.tolist()], dimensions == 3
