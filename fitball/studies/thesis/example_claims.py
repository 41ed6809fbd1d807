"""Examples of the thesis solved exactly, and what they say of each of its claims."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fitball.errors import ParameterError, suggestion
from fitball.inference.prediction.simulate import Simulation, simulate
from fitball.inference.thesis.inputs import BALL_RADIUS, INERTIA, INERTIA_OF, case_parameters
from fitball.models.history import History, Span
from fitball.models.registry import model
from fitball.models.types import Phase
from fitball.studies.thesis.printed_tables import examples, rebound_words, transition_words
from fitball.studies.thesis.simulate_examples import COR, EXAMPLES, Claim, Example
from fitball.values import impacts

# The examples of Chapter III by the figures that show them.
NUMBER_OF: Mapping[str, int] = {"fig25": 1, "fig26": 1, "fig27": 2, "fig28": 2}
RESTING = (Phase.GRIP, Phase.HOLD)
Measure = Callable[[Sequence[Simulation], int], float | bool | None]


@dataclass(frozen=True)
class Finding:
    """A claim beside the exact solution: `found` is a number, a verdict, or None where nothing of the kind happens.

    `computed` is what the thesis's own computation gives for the same inputs (model `thesis`, or the formula it
    uses), where it is known; `note` says where the print itself comes from another run than the rest.
    """

    claim: Claim
    found: float | bool | None
    computed: float | None
    note: str = ""

    @property
    def difference(self) -> float | None:
        """Exact minus printed, where both are numbers."""
        if self.claim.printed is None or self.found is None or isinstance(self.found, bool):
            return None
        return self.found - self.claim.printed


def find_example(name: str) -> Example:
    """The example called `name`. Raises ParameterError."""
    for example in EXAMPLES:
        if example.name == name:
            return example
    known = [example.name for example in EXAMPLES]
    raise ParameterError(f"unknown example '{name}': {suggestion(name, [*known, 'list'])}")


def run_example(example: Example) -> tuple[Simulation, ...]:
    """Every curve by `thesis-exact`, with inertia and restitution as Chapter III gives them."""
    chosen = model("thesis-exact", inertia="table", cor="mean")
    base = {**case_parameters("2/3", 80.0, 0.532), "cor_10": COR}
    return tuple(
        simulate(chosen, {**base, **curve.changed}, impacts(*curve.impact), curve.label) for curve in example.curves
    )


def findings(example: Example, solved: Sequence[Simulation]) -> tuple[Finding, ...]:
    """Each claim of the example, judged."""
    known = _as_computed(example.name)

    def computed(claim: Claim) -> float | None:
        if claim.measure == "rolling start":
            return appendix_b_start(solved[claim.curve])
        return known.get(claim.measure)

    def note(claim: Claim) -> str:
        number = NUMBER_OF.get(example.name)
        return transition_words(examples(), number) if number and claim.measure == "rolling begins" else ""

    return tuple(
        Finding(claim, MEASURES[claim.measure](solved, claim.curve), computed(claim), note(claim))
        for claim in example.claims
    )


def remarks(example: Example) -> tuple[str, ...]:
    """Where the print of Figs 25 to 28 comes from."""
    number = NUMBER_OF.get(example.name)
    return () if number is None else (rebound_words(examples(), number),)


def _as_computed(name: str) -> Mapping[str, float]:
    """What the thesis's computation gives for the inputs stated with Figs 25 to 28."""
    number = NUMBER_OF.get(name)
    if number is None:
        return {}
    table = examples()
    row = table[(table["example"] == number) & (table["inputs"] == "stated")].iloc[0]
    rebound = {"v_x2": float(row["v_x2_recomputed"]), "omega_2": float(row["omega_2_recomputed"])}
    transition = float(row["transition_recomputed"])
    return rebound | ({"rolling begins": transition} if math.isfinite(transition) else {})


def _first_rest(history: History) -> Span | None:
    return next((span for span in history.spans if span.phase in RESTING), None)


