"""Bounces to try: compositions, and random parameters and impacts, near measured ones or far from
them.
"""

from support.taylor import DEFAULT

OPTIONS = {
    "normal": ("momentum", "total", "inner"),
    "offset": ("contact", "grip"),
    "torsion": ("matched", "free"),
    "inertia": ("tied", "table"),
    "spin": ("mean", "shell"),
    "release": ("zero_force", "zero_displacement"),
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


def random_bounce(rng, options, wide=False):
    """Parameters and an impact: near those of tennis balls, or `wide`, wherever they are
    possible.
    """
    mass_ratio = rng.uniform(0.4, 0.97)
    ceiling = mass_ratio if options["normal"] == "momentum" else 1.0
    values = {
        "mass_ratio": mass_ratio,
        "k_y": 10.0 ** rng.uniform(*((2.0, 7.0) if wide else (4.0, 4.7))),
        "mu": float(rng.choice([0.02, 0.1, 0.3, 0.55, 1.0, 3.0])),
        "eps_10": rng.choice([3e-3, 1.5e-2]) * rng.standard_normal(),
        "eps_slope": 1e-4 * rng.standard_normal(),
        "cor_10": rng.uniform(*((0.03, 0.999) if wide else (0.5, 0.95))) * ceiling,
        "zeta_theta": 10.0 ** rng.uniform(*((-4.0, 1.0) if wide else (-2.0, 0.3))),
        "inertia_split": rng.uniform(0.05, 0.95),
    }
    # A joint as fast as the vertical motion, or up to some ten (hundred) times.
    values["k_theta"] = values["k_y"] * 10.0 ** rng.uniform(
        *((-4.0, -0.5) if wide else (-3.0, -1.5))
    )
    values["cor_slope"] = values["cor_10"] * (
        rng.uniform(-0.09, 0.01) if wide else rng.uniform(-0.03, 0.002)
    )
    size = 10.0 ** rng.uniform(-3.0, 2.0) if wide else 1.0
    v_x = size * rng.uniform(-30.0, 30.0) * rng.choice([1.0, 0.1])
    return values, (v_x, size * rng.uniform(3.0, 20.0), size * rng.uniform(-500.0, 500.0))
