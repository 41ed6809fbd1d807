"""What is known about the scene of a table: ball, surface, noise, model; and what is assumed."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from fitball.data.bundled import resolve_table
from fitball.data.heights import BALL_TYPES, like_tennis
from fitball.data.scene_keys import (
    Quantity,
    density_fault,
    meant_inertia,
    range_fault,
    read_scene_file,
    unlikely,
    unlikely_density,
)
from fitball.data.table import FrozenMapping
from fitball.errors import ParameterError, SceneError, fault_list, suggestion
from fitball.kinds import checked
from fitball.observables import NOISE_OF, SHARED_SD
from fitball.values import WANG_INERTIA_RATIO, WANG_MASS, WANG_RADIUS, Ball
from fitball.wording import option

NOMINAL_VELOCITY_SD = 0.25
NOMINAL_SPIN_SD = 10.0
DEFAULT_MODEL = "two-mass"

# What is taken, and said, when a scene is silent.
_NO_FILE = "there is no scene file: nothing is known but the table"
_BALL_WORDS = {
    "mass": f"a ball of mass {1e3 * WANG_MASS:g} g (the ITF allows 56.0 to 59.4 g)",
    "radius": f"a ball of radius {1e3 * WANG_RADIUS:g} mm (the ITF allows 32.7 to 34.3 mm)",
    "inertia_ratio": f"a ball with I/(M R^2) = {WANG_INERTIA_RATIO:g}, that of a tennis ball's thick shell",
}
NO_MU = "nothing is known of the friction coefficient: its prior is wide"
NO_CONTACT_TIME = "the contact time is not known: the stiffness k_y rests on its prior"
NO_VELOCITY_SD = (
    f"the noise of the velocities is not known: it is fitted, and expected around {NOMINAL_VELOCITY_SD:g} m/s"
)
NO_SPIN_SD = f"the noise of the spins is not known: it is fitted, and expected around {NOMINAL_SPIN_SD:g} rad/s"


@dataclass(frozen=True)
class Scene:
    """What is known about a table besides its numbers; SI units, one standard deviation where an sd is named.

    `source` is the scene file (None: there is none). `ball_sd` has some of the keys mass, radius and
    inertia_ratio. `mu` is (value, sd or None), `contact_time` (value, sd), None when unknown.
    `velocity_sd` (of each component) and those in `observables.NOISE_OF` are known measurement noise, not to be
    fitted; the nominal ones are orders of magnitude. `velocity_noise` says whether the columns of the velocity share
    one noise ("tied") or have one each ("separate"), None: as the table can tell. `priors` are texts such as
    `normal(0.55, 0.05)` by parameter. `distribution` is that of the noise; `pool` maps parameters to the label column
    over whose levels they differ, `columns` names of columns in the table that are not ours, by our name;
    `offsets` is the label column whose groups may be biased. `force_file` holds force records, named relative to the
    scene file; `ball_type` is a type of the ITF (see `ball_types`), `ball_temperature` and its sd are in degrees
    Celsius. `force_sd` [N] is the known noise of a sample, `force_start_sd` [s] how well t = 0 is known to be the
    start of contact (None: it is found from the record). `assumed` says in sentences what was taken because
    nothing was said.
    """

    source: str | None = None
    ball: Ball = field(default_factory=Ball)
    ball_sd: Mapping[str, float] = field(default_factory=FrozenMapping)
    ball_type: str | None = None
    ball_temperature: float | None = None
    ball_temperature_sd: float | None = None
    surface: str | None = None
    mu: tuple[float, float | None] | None = None
    contact_time: tuple[float, float] | None = None
    velocity_sd: float | None = None
    v_x_sd: float | None = None
    v_y_sd: float | None = None
    speed_sd: float | None = None
    angle_sd: float | None = None
    spin_sd: float | None = None
    contact_time_sd: float | None = None
    nominal_velocity_sd: float = NOMINAL_VELOCITY_SD
    nominal_spin_sd: float = NOMINAL_SPIN_SD
    velocity_noise: str | None = None
    model: str = DEFAULT_MODEL
    closures: Mapping[str, str] = field(default_factory=FrozenMapping)
    priors: Mapping[str, str] = field(default_factory=FrozenMapping)
    fix: Mapping[str, float] = field(default_factory=FrozenMapping)
    distribution: str = "normal"
    pool: Mapping[str, str] = field(default_factory=FrozenMapping)
    columns: Mapping[str, str] = field(default_factory=FrozenMapping)
    offsets: str | None = None
    force_file: str | None = None
    force_sd: float | None = None
    force_start_sd: float | None = None
    assumed: tuple[str, ...] = ()
    description: str = ""
    citation: str = ""

    @property
    def tennis(self) -> bool:
        """Whether its ball is a tennis ball, by what is stated or by mass and size: the ITF's tests are of these."""
        return self.ball_type is not None or like_tennis(self.ball)

    @property
    def states_ball(self) -> bool:
        """Whether the radius of the ball was stated and not assumed."""
        return self.source is not None and not any(_BALL_WORDS["radius"] in sentence for sentence in self.assumed)