def _rolling_share(history: History) -> float:
    return sum(span.end_share - span.start_share for span in history.spans if span.phase in RESTING)


def _ordered(values: Sequence[float], sign: float) -> bool:
    return bool(np.all(sign * np.diff(values) > 0.0))


def _monotone(solved: Sequence[Simulation], name: str, sign: float) -> bool:
    """Whether a course goes one way from landing to release, in every curve, to a hundredth of its change: as a
    picture shows it.
    """
    courses = [getattr(simulation.history, name) for simulation in solved]
    return all(
        sign * (c[-1] - c[0]) > 0.0 and np.all(np.maximum.accumulate(sign * c) - sign * c <= 0.01 * np.ptp(c))
        for c in courses
    )


def _after(solved: Sequence[Simulation], name: str) -> list[float]:
    return [float(getattr(simulation.history.release.after, name)) for simulation in solved]


def _rolling_start(solved: Sequence[Simulation], curve: int) -> float:
    """Spin with which the shell rolls first [rad/s], or that of the end if it never does."""
    history = solved[curve].history
    span = _first_rest(history)
    return float(np.interp(span.start if span else history.contact_time, history.times, history.omega_2))


def appendix_b_start(simulation: Simulation) -> float:
    """Spin of the shell at n = 0 in Appendix B [rad/s]: from the energy of the ball, its core's spin unchanged."""
    mass = simulation.parameters["ball_mass"]
    inertia = INERTIA_OF["2/3"] * INERTIA
    core = simulation.parameters["inertia_split"] * inertia
    v_x, omega = float(simulation.impact.v_x1[0]), float(simulation.impact.omega_1[0])
    energy = mass * v_x**2 + (inertia - core) * omega**2
    return math.sqrt(energy / (inertia - core + mass * BALL_RADIUS**2))


def _mean_friction(solved: Sequence[Simulation], curve: int) -> float:
    """Eq. (65)."""
    item = solved[curve]
    after, v_y = item.history.release.after, float(item.impact.v_y1[0])
    return (float(item.impact.v_x1[0]) - after.v_x) / (v_y - after.v_y)


def _impulse_ratio(solved: Sequence[Simulation], curve: int) -> float:
    """Impulse of friction over that of the normal force, both exact: the first is the ball's loss of momentum.

    The second is what the core loses until the force ends, `M1 (v_y1 - y')`.
    """
    item = solved[curve]
    history = item.history
    end = next((span.start for span in history.spans if span.phase is Phase.FREE), history.contact_time)
    rate = float(item.model.history(item.parameters, item.impact, end).v_y[0])
    lost = item.parameters["ball_mass"] * (float(item.impact.v_x1[0]) - history.release.after.v_x)
    core = item.parameters["mass_ratio"] * item.parameters["ball_mass"]
    return lost / (core * (float(item.impact.v_y1[0]) - rate))


def _turns(solved: Sequence[Simulation], curve: int) -> bool:
    spin = solved[curve].history.omega_2
    return bool(spin[0] < 0.0 < spin[-1])


def _falls_then_rises(solved: Sequence[Simulation], curve: int) -> bool:
    """Whether the shell, once it rolls, loses spin before it gains some."""
    spin = _while_resting(solved, curve)
    lowest = int(np.argmin(spin))
    return bool(0 < lowest < spin.size - 1 and spin[-1] > spin[lowest])


def _while_resting(solved: Sequence[Simulation], curve: int) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    history = solved[curve].history
    return history.omega_2[np.isin(history.phase, RESTING)]


