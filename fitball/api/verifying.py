"""A port of a fit, compared with the fit on its golden impacts. The file is read and compared; the result is text or
plain data.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fitball.api.fit import FitOrFolder, fit_of
from fitball.api.reading import PathLike
from fitball.data.ports import PortFile, read_port
from fitball.errors import Fault, ParameterError, ResultFolderError, TableError
from fitball.exports.bounces import bounces_of, joined
from fitball.exports.tables import golden_ids
from fitball.inference.prediction.outputs import PortCheck, check_port
from fitball.inference.results.results import Golden
from fitball.inference.results.source import INCIDENT
from fitball.kinds import checked
from fitball.observables import OBSERVABLES, SI_UNITS
from fitball.report.form.document import columns
from fitball.wording import option

DEFAULT_TOLERANCE = 1e-9
# Relative difference of an incident state in the file from the golden one: rounding at most.
REPEATED = 1e-6
EXPLANATION = (
    "Relative: differences of speeds, and of spins times the radius, are divided by the incident speed of centre\n"
    "and surface, times by their own value, path and turn between the flights by what that speed goes in between.\n"
    "Angles are in radians. Double precision reaches 1e-12."
)


@dataclass(frozen=True)
class Verified:
    """A port of `model` on the golden impacts named `ids`."""

    check: PortCheck
    ids: tuple[str, ...]
    model: str

    @property
    def outcome(self) -> str:
        """Whether it passed, in one line."""
        failed = f"FAILED: {int(self.check.failed.sum())} of {len(self.ids)} impacts"
        return f"{'passed' if self.check.passed else failed} (tolerance {self.check.tolerance:g} relative)"

    @property
    def exit_code(self) -> int:
        """0 if every impact passes, else 1."""
        return 0 if self.check.passed else 1

    def report(self) -> str:
        """The result as text."""
        check = self.check
        outputs = [["output", "largest difference", "relative", "at", ""]] + [
            [item.name, f"{item.absolute:.3g} {SI_UNITS[item.name]}", f"{item.relative:.2g}", self.ids[item.worst],
             "ok" if item.relative <= check.tolerance else "FAIL"]
            for item in check.outputs
        ]  # fmt: skip
        impacts = [["impact", "relative", "", "regime"]] + [
            [label, f"{check.relative[k]:.2g}", "FAIL" if check.failed[k] else "ok",
             check.regimes[k] + ("  (the port has another)" if k in check.regimes_wrong else "")]
            for k, label in enumerate(self.ids)
        ]  # fmt: skip
        head = f"Port of {self.model} on {len(self.ids)} golden impacts: {self.outcome}"
        tables = ("\n".join(columns(rows, left=len(rows[0]))) for rows in (outputs, impacts))
        return "\n\n".join([head, *tables, EXPLANATION])

    def json(self) -> dict[str, Any]:
        """The result for other programs: SI units, angles in radians."""
        check = self.check
        return {
            "kind": "fitball verify",
            "model": self.model,
            "passed": check.passed,
            "tolerance": check.tolerance,
            "outputs": {
                item.name: {
                    "unit": SI_UNITS[item.name],
                    "absolute": item.absolute,
                    "relative": item.relative,
                    "impact": self.ids[item.worst],
                }
                for item in check.outputs
            },
            "impacts": [
                {
                    "id": label,
                    "relative": float(check.relative[k]),
                    "regime": check.regimes[k],
                    "regime_agrees": k not in check.regimes_wrong,
                    "passed": not bool(check.failed[k]),
                }
                for k, label in enumerate(self.ids)
            ],
        }


@checked
def verify(
    port: PathLike,
    fit: FitOrFolder | None = None,
    tolerance: float = DEFAULT_TOLERANCE,
    levels: Mapping[str, str] | None = None,
) -> Verified:
    """Compare the rebounds that a port computed for the golden impacts, in a file, with its fit (default: the one
    beside the file). `levels` (column -> label) are those with which the golden impacts were exported.

    Raises ParameterError, ResultFolderError, and TableError for a file of other impacts.
    """
    if not (math.isfinite(tolerance) and tolerance > 0.0):
        raise ParameterError(f"{option('tolerance', f'{tolerance:g}')}: expected a positive number")
    place = Path(port)
    if fit is None:
        fit = place.parent / "fit.json"
        if not fit.exists():
            raise ResultFolderError(f"{port}: no fit.json beside it; name the fit with {option('fit', 'FIT')}")
    saved, given = fit_of(fit), read_port(place)
    golden, _labels = joined(bounces_of(saved, levels))
    ids = golden_ids(golden)
    order = _rows_of(given, ids)
    _check_incident(given, order, golden)
    absent = [OBSERVABLES[name] for name in given.outputs if not saved.fitted.model.gives(OBSERVABLES[name])]
    if absent:
        message = f"model {saved.fitted.model_name} has no {absent[0].title}; delete the column"
        raise TableError(given.source, [Fault(message, column=absent[0].name)])
    outputs = {name: values[order] for name, values in given.outputs.items()}
    regimes = None if given.regimes is None else tuple(given.regimes[k] for k in order)
    check = check_port(saved.fitted, golden, outputs, regimes, tolerance)
    return Verified(check, ids, saved.fitted.model_name)


def _rows_of(port: PortFile, ids: tuple[str, ...]) -> list[int]:
    """The row of the port for each golden impact. Raises TableError."""
    if port.ids is None:
        if port.count != len(ids):
            message = f"read {port.count} rows; expected {len(ids)}, one for each golden impact, or a column id"
            raise TableError(port.source, [Fault(message)])
        return list(range(port.count))
    rows = {label: k for k, label in enumerate(port.ids)}
    faults = [
        Fault(f"read '{label}', which is repeated or no golden impact of this fit; expected {ids[0]} to {ids[-1]}",
              row=k + 1, column="id")
        for k, label in enumerate(port.ids)
        if label not in ids or rows[label] != k
    ]  # fmt: skip
    faults += [Fault(f"no row '{label}'; expected every golden impact once") for label in ids if label not in rows]
    if faults:
        raise TableError(port.source, faults)
    return [rows[label] for label in ids]


def _check_incident(port: PortFile, order: Sequence[int], golden: Golden) -> None:
    """Raise TableError if an incident state in the file is not that of the golden impact."""
    faults = []
    for name in (name for name in INCIDENT if name in port.incident):
        read = port.incident[name]
        for row, meant in zip(order, getattr(golden.impacts, name).tolist(), strict=True):
            if abs(read[row] - meant) > REPEATED * (1.0 + abs(meant)):
                message = f"read {read[row]:g}, expected {meant:g} (SI): this is not the golden impact of this fit"
                faults.append(Fault(message, row=row + 1, column=name))
    if faults:
        raise TableError(port.source, faults)
