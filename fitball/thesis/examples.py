"""Figs 8 to 28 of Jafri (2004): what each varies, and what the thesis states of its inputs; each solved exactly, what
that means for every claim of the thesis, and the text for a user.

They are kept in `datasets/thesis/figures.toml`, their claims in `figure_claims.csv`. The figures of Chapter III have
no inputs in their text: only the two examples behind Figs 25 to 28 are stated. Assumptions are listed with each
figure, with the reason.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fitball.data.bundled import bundled_folder
from fitball.data.published import FOLDER, thesis_rows
from fitball.errors import ParameterError, suggestion
from fitball.inference.prediction.simulate import Simulation, simulate
from fitball.inference.thesis.published_cases import BALL_RADIUS, INERTIA, INERTIA_OF, case_parameters
from fitball.models.history import History, Span
from fitball.models.registry import model
from fitball.models.types import Phase
from fitball.report.form.document import columns, wrapped
from fitball.thesis.printed_tables import examples, rebound_words, transition_words
from fitball.values import FloatArray, impacts

COR = 0.76
# Friction that grips early, without an offset: what Figs 17 to 23 are solved with, see `no_slip` there.
GRIP = {"mu": 5.0, "eps_10": 0.0, "eps_slope": 0.0}


@dataclass(frozen=True)
class Curve:
    """One curve: its label, the impact `(v_x1, v_y1, omega_1)` [m/s, m/s, rad/s], what differs from the base set."""

    label: str
    impact: tuple[float, float, float]
    changed: Mapping[str, float]


@dataclass(frozen=True)
class Claim:
    """A statement of the thesis on a curve, numbered from 0: `measure` names the quantity (see `MEASURES`).

    `printed` is its number, or None for a statement in words that `holds` or not.
    """

    statement: str
    measure: str
    curve: int
    printed: float | None
    unit: str


@dataclass(frozen=True)
class Example:
    """One figure: `panels` as in `figure_history`, inputs `stated` and `assumed` in words."""

    name: str
    title: str
    panels: tuple[str, ...]
    curves: tuple[Curve, ...]
    stated: str
    assumed: tuple[str, ...]

    @property
    def claims(self) -> tuple[Claim, ...]:
        """The claims of the thesis about it."""
        return tuple(
            Claim(
                row["claim"], row["measure"], int(row["curve"]), float(row["printed"]) if row["printed"] else None,
                row["unit"],
            )
            for row in thesis_rows("figure_claims")
            if row["figure"] == self.name
        )  # fmt: skip


def _read() -> tuple[Example, ...]:
    content = tomllib.loads((bundled_folder() / FOLDER / "figures.toml").read_text(encoding="utf-8"))
    texts = content["assumed"]

    def curve(label: str, impact: list[float], grip: bool = False, **more: Mapping[str, float]) -> Curve:
        v_x, v_y, omega = impact
        return Curve(label, (v_x, v_y, omega), {**(GRIP if grip else {}), **more.get("changed", {})})

    return tuple(
        Example(
            figure["name"],
            figure["title"],
            tuple(figure["panels"]),
            tuple(curve(**item) for item in figure["curves"]),
            figure["stated"],
            tuple(texts.get(item, item) for item in figure["assumed"]),
        )
        for figure in content["figure"]
    )


EXAMPLES = _read()
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
    known = {example.name: example for example in EXAMPLES}
    if name not in known:
        raise ParameterError(f"unknown example '{name}': {suggestion(name, [*known, 'list'])}")
    return known[name]


def run_example(example: Example) -> tuple[Simulation, ...]:
    """Every curve by `thesis-exact`, with inertia and restitution as Chapter III gives them."""
    chosen = model("thesis-exact", inertia="table", cor="mean")
    base = {**case_parameters("2/3", 80.0, 0.532), "cor_10": COR}
    return tuple(
        simulate(chosen, {**base, **curve.changed}, impacts(*curve.impact), curve.label) for curve in example.curves
    )


def findings(example: Example, solved: Sequence[Simulation]) -> tuple[Finding, ...]:
    """Each claim of the example, judged."""
    number, known = NUMBER_OF.get(example.name), _as_computed(example.name)

    def finding(claim: Claim) -> Finding:
        start = claim.measure == "rolling start"
        computed = appendix_b_start(solved[claim.curve]) if start else known.get(claim.measure)
        note = transition_words(examples(), number) if number and claim.measure == "rolling begins" else ""
        return Finding(claim, MEASURES[claim.measure](solved, claim.curve), computed, note)

    return tuple(map(finding, example.claims))


def remarks(example: Example) -> tuple[str, ...]:
    """Where the print of Figs 25 to 28 comes from."""
    number = NUMBER_OF.get(example.name)
    return () if number is None else (rebound_words(examples(), number),)


def _as_computed(name: str) -> Mapping[str, float]:
    """What the thesis's computation gives for the inputs stated with Figs 25 to 28."""
    if name not in NUMBER_OF:
        return {}
    table = examples()
    row = table[(table["example"] == NUMBER_OF[name]) & (table["inputs"] == "stated")].iloc[0]
    names = {"v_x2": "v_x2", "omega_2": "omega_2", "rolling begins": "transition"}
    known = {measure: float(row[f"{column}_recomputed"]) for measure, column in names.items()}
    return {measure: value for measure, value in known.items() if math.isfinite(value)}


