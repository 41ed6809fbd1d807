"""Simulated tables of many designs, well read and misread: columns in SI by name. A sphere that
slides or grips, with an offset of the normal force (Walton 1993; Cross 2002), written out; nothing
is shared with the package.
"""

from typing import NamedTuple

import numpy as np

SPINS = ("omega_1", "omega_2")
SPEEDS = ("v_x1", "v_y1", "v_x2", "v_y2")
ANGLES = ("theta_1", "theta_2")
UNITS = (
    dict.fromkeys((*SPEEDS, "v_1", "v_2"), "m/s")
    | dict.fromkeys(SPINS, "rad/s")
    | dict.fromkeys(ANGLES, "deg")
)
# Mass [kg], radius [m], I/(M R^2).
TENNIS = (0.0576, 0.03302, 0.56)
PONG = (2.7e-3, 0.02, 2 / 3)
GOLF = (0.0459, 0.02135, 0.4)
BASKET = (0.62, 0.12, 0.62)
SUPER = (0.045, 0.0225, 0.4)
SQUASH = (0.024, 0.02, 0.55)
CRICKET = (0.16, 0.036, 0.4)
# Friction, tangential restitution, offset [m], restitution at 10 m/s and its slope [s/m].
BALL = (0.55, 0.1, 2.5e-3, 0.775, -0.0145)
BOUNCY = (0.6, 0.1, 2e-3, 0.78, -0.01)


class Design(NamedTuple):
    """What impacts of a simulated table are drawn from."""

    #: Ends of the speeds [m/s].
    speeds: tuple = (14, 20)
    #: Ends of the angles to the court [deg].
    angles: tuple = (15, 75)
    #: Ends of the spins [rad/s].
    spins: tuple = (-250, 250)
    #: Sds of the noise, of velocities [m/s] and of spins [rad/s].
    noise: tuple = (0.25, 10)
    ball: tuple = TENNIS
    surface: tuple = BALL
    rows: int = 30


