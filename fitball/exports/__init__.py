"""A saved fit in the forms that other programs read: parameter sets, tables, engine settings, netCDF, source code,
a page with sliders. Here stand the names of the forms and which option belongs to which, without anything heavy.

Offers: `TEXT_FORMATS`, `interactive_page`.
May import: report, inference, models, data.
"""

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
