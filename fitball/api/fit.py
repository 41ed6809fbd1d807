"""The fit in Python: one type for new fits and for those read back from a folder, with its methods. Then the verbs
that start from a fit, as functions.
"""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, TypeVar

from fitball.api.own_model import AnyModel, check_same
from fitball.api.predicting import Plan, Span, foretell, parsed, planned
from fitball.api.reading import PathLike, Wanted
from fitball.api.simulating import Course, Subject, course_of
from fitball.data.table import FrozenMapping, ImpactTable
from fitball.errors import ParameterError, ResultFolderError, suggestion
from fitball.exports.formats import Exported, exported, exported_model
from fitball.inference.design.make_plan import Asked
from fitball.inference.identifiability.derived import quantities
from fitball.inference.identifiability.examine import with_profiles
from fitball.inference.prediction.new_impacts import NewPrediction, predict_new
from fitball.inference.problem.observables import Observable
from fitball.inference.results import results
from fitball.inference.results.evidence import LEFT_OUT
from fitball.kinds import checked
from fitball.report.figures.registry import FIGURES, no_profiles
from fitball.report.fit.citations import cited, works, works_of
from fitball.report.fit.folder import prepare_folder, write_all
from fitball.report.fit.rows import html_text, report_text, short_text, summary_columns
from fitball.report.form.folders import held
from fitball.report.saved.fit_file import complete, load, read_fit
from fitball.scheduling.engine import engine
from fitball.values import FloatArray, Impacts

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from fitball.report.figures.canvas import Figure


class Plots:
    """Figures of a fit: `fit.plot.corner()` or `fit.plot("corner")` returns a matplotlib Figure, with its panels in
    `axes`. They are not registered with pyplot: nothing has to be closed. A notebook shows the last one of a cell.
    """

    def __init__(self, fit: Fit) -> None:
        self._fit = fit

    def _whole(self) -> Fit:
        """The fit with all its files; files of different runs are refused before anything is drawn."""
        load(self._fit)
        return self._fit

    @checked
    def __call__(self, kind: str) -> Figure:
        """A figure by name. Raises ParameterError for an unknown name, ResultFolderError if the fit lacks the data
        for it.
        """
        from fitball.report.figures.registry import draw

        if kind not in FIGURES:
            raise ParameterError(f"unknown figure '{kind}': {suggestion(kind, FIGURES)}")
        fit = self._whole()
        return draw(kind, profiled(fit) if kind == "profiles" else fit)

    @checked
    def corner(self, package: str = "fitball") -> Figure:
        """All pairs of parameters in one Axes. With `package="corner"` the package of that name draws them, in the
        same units, each pair in its own Axes. Raises ParameterError for another package, ResultFolderError for a
        point fit.
        """
        if package == "fitball":
            return self("corner")
        if package != "corner":
            raise ParameterError(f"package={package!r}: expected 'fitball' or 'corner'")
        from fitball.report.figures.evidence import package_corner_figure

        return package_corner_figure(self._whole())

    def __getattr__(self, kind: str) -> Callable[..., Figure]:
        if kind not in FIGURES:
            raise AttributeError(f"unknown figure '{kind}': {suggestion(kind, FIGURES)}")

        def drawn(*places: object, **named: object) -> Figure:
            if places or named:
                raise ParameterError(
                    f"fit.plot.{kind}() takes no arguments: its panels are in .axes of what it returns"
                )
            return self(kind)

        return drawn

    def __iter__(self) -> Iterator[str]:
        """The names of the figures that this fit has data for."""
        from fitball.report.figures.registry import drawable_kinds

        return iter(drawable_kinds(self._whole()))

    def __dir__(self) -> list[str]:
        return sorted(FIGURES)

    def __repr__(self) -> str:
        width = max(map(len, FIGURES))
        return "\n".join(["figures, as in fit.plot.corner():", *(
            f"  {name:{width}}  {text.summary}" for name, text in FIGURES.items()
        )])  # fmt: skip


