"""Bounces to try: compositions, and random parameters and impacts, near measured ones or far from
them.
"""

from typing import NamedTuple

from support.taylor import DEFAULT

OPTIONS = {
    "normal": ("momentum", "total", "inner"),
    "offset": ("contact", "grip"),
    "torsion": ("matched", "free"),
    "inertia": ("tied", "table"),
    "spin": ("mean", "shell"),
    "release": ("zero_force", "zero_displacement"),
    "cor": ("saturating", "power", "line", "root"),
}
THESIS_EXACT = {
    **DEFAULT,
    "normal": "inner",
    "offset": "grip",
    "spin": "shell",
    "release": "zero_displacement",
}
# The default, the thesis's, and each option away from the default.
COMPOSITIONS = [DEFAULT, THESIS_EXACT] + [
    {**DEFAULT, name: value} for name, values in OPTIONS.items() for value in values[1:]
]


def text_of(options):
    """The two-mass model with these options, as `fitball.model` takes it."""
    changes = [f"{name}={value}" for name, value in options.items() if value != DEFAULT[name]]
    return "+".join(["two-mass", *changes])


def random_options(rng):
    """A random option of each choice."""
    return {name: str(rng.choice(values)) for name, values in OPTIONS.items()}


class Ranges(NamedTuple):
    """Ends of random parameters: powers of ten, or of `cor_10` shares of the largest restitution,
    and of `cor_slope` shares of `cor_10`. A joint of `k_theta` is so much softer than `k_y`.
    """

    k_y: tuple[float, float]
    k_theta: tuple[float, float]
    cor_10: tuple[float, float]
    cor_slope: tuple[float, float]
    zeta_theta: tuple[float, float]


# Near those of tennis balls: a joint as fast as the vertical motion, or up to some ten times.
NEAR = Ranges(
    k_y=(4.0, 4.7),
    k_theta=(-3.0, -1.5),
    cor_10=(0.5, 0.95),
    cor_slope=(-0.03, 0.002),
    zeta_theta=(-2.0, 0.3),
)
# Wherever they are possible: a joint up to some hundred times as fast.
FAR = Ranges(
    k_y=(2.0, 7.0),
    k_theta=(-4.0, -0.5),
    cor_10=(0.03, 0.999),
    cor_slope=(-0.09, 0.01),
    zeta_theta=(-4.0, 1.0),
)


def random_bounce(rng, options, wide=False):
    """Parameters and an impact: near those of tennis balls, or `wide`, wherever they are
    possible.
    """
    ends = FAR if wide else NEAR
    mass_ratio = rng.uniform(0.4, 0.97)
    ceiling = mass_ratio if options["normal"] == "momentum" else 1.0
    values = {
        "mass_ratio": mass_ratio,
        "k_y": 10.0 ** rng.uniform(*ends.k_y),
        "mu": float(rng.choice([0.02, 0.1, 0.3, 0.55, 1.0, 3.0])),
        "eps_10": rng.choice([3e-3, 1.5e-2]) * rng.standard_normal(),
        "eps_slope": 1e-4 * rng.standard_normal(),
        "cor_10": rng.uniform(*ends.cor_10) * ceiling,
        "zeta_theta": 10.0 ** rng.uniform(*ends.zeta_theta),
        "inertia_split": rng.uniform(0.05, 0.95),
    }
    values["k_theta"] = values["k_y"] * 10.0 ** rng.uniform(*ends.k_theta)
    values["cor_slope"] = values["cor_10"] * rng.uniform(*ends.cor_slope)
    size = 10.0 ** rng.uniform(-3.0, 2.0) if wide else 1.0
    v_x = size * rng.uniform(-30.0, 30.0) * rng.choice([1.0, 0.1])
    v_y = size * rng.uniform(3.0, 20.0)
    omega = size * rng.uniform(-500.0, 500.0)
    return values, (v_x, v_y, omega)
