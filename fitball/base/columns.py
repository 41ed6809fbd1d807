"""The columns of a table, incident and rebound, in one registry: a new column is one row.

Sources of noises: v 0.25 m/s, 1.4 deg, 10 rad/s as in Wang's tables; of the contact time a frame at
5,000/s; of the gaps what flights of 1 mm and 2 deg a frame leave, ten frames long.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import pi
from typing import Literal

import numpy as np

from fitball.base.display_units import DEG, MM, MS, SI
from fitball.base.numbers import Unit
from fitball.base.priors import ParameterSpec
from fitball.base.values import FloatArray

# The incident state, and all columns by end, in the order in which tables have them.
STATE = ("v_x1", "v_y1", "omega_1")
INCIDENT = (*STATE, "v_1", "theta_1")
REBOUND = (
    "v_x2",
    "v_y2",
    "v_2",
    "theta_2",
    "omega_2",
    "contact_time",
    "gap_time",
    "gap_path",
    "gap_turn",
)
# Those of the other sign for the mirror image of an impact. Angles to the court are then those to
# 180 degrees, so that their deviations have the other sign too.
MIRRORED = ("v_x1", "omega_1", "v_x2", "omega_2", "gap_path", "gap_turn")
MIRRORED_DEVIATIONS = (*MIRRORED, "theta_1", "theta_2")
# What laboratories write instead of speeds of a drop test; a table has the speeds.
SPEED_OF_HEIGHT = {"drop_height": "v_y1", "rebound_height": "v_y2"}
HEIGHTS = tuple(SPEED_OF_HEIGHT)
# Flights from one bounce to the next, before and after the impact; a table has the speeds.
SPEED_OF_FLIGHT = {"flight_time_1": "v_y1", "flight_time_2": "v_y2"}
FLIGHTS = tuple(SPEED_OF_FLIGHT)
# Columns of which each row is one of successive bounces of a ball.
SERIES = ("bounce_time", "bounce_interval", "peak_height")
# What stands for a rebound speed beside an incident one.
RATIOS = ("cor", "height_ratio")
# Columns that become velocities, of names that people also give to labels and results.
OTHER_FORMS = (*FLIGHTS, *SERIES, *RATIOS, "surface_speed")
# The components of the velocity at the ends of the bounce, "1" incident and "2" rebound.
COMPONENTS: Mapping[str, tuple[str, str]] = {"1": ("v_x1", "v_y1"), "2": ("v_x2", "v_y2")}


@dataclass(frozen=True)
class Column:
    """A column of numbers: SI `unit` (empty: dimensionless), angles in radians, and the
    `display_unit` that people read, by default `unit`; numbers outside `limits` are faults;
    `opposite` is the other convention. `tangential` ones need motion along the court, `timed` ones
    a time axis, `gap` ones lie between the flights. `noise` is the scatter of a rebound column;
    `formula` gives it from the components of the velocity at its end, None: a measurement of its
    own, or a model's output.
    """

    name: str
    unit: str
    title: str
    symbol: str
    limits: tuple[float, float]
    display_unit: Unit = SI
    opposite: Literal["", "negated", "from the normal"] = ""
    tangential: bool = False
    timed: bool = False
    gap: bool = False
    noise: ParameterSpec | None = None
    formula: Callable[[FloatArray, FloatArray], FloatArray] | None = None

    def __post_init__(self) -> None:
        if self.display_unit is SI:
            object.__setattr__(self, "display_unit", Unit(self.unit))

    @property
    def vertical(self) -> bool:
        """Whether a drop shows it: without motion along the court, and without a time axis."""
        return not self.tangential and not self.timed

    @property
    def of_velocity(self) -> bool:
        """Whether it is a component of a velocity, or follows from both."""
        return self.formula is not None or any(self.name in pair for pair in COMPONENTS.values())


# Ten times the fastest serve of any ball game, and more.
_ALONG = (-1000.0, 1000.0)
_FAST = (0.0, 1000.0)
# A ball that does not come has no bounce.
_COMING = (1e-3, 1000.0)
# Ten times the fastest spins of any ball game, and more.
_SPIN = (-1e5, 1e5)
# From a fifth of a millisecond (hard spheres of some centimetres) to some tens.
_TIME = (1e-4, 0.1)
# Drops from a millimetre to a fall at 31 m/s.
_HEIGHT = (1e-3, 50.0)
# From a bounce of a tenth of a millimetre to one of 31 m.
_FLIGHT = (0.01, 5.0)
# Seconds of a day and more, from any zero.
_MOMENT = (-1e6, 1e6)
# A ball that leaves half as fast again as it came was hit, or the number is in percent.
_RATIO = (0.0, 1.5)
# Between its flights a ball moves less than in a tenth of a second at the largest speeds,
_PATH = (-10.0, 10.0)
# and turns less than in that time at any spin that was measured.
_TURN = (-1e3, 1e3)
# A grazing impact of less than 0.006 degrees is none.
_FALLING = (1e-4, pi - 1e-4)
# A rebound leaves the court.
_RISING = (0.0, pi)


def _noise(
    name: str,
    unit: str,
    ends: tuple[float, float],
    typical: str,
    column: str,
    symbol: str,
    display_unit: Unit = SI,
) -> ParameterSpec:
    """Scatter of a column, one sd common to all rows: within a factor 4 of what is typical (95
    %).
    """
    prior = f"lognormal({typical}, 0.7)"
    meaning = f"noise of {column}"
    return ParameterSpec(name, unit, *ends, prior, meaning, symbol, display_unit=display_unit)


def _angle(v_x: FloatArray, v_y: FloatArray) -> FloatArray:
    """Between velocity and court, 0 to pi, above pi/2 where the ball moves backwards."""
    return np.asarray(np.arctan2(v_y, v_x))


# From a tenth of a millimetre a second, finer than any camera, to what is no measurement any more.
_SPEED_SD = (1e-4, 10.0)
# From a microsecond to some contacts.
_TIME_SD = (1e-6, 1e-2)
_ALL = (
    Column("v_x1", "m/s", "horizontal incident velocity", r"$v_{x1}$", _ALONG, opposite="negated"),
    Column("v_y1", "m/s", "vertical incident velocity", r"$v_{y1}$", _COMING, opposite="negated"),
    Column("omega_1", "rad/s", "incident spin", r"$\omega_1$", _SPIN, opposite="negated"),
    Column("v_1", "m/s", "incident speed", r"$v_1$", _COMING, formula=np.hypot),
    Column(
        "theta_1",
        "rad",
        "incident angle",
        r"$\theta_1$",
        _FALLING,
        display_unit=DEG,
        opposite="from the normal",
        formula=_angle,
    ),
    Column(
        "v_x2",
        "m/s",
        "horizontal rebound velocity",
        r"$v_{x2}$",
        _ALONG,
        opposite="negated",
        tangential=True,
        noise=_noise("v_x_sd", "m/s", _SPEED_SD, "0.25", "v_x2", r"$\sigma_{v_x}$"),
    ),
    Column(
        "v_y2",
        "m/s",
        "vertical rebound velocity",
        r"$v_{y2}$",
        _FAST,
        opposite="negated",
        noise=_noise("v_y_sd", "m/s", _SPEED_SD, "0.25", "v_y2", r"$\sigma_{v_y}$"),
    ),
    Column(
        "v_2",
        "m/s",
        "rebound speed",
        r"$v_2$",
        _FAST,
        formula=np.hypot,
        noise=_noise("speed_sd", "m/s", _SPEED_SD, "0.25", "v_2", r"$\sigma_{|v|}$"),
    ),
    Column(
        "theta_2",
        "rad",
        "rebound angle",
        r"$\theta_2$",
        _RISING,
        display_unit=DEG,
        opposite="from the normal",
        tangential=True,
        formula=_angle,
        noise=_noise(
            "angle_sd",
            "rad",
            (1e-5, 1.6),
            "0.025",
            "theta_2",
            r"$\sigma_\theta$",
            DEG,
        ),
    ),
    Column(
        "omega_2",
        "rad/s",
        "rebound spin",
        r"$\omega_2$",
        _SPIN,
        opposite="negated",
        tangential=True,
        noise=_noise("spin_sd", "rad/s", (1e-2, 1e3), "10", "omega_2", r"$\sigma_\omega$"),
    ),
    Column(
        "contact_time",
        "s",
        "contact time",
        r"$t_c$",
        _TIME,
        display_unit=MS,
        timed=True,
        noise=_noise(
            "contact_time_sd",
            "s",
            _TIME_SD,
            "2e-4",
            "contact_time",
            r"$\sigma_t$",
            MS,
        ),
    ),
    Column(
        "gap_time",
        "s",
        "time between the flights",
        r"$T$",
        _TIME,
        display_unit=MS,
        timed=True,
        gap=True,
        noise=_noise(
            "gap_time_sd",
            "s",
            _TIME_SD,
            "1e-4",
            "gap_time",
            r"$\sigma_T$",
            MS,
        ),
    ),
    Column(
        "gap_path",
        "m",
        "path between the flights",
        r"$P$",
        _PATH,
        display_unit=MM,
        opposite="negated",
        tangential=True,
        timed=True,
        gap=True,
        noise=_noise(
            "gap_path_sd",
            "m",
            (1e-6, 0.2),
            "1e-3",
            "gap_path",
            r"$\sigma_P$",
            MM,
        ),
    ),
    Column(
        "gap_turn",
        "rad",
        "turn between the flights",
        r"$Q$",
        _TURN,
        display_unit=DEG,
        opposite="negated",
        tangential=True,
        timed=True,
        gap=True,
        noise=_noise(
            "gap_turn_sd",
            "rad",
            (1e-5, 6.0),
            "0.04",
            "gap_turn",
            r"$\sigma_Q$",
            DEG,
        ),
    ),
    Column("drop_height", "m", "drop height", r"$h_1$", _HEIGHT),
    Column("rebound_height", "m", "rebound height", r"$h_2$", _HEIGHT),
    Column("flight_time_1", "s", "time of the flight before the impact", r"$T_1$", _FLIGHT),
    Column("flight_time_2", "s", "time of the flight after the impact", r"$T_2$", _FLIGHT),
    Column("bounce_time", "s", "moment of one of successive bounces", "$t$", _MOMENT),
    Column("bounce_interval", "s", "time from a bounce to the next", "$T$", _FLIGHT),
    Column("peak_height", "m", "greatest height after a bounce", "$h$", _HEIGHT),
    Column("cor", "", "coefficient of restitution", "$e$", _RATIO),
    Column("height_ratio", "", "rebound height over drop height", "$h_2/h_1$", _RATIO),
    Column(
        "surface_speed",
        "m/s",
        "speed of the surface towards the ball",
        "$v_s$",
        _ALONG,
        opposite="negated",
    ),
)
COLUMNS: Mapping[str, Column] = {column.name: column for column in _ALL}


def velocity_columns(end: str) -> tuple[str, ...]:
    """The columns of one end of the bounce ("1" incident, "2" rebound) that are its velocity or
    follow from it, components first. Any two of them say the others.
    """
    names = INCIDENT if end == "1" else REBOUND
    others = [name for name in names if COLUMNS[name].of_velocity and name not in COMPONENTS[end]]
    return (*COMPONENTS[end], *others)