def lacks_profiles(fit: Fit) -> bool:
    """Whether the fit has no profiles yet but can have them."""
    return bool(no_profiles(fit)) and fit.identifiability.profiles_missing in ("", LEFT_OUT)


def profiled(fit: Fit, cores: int | None = None, scheduler: str | None = None) -> Fit:
    """The fit with its profiles. Missing ones are computed now, unless the fit cannot have them, by `cores` processes
    (default: all) or on the Dask cluster at the address `scheduler`.
    """
    if not lacks_profiles(fit):
        return fit
    workers = engine(cores, scheduler)
    return replace(fit, identifiability=with_profiles(fit.problem, fit.point, fit.identifiability, workers))


class Fit(results.Fit):
    """The result of a calibration: `calibrate` returns one, and `load_fit` reads one from its folder.

    Numbers are in SI, angles in radians. Two fits are equal if measurements, model, priors, numbers and draws are the
    same to the last digit. After `load_fit`, `fit.json` is in memory; the other files are read when they are first
    needed. ResultFolderError is raised if one is missing, damaged or from another fit.

    >>> fit
    <Fit of grip-slip to wang_zero_spin: 7 impacts, 7 free parameters, not converged>
      ...
    """

    @classmethod
    def from_results(cls, found: results.Fit) -> Fit:
        """A fit with the methods of this class, from the results of a run or of a file."""
        fit = cls.__new__(cls)
        fit.__dict__.update(vars(found))
        # A number that was changed here would change no other, and would be saved.
        fit.__dict__["parameters"] = FrozenMapping(found.parameters)
        return fit

    @property
    def table(self) -> ImpactTable:
        """The measurements."""
        return self.problem.table

    def __repr__(self) -> str:
        return short_text(self)

    def _repr_html_(self) -> str:
        """A short table, for a notebook."""
        return html_text(self)

    def report(self) -> str:
        """The fit as text, in the style of lmfit: outcome, statistics, parameters, correlations, notes.

        >>> print(fit.report())
        [[Fit]]
            grip-slip on wang_zero_spin: 7 impacts with v_x2, v_y2 and omega_2; 7 free parameters
        ...
        """
        return report_text(self)

    def summary(self) -> pd.DataFrame:
        """One row for each parameter, after those of its levels, in SI: unit, median, sd, quantiles, point estimate,
        prior, verdict, sampling.

        >>> fit.summary().loc["mu", ["unit", "verdict"]].tolist()
        ['', 'identified']
        """
        import pandas as pd

        return pd.DataFrame(summary_columns(self)).set_index("parameter")

    def draws(self) -> pd.DataFrame:
        """All draws in SI, one row each: of the free parameters, then of values at levels, such as `mu[clay]`.
        Raises ResultFolderError for a point fit.
        """
        import pandas as pd

        posterior = self.posterior
        if posterior is None:
            raise ResultFolderError("a point fit has no draws; fit again without point_only=True")
        draws = posterior.draws
        levels = [item for item in quantities(self.problem) if item.level] if self.fitted.levels else []
        made = pd.DataFrame(draws, columns=list(posterior.names))
        return made.assign(**{item.parameter.name: item.rule(draws) for item in levels})

    @property
    def plot(self) -> Plots:
        """Figures by name: `fit.plot.corner()`, `fit.plot("corner")`; `dir(fit.plot)` lists them."""
        return Plots(self)

    @checked
    def predict(
        self,
        data: Any,
        *,
        units: Mapping[str, str] | None = None,
        flip: str | Sequence[str] = (),
        columns: Mapping[str, str] | None = None,
        exact_incidence: bool = False,
        levels: Mapping[str, str | Sequence[str]] | None = None,
        seed: int = 1,
    ) -> pd.DataFrame:
        """Rebounds of new impacts with intervals: one row for each impact, with the index of `data`. Column names
        contain units.

        `data` is a data frame, a path or bundled name, an `ImpactTable`, `Impacts`, or texts such as `"v=38 mph,
        theta=18 deg, spin=950 rpm top"`. For `units`, `flip` and `columns` see `calibrate`. Columns such as
        `v_x2_mean_q025 [m/s]` are quantiles of the rebound itself, `v_x2_data_q025 [m/s]` of a measurement of it. If
        sds of the incident state are given, both include them, unless `exact_incidence`. Rebound columns of `data`
        are returned as `v_x2_measured`, with residuals. Notes are in `.attrs["notes"]`.

        Where parameters differ between surfaces, balls or places, each impact has those of its own label, in the
        column of `data` that the fit used. `levels` names them where `data` does not: `{"surface": "clay"}`, or a
        label for each impact. The label `"new"` is a surface of which nothing was measured, with wider intervals.

        >>> fit.predict("v=17, theta=25, spin=100")["v_x2_median [m/s]"].round().tolist()
        [10.0]
        """
        return foretell(self, self.predicting, data, units, flip, exact_incidence, seed, columns, levels).frame()

    @checked
    def predict_interval(
        self,
        impacts: Impacts,
        observed: Sequence[Observable] = (),
        *,
        seed: int = 1,
        incident_covariance: FloatArray | None = None,
        levels: Mapping[str, str | Sequence[str]] | None = None,
    ) -> NewPrediction:
        """The same as arrays; see `inference.prediction.new_impacts.predict_new`."""
        return predict_new(self.predicting, impacts, observed, seed, incident_covariance, levels)

    @checked
    def simulate(self, impact: Impacts | str, *, draws: int = 200, levels: Mapping[str, str] | None = None) -> Course:
        """One impact through time, with bands from `draws` posterior draws; see `fitball.simulate`."""
        return course_of(Subject.from_fit(self, None, {}, levels), impact, draws)

    @checked
    def plan(
        self,
        target: str | Sequence[str] | None = None,
        *,
        speed: Span | None = None,
        angle: Span | None = None,
        spin: Span | None = None,
        impacts: int = 5,
        repeats: int = 1,
        sensors: str | Sequence[str] | None = None,
        cost: Mapping[str, float] | None = None,
        levels: Mapping[str, str] | None = None,
        seed: int = 1,
        progress: Wanted = False,
    ) -> Plan:
        """Plan the next measurements: the `impacts` with the largest expected information gain about the `target`,
        and the gain of other sensors.

        `target` are names of parameters (default: all of the model), `"court pace"`, or `"impact=v=30 m/s, theta=16
        deg"`. `speed`, `angle` and `spin` are ranges of your machine. Give texts such as `"5:20"` [m/s], `"10:80"`
        [deg], `"-300:300 rpm"`, or pairs in SI (default: the range of the fitted table). `sensors` are texts such as
        `"contact_time=0.2ms"`, `"force=20N"`, `"camera=0.5"`, `"drop=254cm"`. `cost` is that of an impact with a
        sensor, relative to one measured as before. Where parameters differ between surfaces or balls, the plan is for
        all of these, or for those of `levels`, such as `{"surface": "clay"}`. For `progress` see `calibrate`. Raises
        ParameterError, and FitError for a fit that allows no plan.

        >>> fit.plan("mu", speed="10:20:2", angle="20:60:3", spin=0.0, impacts=2, sensors="camera=0.5")
        <Plan of 2 impacts about mu: ... nats>
        """
        ranges = (parsed("speed", speed), parsed("angle", angle), parsed("spin", spin))
        ways = (sensors,) if isinstance(sensors, str) else sensors
        asked = Asked(target, *ranges, impacts, repeats, ways, dict(cost or {}), seed, dict(levels or {}))
        return planned(self, asked, progress)

    @checked
    def export(
        self, /, to: str, out: str | os.PathLike[str] | None = None, *, overwrite: bool = False, **options: Any
    ) -> Mapping[str, str] | tuple[Path, ...]:
        """The fit in another format, as the verb `export` writes it. Returns texts by the ending of their file, or
        with `out` (a file or a folder) the paths of the files.

        Formats are `python`, `c`, `javascript`, `csharp`, `golden`, `lookup`, `engine`, `json`,
        `latex`, `markdown`, `certificate`, and `pdf` and `netcdf` (files only). Options: `prefix` (c, javascript,
        csharp), `inputs_only` (golden), `range` (lookup), `at` and `engine_inertia` (engine), `json` (engine, lookup:
        JSON only). If parameters differ between surfaces or balls, the first seven have all of them;
        `levels`, such as `{"surface": "clay"}`, chooses one. Raises ParameterError, ResultFolderError.

        >>> print(fit.export("latex")[".tex"].splitlines()[0])
        %...
        """
        made = self.exported(to, options)
        if out is not None:
            return made.write(Path(out), overwrite)
        if not made.texts:
            raise ParameterError(f"to={to!r} is not text: name a file (out), or use to_inferencedata()")
        return made.texts

    def exported(self, to: str, options: Mapping[str, Any]) -> Exported:
        """The same before it is written, with its note."""
        return exported(self, to, options)

    @checked
    def to_datatree(self, draws: int | None = None, unit: str = "measurement") -> xr.DataTree:
        """Draws and data in the layout of ArviZ: an xarray DataTree with four chains of `draws` each, by default a
        thousand, fewer for long tables.

        Its groups are posterior, sample_stats, log_likelihood, log_prior, posterior_predictive, prior,
        prior_predictive, observed_data and constant_data. `log_likelihood` has a variable for each measured column,
        or with `unit="impact"` one value for all measurements of an impact. A small fit of a batch has 400 draws in
        one chain; the attribute `notes` says what is missing. Raises ResultFolderError for a point fit,
        ParameterError for draws that there are not.

        >>> fit.to_datatree(draws=100)["posterior"].sizes["chain"]
        4
        """
        from fitball.exports.arviz_file import datatree

        return datatree(self, draws, unit)

    @checked
    def to_inferencedata(self, draws: int | None = None, unit: str = "measurement") -> Any:
        """The same as the installed ArviZ takes it: a DataTree, or an `arviz.InferenceData` before ArviZ 1.

        >>> fit.to_inferencedata(draws=100)["posterior"].sizes["chain"]
        4
        """
        from fitball.exports.arviz_file import inferencedata

        return inferencedata(self.to_datatree(draws, unit))

    @checked
    def save(self, folder: str | os.PathLike[str], *, overwrite: bool = False, figures: bool = True) -> Path:
        """Write the result folder: `fit.json`, measurements, draws, tables, `report.html` and, if `figures`, figures.

        Raises ResultFolderError if the folder cannot be written, or if it holds an older result, unless `overwrite`.
        """
        path = Path(folder)
        load(self)
        with held(path):
            prepare_folder(path, overwrite=overwrite, resume=False)
            write_all(self, path, figures=figures)
        return path

    @checked
    def cite(self, to: str = "bibtex") -> str:
        """References to cite with the fit: fitball, data, model, optimiser, sampler. See `fitball.cite`."""
        return cited(works_of(self), to)

    def __getstate__(self) -> dict[str, Any]:
        """The whole fit, so that it can be unpickled without its folder; if only `fit.json` exists, its content."""
        if complete(self):
            load(self)
        return dict(vars(self))