def _first_rest(history: History) -> Span | None:
    return next((span for span in history.spans if span.phase in RESTING), None)


def _ordered(value: Callable[[Simulation], float], sign: float) -> Measure:
    """Whether a value rises (or falls) from curve to curve."""
    return lambda solved, _curve: bool(np.all(sign * np.diff([value(item) for item in solved]) > 0.0))


def _monotone(name: str, sign: float) -> Measure:
    """Whether a course goes one way from landing to release, in every curve, to a hundredth of its change: as a
    picture shows it.
    """

    def measure(solved: Sequence[Simulation], _curve: int) -> bool:
        courses = [sign * getattr(item.history, name) for item in solved]
        return all(c[-1] > c[0] and np.all(np.maximum.accumulate(c) - c <= 0.01 * np.ptp(c)) for c in courses)

    return measure


def _every(holds: Callable[[History], object]) -> Measure:
    """Whether something is so of every curve."""
    return lambda solved, _curve: all(bool(holds(item.history)) for item in solved)


def _of(value: Callable[[Simulation], float | bool | None]) -> Measure:
    """What one curve gives."""
    return lambda solved, curve: value(solved[curve])


def _after(name: str, sign: float = 1.0) -> Callable[[Simulation], float]:
    return lambda item: sign * float(getattr(item.history.release.after, name))


def _rolling_start(item: Simulation) -> float:
    """Spin with which the shell rolls first [rad/s], or that of the end if it never does."""
    history, span = item.history, _first_rest(item.history)
    return float(np.interp(span.start if span else history.contact_time, history.times, history.omega_2))


def appendix_b_start(simulation: Simulation) -> float:
    """Spin of the shell at n = 0 in Appendix B [rad/s]: from the energy of the ball, its core's spin unchanged."""
    mass = simulation.parameters["ball_mass"]
    inertia = INERTIA_OF["2/3"] * INERTIA
    core = simulation.parameters["inertia_split"] * inertia
    v_x, omega = float(simulation.impact.v_x1[0]), float(simulation.impact.omega_1[0])
    energy = mass * v_x**2 + (inertia - core) * omega**2
    return math.sqrt(energy / (inertia - core + mass * BALL_RADIUS**2))


def _loss(item: Simulation) -> float:
    """Of velocity along the court [m/s]."""
    return float(item.impact.v_x1[0]) - item.history.release.after.v_x


def _mean_friction(item: Simulation) -> float:
    """Eq. (65)."""
    return _loss(item) / (float(item.impact.v_y1[0]) - item.history.release.after.v_y)


def _impulse_ratio(item: Simulation) -> float:
    """Impulse of friction over that of the normal force, both exact: the first is the ball's loss of momentum.

    The second is what the core loses until the force ends, `M1 (v_y1 - y')`.
    """
    history = item.history
    end = next((span.start for span in history.spans if span.phase is Phase.FREE), history.contact_time)
    rate = float(item.model.history(item.parameters, item.impact, end).v_y[0])
    core = item.parameters["mass_ratio"] * item.parameters["ball_mass"]
    return item.parameters["ball_mass"] * _loss(item) / (core * (float(item.impact.v_y1[0]) - rate))


def _while_resting(item: Simulation, name: str = "omega_2") -> FloatArray:
    """A course while the shell rolls, by default its spin."""
    course: FloatArray = getattr(item.history, name)[np.isin(item.history.phase, RESTING)]
    return course


def _falls_then_rises(item: Simulation) -> bool:
    """Whether the shell, once it rolls, loses spin before it gains some."""
    spin = _while_resting(item)
    lowest = int(np.argmin(spin))
    return bool(0 < lowest < spin.size - 1 and spin[-1] > spin[lowest])


