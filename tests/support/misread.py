"""Simulated tables of many designs, well read and misread: columns in SI by name. A sphere that
slides or grips, with an offset of the normal force (Walton 1993; Cross 2002), written out; nothing
is shared with the package.
"""

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
# Friction, tangential restitution, offset [m], restitution at 10 m/s and its slope [s/m].
BALL = (0.55, 0.1, 2.5e-3, 0.775, -0.0145)
BOUNCY = (0.6, 0.1, 2e-3, 0.78, -0.01)
WIDE = ((14, 20), (15, 75), (-250, 250))
SMALL = (0.25, 10)
# Rows; speeds [m/s], angles to the court [deg], spins [rad/s]; noise [m/s], [rad/s]; ball; surface.
DESIGNS = {
    "wide": (30, WIDE, SMALL, TENNIS, BALL),
    "all grip": (30, ((14, 20), (45, 75), (-250, 250)), SMALL, TENNIS, (0.9, *BALL[1:])),
    "all slide": (30, ((18, 24), (14, 19), (-250, 0)), SMALL, TENNIS, (0.45, *BALL[1:])),
    "one angle": (30, ((14, 20), (39, 41), (-250, 250)), SMALL, TENNIS, BALL),
    "without spin": (30, ((14, 20), (15, 75), (-8, 8)), SMALL, TENNIS, BALL),
    "backspin": (30, ((14, 20), (15, 75), (-400, -100)), SMALL, TENNIS, BALL),
    "three rows": (3, WIDE, SMALL, TENNIS, BALL),
    "two rows": (2, WIDE, SMALL, TENNIS, BALL),
    "steep": (30, ((14, 18), (75, 89), (-20, 20)), SMALL, TENNIS, BALL),
    "dropped": (12, ((3, 8), (90, 90), (0, 0)), (0.1, 5), TENNIS, BOUNCY),
    "dropped with spin": (12, ((3, 8), (90, 90), (-200, 200)), (0.1, 5), TENNIS, BOUNCY),
    "slow": (30, ((2, 5), (25, 80), (-60, 60)), (0.1, 4), TENNIS, BOUNCY),
    "noisy": (30, WIDE, (2, 60), TENNIS, BALL),
    "very noisy": (30, WIDE, (4, 150), TENNIS, BALL),
    "long": (8000, WIDE, SMALL, TENNIS, (0.55, 0.1, 2e-3, 0.76, -0.01)),
    "slippery": (30, WIDE, SMALL, TENNIS, (0.08, 0.3, 0.0, 0.8, -0.01)),
    "rolling": (30, WIDE, SMALL, TENNIS, (0.55, 0.0, 0.0, 0.75, -0.01)),
    "table tennis": (
        30,
        ((3, 15), (15, 75), (-800, 800)),
        (0.1, 10),
        PONG,
        (0.25, 0.1, 0.0, 0.85, -0.01),
    ),
    "golf": (30, ((8, 25), (30, 60), (-900, -200)), (0.2, 20), GOLF, (0.35, 0.1, 0.0, 0.6, -0.01)),
    "basketball": (
        30,
        ((3, 9), (25, 80), (-20, 20)),
        (0.1, 1),
        BASKET,
        (0.8, 0.2, 2e-3, 0.75, -0.01),
    ),
    "superball": (
        30,
        ((3, 9), (25, 80), (-200, 200)),
        (0.1, 5),
        SUPER,
        (0.8, 0.6, 0.0, 0.88, -0.01),
    ),
    "squash": (
        30,
        ((8, 40), (15, 75), (-250, 250)),
        (0.4, 15),
        SQUASH,
        (0.8, 0.0, 1e-3, 0.4, -0.003),
    ),
    "grazing": (30, ((15, 30), (3, 8), (-50, 50)), SMALL, TENNIS, (0.55, 0.1, 2e-3, 0.76, -0.01)),
}


