"""Model-free balances: what each measured impact says by conservation laws alone, with its uncertainty.

Notation: incident (1) and rebound (2), mass M, radius R, moment of inertia I, slip u = v_x - R omega.
The mean friction coefficient is Eq. (65) of Jafri (2004) with the measured restitution, whose
values are printed in its Table 7; the others are the tangential restitution of the contact
point, the angular momentum about the contact point, and the energy.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitball.data.kinematics import Uncertain, velocity
from fitball.data.scene import Scene
from fitball.data.table import ImpactTable, Measurement, frozen
from fitball.errors import ParameterError
from fitball.observables import NOISE_OF
from fitball.values import Ball, FloatArray


@dataclass(frozen=True)
class Balance:
    """One balance: `values` and one standard deviation `sd`, both (impacts,) in `unit`.

    Both are NaN where the balance does not exist; `reasons` (impacts,) says why, and is "" elsewhere.
    """

    name: str
    unit: str
    meaning: str
    values: FloatArray
    sd: FloatArray
    reasons: tuple[str, ...]

    @property
    def known(self) -> bool:
        """Whether at least one impact has it."""
        return "" in self.reasons


@dataclass(frozen=True)
class Balances:
    """All balances of a table."""

    ids: tuple[str, ...]
    mu_bar: Balance
    e_x: Balance
    offset: Balance
    cor: Balance
    energy_lost: Balance
    energy_fraction: Balance

    @property
    def all(self) -> tuple[Balance, ...]:
        """Every balance, in the order of the columns."""
        return tuple(getattr(self, name) for name in _MEANING)

    def rows(self, places: Sequence[int] | None = None) -> Iterator[dict[str, str]]:
        """One row per impact for a CSV file, or for those at `places`: names with units as keys; absent values empty,
        with a remark.
        """
        for k in range(len(self.ids)) if places is None else places:
            row = {"id": self.ids[k]}
            for balance in self.all:
                bracket = f" [{balance.unit}]" if balance.unit else ""
                for name, column in ((balance.name, balance.values), (f"{balance.name}_sd", balance.sd)):
                    row[name + bracket] = "" if balance.reasons[k] else f"{column[k]:.6g}"
            remarks = [f"{balance.name}: {balance.reasons[k]}" for balance in self.all if balance.reasons[k]]
            yield row | {"remark": "; ".join(remarks)}


def scene_balances(table: ImpactTable, scene: Scene) -> Balances:
    """`balances` with what the scene knows: its ball, and its noise, or else the nominal noise."""
    return balances(
        table,
        scene.ball,
        scene.nominal_velocity_sd if scene.velocity_sd is None else scene.velocity_sd,
        scene.nominal_spin_sd,
        known={name: sd for name, noise in NOISE_OF.items() if (sd := getattr(scene, noise)) is not None},
    )


def balances(
    table: ImpactTable, ball: Ball, velocity_sd: float, spin_sd: float, *, known: Mapping[str, float] | None = None
) -> Balances:
    """Balances of every impact.

    `velocity_sd` [m/s] and `spin_sd` [rad/s] stand in for sds that the table does not state; an angle
    without one gets `velocity_sd` across the direction of flight. Before them goes what is `known` of a column's own
    noise, by name of the column in its SI unit. Incident quantities are exact unless
    the table states their sd. Deviations propagate linearly (see `propagation`) and do not include
    those of the ball. Raises ParameterError for an sd that is not positive and finite.
    """
    for name, sd in (("velocity_sd", velocity_sd), ("spin_sd", spin_sd)):
        if not (np.isfinite(sd) and sd > 0.0):
            raise ParameterError(f"{name} = {sd!r}: expected a positive, finite number")
    own = known or {}
    seen = _incident(table)
    for measurement in table.measurements:
        if measurement.name == "contact_time":
            continue
        if measurement.sd is not None:
            spread = measurement.sd
        elif measurement.name in own:
            spread = np.full(len(table), own[measurement.name])
        else:
            spread = _default_sd(table, measurement, velocity_sd, spin_sd)
        seen[measurement.name] = Uncertain.measured(measurement.name, measurement.values, spread)
    quantities = _quantities(table, ball, seen)
    missing = {item.name: ~item.measured for item in table.measurements}
    made = {name: _finish(name, quantities[name], missing, len(table)) for name in _MEANING}
    return Balances(ids=table.ids, **made)


def _incident(table: ImpactTable) -> dict[str, Uncertain]:
    """The incident columns that the table has."""
    known = {}
    for name in table.incident_columns:
        values = getattr(table.impacts, name)
        sd = table.incident_sd.get(name)
        known[name] = Uncertain.exact(values) if sd is None else Uncertain.measured(name, values, sd)
    return known


def _default_sd(table: ImpactTable, measurement: Measurement, velocity_sd: float, spin_sd: float) -> FloatArray:
    if measurement.name == "omega_2":
        return np.full(len(table), spin_sd)
    if measurement.name == "theta_2":
        with np.errstate(divide="ignore"):  # v_x2 = 0 beside an angle: no finite sd, marked absent later
            return velocity_sd / _rebound_speed(table)
    return np.full(len(table), velocity_sd)


def _rebound_speed(table: ImpactTable) -> FloatArray:
    """Speed [m/s] behind a measured angle: v_2, or from the one component beside it; NaN with neither."""
    beside = {measurement.name: measurement.values for measurement in table.measurements}
    if "v_2" in beside:
        return beside["v_2"]
    for name, part_of in (("v_x2", np.cos), ("v_y2", np.sin)):
        if name in beside:
            speed: FloatArray = np.abs(beside[name] / part_of(beside["theta_2"]))
            return speed
    return np.full(len(table), np.nan)


# unit and meaning of each balance
_MEANING = {
    "mu_bar": ("", "mean friction coefficient, (v_x1 - v_x2)/(v_y1 + v_y2)"),
    "e_x": ("", "tangential restitution of the contact point, -(v_x2 - R omega_2)/(v_x1 - R omega_1)"),
    "offset": (
        "m",
        "distance of the normal force ahead of the centre, from angular momentum about the contact point",
    ),
    "cor": ("", "coefficient of restitution, v_y2/v_y1"),
    "energy_lost": ("J", "kinetic energy lost, of flight and of spin"),
    "energy_fraction": ("", "kinetic energy lost, as a fraction of the incident"),
}

Quantity = Uncertain | str


def _quantities(table: ImpactTable, ball: Ball, known: Mapping[str, Uncertain]) -> dict[str, Quantity]:
    """Each balance, or the reason why the table cannot give it."""
    before, after = velocity(known, "1"), velocity(known, "2")
    x1, y1, x2, y2 = before.x, before.y, after.x, after.y
    no_v_y2 = "v_y2 was not measured"
    result: dict[str, Quantity] = dict.fromkeys(_MEANING, "v_x was not measured before and after")
    result["cor"] = no_v_y2 if y1 is None or y2 is None else y2 / y1
    result.update(_energy(table, ball, known))
    if x1 is None or x2 is None or y1 is None:
        return result
    zero = Uncertain.exact(np.zeros(len(table)))
    omega_1, omega_2 = known.get("omega_1", zero), known.get("omega_2")
    no_spin = "omega_2 was not measured"
    slowed = x1 - x2
    turn = None if omega_2 is None else (omega_2 - omega_1).scaled(ball.inertia)
    result["mu_bar"] = no_v_y2 if y2 is None else slowed / (y1 + y2)
    if omega_2 is None or turn is None:
        return {**result, "e_x": no_spin, "offset": no_spin}
    slip_1, slip_2 = x1 - omega_1.scaled(ball.radius), x2 - omega_2.scaled(ball.radius)
    result["e_x"] = (slip_2 / slip_1).scaled(-1.0)
    if y2 is None:
        return {**result, "offset": no_v_y2}
    moment = slowed.scaled(ball.mass * ball.radius) - turn
    return {**result, "offset": moment / (y1 + y2).scaled(ball.mass)}


def _energy(table: ImpactTable, ball: Ball, known: Mapping[str, Uncertain]) -> dict[str, Quantity]:
    """Energy lost, absolute and as a fraction, or why it is not known.

    A table without any column of motion along the court or of spin is a drop test: its energy is that of
    the vertical motion.
    """
    before, after = velocity(known, "1"), velocity(known, "2")
    first, last = before.speed_squared, after.speed_squared
    if not table.has_tangential and "v_x1" not in known and before.y is not None and after.y is not None:
        first, last = before.y * before.y, after.y * after.y
    reason = ""
    if first is None or last is None:
        reason = "the rebound velocity was not measured completely"
    elif "omega_2" not in known and (table.has_tangential or "omega_1" in known or "v_x1" in known):
        reason = "omega_2 was not measured"
    if reason or first is None or last is None:
        return {"energy_lost": reason, "energy_fraction": reason}
    start, end = first.scaled(ball.mass / 2), last.scaled(ball.mass / 2)
    if "omega_1" in known:
        start = start + (known["omega_1"] * known["omega_1"]).scaled(ball.inertia / 2)
    if "omega_2" in known:
        end = end + (known["omega_2"] * known["omega_2"]).scaled(ball.inertia / 2)
    lost = start - end
    return {"energy_lost": lost, "energy_fraction": lost / start}


def _finish(name: str, quantity: Quantity, missing: Mapping[str, NDArray[np.bool_]], count: int) -> Balance:
    """Freeze a balance; whatever is not finite is marked absent. `missing` are the gaps of each measured column."""
    unit, meaning = _MEANING[name]
    if isinstance(quantity, str):
        nothing = frozen(np.full(count, np.nan))
        return Balance(name, unit, meaning, nothing, nothing, (quantity,) * count)
    sd = quantity.sd
    finite = np.isfinite(quantity.value) & np.isfinite(sd)
    reasons = ["" if good else _NOT_FINITE.get(name, "the known columns do not determine it") for good in finite]
    used = [column for column in missing if column in quantity.parts]
    for k in np.flatnonzero(np.any([missing[column] for column in used], axis=0)).tolist() if used else ():
        reasons[k] = f"{' and '.join(column for column in used if missing[column][k])} not measured"
    nan = np.float64("nan")
    values, sds = frozen(np.where(finite, quantity.value, nan)), frozen(np.where(finite, sd, nan))
    return Balance(name, unit, meaning, values, sds, tuple(reasons))


_NOT_FINITE = {"e_x": "the ball arrives without slip (v_x1 = R omega_1), so there is nothing to restore"}
