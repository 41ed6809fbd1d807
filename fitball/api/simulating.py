"""One impact through time, a map of contact regimes over angle and spin, and the page with sliders. They are
of a fit, or of a model at default values. Each has text, content for other programs, a figure and files.
"""

from __future__ import annotations

import math
import re
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
from fitball.inference.prediction.impact_levels import new_words
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
from fitball.inference.problem.level_names import at_level
from fitball.inference.results.fitted_model import FittedModel, at_values, checked_labels
from fitball.inference.results.results import Fit, RunStatus, Verdict
from fitball.kinds import checked
from fitball.models.registry import model
from fitball.models.specs import DEFAULT_MODEL
from fitball.observables import OBSERVABLES
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
    """The model to simulate: `fitted`, of the fit `saved` on the surface and with the ball of `levels` (column ->
    label), or at default values except for those `given`.
    """

    fitted: FittedModel
    saved: Fit | None = None
    given: tuple[str, ...] = ()
    levels: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def from_fit(
        cls,
        saved: Fit | None,
        name: str | None,
        values: Mapping[str, float],
        levels: Mapping[str, str] | None = None,
    ) -> Subject:
        """A fit at `levels`, or the model with this name. Raises ModelError; ParameterError, also where parameters of
        the fit differ between surfaces or balls and none of these is named.
        """
        if saved is not None:
            named = checked_labels(saved.fitted, levels or {})
            return cls(saved.fitted.at(named), saved, levels=named)
        if levels:
            column, label = next(iter(levels.items()))
            raise ParameterError(f"{at_level(column, label)}: only a fit has levels: leave it out, or name a fit")
        plain, closures = parse_name(str(name) if name is not None else DEFAULT_MODEL)
        chosen = model(plain, ball=None, tangential=True, **closures)
        return cls(at_values(chosen, chosen_parameters(chosen, values)), given=tuple(values))

    @property
    def name(self) -> str:
        """The name in file names."""
        labels = (re.sub(r"\W+", "-", label) for label in dict.fromkeys(self.levels.values()))
        return "_".join([f"{'' if self.saved is None else 'fit_'}{self.fitted.model.name}", *labels])

    @property
    def title(self) -> str:
        """The title of figures."""
        return self.fitted.model.name + (
            "" if self.saved is None else f" fitted to {self.saved.source.name}{self.at}"
        )

    @property
    def at(self) -> str:
        """The levels in words, after a comma; empty where there are none."""
        return "".join(f", {column} {label}" for column, label in self.levels.items())

    @property
    def parameters(self) -> dict[str, float]:
        """The parameters by name."""
        return dict(zip(self.fitted.names, map(float, self.fitted.point), strict=True))

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on its values."""
        if self.saved is not None:
            new = [column for column, label in self.levels.items() if label not in self.saved.fitted.labels[column]]
            return tuple(new_words(self.saved.fitted, new))
        rest = ", ".join(f"{name} = {value:g}" for name, value in self.parameters.items() if name not in self.given)
        return (f"default values, near the fits to Wang's balls: {rest}",) if rest else ()


@dataclass(frozen=True, repr=False)
class Course:
    """One impact through time, or several in one figure, from `source`, with `notes`. `panels` are the quantities in
    the figure (empty: those of the model), `heading` and `more` further text and data of an example. `levels` are the
    surface and ball, where parameters of a fit differ between these.
    """

    simulations: tuple[Simulation, ...]
    source: str
    title: str
    notes: tuple[str, ...] = ()
    panels: tuple[str, ...] = ()
    heading: str = ""
    more: Mapping[str, object] = field(default_factory=dict)
    levels: Mapping[str, str] = field(default_factory=dict)

    def __repr__(self) -> str:
        return f"<Course of {self.title}>"

    @property
    def name(self) -> str:
        """The name of its folder."""
        if self.more:
            return self.source
        given = self.simulations[0].impact
        return "_".join([self.source, *(f"{column[0]:.4g}" for column in (given.v_x1, given.v_y1, given.omega_1))])

    def report(self) -> str:
        """Phases with their times, peaks, and the state before and after, as text."""
        return "\n\n".join(filter(None, (self.heading, document.render(self.simulations))))

    def to_frame(self) -> pd.DataFrame:
        """The time series: one row for each time, columns with units, and quantiles if there is a posterior."""
        import pandas as pd

        return pd.DataFrame(document.history_rows(self.simulations))

    def summary(self) -> Mapping[str, object]:
        """Impact, phases, peaks, jumps and rebound in SI, of the first simulation."""
        return document.simulation_json(self.simulations[0])

    def json(self) -> dict[str, object]:
        """The content of `simulate.json`: all but the time series."""
        more = self.more or {"notes": list(self.notes), **({"levels": dict(self.levels)} if self.levels else {})}
        return {**more, "simulations": [document.simulation_json(item) for item in self.simulations]}

    def plot(self) -> Figure:
        """The time series, as a matplotlib Figure that is not registered with pyplot."""
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
        """Write `simulate.json`, `history.csv` and the figure; also the time series to the file `csv`, and a `film`.
        Returns the paths; raises ResultFolderError.
        """
        if film is not None and len(self.simulations) > 1:
            raise ParameterError(
                f"{spoken('--animate', 'a film')} shows one bounce; example {self.source} has {len(self.simulations)}"
            )
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
    """One impact, from text or `Impacts`. Raises ParameterError for several."""
    if isinstance(impact, str):
        return parse_impact(impact)
    if not isinstance(impact, Impacts) or len(impact) != 1:
        raise ParameterError(
            f"simulate takes one impact: read {impact!r}, expected a text such as 'v=17, theta=18, spin=100' or "
            "fitball.impacts(v_x1, v_y1, omega_1)"
        )
    return impact


def course_of(subject: Subject, impact: Impacts | str, draws: int) -> Course:
    """Best-fit curves and bands of a fit, or curves of a model at its values. Raises ModelError, ParameterError, and
    as `Model.history` does.
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
    return Course((simulation,), subject.name, title + subject.at, notes, levels=subject.levels)


