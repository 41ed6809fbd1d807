"""A fit for a caller of Python: one type, whether it was just made or read back from its folder."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fitball.api.exporting import Exported, exported
from fitball.api.planning import Plan, Span, parsed, planned
from fitball.api.plotting import Plots
from fitball.api.predicting import foretell
from fitball.api.progress import Wanted
from fitball.api.simulating import Course, course_of_fit
from fitball.data.table import ImpactTable
from fitball.errors import ParameterError, ResultFolderError
from fitball.inference.design.make_plan import Asked
from fitball.inference.prediction.new_impacts import NewPrediction, predict_new
from fitball.inference.problem.observables import Observable
from fitball.inference.results import results
from fitball.kinds import checked
from fitball.report.fit.folder import prepare_folder, write_all
from fitball.report.fit.short import html_text, report_text, short_text, summary_columns
from fitball.report.form.folders import held
from fitball.report.saved.fit_file import complete, load
from fitball.values import FloatArray, Impacts

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


class Fit(results.Fit):
    """What a calibration found; `calibrate` makes one and `load_fit` reads one back, with all that its folder holds.

    Numbers are in SI, angles in radians. Two fits are equal when they say the same to the last digit: measurements,
    model, priors, numbers and draws. Of a fit that was read back, `fit.json` is in memory, and the other files are
    read when something in them is first asked for; ResultFolderError says if one is missing, damaged or foreign.

    >>> fit
    <Fit of grip-slip to wang_zero_spin: 7 impacts, 7 free parameters, not converged>
      ...
    """

    @classmethod
    def of(cls, found: results.Fit) -> Fit:
        """What a run found, or what was read, with all that can be asked of it here."""
        fit = cls.__new__(cls)
        fit.__dict__.update(vars(found))
        return fit

    @property
    def table(self) -> ImpactTable:
        """The measurements."""
        return self.problem.table

    def __repr__(self) -> str:
        return short_text(self)

    def _repr_html_(self) -> str:
        """A short table, as a notebook shows it."""
        return html_text(self)

    def report(self) -> str:
        """The fit as text, in the manner of lmfit: outcome, statistics, parameters, correlations, notes.

        >>> print(fit.report())
        [[Fit]]
            grip-slip on wang_zero_spin: 7 impacts with v_x2, v_y2 and omega_2; 7 free parameters
        ...
        """
        return report_text(self)

    def summary(self) -> pd.DataFrame:
        """One row a parameter, in SI: unit, median, sd, quantiles, point estimate, prior, verdict, sampling.

        >>> fit.summary().loc["mu", ["unit", "verdict"]].tolist()
        ['', 'identified']
        """
        import pandas as pd

        columns = summary_columns(self)
        return pd.DataFrame(columns, index=pd.Index(self.parameters, name="parameter"))

    def draws(self) -> pd.DataFrame:
        """All draws of the free parameters in SI, one row a draw. Raises ResultFolderError for a point fit."""
        import pandas as pd

        posterior = self.posterior
        if posterior is None:
            raise ResultFolderError("a point fit has no draws; fit again without point_only=True")
        return pd.DataFrame(posterior.draws, columns=list(posterior.names))

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
        seed: int = 1,
    ) -> pd.DataFrame:
        """Rebounds of new impacts with intervals: a row an impact, indexed as `data` is, columns with their units.

        `data` is a data frame, a path or bundled name, an `ImpactTable`, `Impacts`, or texts such as `"v=38 mph,
        theta=18 deg, spin=950 rpm top"`; for `units`, `flip` and `columns` see `calibrate`. `v_x2_mean_q025 [m/s]`
        and the like are quantiles of the rebound itself, `v_x2_data_q025 [m/s]` of a measurement. Where sds of the
        incident state are stated both contain it, unless `exact_incidence`. Rebound columns of `data` come back as
        `v_x2_measured` with residuals. What one should know of it is in `.attrs["notes"]`.

        >>> fit.predict("v=17, theta=25, spin=100")["v_x2_median [m/s]"].round().tolist()
        [10.0]
        """
        return foretell(self, self.predicting, data, units, flip, exact_incidence, seed, columns).frame()

    @checked
    def predict_interval(
        self,
        impacts: Impacts,
        observed: Sequence[Observable] = (),
        *,
        seed: int = 1,
        incident_covariance: FloatArray | None = None,
    ) -> NewPrediction:
        """The same as arrays; see `inference.prediction.new_impacts.predict_new`."""
        return predict_new(self.predicting, impacts, observed, seed, incident_covariance)

    @checked
    def simulate(self, impact: Impacts | str, *, draws: int = 200) -> Course:
        """One impact through time, with bands from `draws` of the posterior; see `fitball.simulate`."""
        return course_of_fit(self, impact, draws)

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
        seed: int = 1,
        progress: Wanted = False,
    ) -> Plan:
        """What to measure next: the `impacts` expected to tell most about the `target`, and other ways of measuring.

        `target` are names of parameters (default: all of the model), `"court pace"`, or `"impact=v=30 m/s, theta=16
        deg"`. `speed`, `angle` and `spin` are what the machine can do: texts such as `"5:20"` [m/s], `"10:80"` [deg],
        `"-300:300 rpm"`, or pairs in SI; by default the range of the fitted table. `sensors` are texts such as
        `"contact_time=0.2ms"`, `"force=20N"`, `"camera=0.5"`, `"drop=254cm"`; `cost` what an impact read by one
        costs, one measured as before being 1; for `progress` see `calibrate`. Raises FitError for a fit that cannot
        be planned from, ParameterError.

        >>> fit.plan("mu", speed="10:20:2", angle="20:60:3", spin=0.0, impacts=2, sensors="camera=0.5")
        <Plan of 2 impacts about mu: ... nats>
        """
        ranges = (parsed("speed", speed), parsed("angle", angle), parsed("spin", spin))
        ways = (sensors,) if isinstance(sensors, str) else sensors
        return planned(self, Asked(target, *ranges, impacts, repeats, ways, dict(cost or {}), seed), progress)

    @checked
    def export(
        self, /, to: str, out: str | os.PathLike[str] | None = None, *, overwrite: bool = False, **options: Any
    ) -> Mapping[str, str] | tuple[Path, ...]:
        """The fit in another form, as the verb `export` writes it: texts by the ending of their file, or with `out`
        (a file or a folder) the places that were written.

        Forms are `python`, `c`, `javascript`, `csharp`, `golden`, `lookup`, `engine`, `json`,
        `latex`, `markdown`, `certificate` and `netcdf` (a file only). Options: `prefix` (c, javascript,
        csharp), `inputs_only` (golden), `range` (lookup), `at` and `engine_inertia` (engine), `json` (engine, lookup:
        the JSON alone). Raises ParameterError, ResultFolderError.

        >>> print(fit.export("latex")[".tex"].splitlines()[0])
        %...
        """
        made = self.exported(to, options)
        if out is not None:
            return made.write(Path(out), overwrite)
        if made.tree is not None:
            raise ParameterError(f"to={to!r} is no text: name a file, or use to_inferencedata()")
        return made.texts

    def exported(self, to: str, options: Mapping[str, Any]) -> Exported:
        """The same, not yet written, with what one should know of it."""

        def tree() -> tuple[xr.DataTree, str]:
            from fitball.exports.arviz_file import partial_tree

            return (self.to_inferencedata(), "") if complete(self) else partial_tree(self)

        return exported(self, to, options, tree)

    @checked
    def to_inferencedata(self, draws: int | None = None) -> xr.DataTree:
        """Draws and data for ArviZ: groups posterior, sample_stats, log_likelihood, posterior_predictive, prior,
        observed_data and constant_data, as `arviz_base` makes them (a DataTree), in four chains of `draws` each.

        By default a thousand, fewer for long tables (see `exports.arviz_file`). `log_likelihood` is that of whole
        impacts, which is what can be left out. Raises ResultFolderError for a point fit.

        >>> fit.to_inferencedata(draws=100)["posterior"].sizes["chain"]
        4
        """
        from fitball.exports.arviz_file import whole_tree

        return whole_tree(self, draws)

    @checked
    def save(self, folder: str | os.PathLike[str], *, overwrite: bool = False, figures: bool = True) -> Path:
        """Write the result folder: `fit.json`, measurements, draws, tables, figures (unless without) and
        `report.html`.

        Raises ResultFolderError for a folder that cannot be written, or that holds an older result unless it may
        `overwrite` that.
        """
        path = Path(folder)
        load(self)
        with held(path):
            prepare_folder(path, overwrite=overwrite, resume=False)
            write_all(self, path, figures=figures)
        return path

    def __getstate__(self) -> dict[str, Any]:
        """All of it, so that it can be unpickled where its folder is not; of a lone `fit.json` that alone."""
        if complete(self):
            load(self)
        return dict(vars(self))
