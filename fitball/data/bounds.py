"""What no ball can do: leave the court faster, or with more energy, than it came, beyond what its noise explains."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from fitball.data.checks import knows_incident
from fitball.data.columns import SD_SUFFIX
from fitball.data.findings import Findings
from fitball.data.kinematics import Uncertain, independent, velocity
from fitball.data.numbers import NumberColumn
from fitball.data.scene import Scene
from fitball.observables import NOISE_OF
from fitball.values import FloatArray, quotient

# Chance that noise alone puts the worst row of a table this far above a bound, were every true value on it: 4.4 sd of
# noise among 20 rows, 6 among 100,000.
CHANCE = 1e-4
# Sds of the scene's ball within which it may lie.
BALL_SDS = 5.0
HINT = (
    "check the units and whether columns are swapped, or say in the scene how large the noise is "
    "([measurement]) and what ball this is ([ball])"
)


def normal_speed(columns: Mapping[str, NumberColumn], end: str) -> FloatArray | None:
    """v_y [m/s] of `end` ("1" or "2") as a column or from speed and angle; None otherwise.

    Other pairs of columns determine it too, but at steep or grazing angles so badly that no bound
    can rest on it.
    """
    names = _normal_columns(columns, end)
    speed = velocity({name: Uncertain.exact(columns[name].values) for name in names}, end).y
    return None if speed is None else speed.value


def _normal_columns(columns: Mapping[str, NumberColumn], end: str) -> tuple[str, ...]:
    counted = independent(columns, end)
    if f"v_y{end}" in counted:
        return (f"v_y{end}",)
    return counted if counted == (f"v_{end}", f"theta_{end}") else ()


def check_bounds(columns: Mapping[str, NumberColumn], scene: Scene, found: Findings) -> None:
    """Add a fault for rows with a coefficient of restitution above 1 or a gain of energy that noise does not explain,
    a notice for those where it does.

    Noise is what the table states, or else what the scene knows or expects. All rows together are held to it too, so
    that swapped columns of slow impacts are found. Spin may turn into speed and back, so energy counts both, with
    the gyration of the scene's ball that favours the table. What was not measured of the rebound counts as zero.
    Nothing is checked while the incident velocity is incomplete.
    """
    if not knows_incident(columns):
        return
    known = _known(columns, scene)
    restitution = _restitution(known, columns)
    blamed = np.zeros(len(found.rows), dtype=np.bool_)
    if restitution is not None:
        blamed = restitution.report(blamed, found)
    _energy(known, columns, scene, len(found.rows)).report(blamed, found)


@dataclass(frozen=True)
class _Bound:
    """By how much each row is above a bound: `excess` (rows,) with its sd. `kind` names it, `expected` says what
    should be, `words` tell a row's numbers, `column` the column to point at.
    """

    excess: Uncertain
    kind: str
    expected: str
    words: Callable[[int], str]
    column: Callable[[int], str]

    def report(self, blamed: NDArray[np.bool_], found: Findings) -> NDArray[np.bool_]:
        """Add what is to be said of rows that are not `blamed` (rows,) yet; returns the rows above the bound."""
        sds = quotient(self.excess.value, self.excess.sd)
        known = np.isfinite(sds)
        above = (sds > 0.0) & ~blamed
        beyond = above & (sds > _reach(max(int(known.sum()), 1)))
        for k in np.flatnonzero(beyond).tolist():
            message = f"{self.kind}: {self.words(k)}, {sds[k]:.3g} sd of the noise; expected {self.expected}: {HINT}"
            found.fault(message, self.column(k), k)
        spread = float(np.sqrt(np.sum(self.excess.sd[known] ** 2)))
        together = float(np.sum(self.excess.value[known])) / spread if spread > 0.0 else 0.0
        if together > _reach(1) and not beyond.any() and above.any():
            message = (
                f"{self.kind} in {int(above.sum())} of {len(found.rows)} rows: each may be noise, all together are "
                f"{together:.3g} sd of it; expected {self.expected}: {HINT}"
            )
            found.fault(message, self.column(int(np.flatnonzero(above)[0])))
        else:
            kind = f"{self.kind}, within its noise"
            for k in np.flatnonzero(above & ~beyond).tolist():
                found.notice(f"{kind}: {self.words(k)}", self.column(k), place=k, kind=kind)
        return above | blamed


def _reach(count: int) -> float:
    """Sds that the largest of `count` normal deviations exceeds with probability CHANCE."""
    return -NormalDist().inv_cdf(CHANCE / count)


def _known(columns: Mapping[str, NumberColumn], scene: Scene) -> dict[str, Uncertain]:
    """The columns that count, each with its noise: as stated, or else as the scene expects it of the rebound."""
    velocity_sd = scene.nominal_velocity_sd if scene.velocity_sd is None else scene.velocity_sd
    quantities = {}
    for name in (*independent(columns, "1"), *independent(columns, "2"), "omega_1", "omega_2"):
        if name not in columns:
            continue
        values = columns[name].values
        sd = np.zeros_like(values)
        if name + SD_SUFFIX in columns:
            sd = columns[name + SD_SUFFIX].values
        elif name in NOISE_OF and (own := getattr(scene, NOISE_OF[name])) is not None:
            sd = np.full_like(values, own)
        elif name == "omega_2":
            sd = np.full_like(values, scene.nominal_spin_sd)
        elif name == "theta_2" and "v_2" in columns:
            # The noise across the flight; none is finite of a ball that stands, which is a fault of its own.
            sd = quotient(velocity_sd, np.abs(columns["v_2"].values))
        elif name.endswith("2"):
            sd = np.full_like(values, velocity_sd)
        quantities[name] = Uncertain.measured(name, values, sd)
    return quantities


def _restitution(known: Mapping[str, Uncertain], columns: Mapping[str, NumberColumn]) -> _Bound | None:
    before, after = (
        velocity({name: known[name] for name in _normal_columns(columns, end)}, end).y for end in ("1", "2")
    )
    if before is None or after is None:
        return None
    v_1, v_2 = before.value, after.value

    def words(k: int) -> str:
        return f"{v_2[k] / v_1[k]:.3f}, v_y2 = {v_2[k]:.4g} m/s after v_y1 = {v_1[k]:.4g} m/s"

    # A speed that is not towards the court is a fault of its own.
    excess = Uncertain(np.where(v_1 > 0.0, after.value - v_1, np.nan), (after - before).parts)
    column = "v_y2" if "v_y2" in columns else "v_2"
    return _Bound(excess, "coefficient of restitution above 1", "at most 1", words, lambda _k: column)


def _energy(known: Mapping[str, Uncertain], columns: Mapping[str, NumberColumn], scene: Scene, count: int) -> _Bound:
    """Gain of energy over half the mass [m^2/s^2]."""
    zero = Uncertain.exact(np.zeros(count))
    known = {name: _or_zero(quantity) if name.endswith("2") else quantity for name, quantity in known.items()}
    before, after = (_least_speed_squared(known, end, zero) for end in ("1", "2"))
    spin_1, spin_2 = (known.get(name, zero) for name in ("omega_1", "omega_2"))
    gained = spin_2 * spin_2 - spin_1 * spin_1
    least, most = gyration(scene)
    weight = Uncertain.exact(np.where(gained.value > 0.0, least, most))

    def words(k: int) -> str:
        return (
            f"{np.sqrt(after.value[k]):.4g} m/s and {abs(spin_2.value[k]):.4g} rad/s after "
            f"{np.sqrt(before.value[k]):.4g} m/s and {abs(spin_1.value[k]):.4g} rad/s, for a ball of radius "
            f"{1e3 * scene.ball.radius:.4g} mm and I/(M R^2) = {scene.ball.inertia_ratio:.3g}"
        )

    def column(k: int) -> str:
        """A velocity when the speed alone is too much, the spin otherwise."""
        by_speed = after.value[k] > before.value[k]
        order = ("v_2", "v_x2", "v_y2", "omega_2") if by_speed else ("omega_2", "v_2", "v_x2", "v_y2")
        return next(name for name in order if name in columns)

    return _Bound(
        after - before + weight * gained,
        "the ball leaves with more energy than it came with",
        "a loss",
        words,
        column,
    )


def _or_zero(quantity: Uncertain) -> Uncertain:
    """The quantity, zero where it was not measured."""
    parts = {name: np.nan_to_num(part, nan=0.0) for name, part in quantity.parts.items()}
    return Uncertain(np.nan_to_num(quantity.value, nan=0.0), parts)


def gyration(scene: Scene) -> tuple[float, float]:
    """Least and largest radius of gyration squared [m^2] that the scene's ball may have."""
    ball, sds = scene.ball, scene.ball_sd
    ends = []
    for side in (-BALL_SDS, BALL_SDS):
        ratio = ball.inertia_ratio + side * sds.get("inertia_ratio", 0.0)
        radius = max(ball.radius + side * sds.get("radius", 0.0), 0.0)
        ends.append(min(max(ratio, 0.0), 1.0) * radius**2)
    return ends[0], ends[1]


def _least_speed_squared(known: Mapping[str, Uncertain], end: str, zero: Uncertain) -> Uncertain:
    """v^2 [m^2/s^2] as far as the columns say; components count before the speed."""
    parts = [known[name] for name in (f"v_x{end}", f"v_y{end}") if name in known]
    if f"v_{end}" in known and len(parts) < 2:
        parts = [known[f"v_{end}"]]
    total = zero
    for part in parts:
        total = total + part * part
    return total
