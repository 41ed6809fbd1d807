"""The forms of a fit by name, and which option belongs to which; nothing here is heavy, for help's sake."""

from __future__ import annotations

from collections.abc import Mapping
from numbers import Real

FORMAT_NAMES = (
    "python", "c", "javascript", "csharp", "golden", "lookup", "engine", "json", "latex",
    "markdown", "netcdf", "certificate",
)  # fmt: skip
# What an option is, in words too; and which formats alone have it. `json` leaves the other texts out.
KINDS: Mapping[str, tuple[type, str]] = {
    **dict.fromkeys(("prefix", "range", "at"), (str, "a text")), "engine_inertia": (Real, "a number"),
    **dict.fromkeys(("inputs_only", "json"), (bool, "True or False")),
}  # fmt: skip
OWNERS = {
    "prefix": ("c", "javascript", "csharp"), "inputs_only": ("golden",), "range": ("lookup",), "at": ("engine",),
    "engine_inertia": ("engine",), "json": ("engine", "lookup"),
}  # fmt: skip
