"""One impact through time, as a value with its table, its text and its figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from fitball.data.lines import parse_impact
from fitball.errors import ParameterError, check_whole
from fitball.inference.comparison.candidates import parse_name
from fitball.inference.prediction.new_impacts import predict_new
from fitball.inference.prediction.simulate import Simulation, chosen_parameters, simulate_fit
from fitball.inference.prediction.simulate import simulate as follow
from fitball.inference.results.results import Fit, RunStatus, Verdict
from fitball.models.model import Model
from fitball.models.names import DEFAULT_MODEL
from fitball.models.registry import model
from fitball.report.history.document import history_rows, render, simulation_json
from fitball.report.predict import remarks_on
from fitball.values import Impacts

if TYPE_CHECKING:
    import pandas as pd

    from fitball.report.figures.canvas import Figure


@dataclass(frozen=True, repr=False)
class Course:
    """One impact followed through time, or several in one picture, from `source`; `notes` say what one should know,
    and `panels` which courses the figure shows (empty: as the model has them).
    """

    simulations: tuple[Simulation, ...]
    source: str
    title: str
    notes: tuple[str, ...] = ()
    panels: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return f"<Course of {self.title}>"

    def report(self) -> str:
        """Phases with their times, peaks, and the state before and after, as text."""
        return render(self.simulations)

    def to_frame(self) -> pd.DataFrame:
        """The course: one row a point of time, columns with their units, quantiles where there is a posterior."""
        import pandas as pd

        return pd.DataFrame(history_rows(self.simulations))

    def summary(self) -> Mapping[str, object]:
        """What went in, phases, peaks, jumps and rebound, in SI; of several simulations the first."""
        return simulation_json(self.simulations[0])

    def plot(self) -> Figure:
        """The courses along the contact, as a matplotlib Figure that pyplot does not know."""
        from fitball.report.history.figure import history_figure

        return history_figure(self.simulations, self.title, self.panels)


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


def _course(simulation: Simulation, source: str, notes: Sequence[str]) -> Course:
    v_x, v_y, omega = (float(getattr(simulation.impact, name)[0]) for name in ("v_x1", "v_y1", "omega_1"))
    title = f"{simulation.model.name}: {v_x:.2f} m/s along, {v_y:.2f} m/s towards the court, {omega:.0f} rad/s"
    return Course((simulation,), source, title, tuple(notes))


def course_of_fit(saved: Fit, impact: Impacts | str, draws: int) -> Course:
    """Point estimate and bands of a fit. Raises ParameterError, and what `Model.history` raises."""
    given = impact_of(impact)
    check_whole(draws=draws)
    if draws < 1:
        raise ParameterError(f"draws = {draws}: expected at least 1")
    simulation = simulate_fit(saved.fitted, given, draws)
    notes = [*remarks_on(predict_new(saved.fitted, given), 0), *filter(None, [saved.at_common])]
    if saved.status is RunStatus.POINT_ONLY:
        notes.append("a point fit has no posterior: courses at the point estimate, without bands")
    if saved.status is RunStatus.NOT_CONVERGED:
        notes.append("the sampler of this fit did not converge: bands may change")
    stiffness = saved.parameters.get("k_y")
    rests = {Verdict.FIXED: "the value it was held at", Verdict.PRIOR_DOMINATED: "its prior"}
    if stiffness is not None and stiffness.verdict in rests:
        notes.append(f"times, compression and forces rest on k_y, and in this fit k_y on {rests[stiffness.verdict]}")
    return _course(simulation, f"fit_{simulation.model.name}", notes)


def model_at(name: str | None, values: Mapping[str, float]) -> tuple[Model, dict[str, float], list[str]]:
    """A model at its defaults, some of them set, and a note that says which were not. Raises ModelError,
    ParameterError.
    """
    plain, closures = parse_name(str(name) if name is not None else DEFAULT_MODEL)
    chosen = model(plain, ball=None, tangential=True, **closures)
    parameters = chosen_parameters(chosen, values)
    # A model without a history has parameters without a typical value; it is refused when it is followed.
    rest = ", ".join(f"{item} = {value:g}" for item, value in parameters.items() if item not in values)
    return chosen, parameters, [f"defaults near the fits to Wang's balls: {rest}"] if rest else []


def course_of_model(impact: Impacts | str, name: str | None, values: Mapping[str, float]) -> Course:
    """A model at its defaults, some of them set. Raises ModelError, ParameterError, and as `Model.history` does."""
    given = impact_of(impact)
    chosen, parameters, notes = model_at(name, values)
    return _course(follow(chosen, parameters, given), chosen.name, notes)
