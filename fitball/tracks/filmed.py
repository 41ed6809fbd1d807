"""What a scene says about a film: how its files are to be read, and what is known of ball, air and contact.

A tennis ball is known well. Of a table-tennis ball the contact time is that of a spring of the stiffness of a
spherical shell under a point load (E. Reissner, J. Math. Phys. 25 (1946) 279), `T = pi sqrt(M/k)` with
`k = 4 E h^2 / (R sqrt(3 (1 - nu^2)))`: 0.8 ms for 0.4 mm of celluloid of 2.2 GPa. Measured ones are near (M. Hubbard
and W. J. Stronge, Sports Eng. 4 (2001) 49). Of other balls only the order of magnitude is taken as known. Drag of
spheres that are no tennis balls is that below the drag crisis (E. Achenbach, J. Fluid Mech. 54 (1972) 565).
"""

from __future__ import annotations

from dataclasses import replace

from fitball.data.heights import AIR_DENSITY, DRAG_COEFFICIENT
from fitball.data.scene import Camera, Scene
from fitball.tracks.clips import Reading
from fitball.tracks.frames import Air, Filmed
from fitball.values import WANG_RADIUS, Ball

# Mean and range of contact times [s].
TENNIS_CONTACT = (4.7e-3, 2e-3, 9e-3)
TABLE_TENNIS_CONTACT = (0.9e-3, 0.3e-3, 2.5e-3)
ANY_CONTACT = (3e-3, 0.1e-3, 40e-3)
# By mass [kg] and radius [m]: 2.7 g and 20 mm, older balls 2.5 g and 19 mm.
_TABLE_TENNIS = ((2.2e-3, 3.2e-3), (18.5e-3, 20.7e-3))
_SPHERE_DRAG, _SPHERE_DRAG_SD, _SPHERE_LIFT_SD = 0.45, 0.1, 0.15
# Spread of incident spins of tennis balls [rad/s]. Other balls have the same speed of their surface.
_SPIN_SD = 250.0
# Of dry air [J/(kg K)]; pressure at sea level [Pa].
_GAS, _PRESSURE, _ZERO = 287.05, 101_325.0, 273.15
# A stated contact time is that of the scene give or take so many of its sds.
_SPREADS = 5.0


def like_table_tennis(ball: Ball) -> bool:
    """Whether a ball is one of table tennis, by its mass and size."""
    (light, heavy), (small, large) = _TABLE_TENNIS
    return light <= ball.mass <= heavy and small <= ball.radius <= large


def reading_from(scene: Scene, how: Reading | None = None) -> Reading:
    """How files of positions are to be read: what `how` leaves open is taken from the scene."""
    how, camera = how or Reading(), scene.camera or Camera()
    return replace(
        how,
        fps=camera.fps if how.fps is None else how.fps,
        metres_per_px=1e-3 * camera.mm_per_px
        if how.metres_per_px is None and camera.mm_per_px is not None
        else how.metres_per_px,
        ball=scene.ball,
        states_ball=how.states_ball or scene.states_ball,
        air_density=density_of(scene),
        y_down=scene.y_axis == "down" if how.y_down is None and scene.y_axis is not None else how.y_down,
    )


def filmed_from(scene: Scene, court: float | None = None) -> Filmed:
    """What is known about a film; `court` [m] is the height of the court in the coordinates of the tracks, None where
    it is not known. `assumptions_of` has the words.
    """
    camera = scene.camera or Camera()
    return Filmed(
        ball=scene.ball, air=_air(scene), camera=camera, court=court, contact_time=_contact_time(scene),
        spin_sd=scene.incident_spin_sd or _SPIN_SD * (1.0 if scene.tennis else WANG_RADIUS / scene.ball.radius),
        row_time=camera.row_time,
    )  # fmt: skip


def density_of(scene: Scene) -> float:
    """Density of the air [kg/m^3], as stated, or that of dry air at the temperature and pressure stated."""
    if scene.air_density is not None:
        return scene.air_density
    if scene.air_temperature is None and scene.air_pressure is None:
        return AIR_DENSITY
    warmth = 20.0 if scene.air_temperature is None else scene.air_temperature.value
    return (scene.air_pressure or _PRESSURE) / (_GAS * (warmth + _ZERO))


def _air(scene: Scene) -> Air:
    drag, drag_sd, lift_sd = DRAG_COEFFICIENT, Air.drag_sd, Air.lift_sd
    if not scene.tennis:
        drag, drag_sd, lift_sd = _SPHERE_DRAG, _SPHERE_DRAG_SD, _SPHERE_LIFT_SD
    lift = 0.0
    if scene.drag is not None:
        drag, drag_sd = scene.drag.value, scene.drag.sd or Air.drag_shot_sd
    if scene.lift is not None:
        lift, lift_sd = scene.lift.value, scene.lift.sd or lift_sd
    return Air(density_of(scene), drag, drag_sd, lift_sd=lift_sd, lift=lift)


def _contact_time(scene: Scene) -> tuple[float, float, float]:
    if scene.contact_time is not None:
        value, sd = scene.contact_time
        return value, max(value - _SPREADS * sd, 0.2 * value), value + _SPREADS * sd
    if scene.tennis:
        return TENNIS_CONTACT
    return TABLE_TENNIS_CONTACT if like_table_tennis(scene.ball) else ANY_CONTACT


def assumptions_of(scene: Scene) -> tuple[str, ...]:
    """What `filmed_from` assumes, in sentences for notes."""
    mean, low, high = (1e3 * time for time in _contact_time(scene))
    words = []
    if scene.contact_time is None and not scene.tennis:
        which = (
            "of table tennis" if like_table_tennis(scene.ball) else "of any kind: state [contact_time] in the scene"
        )
        words.append(f"contact times of {low:g} to {high:g} ms are plausible, about {mean:g} ms, for a ball {which}")
    if scene.drag is None and not scene.tennis:
        words.append(f"drag coefficient {_SPHERE_DRAG:g} ± {_SPHERE_DRAG_SD:g}, that of smooth spheres")
    if scene.incident_spin_sd is None and not scene.tennis:
        words.append(f"incident spins within about {filmed_from(scene).spin_sd:.0f} rad/s of zero")
    return tuple(words)
