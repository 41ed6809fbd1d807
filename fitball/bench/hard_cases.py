"""Impacts that are hard to solve, each named for what is hard: held to fifty digits by tests, timed by the bench."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fitball.models.kernels.contact import tied_inertia_split
from fitball.models.model import Model
from fitball.models.registry import model
from fitball.values import Ball, Impacts, impacts

BASE: Mapping[str, float] = {
    "mass_ratio": 0.88,
    "k_y": 1.93e4,
    "k_theta": 18.0,
    "mu": 0.567,
    "eps_10": 2.4e-3,
    "eps_slope": 0.0,
    "cor_10": 0.77,
    "cor_slope": 0.0,
    "zeta_theta": 0.3,
    "inertia_split": 0.7,
}
FAST = (14.0, 12.0, 100.0)
STEEP = (6.0, 15.0, -50.0)
SHALLOW = (16.0, 5.0, 0.0)


@dataclass(frozen=True)
class HardCase:
    """One impact `(v_x1, v_y1, omega_1)` with parameters changed from `BASE` and closures from `two-mass`."""

    name: str
    impact: tuple[float, float, float] = FAST
    changes: Mapping[str, float] = field(default_factory=dict)
    closures: Mapping[str, str] = field(default_factory=dict)
    cor: float | None = None

    @property
    def model(self) -> Model:
        """The composition."""
        closures: dict[str, Any] = dict(self.closures)
        return model("two-mass", **closures)

    @property
    def parameters(self) -> dict[str, float]:
        """Values of the parameters that the composition has."""
        values = {**BASE, **self.changes}
        return {name: values[name] for name in self.model.parameter_names}

    @property
    def impacts(self) -> Impacts:
        """The impact."""
        return impacts(*self.impact, cor=self.cor)


FREE = {"torsion": "free"}


def hard_cases() -> tuple[HardCase, ...]:
    """The whole catalogue; names are unique."""
    kinds = (
        *(_torsional_damping, _resonance, _stiffness, _restitution, _friction, _start_without_slip, _events),
        *(_many_cycles, _mass_ratio, _extremes),
    )
    cases = tuple(case for kind in kinds for case in kind())
    assert len({case.name for case in cases}) == len(cases)
    return cases


def _torsional_damping() -> Iterator[HardCase]:
    for label, zeta in (
        ("zero", 0.0), ("one thousandth", 1e-3), ("half critical", 0.5), ("critical less 1e-6", 1.0 - 1e-6),
        ("critical less 1e-12", 1.0 - 1e-12), ("critical", 1.0), ("critical and 1e-12", 1.0 + 1e-12),
        ("critical and 1e-6", 1.0 + 1e-6), ("twice critical", 2.0), ("ten times critical", 10.0),
    ):  # fmt: skip
        yield HardCase(f"torsional damping {label}", changes={"zeta_theta": zeta}, closures=FREE)


def _resonance() -> Iterator[HardCase]:
    """The torsional pole on the vertical one while sliding, and at growing distance."""
    ball = Ball()
    split = tied_inertia_split(BASE["mass_ratio"])
    compliance = 1.0 / (split * ball.inertia) + 1.0 / ((1.0 - split) * ball.inertia)
    natural2 = BASE["k_y"] / (BASE["mass_ratio"] * ball.mass)
    # Damping of the vertical motion for this restitution: -ln(e) = 2 b cot(b), zeta = cos(b).
    from scipy.optimize import brentq

    loss = -np.log(BASE["cor_10"] / BASE["mass_ratio"])
    zeta = float(np.cos(brentq(lambda b: 2.0 * b / np.tan(b) - loss, 1e-3, 0.5 * np.pi, xtol=1e-15)))
    for label, factor in (
        ("exactly", 1.0), ("to 1e-14", 1.0 + 1e-14), ("to 1e-10", 1.0 + 1e-10), ("to 1e-6", 1.0 + 1e-6),
        ("to 1e-3", 1.001), ("to a tenth", 1.1), ("to a half", 1.5),
    ):  # fmt: skip
        changes = {"zeta_theta": zeta, "k_theta": natural2 / compliance * factor}
        yield HardCase(f"torsional pole on the vertical one {label}", STEEP, changes, FREE)


def _stiffness() -> Iterator[HardCase]:
    for power in (-2, -1, 0, 1, 2, 3, 4):
        yield HardCase(f"k_theta = 1e{power}", FAST, {"k_theta": 10.0**power}, FREE)
    for power in (2, 3, 4, 5, 6, 7, 8):
        yield HardCase(f"k_theta = 1e{power}, matched", FAST, {"k_theta": 10.0**power})


def _restitution() -> Iterator[HardCase]:
    critical = BASE["mass_ratio"] * float(np.exp(-2.0))
    for label, cor in (
        ("mass_ratio", 0.88), ("mass_ratio less 1e-12", 0.88 * (1.0 - 1e-12)), ("mass_ratio less 1e-6", 0.88 - 1e-6),
        ("0.3", 0.3), ("that of critical damping", critical),
        ("that of critical damping, 1e-9 below", critical - 1e-9),
        ("that of critical damping, 1e-9 above", critical + 1e-9), ("0.05", 0.05), ("0.01", 0.01),
    ):  # fmt: skip
        yield HardCase(f"restitution {label}", FAST, {"cor_10": cor})
    whole = {"normal": "total", "release": "zero_displacement"}
    for label, cor in (("1", 1.0), ("1 less 1e-15", 1.0 - 1e-15), ("0.05", 0.05)):
        yield HardCase(f"restitution {label} of the whole mass", FAST, {"cor_10": cor}, whole)


def _friction() -> Iterator[HardCase]:
    for label, mu in (("0", 0.0), ("1e-12", 1e-12), ("1e-6", 1e-6), ("0.01", 0.01), ("2", 2.0), ("5", 5.0)):
        yield HardCase(f"friction {label}", FAST, {"mu": mu})
    yield HardCase("no speed along the court", (0.0, 12.0, 0.0))
    yield HardCase("no speed along the court, no offset", (0.0, 12.0, 0.0), {"eps_10": 0.0})
    yield HardCase("negative offset", FAST, {"eps_10": -3e-3})
    yield HardCase("large negative offset", STEEP, {"eps_10": -1.5e-2})


def _start_without_slip() -> Iterator[HardCase]:
    radius = Ball().radius
    spin = 300.0
    exact = radius * spin
    for label, v_x in (
        ("exactly", exact), ("one rounding above", float(np.nextafter(exact, 99.0))),
        ("one rounding below", float(np.nextafter(exact, 0.0))), ("1e-12 above", exact * (1.0 + 1e-12)),
        ("1e-12 below", exact * (1.0 - 1e-12)), ("1e-6 above", exact * (1.0 + 1e-6)),
        ("1e-6 below", exact * (1.0 - 1e-6)),
    ):  # fmt: skip
        yield HardCase(f"no slip at landing, {label}", (v_x, 10.0, spin))
    yield HardCase("grip broken at once", (exact, 10.0, spin), {"mu": 0.02, "eps_10": 8e-3})
    yield HardCase("slip reversed by offset alone", (exact + 0.05, 10.0, spin), {"mu": 0.05, "eps_10": -2e-2})
    whole = {"normal": "total"}
    yield HardCase("no slip and no landing impulse", (exact, 10.0, spin), {}, whole)
    yield HardCase("slip of 1e-9 and no landing impulse", (exact * (1.0 + 1e-9), 10.0, spin), {}, whole)


def _events() -> Iterator[HardCase]:
    """Friction at which a sequence of phases just changes: slip that dies at the very end, or touches zero."""
    ringing = {"k_theta": 400.0, "zeta_theta": 0.01}
    for name, impact, changes, closures, low, high in (
        ("slip that ends with the contact", SHALLOW, {}, {}, 0.7, 0.775),
        ("grip that breaks at the end", SHALLOW, {}, {}, 0.775, 0.85),
        ("slip that landing just ends", STEEP, {}, {}, 2.0, 3.5),
        ("soft joint, slip that just reaches zero", SHALLOW, {"k_theta": 4.0, "zeta_theta": 0.02}, FREE, 0.2, 0.7),
        ("ringing joint, grip once or twice", FAST, ringing, FREE, 0.22, 0.24),
        ("ringing joint, slip that touches zero", FAST, ringing, FREE, 0.25, 0.26),
        ("ringing joint, slip that turns or grips", FAST, ringing, FREE, 0.3, 0.305),
        ("offset held back, hold that just sets in", STEEP, {"eps_10": 1.2e-2}, {"offset": "grip"}, 0.1, 0.117),
    ):  # fmt: skip
        edge = _change_of_regime(HardCase(name, impact, changes, closures), low, high)
        for label, factor in (("1e-9 before", 1.0 - 1e-9), ("1e-9 after", 1.0 + 1e-9)):
            yield HardCase(f"{name}, {label}", impact, {**changes, "mu": edge * factor}, closures)


def _change_of_regime(case: HardCase, low: float, high: float) -> float:
    """A friction coefficient between `low` and `high` at which the phases change, by bisection."""
    chosen, values = case.model, case.parameters

    def phases(mu: float) -> int:
        return int(chosen.rebound({**values, "mu": mu}, case.impacts).regime[0])

    first = phases(low)
    assert phases(high) != first
    while low < (middle := 0.5 * (low + high)) < high:
        if phases(middle) == first:
            low = middle
        else:
            high = middle
    return high


def _many_cycles() -> Iterator[HardCase]:
    for label, k_theta, zeta in (("a dozen", 1e3, 1e-3), ("dozens", 1e4, 1e-4), ("hundreds", 1e5, 1e-3)):
        changes = {"k_theta": k_theta, "zeta_theta": zeta, "mu": 0.3}
        yield HardCase(f"{label} torsional periods in one contact", (9.0, 14.0, 0.0), changes, FREE)
    yield HardCase("undamped joint", (9.0, 14.0, 0.0), {"k_theta": 2e3, "zeta_theta": 0.0, "mu": 0.4}, FREE)


def _mass_ratio() -> Iterator[HardCase]:
    for label, ratio in (("at the restitution", 0.77), ("1 less 1e-3", 0.999), ("1 less 1e-6", 1.0 - 1e-6)):
        yield HardCase(f"mass_ratio {label}", FAST, {"mass_ratio": ratio})
    yield HardCase("mass_ratio 1 with a shell of its own inertia", FAST, {"mass_ratio": 1.0}, {"inertia": "table"})
    yield HardCase("mass_ratio 0.3", FAST, {"mass_ratio": 0.3, "cor_10": 0.25})
    for split in (1e-4, 0.9999):
        changes = {"inertia_split": split, "k_theta": 100.0}
        yield HardCase(f"share of inertia {split:g}", FAST, changes, {"inertia": "table"})


def _extremes() -> Iterator[HardCase]:
    for spin in (1e4, -1e4):
        yield HardCase(f"spin {spin:g} rad/s", (14.0, 12.0, spin))
    for label, size in (("1e-6", 1e-6), ("1e6", 1e6)):
        yield HardCase(f"all speeds times {label}", (14.0 * size, 12.0 * size, 100.0 * size))
    yield HardCase("grazing incidence", (50.0, 0.01, 0.0))
    yield HardCase("grip with the offset held back", STEEP, {"eps_10": 1.2e-2, "mu": 0.3}, {"offset": "grip"})
    yield HardCase("k_y = 1e2", FAST, {"k_y": 1e2, "k_theta": 0.5})
    yield HardCase("k_y = 1e7", FAST, {"k_y": 1e7, "k_theta": 2e4})
