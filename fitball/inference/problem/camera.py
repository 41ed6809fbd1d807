"""The camera of a session: scale, clock, tilt and court height that its impacts share.

With scale s and clock c (true over measured), tilt tau, court height h, R = [[cos tau, -sin tau],
[sin tau, cos tau]], v_1 = (v_x1, v_y1) with v_y1 downwards, v_2 = (v_x2, v_y2) upwards; ' is
measured, T, P, Q are time, path and turn between the flights:
    v_1 = (s/c) R v_1',  omega_1 = omega_1'/c,  v_2' = (c/s) R v_2,  omega_2' = c omega_2,
    T' = T/c - h/v_y1' - r/v_y2',  P' = (P/s) cos(tau) - h v_x1'/v_y1' - r v_x2'/v_y2',
    Q' = Q - h omega_1'/v_y1' - r omega_2'/v_y2',  r = h + (P/s) sin(tau).
A court that is higher is reached earlier and left later; a tilted one has the height h at landing
and r at release.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Annotated, NamedTuple

import numpy as np

from fitball.base.display_units import DEG, MM
from fitball.base.errors import Note
from fitball.base.priors import ParameterSpec
from fitball.base.values import FloatArray, Impacts, IntArray
from fitball.data.labels import role_of
from fitball.data.scene import CameraSection
from fitball.data.table import ImpactTable
from fitball.inference.forward import Values, spec_at_label
from fitball.models.types import Rebound, Status

_SPECS = (
    ParameterSpec(
        name="scale",
        unit="",
        lower=0.2,
        upper=5.0,
        prior="normal(1, 0.01)",
        meaning="scale of the camera, true lengths over measured ones",
        symbol=r"$s$",
    ),
    ParameterSpec(
        name="clock",
        unit="",
        lower=0.2,
        upper=5.0,
        prior="normal(1, 0.001)",
        meaning="clock of the camera, true times over measured ones",
        symbol=r"$c$",
    ),
    ParameterSpec(
        name="tilt",
        unit="rad",
        lower=-0.3,
        upper=0.3,
        prior="normal(0, 0.005)",
        meaning="tilt of the court, upwards along the flight in the picture",
        symbol=r"$\tau$",
        display_unit=DEG,
    ),
    ParameterSpec(
        name="court_height",
        unit="m",
        lower=-0.2,
        upper=0.2,
        prior="normal(0, 0.003)",
        meaning="height of the court, above the one assumed",
        symbol=r"$h$",
        display_unit=MM,
    ),
)
CAMERA_SPECS: Mapping[str, ParameterSpec] = {spec.name: spec for spec in _SPECS}
# The values of a camera without errors, which parameters that are not fitted have.
WITHOUT_ERROR = {"scale": 1.0, "clock": 1.0, "tilt": 0.0, "court_height": 0.0}


class CameraModel(NamedTuple):
    """A camera whose `keys` (of scale, clock, tilt, court_height) are parameters, each with a value
    for each of the `sessions`; `session` is the index of each impact's session. States that do not
    reach the court have status NO_IMPACT.
    """

    keys: tuple[str, ...]
    sessions: tuple[str, ...]
    session: Annotated[IntArray, "impacts"]

    def name(self, key: str, session: str) -> str:
        """The name of a session's parameter: `tilt[monday]`, or `tilt` where the only session has
        the name "".
        """
        return f"{key}[{session}]" if session else key

    def take(self, rows: Annotated[IntArray, "rows"]) -> CameraModel:
        """The camera of the impacts with these row numbers."""
        return self._replace(session=self.session[rows])

    def _settings(self, values: Values) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Scale, clock, tilt [rad] and court height [m], which broadcast to (draws, impacts)."""
        settings = {key: np.full((1, 1), value) for key, value in WITHOUT_ERROR.items()}
        for key in self.keys:
            by_session = [values[self.name(key, session)] for session in self.sessions]
            setting = np.stack(by_session, axis=1)
            if len(self.sessions) > 1:
                setting = setting[:, self.session]
            settings[key] = setting
        return settings["scale"], settings["clock"], settings["tilt"], settings["court_height"]

    def true_states(self, values: Values, measured: Impacts) -> Impacts:
        """True incident states (draws, impacts) of measured ones."""
        scale, clock, tilt, _ = self._settings(values)
        true_over_measured = scale / clock
        cosine = np.cos(tilt)
        sine = np.sin(tilt)
        along = true_over_measured * (measured.v_x1 * cosine - measured.v_y1 * sine)
        down = true_over_measured * (measured.v_x1 * sine + measured.v_y1 * cosine)
        return Impacts(*np.broadcast_arrays(along, down, measured.omega_1 / clock))

    def measured_rebounds(self, values: Values, measured: Impacts, rebound: Rebound) -> Rebound:
        """Rebounds (draws, impacts) as the camera shows them, of true ones; `measured` are the
        incident states as the camera shows them.
        """
        scale, clock, tilt, landing_height = self._settings(values)
        measured_over_true = clock / scale
        cosine = np.cos(tilt)
        sine = np.sin(tilt)
        path = rebound.gap_path / scale
        v_x2 = measured_over_true * (rebound.v_x2 * cosine - rebound.v_y2 * sine)
        v_y2 = measured_over_true * (rebound.v_x2 * sine + rebound.v_y2 * cosine)
        omega_2 = clock * rebound.omega_2
        release_height = landing_height + path * sine
        # A state that moves away from the court has no landing: its gaps mean nothing.
        with np.errstate(divide="ignore", invalid="ignore"):
            # Times [s] by which a higher court is reached earlier, and left later.
            early = landing_height / measured.v_y1
            late = release_height / v_y2
            gap_time = rebound.gap_time / clock - early - late
            gap_path = path * cosine - early * measured.v_x1 - late * v_x2
            gap_turn = rebound.gap_turn - early * measured.omega_1 - late * omega_2
        status = np.where(
            (measured.v_y1 > 0.0) | (rebound.status != Status.OK),
            rebound.status,
            Status.NO_IMPACT,
        )
        return Rebound(
            v_x2,
            v_y2,
            omega_2,
            rebound.contact_time,
            gap_time,
            gap_path,
            gap_turn,
            rebound.regime,
            status,
        )


