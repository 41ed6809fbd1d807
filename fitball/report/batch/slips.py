"""Tables of a batch that are probably slips: copies of others, or exchanged with a table of another level."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from statistics import median

import numpy as np

from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.report.batch.rows import DONE, LABEL, NAME, Row
from fitball.report.batch.series import Series
from fitball.report.form.numbers import listed, significant

# Robust sds from the median of its level by which a table is unlike the others there, and the share of this distance
# within which it agrees with another level. A median needs so many tables.
FAR, NEAR, LEAST = 8.0, 0.25, 3
# Sentences that a first screen has room for, of a kind.
MOST = 3
# Ratio of the sd of a normal variate and its median distance from the median.
ROBUST = 1.4826


def slips(rows: Sequence[Row], series: Sequence[Series]) -> list[str]:
    """Sentences on copies and on exchanged tables."""
    return [*_copied(rows), *list(_exchanged(rows, series))[:MOST]]


def _copied(rows: Sequence[Row]) -> list[str]:
    """Tables whose fits agree in every number: with the same seed no others than copies do."""
    alike: dict[tuple[object, ...], list[str]] = {}
    for row in rows:
        numbers = tuple(cell for head, cell in row.items() if head != NAME and not head.startswith(LABEL))
        if row["outcome"] == DONE and sum(isinstance(cell, float) for cell in numbers) > 1:
            alike.setdefault(numbers, []).append(str(row[NAME]))
    found = [names for names in alike.values() if len(names) > 1]
    more = [f"{len(found) - MOST:,} more tables have copies."] if len(found) > MOST else []
    return [f"The data of {listed(names, 5)} are the same: leave out the copies." for names in found[:MOST]] + more


def _exchanged(rows: Sequence[Row], series: Sequence[Series]) -> Iterator[str]:
    """Tables far from the others of their level, and near those of another: with the first quantity that is."""
    named = set()
    for label in dict.fromkeys(head for row in rows for head in row if head.startswith(LABEL)):
        for one in series:
            if one.quantity in NOISE_SPECS:
                continue
            own = [str(rows[place].get(label) or "") for place in one.rows]
            values = [float(value) for value in one.median]
            members = {level: [v for v, at in zip(values, own, strict=True) if at == level] for level in own}
            middles = {level: median(of) for level, of in members.items() if level and len(of) >= LEAST}
            known = [k for k, level in enumerate(own) if level in middles]
            if len(middles) < 2:
                continue
            away = {k: abs(values[k] - middles[own[k]]) for k in known}
            sds = one.sd[np.isfinite(one.sd)]
            typical = np.hypot(ROBUST * median(away.values()), np.median(sds) if sds.size else 0.0)
            for k, distance in away.items():
                like = min(set(middles) - {own[k]}, key=lambda level: abs(values[k] - middles[level]))
                near = abs(values[k] - middles[like]) < NEAR * distance
                if distance > FAR * typical > 0.0 and near and one.names[k] not in named:
                    named.add(one.names[k])
                    number, usual, there = (
                        significant(value * one.scale.factor, 3)
                        for value in (values[k], middles[own[k]], middles[like])
                    )
                    yield (
                        f"{one.names[k]} is unlike other tables of {label.removeprefix(LABEL)} {own[k]} ({one.name} "
                        f"{number}, median there {usual}) and like those of {like} ({there}): check file and label."
                    )
