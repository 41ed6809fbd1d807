"""Do plans deliver what they predict? A truth is drawn from the posterior, tables are simulated at planned impacts,
and each is fitted together with the first table. The decrease of the sds is compared with the prediction, and with
that of as many existing impacts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from fitball.api.calibrating import calibrate
from fitball.data.lines import parse_range
from fitball.errors import FitError
from fitball.inference.design.asked import Sensor, as_before, parse_sensor
from fitball.inference.design.knowledge import Knowledge, knowledge
from fitball.inference.design.make_plan import Asked, Plan, make_plan
from fitball.inference.design.targets import Target, parse_target
from fitball.inference.identifiability.information import about
from fitball.inference.problem.observables import Observable
from fitball.inference.problem.problem import Problem
from fitball.inference.results.results import Fit
from fitball.inference.sampling.importance import importance_posterior
from fitball.inference.sampling.moves import StudentProposal
from fitball.report.form.document import columns
from fitball.values import FloatArray, Impacts
from validation.harness import Row, Study, Verdict, standard_error

PLANNED, AGAIN = "planned", "table again"
# Independent draws that a refit is worth: an sd is then known within 1.8 %.
EFFECTIVE = 1500.0
# By what share the sds found may differ from those promised.
WITHIN = 0.2
TIMER = "contact_time"


@dataclass(frozen=True)
class Case:
    """A plan in `words`: from the fit of `model` to a bundled `table`, about a `target`. It has `impacts` impacts
    within ranges given as options, measured by the `sensor` (None: as before).
    """

    words: str
    table: str
    model: str
    target: str | None
    impacts: int
    ranges: Mapping[str, str]
    sensor: str | None = None

    def asked(self, seed: int) -> Asked:
        """What the plan is asked."""
        ranges = {name: parse_range(name, text) for name, text in self.ranges.items()}
        # Of equal costs the sensor is chosen whenever it tells more.
        cost = {} if self.sensor is None else {self.sensor.partition("=")[0]: 1.0}
        sensors = ("none",) if self.sensor is None else (self.sensor,)
        return Asked(
            self.target, ranges["speed"], ranges["angle"], ranges["spin"], self.impacts, 1, sensors, cost, seed
        )


MACHINE = {"speed": "5:20", "angle": "10:80", "spin": "-300:300"}
CASES: Mapping[str, Case] = {
    "wang": Case(
        "all parameters of the two-mass ball, after Wang's 21 impacts", "wang_all", "two-mass", None, 6, MACHINE
    ),
    "pace": Case("court pace, after Wang's 21 impacts", "wang_all", "two-mass", "court pace", 6, MACHINE),
    "timer": Case(
        "both stiffnesses, with a contact timer of 0.2 ms, after Wang's 21 impacts", "wang_all", "two-mass",
        "k_y,k_theta", 3, MACHINE, f"{TIMER}=0.2ms",
    ),
    "short": Case(
        "all parameters of grip-slip, after Wang's 7 impacts without spin", "wang_zero_spin", "grip-slip", None, 4,
        MACHINE,
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Design:
    """Impacts to simulate, the sensor that reads them, and what the plan promises: `gain` in nats, `sds` (parts,)."""

    impacts: Impacts
    like: NDArray[np.int64]
    sensor: Sensor
    gain: float
    sds: FloatArray


@dataclass(frozen=True)
class Ready:
    """A case with its fit, plan and designs by name."""

    name: str
    case: Case
    known: Knowledge
    target: Target
    plan: Plan
    designs: Mapping[str, Design]
    proposal: StudentProposal


def prepared(name: str, seed: int) -> Ready:
    """Fit the table of the case called `name`, and plan."""
    case = CASES[name]
    return planned_from(name, case, calibrate(case.table, case.model, seed=seed, cores=1), seed)


def planned_from(name: str, case: Case, fit: Fit, seed: int) -> Ready:
    """Plan from a fit, with what plan and table promise. Raises FitError for a fit whose table cannot be extended."""
    problem, asked = fit.problem, case.asked(seed)
    known = knowledge(problem, fit.posterior, np.random.default_rng(seed))
    if known.problem is not problem or problem.pooling or problem.errors is not None or problem.force is not None:
        raise FitError(f"{case.words}: the study extends tables without groups, levels and uncertain incidence only")
    plan = make_plan(problem, fit.posterior, asked)
    sensor = as_before(problem) if case.sensor is None else parse_sensor(problem, case.sensor)
    states = [one.setting for one in plan.chosen]
    speed, angle, spin = (np.array([getattr(state, part) for state in states]) for part in ("speed", "angle", "spin"))
    chosen = Impacts(speed * np.cos(angle), speed * np.sin(angle), spin)
    # Evenly over the table by angle, as it was made.
    order = np.argsort(np.arctan2(problem.impacts.v_y1, problem.impacts.v_x1), kind="stable")
    rows = order[((np.arange(case.impacts) + 0.5) * len(order) / case.impacts).astype(np.int64)]
    designs = {
        PLANNED: Design(chosen, np.zeros(case.impacts, dtype=np.int64), sensor, plan.gain, plan.chosen[-1].sds),
        AGAIN: Design(problem.impacts.take(rows), rows, as_before(problem), plan.again, plan.again_sds),
    }
    weights = np.full(len(known.coordinates), 1.0 / len(known.coordinates))
    proposal = StudentProposal.fit(known.coordinates, weights)
    if proposal is None:
        raise FitError(f"{case.words}: the draws of the posterior do not span its space")
    return Ready(name, case, known, parse_target(case.target, known), plan, designs, proposal)


def replicate(ready: Ready, seed: int, number: int) -> list[Row]:
    """One record: a truth from the posterior, a table at each design, the fit of both tables. For each design: the
    information in nats, the sds, and the effective draws of the refit (None without one).
    """
    rng = np.random.default_rng([seed, number])
    row = rng.integers(len(ready.known.coordinates), size=1)
    return [{name: _narrowed(ready, design, row, rng) for name, design in ready.designs.items()}]


def _narrowed(ready: Ready, design: Design, row: NDArray[np.int64], rng: np.random.Generator) -> Row | None:
    known, truth = ready.known, ready.known.coordinates[row]
    y = _simulated(known.at(design.impacts, design.like), design.sensor, truth, rng)
    if y is None:
        return None
    problem = extended(known.problem, design.impacts, design.sensor, y)
    drawn = importance_posterior(problem, [ready.proposal, about(problem, truth[0])], rng, EFFECTIVE)
    if not drawn.settled:
        return None
    weights = np.exp(drawn.log_weights)
    after = _covariance(ready.target.values(problem.to_coordinates(drawn.values)), weights)
    before = _covariance(ready.target.values(known.coordinates), np.full(len(known.coordinates), 1.0))
    nats = 0.5 * float(np.linalg.slogdet(before)[1] - np.linalg.slogdet(after)[1])
    return {"nats": nats, "sds": np.sqrt(np.diag(after)).tolist(), "effective": drawn.effective}


def _simulated(problem: Problem, sensor: Sensor, truth: FloatArray, rng: np.random.Generator) -> FloatArray | None:
    """What a sensor reads (impacts, columns) at one draw `truth` (1, free); None where that cannot be evaluated."""
    values = problem.to_values(truth)
    columns, rebound = problem.all_values(values), problem.rebound(values)
    if not np.all(rebound.status == 0):
        return None
    means = np.stack([column.predict(rebound)[0] for column in sensor.columns], axis=1)
    sds = np.stack([column.sds(columns, rebound)[0] for column in sensor.columns], axis=1)
    return np.asarray(means + sds * problem.noise.draw(rng, (1, *means.shape), columns)[0])


def _covariance(quantities: FloatArray, weights: FloatArray) -> FloatArray:
    told = np.isfinite(quantities).all(axis=1)
    return np.atleast_2d(np.cov(quantities[told], rowvar=False, aweights=weights[told]))


def extended(problem: Problem, impacts: Impacts, sensor: Sensor, y: FloatArray) -> Problem:
    """The problem of a table with further impacts, read by a sensor as `y` (impacts, columns). Raises FitError for a
    sensor that reads a column of the table with another noise.
    """
    first = len(problem.impacts)
    joined = Impacts(
        np.concatenate([problem.impacts.v_x1, impacts.v_x1]),
        np.concatenate([problem.impacts.v_y1, impacts.v_y1]),
        np.concatenate([problem.impacts.omega_1, impacts.omega_1]),
    )
    before = {column.name: column for column in as_before(problem).columns}
    if any(before.get(column.name, column) != column for column in sensor.columns):
        raise FitError(f"sensor {sensor.name}: columns that the table has can only be read as the table was")
    measured = {column.name: y[:, k] for k, column in enumerate(sensor.columns)}
    observables = [
        replace(
            item.everywhere(first),
            observed=np.concatenate([item.everywhere(first).observed, measured.pop(item.name)]),
        )
        for item in problem.observables
    ]
    rows = np.arange(first, first + len(impacts))
    sds = {column.name: column.sd for column in sensor.columns}
    for name, values in measured.items():
        observables.append(Observable(name, values, np.full(len(values), sds[name]), None, rows))
    return replace(problem, impacts=joined, observables=tuple(observables))


def study(ready: Ready, seed: int) -> Study:
    """Its refits; the plan was made with this `seed`."""
    promised = {design: f"{one.gain:.6g}" for design, one in ready.designs.items()}
    settings = {"case": ready.name, "planned_with": seed, "words": ready.case.words, "promised": promised}
    return Study(ready.name, partial(replicate, ready), settings, ready.name, "refits")


@dataclass(frozen=True)
class Line:
    """One part of a target under one design: its sd as a share of that before, as `promised` and as `found`
    (geometric mean over replicates), with the standard error of the latter.
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
    """A case in `words`: `replicates` with both refits, `lost` without; its lines and gains. `more` is the gain of
    the planned design over as many existing impacts, with the standard error of the mean difference.
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
        """Whether the planned design surely gained more."""
        return self.more > 2.0 * self.more_se

    @property
    def holds(self) -> bool:
        """Both."""
        return self.replicates > 1 and self.kept and self.better


def finding(ready: Ready, records: Sequence[Row]) -> Finding:
    """What the replicates of a case say, those with all refits. Raises FitError where there are none."""
    whole = [row for row in records if all(row.values())]
    if not whole:
        raise FitError(f"case {ready.name}: no simulated table could be refitted at both designs")
    before, parts = ready.plan.sds, [part.name for part in ready.plan.parts]
    lines, gains = [], []
    for design, promise in ready.designs.items():
        logs = np.log([np.array(row[design]["sds"]) / before for row in whole])
        errors = standard_error(logs)
        for part, promised, mean, se in zip(parts, promise.sds / before, logs.mean(axis=0), errors, strict=True):
            share = float(np.exp(mean))
            lines.append(Line(design, part, float(promised), share, share * float(se)))
        nats = np.array([row[design]["nats"] for row in whole])
        gains.append(Gain(design, promise.gain, float(nats.mean()), float(standard_error(nats))))
    gaps = np.array([row[PLANNED]["nats"] - row[AGAIN]["nats"] for row in whole])
    more, lost = (float(gaps.mean()), float(standard_error(gaps))), len(records) - len(whole)
    return Finding(ready.name, ready.case.words, len(whole), lost, tuple(lines), tuple(gains), *more)


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


def judge(found: Sequence[Finding], seed: int) -> Verdict:
    """Were promises kept?"""
    gains, sds = gain_rows(found), sd_rows(found)
    cases = {one.name: {"words": one.words, "kept": one.kept, "better": one.better} for one in found}
    content = {"seed": seed, "holds": all(one.holds for one in found), "cases": cases, "gains": gains, "sds": sds}
    return Verdict(content, {"gains": gains, "sds": sds}, findings_text(found))


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
        better = "gained more" if one.better else "did NOT surely gain more"
        parts += [
            f"{kept} within {100.0 * WITHIN:.0f} %; the planned impacts {better} than as many existing impacts: "
            f"{one.more:.2f} ± {one.more_se:.2f} nats.",
            "",
        ]
    return "\n".join(parts)