def _steady(item: Simulation) -> bool:
    """Whether the last fifth of rolling changes the spin by less than a hundredth."""
    spin = _while_resting(item)
    return bool(np.ptp(spin[-spin.size // 5 :]) < 0.01 * abs(spin[-1]))


def _rolls_first(solved: Sequence[Simulation], _curve: int) -> bool:
    zero, top = _first_rest(solved[0].history), _first_rest(solved[1].history)
    return zero is not None and top is not None and top.start < zero.start


def _begins(item: Simulation) -> float | None:
    span = _first_rest(item.history)
    return None if span is None else span.start_share


def _angle(item: Simulation) -> float:
    after = item.history.release.after
    return math.degrees(math.atan2(-after.v_y, after.v_x))


def _spin_order(solved: Sequence[Simulation], _curve: int) -> bool:
    zero, top, back = (item.history.release.after.omega_2 for item in solved)
    return top > zero > back


MEASURES: Mapping[str, Measure] = {
    "v_x2": _of(_after("v_x")),
    "v_y2": _of(_after("v_y", -1.0)),
    "omega_2": _of(_after("omega_2")),
    "theta_2": _of(_angle),
    "v_2": _of(lambda item: math.hypot(item.history.release.after.v_x, item.history.release.after.v_y)),
    "mean friction": _of(_mean_friction),
    "impulse ratio": _of(_impulse_ratio),
    "rolling begins": _of(_begins),
    "rolling start": _of(_rolling_start),
    "no rolling": _of(lambda item: _first_rest(item.history) is None),
    "rolls more than half": _of(
        lambda item: sum(s.end_share - s.start_share for s in item.history.spans if s.phase in RESTING) > 0.5
    ),
    "topspin rolls first": _rolls_first,
    "rising peak compression": _ordered(lambda item: item.history.peak_compression.value, 1.0),
    "rising peak force": _ordered(lambda item: item.history.peak_force.value, 1.0),
    "peak of compression before the middle": _every(lambda h: h.peak_compression.time < 0.5 * h.contact_time),
    "peak of force before the middle": _every(lambda h: h.peak_force.time < 0.5 * h.contact_time),
    "rising rebound v_y2": _ordered(_after("v_y"), -1.0),
    "rising rebound v_x2": _ordered(_after("v_x"), 1.0),
    "falling rebound v_x2": _ordered(_after("v_x"), -1.0),
    "rising rebound omega_2": _ordered(_after("omega_2"), 1.0),
    "falling rebound omega_2": _ordered(_after("omega_2"), -1.0),
    "rising v_x": _monotone("v_x", 1.0),
    "falling v_x": _monotone("v_x", -1.0),
    "rising spin": _monotone("omega_2", 1.0),
    "equal loss of v_x": lambda s, _k: max(map(_loss, s)) - min(map(_loss, s)) < 1e-9 * max(map(_loss, s)),
    "backspin turns": _of(lambda item: bool(item.history.omega_2[0] < 0.0 < item.history.omega_2[-1])),
    "spin falls, then rises": _of(_falls_then_rises),
    "spin rises while gripping": _of(lambda item: bool(_while_resting(item)[-1] > _while_resting(item)[0])),
    "steady at the end": _of(_steady),
    "topspin above zero above backspin": _spin_order,
    "less spin, more friction": _ordered(
        lambda item: float(np.max(np.abs(_while_resting(item, "friction_force")))), -1.0
    ),
    "friction starts negative": _every(lambda h: h.friction_force[0] < 0.0),
    "friction is mu F": _every(lambda h: np.allclose(np.abs(h.friction_force), h.friction * h.normal_force)),
}


def list_text() -> str:
    """All examples, one per line."""
    return "\n".join(
        columns([["example", "what it shows"], *([example.name, example.title] for example in EXAMPLES)], left=2)
    )


def list_json() -> list[dict[str, str]]:
    """All examples: name and title."""
    return [{"name": example.name, "title": example.title} for example in EXAMPLES]


def example_text(example: Example, results: Sequence[Finding]) -> str:
    """Title, inputs, and each claim with its finding."""
    head = f"{example.name}: {example.title} (Jafri 2004)"
    lines = [head, "=" * len(head), *wrapped([example.stated], "Stated: ", " " * 8)]
    for text in example.assumed:
        lines += wrapped([text], "Assumed: ", " " * 9)
    for text in remarks(example):
        lines += wrapped([text], "Note: ", " " * 6)
    rows = [["the thesis says", "printed", "exact", "exact - printed", "thesis's computation"]]
    rows += [[finding.claim.statement, *_cells(finding)] for finding in results]
    notes = [line for finding in results if finding.note for line in wrapped([finding.note], "* ", " " * 2)]
    return "\n".join([*lines, "", *columns(rows), *notes])


def example_json(example: Example, results: Sequence[Finding]) -> dict[str, Any]:
    """The record of an example: what was stated, assumed, claimed and found."""
    return {
        "name": example.name,
        "title": example.title,
        "stated": example.stated,
        "assumed": list(example.assumed),
        "remarks": list(remarks(example)),
        "claims": [
            {
                "said": finding.claim.statement,
                "curve": example.curves[finding.claim.curve].label,
                "unit": finding.claim.unit,
                "printed": finding.claim.printed,
                "exact": finding.found,
                "difference": finding.difference,
                "thesis_computation": finding.computed,
                "note": finding.note,
            }
            for finding in results
        ],
    }


def _cells(finding: Finding) -> list[str]:
    unit = f" {finding.claim.unit}" if finding.claim.unit else ""
    numbers = (finding.claim.printed, finding.found, finding.difference, finding.computed)
    printed, exact, difference, computed = (
        "" if number is None or isinstance(number, bool) else f"{number:.5g}{unit}" for number in numbers
    )
    if isinstance(finding.found, bool):
        exact = "true" if finding.found else "false"
    elif finding.found is None:
        exact = "never"
    return [f"{printed} *" if finding.note else printed, exact, difference, computed]
