"""The face of the thesis's own computation: arrays and names on this side, kernels on the other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace

import numpy as np

from fitball.models.kernels.contact import tied_inertia_split
from fitball.models.kernels.dual import NumberArray
from fitball.models.kernels.vertical import ANCHOR_SPEED
from fitball.models.model import INPUTS, LINES, KernelCall, Model, ReboundJacobian, ball_columns, moved_inputs
from fitball.models.specs import specs
from fitball.models.thesis import jacobian as thesis_jacobian
from fitball.models.thesis import kernel as thesis
from fitball.models.types import OUTPUTS, Rebound, ThesisClosures
from fitball.values import Ball, FloatArray, Impacts, OwnImpacts

DAMPING_CODES = {
    "given": thesis.DAMPING_GIVEN,
    "chapter_three": thesis.DAMPING_CHAPTER_THREE,
    "chapter_five": thesis.DAMPING_CHAPTER_FIVE,
}
ALWAYS = ("mass_ratio", "k_y", "k_theta", "mu", "eps_10", "eps_slope")


def thesis_parameters(closures: ThesisClosures) -> tuple[str, ...]:
    """Names of the parameters of a composition."""
    wanted = {
        "cor_10": closures.cor != "measured",
        "cor_slope": closures.cor == "line",
        "inertia_split": closures.inertia == "table",
        "c_y": closures.damping == "given",
    }
    return (*ALWAYS, *(name for name, present in wanted.items() if present))


@dataclass(frozen=True)
class ThesisCourse:
    """Horizontal velocity, surface velocity `R omega_2` [m/s] and shell spin [rad/s] at `times` (times,) [s].

    `transition` [s] is when rolling begins, NaN if it does not.
    """

    times: FloatArray
    v_x: FloatArray
    surface: FloatArray
    omega_2: FloatArray
    transition: float
    contact_time: float


@dataclass(frozen=True)
class ThesisModel(Model):
    """The bounce as the thesis computed it; reproduces print and breaks balances, so it is no rival of the others."""

    has_time = True
    no_history = (
        "has no history: forces and spins of its computation do not obey its own equations; `course` gives the "
        "velocities it computed"
    )
    remark = (
        "model thesis repeats a printed computation with its slips: it breaks the ball's own balances, reproduces "
        "print, and is no rival of the other models"
    )
    unranked = (
        "model thesis repeats a printed computation with its slips and is not ranked; its published parameter sets "
        "are scored by themselves on Wang's tables, and thesis-exact solves its equations"
    )

    closures: ThesisClosures = field(kw_only=True)

    def _rows(self, names: Sequence[str], values: NumberArray) -> tuple[NumberArray, dict[str, int]]:
        index = {name: column for column, name in enumerate(names)}
        rows = np.zeros((values.shape[0], len(thesis.COLUMNS)), dtype=values.dtype)
        for column, name in enumerate(thesis.COLUMNS):
            if name in index:
                rows[:, column] = values[:, index[name]]
        if self.closures.inertia == "tied":
            rows[:, thesis.INERTIA_SPLIT] = [tied_inertia_split(m) for m in rows[:, thesis.MASS_RATIO]]
        columns = ball_columns(self.ball, names, values)
        rows[:, thesis.BALL_MASS], rows[:, thesis.BALL_RADIUS], rows[:, thesis.BALL_INERTIA] = columns
        return rows, index

    def _lines(
        self, names: Sequence[str], values: NumberArray, v_y1: NumberArray, measured: NumberArray | None
    ) -> tuple[NumberArray, NumberArray]:
        """Offset and restitution, each (draws, impacts), in the kind of number given."""
        index = {name: column for column, name in enumerate(names)}

        def line(at_anchor: str, slope: str) -> NumberArray:
            rate = values[:, index[slope], None] if slope in index else 0.0
            return np.asarray(values[:, index[at_anchor], None] + rate * (v_y1 - ANCHOR_SPEED))

        if measured is not None and self.closures.cor == "measured":
            cor = np.ascontiguousarray(np.broadcast_to(measured, (values.shape[0], v_y1.shape[1])))
        else:
            cor = line("cor_10", "cor_slope")
        return line("eps_10", "eps_slope"), cor

    def evaluate(self, names: Sequence[str], values: FloatArray, impacts: Impacts | OwnImpacts) -> Rebound:
        """See `Model.evaluate`."""
        draws, count = values.shape[0], len(impacts)
        rows, _index = self._rows(names, values)
        v_x1, v_y1, omega_1, measured = impacts.states()
        eps, cor = self._lines(names, values, v_y1, measured)
        out = np.empty((4, draws, count))
        regime = np.empty((draws, count), dtype=np.int64)
        status = np.empty((draws, count), dtype=np.int8)
        thesis.thesis_batch(
            rows, eps, DAMPING_CODES[self.closures.damping], cor,
            v_x1, v_y1, omega_1, out, regime, status,
        )  # fmt: skip
        return Rebound(out[0], out[1], out[2], out[3], regime, status)

    def jacobian(
        self,
        names: Sequence[str],
        values: FloatArray,
        impacts: Impacts | OwnImpacts,
        parameters: Sequence[str] | None = None,
    ) -> ReboundJacobian:
        """See `Model.jacobian`."""
        chosen = tuple(names) if parameters is None else tuple(parameters)
        given = impacts if self.needs_cor else replace(impacts, cor=None)
        first = len(INPUTS) + (given.cor is not None)
        slopes = np.empty((first + len(chosen), values.shape[0], len(impacts), len(OUTPUTS)))
        for moved in moved_inputs(names, values, given, chosen):
            rows, _index = self._rows(names, moved.values)
            eps, cor = self._lines(names, moved.values, moved.v_y1, moved.cor)
            thesis_jacobian.thesis_slopes(
                rows, DAMPING_CODES[self.closures.damping], eps, cor,
                moved.v_x1, moved.v_y1, moved.omega_1, slopes[moved.place],
            )  # fmt: skip
        slopes = np.moveaxis(slopes, 0, -1)
        return ReboundJacobian(
            rebound=self.evaluate(names, values, impacts),
            names=chosen,
            inputs=slopes[..., : len(INPUTS)],
            parameters=slopes[..., first:],
            cor=slopes[..., len(INPUTS)] if given.cor is not None else None,
        )

    def kernel_call(self, names: Sequence[str], values: FloatArray) -> KernelCall:
        """See `Model.kernel_call`."""
        given = np.asarray(values, dtype=np.float64)[None, :]
        rows, index = self._rows(names, given)
        lines = {name: float(given[0, index[name]]) if name in index else 0.0 for name in LINES}
        code = DAMPING_CODES[self.closures.damping]
        return KernelCall("thesis", thesis.thesis_bounce, thesis.COLUMNS, tuple(map(float, rows[0])), (code,), lines)

    def course(self, parameters: Mapping[str, float], impact: Impacts, times: FloatArray) -> ThesisCourse:
        """Velocities of one impact (the first) at `times` [s]; raises what `rebound` raises."""
        self.rebound(parameters, impact)
        names = tuple(parameters)
        call = self.kernel_call(names, np.array([float(parameters[name]) for name in names]))
        row, lines = np.array(call.row), call.lines
        v_x, v_y, omega = (float(column[0]) for column in (impact.v_x1, impact.v_y1, impact.omega_1))
        line = v_y - ANCHOR_SPEED
        row[thesis.EPS] = lines["eps_10"] + lines["eps_slope"] * line
        told = impact.cor if self.needs_cor else None
        cor = lines["cor_10"] + lines["cor_slope"] * line if told is None else float(told[0])
        mass_ratio, k_y = row[thesis.MASS_RATIO], row[thesis.K_Y]
        core_mass, formula = mass_ratio * row[thesis.BALL_MASS], call.codes[0]
        sigma = thesis.thesis_damping(formula, row[thesis.C_Y], core_mass, k_y, mass_ratio, cor)
        motion = thesis.thesis_motion(thesis.contact_of(row, sigma, v_x, v_y, omega))
        z, t_r, t_c = motion.z, motion.t_r, motion.t_c
        slip_end = t_r if np.isfinite(t_r) else t_c
        sliding = np.exp(z * np.minimum(times, slip_end)) - 1.0
        rolling = np.exp(z * np.maximum(times, slip_end)) - np.exp(z * slip_end)
        spin = omega + (motion.slide * sliding).real + (motion.roll * rolling).real
        surface = row[thesis.BALL_RADIUS] * spin
        velocity = np.where(times <= slip_end, v_x - (motion.friction * sliding).real, surface)
        return ThesisCourse(times, velocity, surface, spin, t_r, t_c)


def compose_thesis(name: str, ball: Ball, tangential: bool, closures: ThesisClosures) -> ThesisModel:
    """The model of a composition with its parameters; it knows no motion that is vertical only."""
    parameters = specs(*thesis_parameters(closures))
    return ThesisModel(name, ball, asdict(closures), parameters, closures=closures, tangential=tangential)