def camera_of(
    table: ImpactTable,
    stated: CameraSection | None,
    named: Iterable[str],
    has_gaps: bool,
    notes: list[Note],
) -> tuple[CameraModel | None, dict[str, ParameterSpec]]:
    """The camera of a table and the specs of its parameters by name; None and no specs without one.
    A quantity of the camera is a parameter where the scene `stated` it, or its name is among those
    `named` in priors and fixed values. `has_gaps` says whether a measured column lies between the
    flights; `notes` gets a note on each quantity that has no effect.
    """
    keys_named = {name.partition("[")[0] for name in named}
    keys = [
        key for key in CAMERA_SPECS if key in keys_named or getattr(stated, key, None) is not None
    ]
    # Why a quantity of the camera has no effect, by its name.
    idle = dict[str, str]()
    if not has_gaps:
        idle["court_height"] = "no column shows what is between the flights"
    if not table.has_tangential:
        idle["tilt"] = "no motion along the court was measured"
    notes += [
        Note("camera-idle", f"{key} of the camera is not used: {idle[key]}.")
        for key in keys
        if key in idle
    ]
    columns = [cells for name, cells in table.labels.items() if role_of(name) == "session"]
    labels = columns[0] if columns else ()
    index_of = {label: k for k, label in enumerate(dict.fromkeys(labels))}
    if len(index_of) < 2:
        # A single session has no name.
        index_of = {"": 0}
        labels = ("",) * len(table)
    camera = CameraModel(
        keys=tuple(key for key in keys if key not in idle),
        sessions=tuple(index_of),
        session=np.array([index_of[label] for label in labels], dtype=np.int64),
    )
    specs = {
        camera.name(key, session): spec_at_label(
            CAMERA_SPECS[key],
            camera.name(key, session),
            session,
            "in session",
        )
        for session in camera.sessions
        for key in camera.keys
    }
    return camera if specs else None, specs