@checked
def load_fit(path: PathLike, model: AnyModel | None = None) -> Fit:
    """Read a fit from its folder, or its `fit.json`; the other files of the folder are read when they are needed.

    The fit of a function of your own names it and does not contain it. Numbers and draws are read without it. New
    rebounds need it again, as `model`: what `model_from` returns, or `FILE.py:NAME`. Raises ModelError for another
    function, ResultFolderError for files that are missing, damaged or from another fit.

    >>> fit = fitball.load_fit(folder)
    >>> fit.status
    <RunStatus.NOT_CONVERGED: 'not converged'>
    """
    saved = read_fit(Path(path))
    if model is not None:
        check_same(Path(path), saved.fitted.model_name, saved.fitted.options, model)
        saved = read_fit(Path(path))
    return Fit.from_results(saved)


FitOrFolder = Fit | str | os.PathLike[str]
P = ParamSpec("P")
T = TypeVar("T")


def fit_of(fit: FitOrFolder) -> Fit:
    """The fit itself, or the one in a folder. Raises ResultFolderError."""
    return fit if isinstance(fit, Fit) else load_fit(fit)


def _of_fit(method: Callable[Concatenate[Fit, P], T]) -> Callable[Concatenate[FitOrFolder, P], T]:
    """A method of fits as a function of a fit or of its folder, with the documentation of the method."""

    @wraps(method)
    def verb(fit: FitOrFolder, *args: P.args, **named: P.kwargs) -> T:
        return method(fit_of(fit), *args, **named)

    own = inspect.signature(method)
    fit, *others = own.parameters.values()
    first = fit.replace(name="fit", annotation="FitOrFolder")
    verb.__signature__ = own.replace(parameters=[first, *others])  # type: ignore[attr-defined]
    # The fit may be given by keyword too, which the type does not say.
    return verb  # type: ignore[return-value]


