"""Everything that is damaged, by name."""

from __future__ import annotations

from pathlib import Path

from fitball.studies.fuzz.harness import Target
from fitball.studies.fuzz.result_folders import result_folders
from fitball.studies.fuzz.user_files import hand_written
from fitball.studies.fuzz.with_fit import MakeFit, with_fit


def short_fit(folder: Path) -> None:
    """Write the result folder of a fit of grip-slip that is too short to converge, which is as good to damage."""
    from fitball.api import calibrate

    calibrate("wang_zero_spin.csv", model="grip-slip", seed=4, cores=1, max_steps=100).save(folder)


def all_targets(make_fit: MakeFit = short_fit) -> dict[str, Target]:
    """The targets by name, in a fixed order; `make_fit` is called when a target that needs a fit is built."""
    return {target.name: target for target in (*hand_written(), *with_fit(make_fit), *result_folders(make_fit))}
