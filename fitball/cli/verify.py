"""`fitball verify PORT.csv`: does another program compute the same bounce?"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

from fitball.errors import Fault, ParameterError, ResultFolderError, TableError

if TYPE_CHECKING:
    from fitball.data.read import PortFile
    from fitball.inference.results.results import Golden
    from fitball.values import FloatArray

DEFAULT_TOLERANCE = 1e-9
HELP = "check a port of a fitted model against its golden impacts"
DESCRIPTION = "Compare the outputs of another program with the golden impacts of a fit."
EXAMPLE = """PORT.csv holds what the port answers to the golden impacts: columns by name, with units as in impact
tables (v_x2, v_y2, omega_2, contact_time, v_2, theta_2; without a unit m/s, rad/s, s, deg), any of them, and a
column id, or the order of the golden impacts. A column regime, if there is one, is compared too.

The tolerance is relative: speeds to the incident speed, spins times the radius likewise, contact times to themselves.
Two double-precision programs agree to 1e-12; 1e-9 leaves room for ten printed digits.

examples:
  fitball export fits/wang_all/two-mass --to golden --inputs-only --out impacts.csv
  fitball verify port.csv --fit fits/wang_all/two-mass
  fitball verify port.csv --fit fits/wang_all/two-mass --tolerance 1e-5     a port in single precision

Exit code 0 if every impact passes, 1 if one fails."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add what the verb may be asked."""
    parser.add_argument("port", metavar="PORT.csv", help="outputs of the port for the golden impacts")
    parser.add_argument("--fit", metavar="FIT", help="result folder or fit.json (default: beside PORT.csv)")
    parser.add_argument(
        "--tolerance", type=float, default=DEFAULT_TOLERANCE, metavar="X", help="largest relative difference (1e-9)"
    )
    parser.add_argument("--json", action="store_true", help="print JSON (SI units, angles in radians)")
    parser.add_argument("--quiet", action="store_true", help="print the result alone")


def run(args: argparse.Namespace) -> int:
    """Compare the port and print where it deviates; 0 where it agrees, else 1."""
    if not (math.isfinite(args.tolerance) and args.tolerance > 0.0):
        raise ParameterError(f"--tolerance {args.tolerance:g}: expected a positive number")
    from fitball.data.read import read_port
    from fitball.exports.golden import golden_ids, port_json, port_text
    from fitball.inference.prediction.port_check import check_port
    from fitball.observables import OBSERVABLES
    from fitball.report.form.files import json_text
    from fitball.report.saved.fit_file import read_fit

    saved = read_fit(_fit_path(args.port, args.fit))
    port = read_port(Path(args.port))
    ids = golden_ids(saved.golden)
    order = _order(port, ids)
    _check_incident(port, order, saved.golden)
    outputs = {name: values[order] for name, values in port.outputs.items()}
    timed = [OBSERVABLES[name] for name in outputs if OBSERVABLES[name].timed]
    if timed and not saved.fitted.model.has_time:
        message = f"model {saved.fitted.model_name} has no {timed[0].title} to compare with; delete the column"
        raise TableError(port.source, [Fault(message, column=timed[0].name)])
    regimes = None if port.regimes is None else tuple(port.regimes[k] for k in order)
    check = check_port(saved.fitted, saved.golden, outputs, regimes, args.tolerance)
    if args.json:
        print(json_text(port_json(check, ids, saved.fitted.model_name)), end="")
    else:
        text = port_text(check, ids, saved.fitted.model_name)
        print(text[text.rindex("\n\n") + 2 :] if args.quiet else text)
    return 0 if check.passed else 1


def _fit_path(port: str, fit: str | None) -> Path:
    if fit is not None:
        return Path(fit)
    beside = Path(port).parent / "fit.json"
    if not beside.exists():
        raise ResultFolderError(f"{port}: no fit.json beside it; say with --fit FIT which fit was ported")
    return beside


def _order(port: PortFile, ids: tuple[str, ...]) -> list[int]:
    """For each golden impact the row of the port that answers it. Raises TableError."""
    if port.ids is None:
        if port.count != len(ids):
            message = f"read {port.count} rows; expected {len(ids)}, one for each golden impact, or a column id"
            raise TableError(port.source, [Fault(message)])
        return list(range(port.count))
    rows = {label: k for k, label in enumerate(port.ids)}
    faults = [
        Fault(f"read '{label}', which is no golden impact of this fit or comes twice; expected {ids[0]} to {ids[-1]}",
              row=k + 1, column="id")
        for k, label in enumerate(port.ids)
        if label not in ids or rows[label] != k
    ]  # fmt: skip
    faults += [Fault(f"no row '{label}'; expected every golden impact once") for label in ids if label not in rows]
    if faults:
        raise TableError(port.source, faults)
    return [rows[label] for label in ids]


# Printed digits of an incident state that is repeated in the file: any fewer and it is not the golden one.
REPEATED = 1e-6


def _check_incident(port: PortFile, order: list[int], golden: Golden) -> None:
    """Raise TableError where the file repeats another incident state than that of the golden impact."""
    faults = []
    for name in ("v_x1", "v_y1", "omega_1"):
        if name not in port.incident:
            continue
        meant: FloatArray = getattr(golden.impacts, name)
        for k, row in enumerate(order):
            read = port.incident[name][row]
            if abs(read - meant[k]) > REPEATED * (1.0 + abs(meant[k])):
                message = (
                    f"read {read:g}, but this golden impact has {meant[k]:g} (SI): is the port fed with this fit's?"
                )
                faults.append(Fault(message, row=row + 1, column=name))
    if faults:
        raise TableError(port.source, faults)