@checked
def load_scene(
    table_source: str | os.PathLike[str] | None, config: str | os.PathLike[str] | None = None, as_read: bool = False
) -> Scene:
    """The scene of a table: from `config`, else from the TOML file beside the table, else assumed throughout, as it
    is for a table without a file (None).

    Raises SceneError with every fault of the file and, unless `as_read`, as `likely_scene` does; TableError when the
    table does not exist.

    >>> fitball.load_scene("wang_zero_spin").surface
    'acrylic'
    """
    if config is not None:
        return likely_scene(_read_scene(Path(config)), as_read)
    if table_source is None:
        return _make_scene(None, {})
    beside = resolve_table(table_source).with_suffix(".toml")
    # A folder or a link to nowhere of that name is no scene, and reading it says so.
    return likely_scene(_read_scene(beside) if os.path.lexists(beside) else _make_scene(None, {}), as_read)


def likely_scene(scene: Scene, as_read: bool = False) -> Scene:
    """The scene, where its ball, court and instruments are like others. Raises SceneError otherwise; with `as_read`
    what is unlikely is told among what is assumed.
    """
    doubts = _doubts(scene)
    if not doubts:
        return scene
    if as_read:
        taken = tuple(f"taken as stated, on request (as_read): {doubt}" for doubt in doubts)
        return replace(scene, assumed=(*scene.assumed, *taken))
    message = fault_list(scene.source or "scene", len(doubts), doubts)
    raise SceneError(f"{message}\n  if the scene is right as it stands, pass {option('as_read')}")


def _doubts(scene: Scene) -> list[str]:
    ball = scene.ball
    time, time_sd = scene.contact_time or (None, None)
    stated = {
        "ball.mass": ball.mass, "ball.radius": ball.radius, "ball.inertia_ratio": ball.inertia_ratio,
        "surface.mu": scene.mu[0] if scene.mu else None, "contact_time.value": time, "contact_time.sd": time_sd,
        "force.sd": scene.force_sd, "force.start_sd": scene.force_start_sd,
    }  # fmt: skip
    noises = (SHARED_SD, *NOISE_OF.values(), "nominal_velocity_sd", "nominal_spin_sd")
    stated |= {f"measurement.{name}": getattr(scene, name) for name in noises}
    doubts = [unlikely(key, value) for key, value in stated.items() if value is not None]
    return [doubt for doubt in (*doubts, unlikely_density(ball)) if doubt is not None]


def _read_scene(path: Path) -> Scene:
    return _make_scene(str(path), read_scene_file(path))


