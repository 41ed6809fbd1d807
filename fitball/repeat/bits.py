"""Whether two results are the same bytes, and where they are not."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from fitball.repeat.kept import Kept

# What says where and with what a fit was made, not what it found.
IGNORED = ("versions", "source.name", "source.file", "source.force.file")


def differing_leaves(one: Any, other: Any, at: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Every number or text of two JSON trees that is not the same to the last digit: its dotted place, and both."""
    if at in IGNORED:
        return
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        for key in dict.fromkeys([*one, *other]):
            place = f"{at}.{key}" if at else key
            yield from differing_leaves(one.get(key), other.get(key), place)
    elif isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        for k, (a, b) in enumerate(zip(one, other, strict=True)):
            yield from differing_leaves(a, b, f"{at}[{k}]")
    # As text, so that minus zero is not zero and true is not one.
    elif json.dumps(one) != json.dumps(other):
        yield at, one, other


def same_bytes(original: Kept, repeated: Kept) -> dict[str, bool]:
    """Which parts of two results are equal bit for bit; parts that only one of them has are left out."""
    equal = {"fit.json": next(differing_leaves(original.content, repeated.content), None) is None}
    one, other = original.posterior, repeated.posterior
    if one is not None and other is not None:
        parts = [(getattr(one, part), getattr(other, part)) for part in ("values", "log_posterior", "prior_draws")]
        same = all(a.shape == b.shape and a.tobytes() == b.tobytes() for a, b in parts)
        equal["draws"] = one.names == other.names and same
    elif one is not None or other is not None:
        equal["draws"] = False
    if original.chains is not None and repeated.chains is not None:
        equal["chain"] = _same_chains(original, repeated)
    return equal


def _same_chains(original: Kept, repeated: Kept) -> bool:
    """Whether the steps that both results used are equal; a resumed run may have made some more."""
    one, other = original.chains or (), repeated.chains or ()
    steps = min(int(kept.content["diagnostics"]["steps"]) for kept in (original, repeated))
    return len(one) == len(other) and all(
        np.array_equal(a.chain[:steps], b.chain[:steps])
        and np.array_equal(a.log_posterior[:steps], b.log_posterior[:steps])
        for a, b in zip(one, other, strict=True)
    )
