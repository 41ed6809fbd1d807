"""A fit read back from its folder: `fit.json`, and the draws beside it where they are asked for."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import msgspec
import numpy as np

from fitball.data.table import ImpactTable
from fitball.errors import ResultFolderError
from fitball.inference.problem.force_records import ForceRecords
from fitball.inference.results.fitted_model import FittedModel
from fitball.inference.results.results import (
    Estimate,
    Fit,
    Golden,
    Posterior,
    RunStatus,
    Verdict,
    predicting,
    thinned,
)
from fitball.models.types import OUTPUTS, Rebound
from fitball.report.saved.data_file import DATA_NAME, read_data
from fitball.report.saved.fit_consistency import checked, outside
from fitball.report.saved.fit_file import (
    KIND,
    SCHEMA_VERSION,
    FitFile,
    FittedPart,
    GoldenPart,
    Incident,
    ParameterPart,
)
from fitball.report.saved.fit_text import fit_text
from fitball.report.saved.posterior_file import read_netcdf
from fitball.report.saved.run_file import RUN_NAME
from fitball.report.saved.structure import Content, damaged, place_of, read_json, refuse_foreign, structured
from fitball.values import FloatArray, Impacts

FIT_NAME = "fit.json"
POSTERIOR_NAME = "posterior.nc"


@dataclass(frozen=True)
class SavedFit:
    """A fit as `fit.json` has it: `file` is all of it, checked, `content` the same as plain values; `place` is where
    it lies, None where it was never saved.
    """

    status: RunStatus
    verdict: str
    parameters: Mapping[str, Estimate]
    derived: tuple[Estimate, ...]
    fitted: FittedModel
    golden: Golden
    file: FitFile
    content: Content
    place: Path | None

    @property
    def free_names(self) -> tuple[str, ...]:
        """The parameters that were fitted, in order."""
        return tuple(name for name, parameter in self.parameters.items() if parameter.verdict is not Verdict.FIXED)

    @property
    def at_common(self) -> str:
        """What is to be said of a bounce without a level, where parameters differ between levels; empty where none
        does.
        """
        pooled = {item.parameter: item.column for item in self.file.levels}
        return "; ".join(
            f"{name} differs between {column}s: taken at the value common to all, which is that of none of them"
            for name, column in pooled.items()
        )

    def beside(self, name: str) -> Path:
        """The file called `name` beside `fit.json`. Raises ResultFolderError for a fit that was never saved."""
        if self.place is None:
            raise ResultFolderError(f"{name}: this fit was not saved")
        return self.place.with_name(name)

    @property
    def complete(self) -> bool:
        """Whether all files that a fit is restored from lie beside it."""
        needed = [DATA_NAME, RUN_NAME, *([] if self.file.diagnostics is None else [POSTERIOR_NAME])]
        return self.place is not None and all(self.beside(name).exists() for name in needed)

    def posterior(self, *, agreeing: bool = True) -> Posterior | None:
        """All draws, from `posterior.nc` beside `fit.json`; None for a point fit.

        `fit.json` holds some of the same draws: unless they are equal to the last digit the two files belong to
        different runs, which is refused if the draws must be `agreeing`. Raises ResultFolderError for that, and for
        a file that is missing, damaged or foreign.
        """
        diagnostics = self.file.diagnostics
        if diagnostics is None:
            return None
        place = self.beside(POSTERIOR_NAME)
        shape = (diagnostics.ensembles, diagnostics.kept, diagnostics.walkers)
        posterior = read_netcdf(place, self.free_names, shape)
        for k, name in enumerate(posterior.names):
            for values in (posterior.values[..., k], posterior.prior_draws[:, k]):
                if outside(name, values):
                    raise damaged(place, f"draws of {name} lie outside its bounds")
        mine = self.fitted.with_draws(posterior.names, thinned(posterior, self.fitted.draws.shape[0])).draws
        if agreeing and not np.array_equal(mine, self.fitted.draws):
            raise ResultFolderError(
                f"{place}: these draws are of another fit than the fit.json beside them; calibrate again, or put the "
                "files of one run together"
            )
        return posterior

    def measured(self) -> tuple[ImpactTable, ForceRecords | None]:
        """The measurements, from `data.nc` beside `fit.json`. Raises ResultFolderError as `read_data` does."""
        return read_data(self.file.table, self.file.data, self.beside(DATA_NAME))

    @property
    def impacts(self) -> Impacts:
        """Every impact of the fit. Of a long table `fit.json` holds those alone that span its range, and the others
        are read from `data.nc`; ResultFolderError where that is missing, damaged or of another fit.
        """
        known = self.fitted.impacts
        return known if len(known) == self.file.table.impacts else self.measured()[0].impacts

    @cached_property
    def predicting(self) -> FittedModel:
        """The fitted model with the draws that predictions are made from. Raises ResultFolderError as `posterior`."""
        return predicting(self.fitted, self.posterior())


def read_fit(path: Path) -> SavedFit:
    """Read `fit.json`, or the one in a folder.

    Raises ResultFolderError for a missing, damaged or foreign file and for another schema version.
    """
    place = place_of(path, FIT_NAME)
    content = read_json(place)
    refuse_foreign(place, content, KIND, SCHEMA_VERSION)
    file = structured(place, content, FitFile)
    wrong = checked(file)
    if wrong is not None:
        raise damaged(place, wrong)
    return _saved(file, content, place)


def as_saved(fit: Fit) -> SavedFit:
    """A fit just made as it would be read back."""
    content = json.loads(fit_text(fit))
    return _saved(structured(Path(FIT_NAME), content, FitFile), content, None)


def _saved(file: FitFile, content: Content, place: Path | None) -> SavedFit:
    return SavedFit(
        status=file.status,
        verdict=file.verdict,
        parameters={name: _estimate(name, parameter) for name, parameter in file.parameters.items()},
        derived=tuple(_estimate(name, item) for name, item in file.derived.items()),
        fitted=_fitted(file, file.fitted),
        golden=_golden(file.golden),
        file=file,
        content=content,
        place=place,
    )


def _estimate(name: str, part: ParameterPart) -> Estimate:
    known = {field: value for field, value in msgspec.structs.asdict(part).items() if field != "thesis_units"}
    return Estimate(name=name, **known)


def _fitted(file: FitFile, part: FittedPart) -> FittedModel:
    return FittedModel(
        model_name=file.model.name,
        options=file.model.closures,
        ball=file.ball.ball(),
        tangential=part.tangential,
        names=part.names,
        point=np.array(part.point),
        draws=np.array(part.draws, dtype=np.float64).reshape(-1, len(part.names)),
        impacts=_impacts(part.impacts),
    )


def _impacts(part: Incident) -> Impacts:
    cor = None if part.cor is None else np.array(part.cor)
    return Impacts(np.array(part.v_x1), np.array(part.v_y1), np.array(part.omega_1), cor)


def _known(values: Sequence[float] | None, count: int) -> FloatArray:
    return np.full(count, np.nan) if values is None else np.array(values)


def _golden(part: GoldenPart) -> Golden:
    made, count = part.rebound, len(part.rebound.v_x2)
    return Golden(
        parameters=part.parameters,
        impacts=_impacts(part.impacts),
        rebound=Rebound(
            **{name: _known(getattr(made, name), count) for name in OUTPUTS},
            regime=np.array(made.regime, dtype=np.int64),
            status=np.zeros(count, dtype=np.int8),
        ),
    )
