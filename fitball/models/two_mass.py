"""The face of the two-mass compositions: arrays and names on this side, kernels on the other."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fitball.models.history import History, two_mass_history
from fitball.models.kernels import bounce, contact, derivative
from fitball.models.kernels.compiled import to_be_made
from fitball.models.kernels.dual import NumberArray
from fitball.models.kernels.phases import MAX_PHASES, PIECE_SIZE
from fitball.models.model import (
    LinearConstraint,
    Model,
    Oracle,
    below_mass_ratio,
    positive,
    restitution_lines,
    saturating_constraints,
    seeds,
)
from fitball.models.specs import specs
from fitball.models.types import Closures, Rebound, options_of
from fitball.values import Ball, FloatArray, Impacts, OwnImpacts


def two_mass_parameters(closures: Closures, tangential: bool) -> tuple[str, ...]:
    """Names of the parameters a composition has; without tangential motion only the vertical ones.

    Without tangential motion and with `normal = total` the mass ratio acts nowhere and is left out.
    """
    rigid = closures.torsion == "rigid"
    wanted = {
        "mass_ratio": closures.normal != "total" or (tangential and not rigid and closures.inertia == "tied"),
        "k_y": True,
        "k_theta": tangential and not rigid,
        "mu": tangential,
        "eps_10": tangential,
        "eps_slope": tangential,
        "cor_10": closures.cor != "measured",
        "cor_slope": closures.cor in ("line", "saturating"),
        "zeta_theta": tangential and closures.torsion == "free",
        "inertia_split": tangential and not rigid and closures.inertia == "table",
    }
    return tuple(name for name, present in wanted.items() if present)


@dataclass(frozen=True)
class TwoMassModel(Model):
    """A two-mass ball composed of `closures`.

    With `tangential` false only the vertical motion is solved: `v_x2` and `omega_2` repeat the incident
    values and cost nothing.
    """

    has_time = True
    has_force = True
    has_gaps = True
    no_history = ""
    convention = "two-mass"
    kernel = staticmethod(bounce.bounce)
    columns = contact.COLUMNS

    closures: Closures = field(kw_only=True)

    @cached_property
    def codes(self) -> NDArray[np.int64]:
        """The closures as the kernel reads them: the place of each among its options."""
        places = [known.index(getattr(self.closures, name)) for name, known in options_of(Closures).items()]
        return np.array([*places, self.tangential], dtype=np.int64)

    def rows(self, names: Sequence[str], values: NumberArray) -> NumberArray:
        """See `Model.rows`; a ball that is not split is all core."""
        rows = super().rows(names, values)
        if "mass_ratio" not in names:
            rows[:, contact.MASS_RATIO] = 1.0
        return rows

    def evaluate(self, names: Sequence[str], values: FloatArray, impacts: Impacts | OwnImpacts) -> Rebound:
        """See `Model.evaluate`."""
        given = self.rows(names, values), self.codes, *_incident(impacts)
        out, regime, status = made = _room(values.shape[0], len(impacts))
        left = status.size
        if self.tangential and self.closures.torsion != "rigid":
            left = bounce.bounce_batch(*given, *made, np.zeros(bounce.LANE_ROOM))
        if left:
            places = np.arange(status.size) if left == status.size else np.flatnonzero(status == bounce.LEFT)
            for _part in _each(given, places, made):
                pass
        return Rebound(*(*out, regime, status))

    def linear_constraints(self, impacts: Impacts) -> tuple[LinearConstraint, ...]:
        """See `Model.linear_constraints`: under momentum balance the core cannot return faster than it came."""
        momentum = self.closures.normal == "momentum"
        if self.closures.cor == "saturating":
            return saturating_constraints(capped_by_mass_ratio=momentum)
        if not momentum:
            return super().linear_constraints(impacts)
        if impacts.cor is not None and self.needs_cor:
            return (below_mass_ratio({}, float(impacts.cor.max())),)
        lines = restitution_lines(self.parameter_names, impacts)
        return tuple(constraint for line in lines for constraint in (positive(line), below_mass_ratio(line)))

    @property
    def oracle(self) -> Oracle | None:
        """See `Model.oracle`."""
        # Its imports take a quarter of a second, which only a calibration needs.
        from fitball.models.oracle import TwoMassOracle

        return TwoMassOracle(self.closures, self.ball) if self.tangential else None

    @property
    def force_remark(self) -> str:
        """The landing impulse of the shell takes no time and is not in the force."""
        if self.closures.normal != "momentum":
            return ""
        return (
            "the impulse that stops the shell at landing takes no time and is in no force record. Records are "
            "compared with the spring's force alone"
        )

    def force_integrals(
        self,
        names: Sequence[str],
        values: NumberArray,
        impacts: Impacts,
        first: NumberArray,
        spacing: FloatArray,
        count: int,
    ) -> tuple[NumberArray, NumberArray, NumberArray]:
        """See `Model.force_integrals`."""
        rows = self.rows(names, values)
        out = np.empty((2, values.shape[0], len(impacts), count), dtype=rows.dtype)
        centroid = np.empty((values.shape[0], len(impacts)), dtype=rows.dtype)
        cor = impacts.cor if impacts.cor is not None else np.full(len(impacts), np.nan)
        contact.force_batch(rows, self.codes, impacts.v_y1, cor, first.astype(rows.dtype), spacing, out, centroid)
        return out[0], out[1], centroid

    def slopes(
        self, names: Sequence[str], values: FloatArray, impacts: Impacts | OwnImpacts, parameters: Sequence[str]
    ) -> FloatArray:
        """See `Model.slopes`; some 10 us an impact for all parameters."""
        gains, draws, count = seeds(self.rows, names, values, parameters), values.shape[0], len(impacts)
        given = self.rows(names, values), self.codes, *_incident(impacts)
        slopes = np.empty((draws, count, derivative.OUTPUT_COUNT, derivative.INPUTS + len(gains)))
        made = _room(draws, count)
        room = np.zeros(derivative.ROOM)
        for first, stop, log, ends in _each(given, np.arange(draws * count), made):
            derivative.jacobian_batch(given[0], gains, *given[1:], first, stop, made[2], log, ends, slopes, room)
        return slopes

    def history(self, parameters: Mapping[str, ArrayLike], impact: Impacts, times: ArrayLike) -> History:
        """See `Model.history`."""
        names, values = self._single(parameters, impact)
        rebound = self.rebound(parameters, impact)
        given = self.rows(names, values), self.codes, *_incident(impact)
        ((_first, _stop, log, ends),) = _each(given, np.arange(1), _room(1, 1))
        return two_mass_history(given[0][0], self.codes, impact, rebound, log, int(ends[0]), times)


# What the kernels of batches begin with: rows, codes, incident columns.
Given: TypeAlias = tuple[FloatArray, NDArray[np.int64], FloatArray, FloatArray, FloatArray, FloatArray]
Made: TypeAlias = tuple[FloatArray, NDArray[np.int64], NDArray[np.int8]]
# Pieces of contacts that are held at once.
LOGGED = 2 * MAX_PHASES


def _room(draws: int, impacts: int) -> Made:
    """Outputs, regimes and statuses to be filled in."""
    shape = draws, impacts
    return (
        np.empty((derivative.OUTPUT_COUNT, *shape)),
        np.empty(shape, dtype=np.int64),
        np.empty(shape, dtype=np.int8),
    )


def _each(
    given: Given, places: NDArray[np.int64], made: Made
) -> Iterator[tuple[int, int, FloatArray, NDArray[np.int64]]]:
    """Solve the impacts at `places` one by one: those from a first to a stop at a time, with log and ends."""
    log, ends = np.empty((LOGGED, PIECE_SIZE)), np.empty(places.shape, dtype=np.int64)
    room, stack = np.zeros(bounce.ROOM), np.zeros(bounce.STACK)
    stop, first = 0, -1
    while first < stop:
        first = stop
        stop = bounce.bounce_each(*given, places, first, *made, log, ends, room, stack)
        yield first, stop, log, ends
        if stop == places.size:
            return


KERNELS = {"rebounds": bounce.bounce_batch, "rebounds alone": bounce.bounce_each, "slopes": derivative.jacobian_batch}


def to_be_compiled() -> tuple[str, ...]:
    """Which of the kernels of rebounds and their derivatives are not on disk, and could be kept there."""
    return tuple(name for name, kernel in KERNELS.items() if to_be_made(kernel))


def compile_kernel(name: str) -> None:
    """Compile one of `KERNELS`: on no impacts."""
    row, column = np.zeros((1, len(contact.COLUMNS))), _read_only(np.zeros((1, 0)))
    given = row, np.zeros(contact.TANGENTIAL + 1, dtype=np.int64), column, column, column, column
    made, none = _room(1, 0), np.arange(0)
    if name == "rebounds":
        bounce.bounce_batch(*given, *made, np.zeros(bounce.LANE_ROOM))
    elif name == "slopes":
        log, slopes = np.zeros((1, PIECE_SIZE)), np.empty((1, 0, derivative.OUTPUT_COUNT, derivative.INPUTS))
        gains, room = np.zeros((0, *row.shape)), np.zeros(derivative.ROOM)
        derivative.jacobian_batch(row, gains, *given[1:], 0, 0, made[2], log, none, slopes, room)
    else:
        for _part in _each(given, none, made):
            pass


def compose_two_mass(name: str, ball: Ball, tangential: bool, closures: Closures) -> TwoMassModel:
    """The model of a composition with its parameters."""
    parameters = specs(*two_mass_parameters(closures, tangential))
    return TwoMassModel(name, ball, asdict(closures), parameters, closures=closures, tangential=tangential)


def _incident(impacts: Impacts | OwnImpacts) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Incident columns as the kernels take them; NaN stands for a restitution that was not measured."""
    v_x1, v_y1, omega_1, cor = impacts.states()
    measured = np.full(v_y1.shape, np.nan) if cor is None else cor
    return _read_only(v_x1), _read_only(v_y1), _read_only(omega_1), _read_only(measured)


def _read_only(column: FloatArray) -> FloatArray:
    """A column as one kind of array: for each other kind the kernel would be compiled again."""
    view = np.ascontiguousarray(column).view()
    view.flags.writeable = False
    return view
