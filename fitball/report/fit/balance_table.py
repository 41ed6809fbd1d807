"""Model-free balances as text: value and one standard deviation, rounded to what that supports."""

from __future__ import annotations

from dataclasses import dataclass

from fitball.data.balances import Balance, Balances
from fitball.report.form.display_units import handy
from fitball.report.form.rounding import decimals, fixed, significant


@dataclass(frozen=True)
class BalanceTable:
    """`heads` with units, `rows` of cells beginning with the impact's id, `legend` one sentence per column."""

    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    legend: tuple[str, ...]


def _cell(balance: Balance, index: int, factor: float) -> str:
    if balance.reasons[index]:
        return "-"
    value, sd = balance.values[index] * factor, balance.sd[index] * factor
    if not sd > 0.0:
        return significant(value)
    places = decimals(sd)
    return f"{fixed(value, places)} +- {fixed(sd, places)}"


def balance_table(found: Balances, most: int | None = None) -> BalanceTable:
    """The balances that at least one impact has, of the first `most` impacts."""
    known = [item for item in found.all if item.known]
    scales = [handy(item.name, item.unit) for item in known]
    heads = ["impact"]
    heads += [
        f"{item.name} [{scale.unit}]" if scale.unit else item.name for item, scale in zip(known, scales, strict=True)
    ]
    rows = tuple(
        (found.ids[k], *(_cell(item, k, scale.factor) for item, scale in zip(known, scales, strict=True)))
        for k in range(len(found.ids))[:most]
    )
    return BalanceTable(tuple(heads), rows, tuple(f"{item.name}: {item.meaning}" for item in known))
