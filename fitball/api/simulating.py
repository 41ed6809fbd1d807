"""A bounce followed through time, the regimes of contact over angle and spin, and the page with sliders: of a fit, or
of a model at round values. Each is a value with its text, its content for machines, its figure and its files.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fitball.api.reading import PathLike
from fitball.data.lines import parse_impact, parse_window
from fitball.data.read import load_table
from fitball.errors import ParameterError, check_whole, suggestion
from fitball.files import all_or_none
from fitball.inference.comparison.candidates import parse_name
from fitball.inference.prediction.new_impacts import predict_new
from fitball.inference.prediction.simulate import (
    RegimeMap,
    Simulation,
    Window,
    chosen_parameters,
    regime_map,
    simulate_fit,
)
from fitball.inference.prediction.simulate import simulate as follow
from fitball.inference.results.fitted_model import FittedModel, at_values
from fitball.inference.results.results import Fit, RunStatus, Verdict
from fitball.kinds import checked
from fitball.models.registry import model
from fitball.models.specs import DEFAULT_MODEL
from fitball.report.form.files import csv_text, json_text, refuse_existing, write_text
from fitball.report.form.folders import clear_folder, held
from fitball.report.history import document
from fitball.report.predict.rows import remarks_on
from fitball.values import Impacts
from fitball.wording import option, spoken

if TYPE_CHECKING:
    import pandas as pd

    from fitball.report.figures.canvas import Figure

MAP_STEM = "regime_map"
# Without a fit: a rally's drive; from grazing to steep, and as much spin as players make [m/s, rad, rad/s].
SPEED, ANGLE, SPIN = 25.0, (math.radians(5.0), math.radians(85.0)), 400.0
CONTOURS = "theta_2"


@dataclass(frozen=True)
class Subject:
    """What bounces: `fitted`, of the fit `saved`, or a model at its defaults, of which `given` were set."""

    fitted: FittedModel
    saved: Fit | None = None
    given: tuple[str, ...] = ()

    @classmethod
    def of(cls, saved: Fit | None, name: str | None, values: Mapping[str, float]) -> Subject:
        """A fit, or the model called so. Raises ModelError, ParameterError."""
        if saved is not None:
            return cls(saved.fitted, saved)
        plain, closures = parse_name(str(name) if name is not None else DEFAULT_MODEL)
        chosen = model(plain, ball=None, tangential=True, **closures)
        return cls(at_values(chosen, chosen_parameters(chosen, values)), given=tuple(values))

    @property
    def name(self) -> str:
        """What files are named for."""
        return f"{'' if self.saved is None else 'fit_'}{self.fitted.model.name}"

    @property
    def title(self) -> str:
        """What it is, for a figure."""
        return self.fitted.model.name + ("" if self.saved is None else f" fitted to {self.saved.source.name}")

    @property
    def parameters(self) -> dict[str, float]:
        """Its values by name."""
        return dict(zip(self.fitted.names, map(float, self.fitted.point), strict=True))

    @property
    def notes(self) -> tuple[str, ...]:
        """What one should know of its values."""
        if self.saved is not None:
            return (self.saved.at_common,) if self.saved.at_common else ()
        rest = ", ".join(f"{name} = {value:g}" for name, value in self.parameters.items() if name not in self.given)
        return (f"defaults near the fits to Wang's balls: {rest}",) if rest else ()


@dataclass(frozen=True, repr=False)
class Course:
    """One impact followed through time, or several in one picture, from `source`; `notes` say what one should know,
    `panels` which courses the figure shows (empty: as the model has them), `heading` and `more` what text and files
    of an example hold besides.
    """

    simulations: tuple[Simulation, ...]
    source: str
    title: str
    notes: tuple[str, ...] = ()
    panels: tuple[str, ...] = ()
    heading: str = ""
    more: Mapping[str, object] = field(default_factory=dict)

    def __repr__(self) -> str:
        return f"<Course of {self.title}>"

    @property
    def name(self) -> str:
        """What its folder is called."""
        if self.more:
            return self.source
        given = self.simulations[0].impact
        return "_".join([self.source, *(f"{column[0]:.4g}" for column in (given.v_x1, given.v_y1, given.omega_1))])

    def report(self) -> str:
        """Phases with their times, peaks, and the state before and after, as text."""
        return "\n\n".join(filter(None, (self.heading, document.render(self.simulations))))

    def to_frame(self) -> pd.DataFrame:
        """The course: one row a point of time, columns with their units, quantiles where there is a posterior."""
        import pandas as pd

        return pd.DataFrame(document.history_rows(self.simulations))

    def summary(self) -> Mapping[str, object]:
        """What went in, phases, peaks, jumps and rebound, in SI; of several simulations the first."""
        return document.simulation_json(self.simulations[0])

    def json(self) -> dict[str, object]:
        """All of it but the courses, as `simulate.json` has it."""
        more = self.more or {"notes": list(self.notes)}
        return {**more, "simulations": [document.simulation_json(item) for item in self.simulations]}

    def plot(self) -> Figure:
        """The courses along the contact, as a matplotlib Figure that pyplot does not know."""
        from fitball.report.history.figure import history_figure

        return history_figure(self.simulations, self.title, self.panels)

    @checked
    def save(
        self,
        folder: PathLike,
        *,
        overwrite: bool = False,
        form: str = "png",
        csv: PathLike | None = None,
        film: PathLike | None = None,
    ) -> tuple[Path, ...]:
        """Write `simulate.json`, `history.csv` and the figure; the courses to the file `csv` too, and a `film` of the
        bounce. Returns their places; raises ResultFolderError.
        """
        if film is not None and len(self.simulations) > 1:
            shown = f"{spoken('--animate', 'a film')} shows one bounce"
            raise ParameterError(f"{shown}; example {self.source} has {len(self.simulations)}")
        named = tuple(Path(place) for place in (csv, film) if place is not None)
        for place in named:
            refuse_existing(place, overwrite)
        path = Path(folder)
        with held(path):
            others = (document.CSV_NAME, f"{document.FIGURE_STEM}.*")
            clear_folder(path, document.JSON_NAME, *others, overwrite=overwrite)
            table = csv_text(document.history_rows(self.simulations))
            places = document.write_all(path, self.json(), table, self.plot(), form)
            if csv is not None:
                write_text(Path(csv), table, named=True)
            if film is not None:
                from fitball.report.history.film import write_film

                write_film(self.simulations[0], self.title, Path(film))
        return (*places, *named)


def impact_of(impact: Any) -> Impacts:
    """One impact, from text or as it is. Raises ParameterError for several."""
    if isinstance(impact, str):
        return parse_impact(impact)
    if not isinstance(impact, Impacts) or len(impact) != 1:
        raise ParameterError(
            f"simulate follows one impact: read {impact!r}, expected a text such as 'v=17, theta=18, spin=100' or "
            "fitball.impacts(v_x1, v_y1, omega_1)"
        )
    return impact


def course_of(subject: Subject, impact: Impacts | str, draws: int) -> Course:
    """Point estimate and bands of a fit, or a model at its values. Raises ModelError, ParameterError, and what
    `Model.history` raises.
    """
    given, fitted, saved = impact_of(impact), subject.fitted, subject.saved
    if saved is None:
        simulation, notes = follow(fitted.model, subject.parameters, given), subject.notes
    else:
        check_whole(draws=draws)
        if draws < 1:
            raise ParameterError(f"draws = {draws}: expected at least 1")
        simulation = simulate_fit(fitted, given, draws)
        notes = (*remarks_on(predict_new(fitted, given), 0), *subject.notes, *_cautions(saved))
    v_x, v_y, omega = (float(getattr(given, name)[0]) for name in ("v_x1", "v_y1", "omega_1"))
    title = f"{simulation.model.name}: {v_x:.2f} m/s along, {v_y:.2f} m/s towards the court, {omega:.0f} rad/s"
    return Course((simulation,), subject.name, title, notes)


def _cautions(saved: Fit) -> Sequence[str]:
    """What the fit itself leaves open."""
    notes = []
    if saved.status is RunStatus.POINT_ONLY:
        notes.append("a point fit has no posterior: courses at the point estimate, without bands")
    if saved.status is RunStatus.NOT_CONVERGED:
        notes.append("the sampler of this fit did not converge: bands may change")
    stiffness = saved.parameters.get("k_y")
    rests = {Verdict.FIXED: "the value it was held at", Verdict.PRIOR_DOMINATED: "its prior"}
    if stiffness is not None and stiffness.verdict in rests:
        notes.append(f"times, compression and forces rest on k_y, and in this fit k_y on {rests[stiffness.verdict]}")
    return notes


@dataclass(frozen=True)
class Regimes:
    """Which sequence of slip and grip an impact of the subject goes through, with contours of one output."""

    found: RegimeMap
    subject: Subject
    contours: str

    @property
    def notes(self) -> tuple[str, ...]:
        """What one should know."""
        return self.subject.notes

    @property
    def name(self) -> str:
        """What its folder is called."""
        return f"map_{self.subject.name}_{self.found.window.speed:.4g}"

    def report(self) -> str:
        """The map in words."""
        from fitball.report.history.regime_map import map_text

        return map_text(self.found, self.subject.title)

    def json(self) -> dict[str, object]:
        """All of it but the grid, as `regime_map.json` has it."""
        from fitball.report.history.regime_map import map_json

        chosen = self.subject.fitted.model
        return {"model": chosen.name, "closures": dict(chosen.options), **map_json(self.found)}

    def save(self, folder: Path, *, overwrite: bool = False, form: str = "png") -> tuple[Path, ...]:
        """Write `regime_map.json`, `regime_map.csv` and the figure; their places. Raises ResultFolderError."""
        from fitball.report.figures.canvas import save_figure
        from fitball.report.history.regime_map import map_figure, map_rows

        saved = self.subject.saved
        impacts, source = (None, "") if saved is None else (saved.impacts, saved.source.name)
        figure = map_figure(self.found, self.subject.title, self.contours, impacts, source)
        picture, table, record = (folder / f"{MAP_STEM}.{ending}" for ending in (form, "csv", "json"))
        with held(folder), all_or_none():
            clear_folder(folder, record.name, table.name, f"{MAP_STEM}.*", overwrite=overwrite)
            save_figure(figure, picture, form)
            write_text(table, csv_text(map_rows(self.found)))
            write_text(record, json_text(self.json()))
        return picture, table, record


def regimes_of(subject: Subject, asked: str, contours: str | None) -> Regimes:
    """The map of a text such as `v=30, theta=10..80, spin=-300..300`; what it does not say is as the fitted impacts
    were. Raises ModelError, ParameterError.
    """
    from fitball.report.history.regime_map import contour_names

    chosen = CONTOURS if contours is None else contours
    if chosen not in contour_names():
        raise ParameterError(f"unknown quantity '{chosen}': {suggestion(chosen, contour_names())}")
    window, (speed, angle, spin) = parse_window(asked), (SPEED, ANGLE, SPIN)
    if chosen == "contact_time" and not subject.fitted.model.has_time:
        raise ParameterError(f"{option('contours', chosen)}: model {subject.fitted.model.name} has none")
    if subject.saved is not None:
        impacts = subject.saved.impacts
        speed, angles = float(np.median(impacts.speed)), impacts.angle
        angle = (min(angle[0], float(0.9 * angles.min())), max(angle[1], min(float(1.1 * angles.max()), math.pi)))
        spin = max(spin, 1.1 * float(np.max(np.abs(impacts.omega_1))))
    ends = window.get("v_1", (speed, speed))[0], window.get("theta_1", angle), window.get("omega_1", (-spin, spin))
    return Regimes(regime_map(subject.fitted, Window(*ends)), subject, chosen)


def page_of(subject: Subject, impact: Impacts | None) -> str:
    """The page with sliders as HTML, begun at an impact (by default in the middle of what was calibrated). Raises
    ModelError.
    """
    from fitball.exports.interactive import interactive_page, round_impact
    from fitball.exports.port.port import origin_of

    if subject.saved is not None:
        fitted, table = subject.fitted, subject.saved.source
        intro, origin = f"As fitted to {table.name}, {table.impacts} impacts.", origin_of(subject.saved)
    else:
        # As if fitted to these, by which the valid range is found.
        fitted, origin = replace(subject.fitted, impacts=load_table("wang_all").impacts), "no fit, round parameters"
        given = ", some of them given" if subject.given else ""
        intro = f"No fit: round parameters near the fits to the balls of Wang (1989){given}."
    return interactive_page(fitted, round_impact(fitted) if impact is None else impact, intro, origin)
