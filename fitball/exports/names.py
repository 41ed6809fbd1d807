"""The forms of a fit by name, and which option belongs to which; nothing here is heavy, for help's sake."""

from __future__ import annotations

FORMAT_NAMES = (
    "python", "c", "javascript", "csharp", "gdscript", "golden", "lookup", "engine", "json", "toml", "csv", "latex",
    "markdown", "netcdf", "certificate",
)  # fmt: skip
# Options that some formats alone have; `json` leaves the other texts out.
OWNERS = {
    "prefix": ("c", "javascript", "csharp"), "inputs_only": ("golden",), "range": ("lookup",), "at": ("engine",),
    "engine_inertia": ("engine",), "json": ("engine", "lookup"),
}  # fmt: skip
