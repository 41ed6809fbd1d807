"""The camera of a session: scale, clock, tilt, court height and row delay that its impacts share.

With scale s and clock c (true over measured), tilt tau, court height h, row delay d, R = [[cos tau,
-sin tau], [sin tau, cos tau]], v_1 = (v_x1, v_y1) with v_y1 downwards, v_2 = (v_x2, v_y2) upwards;
' is measured, T, P, Q are time, path and turn between the flights:
    v_1 = (s/c) R u_1,  omega_1 = omega_1'/(c k_1),  u_1 = (v_x1', v_y1')/k_1 - (0, g h k_1/v_y1'),
    u_2 = (c/s) R v_2,  omega_2' = c omega_2/k_2,  v_2' = (u_x2, w)/k_2,  w = u_y2 + g h/u_y2,
    k_1 = 1 + d v_y1',  k_2 = 1 + d w,
    T' = T/c - h/v_y1' - r/v_y2' + d (r - h),  P' = (P/s) cos(tau) - h v_x1'/v_y1' - r v_x2'/v_y2',
    Q' = Q - h omega_1'/v_y1' - r omega_2'/v_y2',  r = h + (P/s) sin(tau).
A court that is higher is reached earlier, left later, and either at a lower speed; a tilted one has
the height h at landing and r at release. A row that lies lower is read later, by d a metre more
than was taken: a ball that falls gains time, one that rises loses it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Annotated, NamedTuple

import numpy as np

from fitball.base.display_units import DEG, MM, MS_PER_M
from fitball.base.errors import Note
from fitball.base.itf import GRAVITY
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
    ParameterSpec(
        name="row_delay",
        unit="s/m",
        lower=-0.03,
        upper=0.03,
        prior="normal(0, 0.0005)",
        meaning="time by which a lower row is read later than taken, for a metre of height",
        symbol=r"$d$",
        display_unit=MS_PER_M,
    ),
)
CAMERA_SPECS: Mapping[str, ParameterSpec] = {spec.name: spec for spec in _SPECS}
# The values of a camera without errors, which parameters that are not fitted have.
WITHOUT_ERROR = {"scale": 1.0, "clock": 1.0, "tilt": 0.0, "court_height": 0.0, "row_delay": 0.0}


class _Settings(NamedTuple):
    """Scale, clock, tilt [rad], court height [m] and row delay [s/m]; they broadcast to (draws,
    impacts).
    """

    scale: FloatArray
    clock: FloatArray
    tilt: FloatArray
    court_height: FloatArray
    row_delay: FloatArray


class CameraModel(NamedTuple):
    """A camera whose `keys` (of `CAMERA_SPECS`) are parameters, each with a value for each of the
    `sessions`; `session` is the index of each impact's session. States that do not reach the court
    have status NO_IMPACT.
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

    def _settings(self, values: Values) -> _Settings:
        """The settings of the camera."""
        settings = {key: np.full((1, 1), value) for key, value in WITHOUT_ERROR.items()}
        for key in self.keys:
            by_session = [values[self.name(key, session)] for session in self.sessions]
            setting = np.stack(by_session, axis=1)
            if len(self.sessions) > 1:
                setting = setting[:, self.session]
            settings[key] = setting
        return _Settings(**settings)

    def true_states(self, values: Values, measured: Impacts) -> Impacts:
        """True incident states (draws, impacts) of measured ones."""
        camera = self._settings(values)
        longer = 1.0 + camera.row_delay * measured.v_y1
        lands = measured.v_y1 > 0.0
        # By how much a ball is faster a metre lower [1/s]; what does not land has no such place.
        faster = np.where(lands, GRAVITY / np.where(lands, measured.v_y1, 1.0), 0.0)
        true_over_measured = camera.scale / camera.clock
        along = true_over_measured * (measured.v_x1 / longer)
        down = measured.v_y1 / longer - camera.court_height * faster * longer
        down = true_over_measured * down
        omega_1 = measured.omega_1 / (camera.clock * longer)
        cosine = np.cos(camera.tilt)
        sine = np.sin(camera.tilt)
        v_x1 = along * cosine - down * sine
        v_y1 = along * sine + down * cosine
        return Impacts(*np.broadcast_arrays(v_x1, v_y1, omega_1))

    def measured_rebounds(self, values: Values, measured: Impacts, rebound: Rebound) -> Rebound:
        """Rebounds (draws, impacts) as the camera shows them, of true ones; `measured` are the
        incident states as the camera shows them.
        """
        camera = self._settings(values)
        measured_over_true = camera.clock / camera.scale
        cosine = np.cos(camera.tilt)
        sine = np.sin(camera.tilt)
        path = rebound.gap_path / camera.scale
        release_height = camera.court_height + path * sine
        along = measured_over_true * (rebound.v_x2 * cosine - rebound.v_y2 * sine)
        up = measured_over_true * (rebound.v_x2 * sine + rebound.v_y2 * cosine)
        # A state that moves away from the court has no landing: its gaps mean nothing.
        with np.errstate(divide="ignore", invalid="ignore"):
            # At the height that was assumed the ball is faster than at the court above it.
            up = up + GRAVITY * camera.court_height / up
            shortened = 1.0 + camera.row_delay * up
            v_x2 = along / shortened
            v_y2 = up / shortened
            omega_2 = camera.clock * rebound.omega_2 / shortened
            # Times [s] by which a higher court is reached earlier, and left later.
            early = camera.court_height / measured.v_y1
            late = release_height / v_y2
            gap_time = rebound.gap_time / camera.clock - early - late
            gap_time = gap_time + camera.row_delay * path * sine
            gap_path = path * cosine - early * measured.v_x1 - late * v_x2
            gap_turn = rebound.gap_turn - early * measured.omega_1 - late * omega_2
        is_seen = measured.v_y1 > 0.0
        is_seen = is_seen & (1.0 + camera.row_delay * measured.v_y1 > 0.0) & (shortened > 0.0)
        status = np.where(
            is_seen | (rebound.status != Status.OK),
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
    if not has_gaps and table.has_tangential:
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
