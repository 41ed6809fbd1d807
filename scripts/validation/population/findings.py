"""What the studies of populations found: rates with binomial errors, and how far weights and joint fits agree."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import beta

from validation.population.coverage import CONTROL, TABLES
from validation.population.levels import COUNTED, LEVELS
from validation.population.tables import QUANTITIES

LEVEL = 0.95
# As far as weights and joint fit may lie apart, in sds of the joint posterior.
APART = 0.2
# Half of a 95 % interval in sds.
REACH = 1.96


@dataclass(frozen=True)
class Coverage:
    """How many intervals of a `what` of a quantity hold the truth, of how many; `control`: with priors left in."""

    quantity: str
    what: str
    control: bool
    count: int
    of: int

    @property
    def ends(self) -> tuple[float, float]:
        """A 95 % interval of the rate (Clopper and Pearson 1934)."""
        low = beta.ppf(0.5 - LEVEL / 2, self.count, self.of - self.count + 1) if self.count else 0.0
        high = beta.ppf(0.5 + LEVEL / 2, self.count + 1, self.of - self.count) if self.count < self.of else 1.0
        return float(low), float(high)

    @property
    def holds(self) -> bool:
        """Whether the rate may be 95 %."""
        low, high = self.ends
        return low <= LEVEL <= high

    def row(self) -> dict[str, object]:
        """As a row of a table."""
        low, high = self.ends
        return {
            "quantity": self.quantity, "what": self.what, "priors": "left in" if self.control else "divided out",
            "holds": self.count, "of": self.of, "share": self.count / self.of, "low": low, "high": high,
        }  # fmt: skip


def coverages(rows: Sequence[Mapping[str, float]]) -> list[Coverage]:
    """Of centre and spread, and of each table alone and given all."""
    found = []
    for control in (False, True):
        for name in QUANTITIES:
            head = f"{CONTROL}:{name}" if control else name
            for what in ("centre", "spread"):
                count = sum(
                    row[f"{head}:{what}_low"] <= row[f"{head}:{what}_truth"] <= row[f"{head}:{what}_high"]
                    for row in rows
                )
                found.append(Coverage(name, what, control, count, len(rows)))
            for what in ("alone", "given_all"):
                held = int(sum(row[f"{head}:{what}_holds"] for row in rows))
                found.append(Coverage(name, f"tables {what.replace('_', ' ')}", control, held, TABLES * len(rows)))
    return found


def level_coverages(rows: Sequence[Mapping[str, float]]) -> list[Coverage]:
    """Of populations on levels: centre, spread between and within levels, and the levels."""
    found = []
    for control in (False, True):
        for name in QUANTITIES:
            head = f"{CONTROL}:{name}" if control else name
            for what in COUNTED:
                held = int(sum(row[f"{head}:{what}_holds"] for row in rows))
                each = LEVELS if what == "levels" else 1
                found.append(Coverage(name, WORDS[what], control, held, each * len(rows)))
    return found


WORDS = {
    "centre": "centre of levels", "between": "spread between levels", "within": "spread within levels",
    "levels": "levels",
}  # fmt: skip


def error_shares(rows: Sequence[Mapping[str, float]]) -> Mapping[str, float]:
    """Root mean square error of tables given all over that of tables alone, by quantity."""
    return {
        name: float(
            np.sqrt(
                sum(row[f"{name}:given_all_error"] for row in rows) / sum(row[f"{name}:alone_error"] for row in rows)
            )
        )
        for name in QUANTITIES
    }


def apart(rows: Sequence[Mapping[str, object]]) -> list[dict[str, object]]:
    """How far medians by weights lie from those of the joint fits, in sds of the latter, and the ratio of the widths
    of their intervals.
    """
    found: list[dict[str, object]] = []
    for row in rows:
        for what in ("centre", "spread"):
            low, high, middle, mine = (
                float(str(row[key])) for key in (f"joint_{what}_low", f"joint_{what}_high", f"joint_{what}", what)
            )
            width = float(str(row[f"{what}_high"])) - float(str(row[f"{what}_low"]))
            found.append(
                {
                    "set": row["set"], "quantity": row["quantity"], "what": what,
                    "apart": (mine - middle) / ((high - low) / (2.0 * REACH)), "width": width / (high - low),
                }
            )  # fmt: skip
    return found


def findings_json(
    rows: Sequence[Mapping[str, float]],
    joint: Sequence[Mapping[str, object]],
    levels: Sequence[Mapping[str, float]],
    seed: int,
) -> dict[str, object]:
    """Everything that is told; `holds` unless intervals of centre, spreads or levels do not hold as often as they
    say, the control does, or joint fits find something else.
    """
    found, far = [*coverages(rows), *level_coverages(levels)], apart(joint)
    wanted = [one for one in found if not one.what.startswith("tables")]
    good = all(one.holds for one in wanted if not one.control) and not all(one.holds for one in wanted if one.control)
    typical = float(np.median([abs(float(str(row["apart"]))) for row in far]))
    return {
        "seed": seed,
        "populations": len(rows),
        "tables": TABLES * len(rows),
        "on_levels": len(levels),
        "coverages": [one.row() for one in found],
        "error_given_all": error_shares(rows),
        "not_trusted": {name: int(sum(row[f"{name}:not_trusted"] for row in rows)) for name in QUANTITIES},
        "joint": far,
        "typically_apart": typical,
        "holds": good and typical <= APART,
    }


def findings_text(found: Sequence[Coverage]) -> list[list[str]]:
    """Rows of a table of the coverages, its head first."""
    shown = [["quantity", "interval of", "priors", "hold the truth", "95 %"]]
    for one in found:
        low, high = (100.0 * end for end in one.ends)
        held = f"{one.count:,} of {one.of:,} ({100.0 * one.count / one.of:.0f} %)"
        priors = "left in" if one.control else "divided out"
        shown.append([one.quantity, one.what, priors, held, f"[{low:.0f}, {high:.0f}]"])
    return shown
