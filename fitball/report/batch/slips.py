"""Tables of a batch that are probably slips: copies of others, or exchanged with a table of another level."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from statistics import median

import numpy as np

from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.report.batch.rows import DONE, LABEL, NAME, Row
from fitball.report.batch.series import Series
from fitball.report.form.numbers import listed, significant

# Sds from the median of its level by which a table is unlike the others there, and the share of this distance within
# which it agrees with another level. A median needs so many tables. Sentences of a kind that a screen has room for.
FAR, NEAR, LEAST, MOST = 8.0, 0.25, 3, 3
# Sd of a normal variate over its median distance from the median.
ROBUST = 1.4826


def slips(rows: Sequence[Row], series: Sequence[Series]) -> list[str]:
    """Sentences on copies, whose fits agree in every number, and on exchanged tables."""
    alike: dict[tuple[object, ...], list[str]] = {}
    for row in rows:
        numbers = tuple(cell for head, cell in row.items() if head != NAME and not head.startswith(LABEL))
        if row["outcome"] == DONE and sum(isinstance(cell, float) for cell in numbers) > 1:
            alike.setdefault(numbers, []).append(str(row[NAME]))
    copies = [listed(names, 5) for names in alike.values() if len(names) > 1]
    exchanged = dict(reversed([*_exchanged(rows, series)]))
    said = [f"The data of {names} are the same: leave out the copies." for names in copies[:MOST]]
    return said + list(reversed(exchanged.values()))[:MOST]


def _exchanged(rows: Sequence[Row], series: Sequence[Series]) -> Iterator[tuple[str, str]]:
    """Tables far from the others of their level, and near those of another, each with a sentence on a quantity."""
    for label in dict.fromkeys(head for row in rows for head in row if head.startswith(LABEL)):
        for one in (one for one in series if one.quantity not in NOISE_SPECS):
            known = [
                (name, str(rows[place][label]), float(value))
                for name, place, value in zip(one.names, one.rows, one.median, strict=True)
                if rows[place].get(label)
            ]
            members = {level: [value for _, at, value in known if at == level] for _, level, _ in known}
            middles = {level: median(values) for level, values in members.items() if len(values) >= LEAST}
            away = [abs(value - middles[level]) for _, level, value in known if level in middles]
            if len(middles) < 2:
                continue
            sds = one.sd[np.isfinite(one.sd)]
            typical = np.hypot(ROBUST * median(away), np.median(sds) if sds.size else 0.0)
            for name, level, value in (item for item in known if item[1] in middles):
                there, like = min((abs(value - at), other) for other, at in middles.items() if other != level)
                if (distance := abs(value - middles[level])) > FAR * typical and there < NEAR * distance:
                    ends = [significant(at * one.scale.factor, 3) for at in (value, middles[level], middles[like])]
                    here = f"{label.removeprefix(LABEL)} {level} ({one.name} {ends[0]}, median there {ends[1]})"
                    like += f" ({ends[2]}): check file and label."
                    yield name, f"{name} is unlike other tables of {here} and like those of {like}"
