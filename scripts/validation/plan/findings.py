"""Promised against found: by how much sds fell, with Monte Carlo errors, and which design told more."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fitball.errors import FitError
from fitball.report.form.document import columns
from validation.plan.replicate import AGAIN, PLANNED, Narrowed, Ready

# By what share the sds found may differ from those promised.
WITHIN = 0.2


@dataclass(frozen=True)
class Line:
    """One part of a target under one design: its sd as a share of that before, as `promised` and as `found` (the
    geometric mean over replicates) with the standard error of the latter.
    """

    design: str
    part: str
    promised: float
    found: float
    se: float

    @property
    def off(self) -> float:
        """The sd found over that promised, less one."""
        return self.found / self.promised - 1.0


@dataclass(frozen=True)
class Gain:
    """Nats of one design: `promised` to first order, and `found` by refits with its error."""

    design: str
    promised: float
    found: float
    se: float


@dataclass(frozen=True)
class Finding:
    """A case in `words`: `replicates` with both refits, `lost` without; its lines, gains, and by how much the planned
    design told `more` than as many impacts of the table, with the standard error of the mean difference.
    """

    name: str
    words: str
    replicates: int
    lost: int
    lines: tuple[Line, ...]
    gains: tuple[Gain, ...]
    more: float
    more_se: float

    @property
    def kept(self) -> bool:
        """Whether no sd surely differs from its promise by more than it may."""
        return all(abs(line.off) <= WITHIN + 2.0 * line.se / line.promised for line in self.lines)

    @property
    def better(self) -> bool:
        """Whether the planned design surely told more."""
        return self.more > 2.0 * self.more_se

    @property
    def holds(self) -> bool:
        """Both."""
        return self.replicates > 1 and self.kept and self.better


def finding(name: str, ready: Ready, made: Mapping[str, Sequence[Narrowed | None]]) -> Finding:
    """What the replicates of a case say, those with all refits. Raises FitError where there are none."""
    whole = [(one, other) for one, other in zip(made[PLANNED], made[AGAIN], strict=True) if one and other]
    if not whole:
        raise FitError(f"case {name}: no simulated table could be refitted at both designs")
    before, parts = ready.plan.sds, [part.name for part in ready.plan.parts]
    lines, gains = [], []
    for design, refits in zip((PLANNED, AGAIN), zip(*whole, strict=True), strict=True):
        promise = ready.designs[design]
        logs = np.log([one.sds / before for one in refits])
        for part, promised, mean, se in zip(parts, promise.sds / before, logs.mean(axis=0), _se(logs), strict=True):
            share = float(np.exp(mean))
            lines.append(Line(design, part, float(promised), share, share * float(se)))
        nats = np.array([one.nats for one in refits])
        gains.append(Gain(design, promise.gain, float(nats.mean()), float(_se(nats))))
    gaps = np.array([one.nats - other.nats for one, other in whole])
    lost, more = len(made[PLANNED]) - len(whole), (float(gaps.mean()), float(_se(gaps)))
    return Finding(name, ready.case.words, len(whole), lost, tuple(lines), tuple(gains), *more)


def _se(values: np.ndarray) -> np.ndarray:
    return np.asarray(np.std(values, axis=0, ddof=1) / np.sqrt(len(values)))


def gain_rows(found: Sequence[Finding]) -> list[dict[str, object]]:
    """A row a case and design."""
    return [
        {
            "case": one.name, "design": gain.design, "replicates": one.replicates, "lost": one.lost,
            "promised [nats]": round(gain.promised, 4),
            "found [nats]": round(gain.found, 4), "se": round(gain.se, 4),
            "more than table [nats]": round(one.more, 4) if gain.design == PLANNED else None,
            "more se": round(one.more_se, 4) if gain.design == PLANNED else None,
        }
        for one in found
        for gain in one.gains
    ]  # fmt: skip


def sd_rows(found: Sequence[Finding]) -> list[dict[str, object]]:
    """A row a case, design and part: sds as shares of those before."""
    return [
        {
            "case": one.name, "design": line.design, "part": line.part, "promised": round(line.promised, 4),
            "found": round(line.found, 4), "se": round(line.se, 4), "off": round(line.off, 4),
        }
        for one in found
        for line in one.lines
    ]  # fmt: skip


def findings_text(found: Sequence[Finding]) -> str:
    """The verdict as a person reads it."""
    parts = []
    for one in found:
        parts += [f"{one.name}: {one.words}; {one.replicates} simulated tables, {one.lost} without a refit", ""]
        rows = [["design", "promised", "found"]]
        rows += [[gain.design, f"{gain.promised:.2f}", f"{gain.found:.2f} ± {gain.se:.2f}"] for gain in one.gains]
        parts += [*columns(rows), ""]
        rows = [["sd as a share of that before", "design", "promised", "found", "off"]]
        for line in one.lines:
            cells = [line.part, line.design, f"{line.promised:.3f}", f"{line.found:.3f} ± {line.se:.3f}"]
            rows.append([*cells, f"{100.0 * line.off:+.0f} %"])
        parts += [*columns(rows, 2), ""]
        kept = "Kept" if one.kept else "NOT KEPT"
        better = "told more" if one.better else "did NOT surely tell more"
        parts += [
            f"{kept} within {100.0 * WITHIN:.0f} %; the planned impacts {better} than as many of the table: "
            f"{one.more:.2f} ± {one.more_se:.2f} nats.",
            "",
        ]
    return "\n".join(parts)


def findings_json(found: Sequence[Finding], seed: int) -> dict[str, object]:
    """All of it."""
    return {
        "seed": seed,
        "holds": all(one.holds for one in found),
        "cases": {one.name: {"words": one.words, "kept": one.kept, "better": one.better} for one in found},
        "gains": gain_rows(found),
        "sds": sd_rows(found),
    }