def _steady(solved: Sequence[Simulation], curve: int) -> bool:
    """Whether the last fifth of rolling changes the spin by less than a hundredth."""
    spin = _while_resting(solved, curve)
    return bool(np.ptp(spin[-spin.size // 5 :]) < 0.01 * abs(spin[-1]))


def _rises_while_resting(solved: Sequence[Simulation], curve: int) -> bool:
    spin = _while_resting(solved, curve)
    return bool(spin[-1] > spin[0])


def _greatest_friction(solved: Sequence[Simulation]) -> list[float]:
    return [
        float(np.max(np.abs(simulation.history.friction_force[np.isin(simulation.history.phase, RESTING)])))
        for simulation in solved
    ]


def _rolls_first(solved: Sequence[Simulation], _curve: int) -> bool:
    zero, top = _first_rest(solved[0].history), _first_rest(solved[1].history)
    return zero is not None and top is not None and top.start < zero.start


def _begins(solved: Sequence[Simulation], curve: int) -> float | None:
    span = _first_rest(solved[curve].history)
    return None if span is None else span.start_share


def _number(name: str, sign: float = 1.0) -> Measure:
    return lambda solved, curve: sign * float(getattr(solved[curve].history.release.after, name))


def _angle(solved: Sequence[Simulation], curve: int) -> float:
    after = solved[curve].history.release.after
    return math.degrees(math.atan2(-after.v_y, after.v_x))


def _loss(simulation: Simulation) -> float:
    return float(simulation.impact.v_x1[0]) - simulation.history.release.after.v_x


MEASURES: Mapping[str, Measure] = {
    "v_x2": _number("v_x"),
    "v_y2": _number("v_y", -1.0),
    "omega_2": _number("omega_2"),
    "theta_2": _angle,
    "v_2": lambda solved, k: math.hypot(solved[k].history.release.after.v_x, solved[k].history.release.after.v_y),
    "mean friction": _mean_friction,
    "impulse ratio": _impulse_ratio,
    "rolling begins": _begins,
    "rolling start": _rolling_start,
    "no rolling": lambda solved, k: _first_rest(solved[k].history) is None,
    "rolls more than half": lambda solved, k: _rolling_share(solved[k].history) > 0.5,
    "topspin rolls first": _rolls_first,
    "rising peak compression": lambda s, _k: _ordered([item.history.peak_compression.value for item in s], 1.0),
    "rising peak force": lambda s, _k: _ordered([item.history.peak_force.value for item in s], 1.0),
    "peak of compression before the middle": lambda s, _k: all(
        item.history.peak_compression.time < 0.5 * item.history.contact_time for item in s
    ),
    "peak of force before the middle": lambda s, _k: all(
        item.history.peak_force.time < 0.5 * item.history.contact_time for item in s
    ),
    "rising rebound v_y2": lambda s, _k: _ordered(_after(s, "v_y"), -1.0),
    "rising rebound v_x2": lambda s, _k: _ordered(_after(s, "v_x"), 1.0),
    "falling rebound v_x2": lambda s, _k: _ordered(_after(s, "v_x"), -1.0),
    "rising rebound omega_2": lambda s, _k: _ordered(_after(s, "omega_2"), 1.0),
    "falling rebound omega_2": lambda s, _k: _ordered(_after(s, "omega_2"), -1.0),
    "rising v_x": lambda s, _k: _monotone(s, "v_x", 1.0),
    "falling v_x": lambda s, _k: _monotone(s, "v_x", -1.0),
    "rising spin": lambda s, _k: _monotone(s, "omega_2", 1.0),
    "equal loss of v_x": lambda s, _k: max(map(_loss, s)) - min(map(_loss, s)) < 1e-9 * max(map(_loss, s)),
    "backspin turns": _turns,
    "spin falls, then rises": _falls_then_rises,
    "spin rises while gripping": _rises_while_resting,
    "steady at the end": _steady,
    "topspin above zero above backspin": lambda s, _k: (
        _after(s, "omega_2")[1] > _after(s, "omega_2")[0] > _after(s, "omega_2")[2]
    ),
    "less spin, more friction": lambda s, _k: _ordered(_greatest_friction(s), -1.0),
    "friction starts negative": lambda s, _k: all(item.history.friction_force[0] < 0.0 for item in s),
    "friction is mu F": lambda s, _k: all(
        bool(np.allclose(np.abs(item.history.friction_force), item.history.friction * item.history.normal_force))
        for item in s
    ),
}
