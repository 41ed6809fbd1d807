"""`Fit`, the result of `calibrate`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import TYPE_CHECKING, ClassVar, ForwardRef

from fitball.base.files import FIT_FILE
from fitball.base.options import Names, Pairs, Watch, names_of, read_texts
from fitball.base.values import DataFrame, Figure
from fitball.data.read import TableSource
from fitball.inference.fitted import Fitted
from fitball.report.page import Layout
from fitball.results.exported import Exported
from fitball.results.result import Frames, Result

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from xarray import DataTree
else:
    # What `typing.get_type_hints` reads; both are loaded only where they are needed.
    Axes = ForwardRef("__import__('matplotlib.axes').axes.Axes")
    DataTree = ForwardRef("__import__('xarray').DataTree")


class Fit(Fitted, Result):
    """A calibration: `report()`, `plot(name)`, `save(folder)`; `summary` has each parameter with
    its interval and verdict; its methods predict, plan, simulate, compare and export.

    Example:
        >>> import fitball
        >>> fit = fitball.calibrate("wang_zero_spin", model="brody", point_only=True)
        >>> list(fit.parameters)
        ['mu', 'cor_10', 'cor_slope', 'v_x_sd', 'v_y_sd', 'spin_sd']
    """

    record: ClassVar[str] = FIT_FILE

    def __getstate__(self) -> dict[str, object]:
        # What is stored. The rest is computed again when asked for, and cannot all be pickled.
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @classmethod
    def of(cls, fitted: Fitted) -> Fit:
        """A calibration as a result, with all that was computed of it.

        Example:
            >>> import fitball
            >>> fit = fitball.calibrate("wang_zero_spin", model="brody", point_only=True)
            >>> fitball.Fit.of(fit) == fit
            True
        """
        fit = cls.__new__(cls)
        fit.__dict__.update(fitted.__dict__)
        return fit

    @property
    def frames(self) -> Mapping[str, DataFrame]:
        """The frames that are saved as tables, by name; in `summary` what laboratory tests measured
        comes first.

        Example:
            >>> import fitball
            >>> fit = fitball.calibrate("synthetic_drop", model="brody", point_only=True)
            >>> fit.frames["summary"].index[0]
            'rebound_measured'
        """
        from fitball.uses.measured import with_measured

        return {**super().frames, "summary": with_measured(self)}

    @property
    def budget(self) -> DataFrame:
        """The uncertainty budgets of the results that data determine, with held constants, in SI: a
        row a source, the last of a result its combined and expanded uncertainty, and that of a
        Monte Carlo. Empty without a posterior.

        Example:
            >>> import fitball
            >>> fit = fitball.calibrate("wang_zero_spin", model="brody", point_only=True)
            >>> fit.budget.empty
            True
        """
        from fitball.uses.budget import budgets

        return budgets(self)

    @property
    def _sheets(self) -> Mapping[str, DataFrame]:
        # Of best values alone there is none: an empty sheet would look like a fault.
        budget = self.budget
        return {**self.frames, "budget": budget} if len(budget) else self.frames

    @property
    def exit_code(self) -> int:
        """1 if the posterior did not converge, else 0.

        Example:
            >>> import fitball
            >>> fit = fitball.calibrate("wang_zero_spin", model="brody", point_only=True)
            >>> fit.exit_code
            0
        """
        return int(self.status == "not converged")

    @property
    def _layout(self) -> Layout:
        from fitball.report.fit_page import PAGE

        return PAGE.of(self)

    def plot(
        self,
        name: str,
        *,
        width: str = "",
        parameters: Names = (),
        columns: Names = (),
        groups: Names = (),
        ax: Axes | None = None,
    ) -> Figure:
        """A figure by its name, outside of pyplot, or of one panel on the axes `ax` of your own;
        `fitball.plot` has the other options.

        Raises:
            ParameterError: no such figure (`unknown-figure`) or width (`width`), or the fit has no
                data for it (`no-such-data`). The figure does not show what was chosen
                (`not-for-this-figure`), or there is no such parameter or column
                (`unknown-quantity`) or group (`unknown-label`). Axes for several panels
                (`several-panels`).

        Example:
            >>> import fitball
            >>> fit = fitball.calibrate("wang_zero_spin", model="brody", point_only=True)
            >>> len(fit.plot("curves", columns="v_y2", width="88mm").axes)
            1
        """
        from fitball.report.figures.chosen import Chosen
        from fitball.report.plotted import choose_figures, drawn, width_of

        chosen = Chosen(*(tuple(names_of(names)) for names in (parameters, columns, groups)))
        plotted = choose_figures(self, [name], "png", chosen, width_of(width))
        return drawn(plotted, name, ax)

    def predict(
        self, data: TableSource | None = None, *, impact: str = "", level: Pairs = None
    ) -> Frames:
        """Predict rebounds of new impacts, of a table `data` or of an `impact` in words, and
        compare them with what was measured: `fitball.predict` says more.

        Raises:
            ParameterError: neither a table nor words, or both (`no-impacts`); words that cannot be
                read (`impact`); a level that is unknown, missing or named twice (`unknown-level`,
                `unknown-label`, `label-missing`, `level-twice`, `pairs`).
            InputError: the table has faults (the code is that of the first).

        Example:
            >>> import fitball
            >>> fit = fitball.calibrate("wang_zero_spin", model="brody", point_only=True)
            >>> fit.predict(impact="v_1=17, theta_1=10..60 deg:6")
            <Frames: predictions (24 rows) and scores (0 rows)>
        """
        from fitball.base.errors import ParameterError
        from fitball.data.read import load_table, reading_of
        from fitball.report import predict as page
        from fitball.uses.predict import predict, table_in_words

        if (data is None) is not bool(impact):
            given = "both" if impact else "neither"
            raise ParameterError(
                f"predict takes a table or impacts in words (--impact): read {given}",
                "no-impacts",
            )
        if data is None:
            table = table_in_words(impact, self.run.scene)
        else:
            reading = reading_of(self.run.table)
            table = load_table(data, scene=self.run.scene, rebound=False, **reading)
        return Frames(predict(self, table, read_texts("level", level)), page.PAGE)

    def plan(
        self,
        *,
        target: Names = (),
        speed: str = "",
        angle: str = "",
        spin: str = "",
        level: Pairs = None,
        count: int = 5,
        sensor: Pairs = None,
    ) -> Frames:
        """Choose the impacts, and the way of measuring them, that would say most about a target:
        `fitball.plan` says more.

        Raises:
            ParameterError: a target is unknown or fixed (`unknown-quantity`, `fixed`,
                `nothing-free`). A range or number cannot be read (`impact`), or is of what was not
                measured (`not-measured`). A level is none of the fit (`unknown-level`,
                `unknown-label`, `no-such-levels`, `pairs`), or a sensor none of the model
                (`sensor`). The number of impacts or settings is impossible (`count`,
                `too-many-settings`). The fit has no posterior (`point-fit`), or the model no answer
                (`no-answer`).

        Example:
            >>> import fitball
            >>> fit = fitball.calibrate("wang_zero_spin", model="brody")
            >>> len(fit.plan(target="mu", count=2).frames["plan"])
            2
        """
        from fitball.report import plan as page
        from fitball.uses.plan import plan
        from fitball.uses.planned import measured_levels, sensors_of, settings_of, targets_of

        levels = read_texts("level", level)
        targets = targets_of(self, names_of(target), measured_levels(self, levels))
        sensors = sensors_of(self, None if sensor is None else read_texts("sensor", sensor))
        settings = settings_of(self, {"speed": speed, "angle": angle, "spin": spin}, levels)
        findings = plan(self, targets, settings, sensors, count)
        return Frames(findings, page.PAGE)

    def simulate(self, *, impact: str, level: Pairs = None) -> Frames:
        """Follow one impact through time at the best values, with the band of the posterior:
        `fitball.simulate` says more.

        Raises:
            ParameterError: an impact that cannot be read, or is several (`impact`), or has what was
                not measured (`not-measured`); a level that is unknown or missing (`unknown-level`,
                `unknown-label`, `label-missing`, `pairs`); no answer of the model (`no-answer`).
            ModelError: the model has no time axis (`no-history`).

        Example:
            >>> import fitball
            >>> fit = fitball.calibrate("wang_zero_spin", model="thesis-exact", point_only=True)
            >>> fit.simulate(impact="v_1=17, theta_1=20 deg").frames["impact"]["v_y1"].round(2)
            0    5.81
            Name: v_y1, dtype: float64
        """
        from fitball.report import simulate as page
        from fitball.uses.simulate import simulate_fit

        return Frames(simulate_fit(self, impact, read_texts("level", level)), page.PAGE)

    def compare(
        self,
        *,
        models: Names = (),
        quick: bool = False,
        cores: int = 0,
        progress: Watch = None,
    ) -> Frames:
        """Fit several models to the table of this fit, with its priors, fixed values, pool, noise
        and seed, and score each by its predictions of impacts that are left out: `fitball.compare`
        says more. Without `models` the fit's own is among those that can differ on this table.

        Raises:
            ParameterError: a model is named twice (`model-twice`), or the number of cores is
                impossible (`effort`).
            ModelError: there is no such model (`unknown-model`) or option (`unknown-option`), or
                the fit was loaded without its function (`own-model`).
            FitError: the table is too short (`too-few-impacts`), fewer than two models could be
                fitted (`one-model`), or no column is predicted by all (`no-common-column`).

        Example:
            >>> import fitball
            >>> fit = fitball.calibrate("wang_zero_spin", model="brody", point_only=True)
            >>> fit.compare(models="brody,grip-slip")
            <Frames: ...>
        """
        from fitball.base.progress import shown
        from fitball.inference.effort import Effort
        from fitball.report import compare as page
        from fitball.uses.compare import compare, problems_of_fit

        problems = problems_of_fit(self, names_of(models), quick)
        effort = Effort(self.run.effort.seed, cores=cores or None)
        with shown(progress) as show:
            return Frames(compare(problems, effort, show), page.PAGE)

    def export(
        self,
        *,
        to: str,
        level: Pairs = None,
        at: str = "",
        engine: str = "",
        medians: bool = False,
        parameters: Names = (),
    ) -> Exported:
        """Parameters, or the bounce itself as source code, for another program; `to` is the
        format: `fitball.export` says more.

        Raises:
            ParameterError: the format is unknown (`unknown-format`), or does not take an option
                (`not-for-this-format`); the label is unknown (`unknown-label`, `pairs`); the impact
                cannot be read (`impact`); the engine is unknown (`unknown-engine`); there is no
                such row (`unknown-quantity`).
            ModelError: the model has no source code to export (`no-port`), or is a function
                (`own-model`).
            FitError: a point fit has no draws to export (`no-draws`).

        Example:
            >>> import fitball
            >>> fit = fitball.calibrate("wang_zero_spin", model="brody", point_only=True)
            >>> fit.export(to="json")
            <Exported: parameters.json>
        """
        from fitball.exports import export

        levels = read_texts("level", level)
        contents = export(
            self,
            to,
            level=levels,
            fix={},
            at=at,
            engine=engine,
            medians=medians,
            chosen=names_of(parameters),
        )
        return Exported(contents)

    def to_datatree(self) -> DataTree:
        """Draws, densities, predictions and data as ArviZ takes them.

        Raises:
            FitError: a point fit has no draws (`no-draws`).

        Example:
            >>> import fitball
            >>> fit = fitball.calibrate("wang_zero_spin", model="brody")
            >>> "posterior" in fit.to_datatree().children
            True
        """
        from fitball.exports.arviz import datatree

        return datatree(self)
