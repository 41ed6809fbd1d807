"""What the impacts of a session share because one camera saw them: its scale, its clock, its tilt, and the height of
the court that was assumed. They act on all columns of all rows, and so they are parameters of the fit.

A measured state becomes the true one by `true`, the model's rebound what the camera would have shown by `seen`. With
scale `s` and clock `c` true lengths and times over measured ones, `tau` the angle by which the court rises along the
flight in the picture, and `h` how much higher it is than was assumed:

    v = (s/c) rot(tau) v',     omega = omega'/c,
    T/c = T' + h/v_y1 + r/v_y2,   (P/s) cos(tau) = P' + h v_x1/v_y1 + r v_x2/v_y2,
    Q = Q' + h omega_1/v_y1 + r omega_2/v_y2,   r = h + (P/s) sin(tau)

where `'` is measured, and the heights and the speeds beside them are measured ones. A court that is higher is reached
earlier and left later; a tilted one has the height `h` at landing and `r` at release.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from fitball.data.scene import Scene
from fitball.data.table import ImpactTable
from fitball.errors import FitError
from fitball.inference.problem.observables import Observable
from fitball.inference.problem.pooling import levels_of
from fitball.models.kernels.dual import STEP, NumberArray
from fitball.models.model import Model, by_output
from fitball.models.specs import EVERYTHING, POSITIVE, ParameterSpec
from fitball.models.types import OUTPUTS, Rebound, Status
from fitball.values import FloatArray, Impacts, OwnImpacts
from fitball.wording import in_formula

# By name: `scale`, `clock`, `tilt`, `court_height`.
CAMERA_SPECS: Mapping[str, ParameterSpec] = {
    spec.name: spec
    for spec in (
        ParameterSpec(
            "scale", "", 0.2, 5.0, "normal(1, 0.01)", "scale of the camera, true lengths over measured ones", r"$s$",
            possible=POSITIVE,
        ),
        ParameterSpec(
            "clock", "", 0.2, 5.0, "normal(1, 0.001)", "clock of the camera, true times over measured ones", r"$c$",
            possible=POSITIVE,
        ),
        ParameterSpec(
            "tilt", "rad", -0.3, 0.3, "normal(0, 0.005)",
            "tilt of the court, upwards along the flight in the picture", r"$\tau$", possible=EVERYTHING,
            handy=("deg", 180.0 / np.pi),
        ),
        ParameterSpec(
            "court_height", "m", -0.2, 0.2, "normal(0, 0.003)", "height of the court, above the one assumed", r"$h$",
            possible=EVERYTHING, handy=("mm", 1e3),
        ),
    )
}  # fmt: skip
SCALE, CLOCK, TILT, HEIGHT = CAMERA_SPECS
# What nobody states.
LEVEL: Mapping[str, float] = {SCALE: 1.0, CLOCK: 1.0, TILT: 0.0, HEIGHT: 0.0}

# The label column that tells sessions apart.
SESSION = "session"

# By name, each broadcastable to (draws, impacts).
Settings: TypeAlias = Mapping[str, NumberArray]
Incident: TypeAlias = tuple[NumberArray, NumberArray, NumberArray]


def true(settings: Settings, measured: Incident) -> Incident:
    """The true `(v_x1, v_y1, omega_1)` of measured ones, in any kind of number."""
    v_x, v_y, omega = measured
    speed, cosine, sine = settings[SCALE] / settings[CLOCK], np.cos(settings[TILT]), np.sin(settings[TILT])
    # v_y1 is downwards.
    return speed * (v_x * cosine - v_y * sine), speed * (v_x * sine + v_y * cosine), omega / settings[CLOCK]


def seen(settings: Settings, measured: Incident, rebound: Mapping[str, NumberArray]) -> dict[str, NumberArray]:
    """What the camera shows of true rebounds, by output, where it measured these incident states."""
    slow, cosine, sine = settings[CLOCK] / settings[SCALE], np.cos(settings[TILT]), np.sin(settings[TILT])
    v_x1, v_y1, omega_1 = measured
    v_x2 = slow * (rebound["v_x2"] * cosine - rebound["v_y2"] * sine)
    v_y2 = slow * (rebound["v_x2"] * sine + rebound["v_y2"] * cosine)
    omega_2, path = rebound["omega_2"] * settings[CLOCK], rebound["gap_path"] / settings[SCALE]
    landing = settings[HEIGHT]
    release = landing + path * sine
    # Where there is no rebound there is none to be shown.
    with np.errstate(divide="ignore", invalid="ignore"):
        late, early = 1.0 / v_y2, 1.0 / v_y1
        return {
            **rebound,
            "v_x2": v_x2,
            "v_y2": v_y2,
            "omega_2": omega_2,
            "gap_time": rebound["gap_time"] / settings[CLOCK] - landing * early - release * late,
            "gap_path": path * cosine - landing * v_x1 * early - release * v_x2 * late,
            "gap_turn": rebound["gap_turn"] - landing * omega_1 * early - release * omega_2 * late,
        }


@dataclass(frozen=True)
class Moves:
    """How fast `settings` and `measured` incident states change along some directions, each (draws, impacts,
    directions) or broadcastable to it; what does not change is not in `settings`.
    """

    settings: Mapping[str, FloatArray]
    measured: tuple[FloatArray | float, FloatArray | float, FloatArray | float] = (0.0, 0.0, 0.0)

    def stepped(self, settings: Settings, measured: Incident) -> tuple[Settings, Incident]:
        """Both with a complex step along each direction."""
        moved = {key: value[..., None] + 1j * STEP * self.settings.get(key, 0.0) for key, value in settings.items()}
        v_x, v_y, omega = (
            column[..., None] + 1j * STEP * rate for column, rate in zip(measured, self.measured, strict=True)
        )
        return moved, (v_x, v_y, omega)

    def of_true(self, settings: Settings, measured: Incident) -> FloatArray:
        """Derivatives of the true incident states, (draws, impacts, 3, directions)."""
        return np.stack(np.broadcast_arrays(*true(*self.stepped(settings, measured))), axis=-2).imag / STEP

    def of_seen(
        self, settings: Settings, measured: Incident, rebound: Rebound, slopes: Mapping[str, FloatArray]
    ) -> dict[str, FloatArray]:
        """Derivatives (draws, impacts, directions) of what the camera shows of true rebounds with these `slopes`."""
        outputs = {name: getattr(rebound, name)[..., None] + 1j * STEP * slopes[name] for name in OUTPUTS}
        moved, states = self.stepped(settings, measured)
        return {name: np.asarray(column.imag / STEP) for name, column in seen(moved, states, outputs).items()}


@dataclass(frozen=True)
class View:
    """Which of `CAMERA_SPECS` are parameters of a problem: the `keys`, for each of the `sessions` ("" where the
    table has but one); `index` (impacts,) says which session an impact is of.
    """

    keys: tuple[str, ...]
    sessions: tuple[str, ...]
    index: NDArray[np.int64]

    def name(self, key: str, session: str) -> str:
        """The parameter of a session."""
        return f"{key}[{session}]" if session else key

    @property
    def names(self) -> dict[str, str]:
        """The keys of all parameters, by name."""
        return {self.name(key, session): key for session in self.sessions for key in self.keys}

    def specs(self, scene: Scene) -> tuple[dict[str, ParameterSpec], dict[str, tuple[float, str]]]:
        """What the parameters are, by name, with the priors that the scene states; and those that it states without
        an sd, with their value and why it is fixed.
        """
        made, held = {}, {}
        for session in self.sessions:
            for key in self.keys:
                spec, name = CAMERA_SPECS[key], self.name(key, session)
                words = spec.meaning.replace(",", f" in session {session},", 1) if session else spec.meaning
                label = spec.label if not session else rf"{spec.label[:-1]}_{{{in_formula(session)}}}$"
                stated = None if scene.camera is None else getattr(scene.camera, key)
                prior = spec.prior
                if stated is not None and stated.sd is not None:
                    prior = f"normal({stated.value:.10g}, {stated.sd:.10g})"
                made[name] = replace(spec, name=name, prior=prior, meaning=words, label=label)
                if stated is not None and stated.sd is None:
                    held[name] = (stated.value, "stated in the scene")
        return made, held

    def take(self, rows: NDArray[np.int64]) -> View:
        """That of some of the impacts."""
        return replace(self, index=self.index[rows])

    def settings(self, columns: Mapping[str, NumberArray], rows: NDArray[np.int64]) -> Settings:
        """What holds at each of `rows`, (draws, rows), of the parameters of all sessions in `columns` (draws,)."""
        by_session = {
            key: np.stack([columns[self.name(key, session)] for session in self.sessions], axis=-1)
            for key in self.keys
        }
        settings: dict[str, NumberArray] = {key: np.full((1, len(rows)), value) for key, value in LEVEL.items()}
        return settings | {key: values[:, self.index[rows]] for key, values in by_session.items()}

    def moves(self, free: Sequence[str], rates: FloatArray) -> Moves:
        """What changes along each coordinate of the `free` parameters, whose values do at `rates` (draws, free)."""
        settings = {}
        for key in self.keys:
            rate = np.zeros((rates.shape[0], self.index.size, len(free)))
            for place, session in enumerate(self.sessions):
                if (name := self.name(key, session)) in free:
                    k = free.index(name)
                    rate[:, self.index == place, k] = rates[:, [k]]
            settings[key] = rate
        return Moves(settings)

    def paired(
        self, columns: Mapping[str, FloatArray], draws: NDArray[np.int64], rows: NDArray[np.int64]
    ) -> dict[str, FloatArray]:
        """The parameters of the session of each pair of a draw and an impact, (pairs,) by key."""
        by_session = {
            key: np.stack([columns[self.name(key, session)] for session in self.sessions]) for key in self.keys
        }
        return {key: values[self.index[rows], draws] for key, values in by_session.items()}

    def of_pairs(self, columns: Mapping[str, FloatArray]) -> Settings:
        """What holds for pairs of a draw and an impact, (pairs, 1), from `columns` (pairs,) by key."""
        level = {key: np.full((1, 1), value) for key, value in LEVEL.items()}
        return level | {key: columns[key][:, None] for key in self.keys}


def build_view(
    table: ImpactTable, scene: Scene, asked: Collection[str], model: Model, observables: Sequence[Observable]
) -> tuple[View | None, list[str]]:
    """The view of a table whose scene states something of its camera, or of which a prior or a value is `asked`; and
    a sentence for each thing that acts on nothing. Raises FitError for a tilt where the restitution is an input.
    """
    stated = {key for key in CAMERA_SPECS if scene.camera is not None and getattr(scene.camera, key) is not None}
    keys = stated | {key for key in CAMERA_SPECS if any(name.partition("[")[0] == key for name in asked)}
    idle = {
        HEIGHT: "no column shows what is between the flights"
        if not any(item.column.gap for item in observables)
        else "",
        TILT: "no motion along the court was measured" if not table.has_tangential else "",
    }
    notes = [f"{key} of the camera is not used: {why}" for key, why in idle.items() if why and key in keys]
    keys -= {key for key, why in idle.items() if why}
    if TILT in keys and model.needs_cor:
        raise FitError(
            f"{table.source}: cor = measured takes the restitution as it was measured, and a tilt of the camera "
            "changes it: fit the restitution (cor = line or mean), or leave out tilt"
        )
    if not keys:
        return None, notes
    wanted = tuple(key for key in CAMERA_SPECS if key in keys)
    if len(set(table.labels.get(SESSION, ()))) < 2:
        return View(wanted, ("",), np.zeros(len(table), dtype=np.int64)), notes
    return View(wanted, *levels_of(table, SESSION, "[camera]")), notes


def truly(settings: Settings, impacts: Impacts | OwnImpacts) -> tuple[OwnImpacts, NDArray[np.bool_]]:
    """The true impacts (draws, impacts), and which of them reach the court; those that do not stand as measured."""
    v_x, v_y, omega, cor = impacts.states()
    found = np.broadcast_arrays(*true(settings, (v_x, v_y, omega)))
    reaching = found[1] > 0.0
    v_x, v_y, omega = (np.where(reaching, new, old) for new, old in zip(found, (v_x, v_y, omega), strict=True))
    return OwnImpacts(v_x, v_y, omega, None if cor is None else np.broadcast_to(cor, reaching.shape)), reaching


def as_seen(
    settings: Settings, impacts: Impacts | OwnImpacts, reaching: NDArray[np.bool_], rebound: Rebound
) -> Rebound:
    """True rebounds (draws, impacts) as the camera shows them; what does not reach the court has none."""
    outputs = {name: getattr(rebound, name) for name in OUTPUTS}
    made = seen(settings, impacts.states()[:3], outputs)
    status = np.where(reaching, rebound.status, np.int8(Status.NO_IMPACT))
    return replace(
        rebound,
        **{name: np.where(reaching, column, np.nan) for name, column in made.items()},
        status=status,
    )


def incident_slopes(
    settings: Settings, measured: Incident, rebound: Rebound, inputs: FloatArray
) -> dict[str, FloatArray]:
    """Derivatives (draws, impacts, 3) of what the camera shows with respect to measured incident states, from those
    of the model with respect to true ones, (draws, impacts, outputs, 3).
    """
    moves = Moves({}, (np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])))
    slopes = np.matmul(inputs, moves.of_true(settings, measured))
    return moves.of_seen(settings, measured, rebound, by_output(slopes))