SOFT = (0.55, 0.1, 2e-3, 0.76, -0.01)
DESIGNS = {
    "wide": Design(),
    "all grip": Design(angles=(45, 75), surface=(0.9, *BALL[1:])),
    "all slide": Design((18, 24), (14, 19), (-250, 0), surface=(0.45, *BALL[1:])),
    "one angle": Design(angles=(39, 41)),
    "without spin": Design(spins=(-8, 8)),
    "backspin": Design(spins=(-400, -100)),
    "three rows": Design(rows=3),
    "two rows": Design(rows=2),
    "steep": Design((14, 18), (75, 89), (-20, 20)),
    "dropped": Design(
        speeds=(3, 8),
        angles=(90, 90),
        spins=(0, 0),
        noise=(0.1, 5),
        surface=BOUNCY,
        rows=12,
    ),
    "dropped with spin": Design(
        speeds=(3, 8),
        angles=(90, 90),
        spins=(-200, 200),
        noise=(0.1, 5),
        surface=BOUNCY,
        rows=12,
    ),
    "slow": Design((2, 5), (25, 80), (-60, 60), (0.1, 4), surface=BOUNCY),
    "noisy": Design(noise=(2, 60)),
    "very noisy": Design(noise=(4, 150)),
    "long": Design(surface=SOFT, rows=8000),
    "slippery": Design(surface=(0.08, 0.3, 0.0, 0.8, -0.01)),
    "rolling": Design(surface=(0.55, 0.0, 0.0, 0.75, -0.01)),
    "table tennis": Design(
        speeds=(3, 15),
        spins=(-800, 800),
        noise=(0.1, 10),
        ball=PONG,
        surface=(0.25, 0.1, 0.0, 0.85, -0.01),
    ),
    "golf": Design(
        speeds=(8, 25),
        angles=(30, 60),
        spins=(-900, -200),
        noise=(0.2, 20),
        ball=GOLF,
        surface=(0.35, 0.1, 0.0, 0.6, -0.01),
    ),
    "basketball": Design(
        speeds=(3, 9),
        angles=(25, 80),
        spins=(-20, 20),
        noise=(0.1, 1),
        ball=BASKET,
        surface=(0.8, 0.2, 2e-3, 0.75, -0.01),
    ),
    "superball": Design(
        speeds=(3, 9),
        angles=(25, 80),
        spins=(-200, 200),
        noise=(0.1, 5),
        ball=SUPER,
        surface=(0.8, 0.6, 0.0, 0.88, -0.01),
    ),
    "squash": Design(
        speeds=(8, 40),
        noise=(0.4, 15),
        ball=SQUASH,
        surface=(0.8, 0.0, 1e-3, 0.4, -0.003),
    ),
    "grazing": Design((15, 30), (3, 8), (-50, 50), surface=SOFT),
}
# Balls that lose most of their speed: golf on turf with the restitution of Penner (2002), cricket
# balls on pitches, and tennis balls on soft ground.
TURF = (0.43, 0.0, 0.0, 0.225, -0.0195, 9e-4)
SOFT_DESIGNS = {
    "golf on turf": Design((12, 26), (34, 52), (-700, -200), (0.1, 10), GOLF, TURF, 20),
    "steep golf on turf": Design((18, 30), (45, 65), (-1000, -300), (0.15, 15), GOLF, TURF, 20),
    "driven golf on turf": Design((20, 34), (25, 42), (-400, -100), (0.15, 12), GOLF, TURF, 30),
    "golf on a soft green": Design(
        speeds=(15, 28),
        angles=(35, 55),
        spins=(-900, -200),
        noise=(0.15, 15),
        ball=GOLF,
        surface=(0.35, 0.0, 0.0, 0.16, -0.005),
        rows=18,
    ),
    "cricket": Design(
        (26, 34), (8, 16), (-20, 20), (0.1, 5), CRICKET, (0.35, 0, 0, 0.5, -0.01), 18
    ),
    "spin bowling": Design(
        speeds=(18, 25),
        angles=(15, 35),
        spins=(-150, 250),
        noise=(0.15, 8),
        ball=CRICKET,
        surface=(0.45, 0.1, 0.0, 0.35, -0.01),
        rows=24,
    ),
    "soft pitch": Design(
        speeds=(20, 36),
        angles=(10, 25),
        spins=(-60, 60),
        noise=(0.15, 8),
        ball=CRICKET,
        surface=(0.6, 0.0, 0.0, 0.22, -0.01),
        rows=20,
    ),
    "soft court": Design(surface=(0.75, 0.0, 3e-3, 0.3, -0.01), noise=(0.2, 10)),
    "sand": Design(surface=(0.7, 0.0, 3e-3, 0.14, -0.004), noise=(0.15, 10)),
    "foam ball": Design(
        (5, 14), (20, 75), (-80, 80), (0.1, 5), surface=(0.6, 0.1, 1e-3, 0.42, -0.02)
    ),
}
DESIGNS |= SOFT_DESIGNS


def bounce(v_x, v_y, spin, ball, surface):
    """Rebound of a sphere: the impulse along the court turns the slip round by e_x, or slides with
    friction mu.
    """
    mass, radius, ratio = ball
    mu, e_x, offset, *cor_of = surface
    inertia = ratio * mass * radius**2
    # Of a polynomial about 10 m/s.
    # A coefficient may be one of each impact.
    powers = (coefficient * (v_y - 10.0) ** k for k, coefficient in enumerate(cor_of))
    cor = np.clip(sum(powers), 0.05, 1.0)
    up = cor * v_y
    normal = mass * (v_y + up)
    torque = offset * normal
    # The impulse that turns the slip round, and the largest of friction.
    turn = (1.0 + e_x) * (v_x - radius * spin) + radius * torque / inertia
    compliance = 1.0 / mass + radius**2 / inertia
    limit = mu * normal
    along = np.clip(turn / compliance, -limit, limit)
    v_x2 = v_x - along / mass
    omega_2 = spin + (radius * along - torque) / inertia
    return v_x2, up, omega_2