predict = _of_fit(Fit.predict)
plan = _of_fit(Fit.plan)
export = _of_fit(Fit.export)


@checked
def port(
    model: str,
    to: str,
    out: str | os.PathLike[str] | None = None,
    *,
    values: Mapping[str, Any] | None = None,
    surfaces: Mapping[str, Any] | None = None,
    overwrite: bool = False,
    **options: Any,
) -> Mapping[str, str] | tuple[Path, ...]:
    """A bounce without a table: a model at `values` as source code, a lookup table or engine settings, as the verb
    `export` writes it without a fit. Formats, `out`, `options` and what it returns are those of `export`.

    A value is a number in SI or a published one, such as `"literature:clay"`; parameters without one have default
    values. `surfaces` change some of them by name: `{"clay": "literature:clay", "mine": {"mu": 0.6}}`. Several
    surfaces are an argument of the bounce. Raises ParameterError, ModelError, ResultFolderError.

    >>> print(fitball.port("two-mass", "c", values={"mu": 0.7})[".h"].splitlines()[1])
     * Bounce of a ball: model two-mass.
    """
    made = exported_model(model, to, values or {}, surfaces or {}, options)
    return made.texts if out is None else made.write(Path(out), overwrite)


@checked
def cite(fit: FitOrFolder | None = None, to: str = "bibtex") -> str:
    """Entries to cite fitball; with a fit also its data, model, optimiser and sampler, as `bibtex` or `text`.

    Data of your own are cited by `source.citation` of their scene. Raises ParameterError, ResultFolderError.

    >>> print(fitball.cite(to="text"))
    The fitball authors. fitball: parameter identification for the bounce of a tennis ball. Version ...
    """
    return cited([works()["fitball"]], to) if fit is None else fit_of(fit).cite(to)


