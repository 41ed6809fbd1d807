"""Names that completion offers without loading what they name: models and kernels take a second to import.

`tests/test_completion.py` holds them against the registries.
"""

from __future__ import annotations

from collections.abc import Mapping

_TWO_MASS: Mapping[str, tuple[str, ...]] = {
    "release": ("zero_displacement", "zero_force"),
    "normal": ("inner", "momentum", "total"),
    "offset": ("grip", "contact"),
    "spin": ("shell", "mean"),
    "inertia": ("table", "tied"),
    "torsion": ("matched", "free", "rigid"),
    "cor": ("measured", "mean", "line", "saturating"),
}
_IMPULSE: Mapping[str, tuple[str, ...]] = {"cor": ("line", "saturating")}
# The closures of each model, with their options.
CLOSURES: Mapping[str, Mapping[str, tuple[str, ...]]] = {
    "two-mass": _TWO_MASS,
    "thesis-exact": _TWO_MASS,
    "grip-slip": _IMPULSE,
    "brody": _IMPULSE,
    "thesis": {
        "damping": ("given", "chapter_three", "chapter_five"),
        "inertia": ("table", "tied"),
        "cor": ("measured", "mean", "line"),
    },
}
NOISE_PARAMETERS = (
    "velocity_sd", "v_x_sd", "v_y_sd", "speed_sd", "angle_sd", "spin_sd", "contact_time_sd", "force_sd",
    "force_misfit", "degrees_of_freedom",
)  # fmt: skip
NOISES = ("normal", "student-t")
VELOCITY_NOISES = ("tied", "separate")
LABELS = ("surface", "ball", "group", "location")
EXAMPLES = (*(f"fig{number}" for number in range(8, 29)), "list")
