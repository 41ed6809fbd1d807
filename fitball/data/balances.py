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

from fitball.data.kinematics import Uncertain, velocity
from fitball.data.scene import Scene
from fitball.data.table import ImpactTable, frozen
from fitball.values import FloatArray


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


# Unit and meaning of each balance.
_MEANING = {
    "mu_bar": ("", "mean friction coefficient, (v_x1 - v_x2)/(v_y1 + v_y2)"),
    "e_x": ("", "tangential restitution of the contact point, -(v_x2 - R omega_2)/(v_x1 - R omega_1)"),
    "offset": (
        "m",
        "distance of the normal force ahead of the centre, from angular momentum about the contact point",
    ),
    "cor": ("", "coefficient of restitution, v_y2/v_y1"),
    "energy_lost": ("J", "loss of kinetic energy, translational and rotational"),
    "energy_fraction": ("", "the same, as a fraction of the incident energy"),
}
_NOT_FINITE = {"e_x": "undefined, since the ball arrives without slip (v_x1 = R omega_1)"}


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
    """Balances of every impact, of the scene's ball.

    Where the table states no sd of a rebound column it is that of the scene (`Scene.noise_of`). Incident quantities
    are exact unless the table states their sd. Deviations propagate linearly (see `kinematics`) and do not include
    those of the ball.
    """
    known: dict[str, Uncertain] = {}
    for name in table.incident_columns:
        sd = table.incident_sd.get(name)
        known[name] = Uncertain(getattr(table.impacts, name), {} if sd is None else {name: sd})
    measured = {item.name: item for item in table.measurements if item.name != "contact_time"}
    exact = {name: Uncertain.exact(item.values) for name, item in measured.items()}
    speed = velocity(exact, "2").columns("2").get("v_2")
    for name, item in measured.items():
        across = np.full(len(table), np.nan) if speed is None else speed.value
        sd = scene.noise_of(name, across) if item.sd is None else item.sd
        known[name] = Uncertain.measured(name, item.values, sd)
    quantities = dict.fromkeys(_MEANING, "v_x was not measured before and after") | {
        **_impulses(table, scene, known), **_energies(table, scene, known)
    }  # fmt: skip
    return Balances(table.ids, **{name: _finished(name, quantities[name], table) for name in _MEANING})


Quantity = Uncertain | str


def _impulses(table: ImpactTable, scene: Scene, known: Mapping[str, Uncertain]) -> dict[str, Quantity]:
    """Balances of momentum and angular momentum, or the reason why the data do not determine them."""
    before, after = velocity(known, "1"), velocity(known, "2")
    x1, y1, x2, y2 = before.x, before.y, after.x, after.y
    no_v_y2, no_spin = "v_y2 was not measured", "omega_2 was not measured"
    cor: Quantity = no_v_y2 if y1 is None or y2 is None else y2 / y1
    if x1 is None or x2 is None or y1 is None:
        return {"cor": cor}
    ball, slowed = scene.ball, x1 - x2
    mu_bar: Quantity = no_v_y2 if y2 is None else slowed / (y1 + y2)
    omega_1, omega_2 = known.get("omega_1", Uncertain.exact(np.zeros(len(table)))), known.get("omega_2")
    if omega_2 is None:
        return {"cor": cor, "mu_bar": mu_bar, "e_x": no_spin, "offset": no_spin}
    slip_1, slip_2 = x1 - omega_1.scaled(ball.radius), x2 - omega_2.scaled(ball.radius)
    offset: Quantity = no_v_y2
    if y2 is not None:
        moment = slowed.scaled(ball.mass * ball.radius) - (omega_2 - omega_1).scaled(ball.inertia)
        offset = moment / (y1 + y2).scaled(ball.mass)
    return {"cor": cor, "mu_bar": mu_bar, "e_x": (slip_2 / slip_1).scaled(-1.0), "offset": offset}


def _energies(table: ImpactTable, scene: Scene, known: Mapping[str, Uncertain]) -> dict[str, Quantity]:
    """Energy lost, absolute and as a fraction, or why it is not known.

    A table without any column of motion along the court or of spin is a drop test: its energy is that of
    the vertical motion.
    """
    before, after = velocity(known, "1"), velocity(known, "2")
    first, last = before.speed_squared, after.speed_squared
    along = table.has_tangential or "v_x1" in known
    if not along and before.y is not None and after.y is not None:
        first, last = before.y * before.y, after.y * after.y
    if first is None or last is None:
        return dict.fromkeys(("energy_lost", "energy_fraction"), "the rebound velocity was not measured completely")
    if "omega_2" not in known and (along or "omega_1" in known):
        return dict.fromkeys(("energy_lost", "energy_fraction"), "omega_2 was not measured")
    energies = []
    for square, spin in ((first, known.get("omega_1")), (last, known.get("omega_2"))):
        flight = square.scaled(scene.ball.mass / 2)
        energies.append(flight if spin is None else flight + (spin * spin).scaled(scene.ball.inertia / 2))
    lost = energies[0] - energies[1]
    return {"energy_lost": lost, "energy_fraction": lost / energies[0]}


def _finished(name: str, quantity: Quantity, table: ImpactTable) -> Balance:
    """A frozen balance; whatever is not finite is marked absent, gaps of measured columns by their names."""
    unit, meaning = _MEANING[name]
    if isinstance(quantity, str):
        nothing = frozen(np.full(len(table), np.nan))
        return Balance(name, unit, meaning, nothing, nothing, (quantity,) * len(table))
    sd = quantity.sd
    finite = np.isfinite(quantity.value) & np.isfinite(sd)
    reasons = ["" if good else _NOT_FINITE.get(name, "the known columns do not determine it") for good in finite]
    used = [item for item in table.measurements if item.name in quantity.parts]
    for k in np.flatnonzero(np.any([~item.measured for item in used], axis=0)).tolist() if used else ():
        reasons[k] = f"{' and '.join(item.name for item in used if not item.measured[k])} not measured"
    values, sds = (frozen(np.where(finite, numbers, np.nan)) for numbers in (quantity.value, sd))
    return Balance(name, unit, meaning, values, sds, tuple(reasons))