def bounce(v_x, v_y, spin, ball, surface):
    """Rebound of a sphere: the impulse along the court turns the slip round by e_x, or slides with
    friction mu.
    """
    mass, radius, ratio = ball
    mu, e_x, offset, cor, slope = surface
    inertia = ratio * mass * radius**2
    up = np.clip(cor + slope * (v_y - 10.0), 0.05, 1.0) * v_y
    normal = mass * (v_y + up)
    grip = (1.0 + e_x) * (v_x - radius * spin) + radius * offset * normal / inertia
    along = np.clip(grip / (1.0 / mass + radius**2 / inertia), -mu * normal, mu * normal)
    return v_x - along / mass, up, spin + (radius * along - offset * normal) / inertia


def table(design, seed):
    """A table of a design, well read, and its ball."""
    count, (speeds, angles, spins), (velocity_sd, spin_sd), ball, surface = DESIGNS[design]
    rng = np.random.default_rng([seed, list(DESIGNS).index(design)])
    speed = rng.uniform(*speeds, count)
    angle = np.radians(rng.uniform(*angles, count))
    state = (speed * np.cos(angle), speed * np.sin(angle), rng.uniform(*spins, count))
    after = bounce(*state, ball, (surface[0] * np.exp(0.2 * rng.normal()), *surface[1:]))
    noise = rng.normal(size=(3, count)) * [[velocity_sd], [velocity_sd], [spin_sd]]
    rebound = [
        np.abs(x + e) if k == 1 else x + e
        for k, (x, e) in enumerate(zip(after, noise, strict=True))
    ]
    return dict(
        zip(("v_x1", "v_y1", "omega_1", "v_x2", "v_y2", "omega_2"), (*state, *rebound), strict=True)
    ), ball


def polar(columns):
    """Speeds and angles instead of components."""
    turned = {name: values for name, values in columns.items() if name in SPINS}
    for end in "12":
        x = columns[f"v_x{end}"]
        y = columns[f"v_y{end}"]
        turned |= {f"v_{end}": np.hypot(x, y), f"theta_{end}": np.arctan2(y, x)}
    return turned


def spinless(columns):
    return {name: values for name, values in columns.items() if name not in SPINS}


def times(factor, *names):
    """What a wrong unit or sign does."""
    return lambda columns: {
        name: values * (factor if name in names else 1.0) for name, values in columns.items()
    }


def from_normal(*names):
    return lambda columns: {
        n: np.pi / 2 - x if n in names else x for n, x in polar(columns).items()
    }


def exchanged(*pairs):
    other = dict(pairs) | {two: one for one, two in pairs}
    return lambda columns: {other.get(name, name): values for name, values in columns.items()}


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
    "mph and rpm": lambda columns: times(MPH, *SPEEDS)(times(RPM, *SPINS)(columns)),
    "both spins, in rpm": times(-RPM, *SPINS),
    "from the normal": from_normal(*ANGLES),
    "incident from the normal": from_normal("theta_1"),
    "radians": lambda columns: times(1 / DEG, *ANGLES)(polar(columns)),
    "ends": exchanged(*((f"{name}1", f"{name}2") for name in ("v_x", "v_y", "omega_"))),
    "components": exchanged(("v_x1", "v_y1"), ("v_x2", "v_y2")),
    "spins exchanged": exchanged(SPINS),
}


def means(read, columns):
    """Whether columns as read anew are these, or their mirror image, which is the same table."""
    one, other = (
        polar(item) | item if {"v_x1", "v_x2"} <= item.keys() else item for item in (read, columns)
    )
    mirrored = dict(other)
    for name in mirrored:
        if name in ("v_x1", "v_x2", *SPINS):
            mirrored[name] = -other[name]
        elif name in ANGLES:
            mirrored[name] = np.pi - other[name]
    return any(
        all(
            np.allclose(one[name], item[name], rtol=1e-9, atol=1e-9) for name in one if name in item
        )
        for item in (other, mirrored)
    )