def _cautions(saved: Fit) -> Sequence[str]:
    """Notes on limits of the fit."""
    notes = []
    if saved.status is RunStatus.POINT_ONLY:
        notes.append("a point fit has no posterior: best-fit curves without bands")
    if saved.status is RunStatus.NOT_CONVERGED:
        notes.append("sampling of this fit did not converge: bands may change")
    stiffness = saved.parameters.get("k_y")
    sources = {Verdict.FIXED: "is fixed", Verdict.PRIOR_DOMINATED: "comes from its prior"}
    if stiffness is not None and stiffness.verdict in sources:
        notes.append(f"times, compression and forces depend on k_y, which {sources[stiffness.verdict]} in this fit")
    return notes


@dataclass(frozen=True)
class Regimes:
    """The sequence of slip and grip over angle and spin, with contours of one output."""

    found: RegimeMap
    subject: Subject
    contours: str

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the values of the model."""
        return self.subject.notes

    @property
    def name(self) -> str:
        """The name of its folder."""
        return f"map_{self.subject.name}_{self.found.window.speed:.4g}"

    def report(self) -> str:
        """The map in words."""
        from fitball.report.history.regime_map import map_text

        return map_text(self.found, self.subject.title)

    def json(self) -> dict[str, object]:
        """The content of `regime_map.json`: all but the grid."""
        from fitball.report.history.regime_map import map_json

        chosen = self.subject.fitted.model
        levels = {"levels": dict(self.subject.levels)} if self.subject.levels else {}
        return {"model": chosen.name, "closures": dict(chosen.options), **levels, **map_json(self.found)}

    def save(self, folder: Path, *, overwrite: bool = False, form: str = "png") -> tuple[Path, ...]:
        """Write `regime_map.json`, `regime_map.csv` and the figure; returns the paths. Raises ResultFolderError."""
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
    """The map of a text such as `v=30, theta=10..80, spin=-300..300`; ranges that are not given are those of the
    fitted impacts. Raises ModelError, ParameterError.
    """
    from fitball.report.history.regime_map import contour_names

    chosen = CONTOURS if contours is None else contours
    if chosen not in contour_names():
        raise ParameterError(f"unknown quantity '{chosen}': {suggestion(chosen, contour_names())}")
    window, (speed, angle, spin) = parse_window(asked), (SPEED, ANGLE, SPIN)
    if not subject.fitted.model.gives(OBSERVABLES[chosen]):
        raise ParameterError(f"{option('contours', chosen)}: model {subject.fitted.model.name} does not compute it")
    if subject.saved is not None:
        impacts = subject.saved.impacts
        speed, angles = float(np.median(impacts.speed)), impacts.angle
        angle = (min(angle[0], float(0.9 * angles.min())), max(angle[1], min(float(1.1 * angles.max()), math.pi)))
        spin = max(spin, 1.1 * float(np.max(np.abs(impacts.omega_1))))
    ends = window.get("v_1", (speed, speed))[0], window.get("theta_1", angle), window.get("omega_1", (-spin, spin))
    return Regimes(regime_map(subject.fitted, Window(*ends)), subject, chosen)


def page_of(subject: Subject, impact: Impacts | None) -> str:
    """The page with sliders as HTML, starting at an impact (default: the middle of the calibrated range). Raises
    ModelError.
    """
    from fitball.exports.bounces import bounces_of
    from fitball.exports.interactive import interactive_page, round_impact

    if subject.saved is not None:
        bounces, table = bounces_of(subject.saved, subject.levels), subject.saved.source
        fitted, origin = bounces.cases[0].fitted, bounces.origin
        intro = f"As fitted to {table.name}, {table.impacts} impacts{subject.at}."
    else:
        # The valid range is that of these impacts.
        fitted, origin = replace(subject.fitted, impacts=load_table("wang_all").impacts), "default values, no fit"
        given = ", some of them set by the user" if subject.given else ""
        intro = f"Default parameters, near the fits to the balls of Wang (1989){given}. This is not a fit."
    start = round_impact(fitted) if impact is None else impact
    return interactive_page(fitted, start, intro, origin, measured=subject.saved is not None)