@checked
def plot(fit: FitOrFolder, kind: str) -> Figure:
    """A figure of a fit by name, as the verb `plot` draws it: a matplotlib Figure, with its panels in `axes`.

    Kinds are `predictive`, `residuals`, `corner` and others that `dir(fit.plot)` lists. Raises ParameterError for an
    unknown kind, ResultFolderError if the fit lacks the data for it.

    >>> len(fitball.plot(fit, "residuals").axes) > 0
    True
    """
    return fit_of(fit).plot(kind)


@checked
def simulate(
    impact: Impacts | str,
    *,
    fit: FitOrFolder | None = None,
    model: str | None = None,
    values: Mapping[str, Any] | None = None,
    draws: int = 200,
    levels: Mapping[str, str] | None = None,
) -> Course:
    """One impact through time, as the verb `simulate` computes it. From a `fit` it has bands from `draws` posterior
    draws; a `model` has round default values, of which `values` [SI] replace some. `levels` names the surface or
    ball, as in `{"surface": "clay"}`, if parameters of the fit differ between these.

    `impact` is a text or `fitball.impacts(...)` of one impact. Raises ParameterError, ModelError.

    >>> fitball.simulate("v=17, theta=18, spin=100").to_frame().shape[0]
    401
    """
    if fit is not None and (model is not None or values):
        raise ParameterError("a fit has its own model and parameters: leave out model and values")
    subject = Subject.from_fit(None if fit is None else fit_of(fit), model, values or {}, levels)
    return course_of(subject, impact, draws)