def table(name, seed):
    """A table of a design, well read, and its ball."""
    design = DESIGNS[name]
    rng = np.random.default_rng([seed, list(DESIGNS).index(name)])
    speed = rng.uniform(*design.speeds, design.rows)
    angle = np.radians(rng.uniform(*design.angles, design.rows))
    v_x1 = speed * np.cos(angle)
    v_y1 = speed * np.sin(angle)
    omega_1 = rng.uniform(*design.spins, design.rows)
    mu, *others = design.surface
    surface = (mu * np.exp(0.2 * rng.normal()), *others)
    v_x2, v_y2, omega_2 = bounce(v_x1, v_y1, omega_1, design.ball, surface)
    errors = rng.normal(size=(3, design.rows))
    velocity_sd, spin_sd = design.noise
    columns = {
        "v_x1": v_x1,
        "v_y1": v_y1,
        "omega_1": omega_1,
        "v_x2": v_x2 + errors[0] * velocity_sd,
        "v_y2": np.abs(v_y2 + errors[1] * velocity_sd),
        "omega_2": omega_2 + errors[2] * spin_sd,
    }
    return columns, design.ball


def polar(columns):
    """Speeds and angles instead of components."""
    turned = {name: values for name, values in columns.items() if name in SPINS}
    for end in "12":
        x = columns[f"v_x{end}"]
        y = columns[f"v_y{end}"]
        turned[f"v_{end}"] = np.hypot(x, y)
        turned[f"theta_{end}"] = np.arctan2(y, x)
    return turned


def spinless(columns):
    return {name: values for name, values in columns.items() if name not in SPINS}


def times(factor, *names):
    """What a wrong unit or sign does."""

    def misread(columns):
        changed = dict(columns)
        for name in columns:
            if name in names:
                changed[name] = columns[name] * factor
        return changed

    return misread


def from_normal(*names):
    """What angles to the normal do that are read as angles to the court."""

    def misread(columns):
        changed = polar(columns)
        for name in names:
            changed[name] = np.pi / 2 - changed[name]
        return changed

    return misread


def exchanged(*pairs):
    """What columns do that are taken for each other."""
    other = {}
    for first, second in pairs:
        other[first] = second
        other[second] = first

    def misread(columns):
        return {other.get(name, name): values for name, values in columns.items()}

    return misread


def _mph_and_rpm(columns):
    in_rpm = times(RPM, *SPINS)(columns)
    return times(MPH, *SPEEDS)(in_rpm)


def _radians(columns):
    return times(1 / DEG, *ANGLES)(polar(columns))


RPM = 30.0 / np.pi
REV = 0.5 / np.pi
KMH = 3.6
MPH = 1.0 / 0.44704
DEG = 180.0 / np.pi
MISREADINGS = {
    "both spins": times(-1, *SPINS),
    "incident spin": times(-1, "omega_1"),
    "rebound spin": times(-1, "omega_2"),
    "v_x of both": times(-1, "v_x1", "v_x2"),
    "v_x of the rebound": times(-1, "v_x2"),
    "v_y towards the court": times(-1, "v_y1"),
    "rpm": times(RPM, *SPINS),
    "rebound rpm": times(RPM, "omega_2"),
    "rev/s": times(REV, *SPINS),
    "deg/s": times(DEG, *SPINS),
    "km/h": times(KMH, *SPEEDS),
    "mph": times(MPH, *SPEEDS),
    "rebound mph": times(MPH, "v_x2", "v_y2"),
    "mph and rpm": _mph_and_rpm,
    "both spins, in rpm": times(-RPM, *SPINS),
    "from the normal": from_normal(*ANGLES),
    "incident from the normal": from_normal("theta_1"),
    "radians": _radians,
    "ends": exchanged(("v_x1", "v_x2"), ("v_y1", "v_y2"), SPINS),
    "components": exchanged(("v_x1", "v_y1"), ("v_x2", "v_y2")),
    "spins exchanged": exchanged(SPINS),
}


def means(read, columns):
    """Whether columns as read anew are these, or their mirror image, which is the same table."""
    read = _with_polar(read)
    same = _with_polar(columns)
    mirrored = dict(same)
    for name in mirrored:
        if name in ("v_x1", "v_x2", *SPINS):
            mirrored[name] = -same[name]
        elif name in ANGLES:
            mirrored[name] = np.pi - same[name]
    return _agree(read, same) or _agree(read, mirrored)


def _with_polar(columns):
    """Components with speeds and angles beside them."""
    if {"v_x1", "v_x2"} <= columns.keys():
        return polar(columns) | columns
    return columns


def _agree(first, second):
    """Whether the columns that both have are equal."""
    for name in first.keys() & second.keys():
        if not np.allclose(first[name], second[name], rtol=1e-9, atol=1e-9):
            return False
    return True