def _make_scene(source: str | None, known: Mapping[str, Any]) -> Scene:
    ball, ball_sd = _ball(source, known)
    mu, time, warmth = (known.get(key) for key in ("surface.mu", "contact_time.value", "ball.temperature"))
    sds: dict[str, Any] = {name: known.get(f"measurement.{name}") for name in (SHARED_SD, *NOISE_OF.values())}
    nominal_velocity, nominal_spin = (known.get(f"measurement.nominal_{name}_sd") for name in ("velocity", "spin"))
    free: dict[str, Any] = {name: FrozenMapping(known.get(name)) for name in ("priors", "fix", "pool", "columns")}
    told = known.keys() | ({"ball.inertia_ratio"} if "ball.inertia" in known else set())
    kind = known.get("ball.type")
    if kind is not None and kind not in BALL_TYPES:
        raise SceneError(f'{source}: ball.type = "{kind}": {suggestion(kind, BALL_TYPES)}')
    silences = {
        _NO_FILE: source is None,
        **{f"assumed {words}": f"ball.{name}" not in told for name, words in _BALL_WORDS.items()},
        NO_MU: mu is None,
        NO_CONTACT_TIME: time is None,
        NO_VELOCITY_SD: sds[SHARED_SD] is None and nominal_velocity is None,
        NO_SPIN_SD: sds["spin_sd"] is None and nominal_spin is None,
    }
    return Scene(
        source=source,
        ball=ball,
        ball_sd=FrozenMapping(ball_sd),
        ball_type=kind,
        ball_temperature=None if warmth is None else warmth.value,
        ball_temperature_sd=None if warmth is None else warmth.sd,
        surface=known.get("surface.name"),
        mu=None if mu is None else (mu.value, mu.sd),
        contact_time=None if time is None else (time, known["contact_time.sd"]),
        nominal_velocity_sd=nominal_velocity or NOMINAL_VELOCITY_SD,
        nominal_spin_sd=nominal_spin or NOMINAL_SPIN_SD,
        model=known.get("model.name", DEFAULT_MODEL),
        closures=FrozenMapping(known.get("model.closures")),
        velocity_noise=known.get("measurement.velocity_noise"),
        distribution=known.get("measurement.distribution", "normal"),
        offsets=known.get("measurement.offsets"),
        force_file=known.get("force.file"),
        force_sd=known.get("force.sd"),
        force_start_sd=known.get("force.start_sd"),
        assumed=tuple(sentence for sentence, silent in silences.items() if silent),
        description=known.get("source.description", ""),
        citation=known.get("source.citation", ""),
        **sds,
        **free,
    )


def _ball(source: str | None, known: Mapping[str, Any]) -> tuple[Ball, dict[str, float]]:
    """The ball and the stated sds; an sd of the inertia becomes one of the ratio, M and R being as stated."""
    mass = known.get("ball.mass", Quantity(WANG_MASS))
    radius = known.get("ball.radius", Quantity(WANG_RADIUS))
    unit = mass.value * radius.value**2
    inertia = known.get("ball.inertia")
    ratio = known.get("ball.inertia_ratio", Quantity(WANG_INERTIA_RATIO))
    if inertia is not None:
        ratio = Quantity(inertia.value / unit, None if inertia.sd is None else inertia.sd / unit)
    moment = ratio.value * unit if inertia is None else inertia.value
    try:
        ball = Ball(mass.value, radius.value, moment)
    except ParameterError as error:
        raise SceneError(f"{source}: [ball]: {error}{meant_inertia(moment / unit, moment)}") from None
    dense = density_fault(ball)
    if dense is not None:
        raise SceneError(f"{source}: [ball]: {dense}")
    fault = range_fault("ball.inertia_ratio", ball.inertia_ratio, ratio.sd)
    if fault is not None:
        meant = meant_inertia(ball.inertia_ratio, moment)
        raise SceneError(f"{source}: [ball]: inertia {moment:g} kg m^2 makes {fault}{meant}")
    stated = {"mass": mass.sd, "radius": radius.sd, "inertia_ratio": ratio.sd}
    return ball, {name: sd for name, sd in stated.items() if sd is not None}
