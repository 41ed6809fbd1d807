"""A statement about a printed table that a recomputation confirms or refutes."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Check:
    """`name` of what was recomputed; `finding` in words; `holds` whether the recomputation still gives what it gave
    when this was written, so that a change in the code shows.
    """

    name: str
    finding: str
    holds: bool
