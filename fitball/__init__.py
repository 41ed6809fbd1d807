"""fitball fits physical models of a bouncing tennis ball to measured impacts.

From a table of impacts before and after a bounce (speeds, angles, spins) it finds the parameters of
the ball and the court, how sure one can be of each, and which the data do not determine:

    import fitball

    fit = fitball.calibrate("my_balls.csv")
    print(fit.report())
    fit.predict(impact="v_1=17, theta_1=10..60 deg:6").report()

`help(fitball.calibrate)` has all options; each function here is a verb of the command line
`fitball` as well. The manual: docs/index.md of the project, docs/python.md for Python.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from fitball.version import __version__

if TYPE_CHECKING:
    from fitball.base.errors import FitballError
    from fitball.base.values import Ball, Impacts, impacts
    from fitball.batches.batch import Batch
    from fitball.data.force import contact_time
    from fitball.data.read import load_table
    from fitball.data.scene import Scene, load_scene
    from fitball.data.table import ImpactTable
    from fitball.fit_verbs import export, load_fit, plan, plot, predict, simulate
    from fitball.inference.schema import Verdict
    from fitball.models.model import Model
    from fitball.models.own import model_from
    from fitball.models.registry import model
    from fitball.models.types import Rebound, regime_name
    from fitball.results.drawn import Drawn
    from fitball.results.exported import Exported
    from fitball.results.film import Film
    from fitball.results.fit import Fit
    from fitball.results.result import Frames, Result
    from fitball.verbs import (
        batch,
        bench,
        calibrate,
        check,
        compare,
        load_batch,
        rederive,
        track,
    )

_HOMES = {
    "fitball.verbs": "calibrate check compare track batch rederive bench load_batch",
    "fitball.fit_verbs": "predict plan plot simulate export load_fit",
    "fitball.data.force": "contact_time",
    "fitball.data.read": "load_table",
    "fitball.data.scene": "Scene load_scene",
    "fitball.data.table": "ImpactTable",
    "fitball.base.errors": "FitballError",
    "fitball.batches.batch": "Batch",
    "fitball.models.model": "Model",
    "fitball.results.drawn": "Drawn",
    "fitball.results.exported": "Exported",
    "fitball.results.film": "Film",
    "fitball.results.fit": "Fit",
    "fitball.inference.schema": "Verdict",
    "fitball.models.own": "model_from",
    "fitball.models.registry": "model",
    "fitball.models.types": "Rebound regime_name",
    "fitball.results.result": "Frames Result",
    "fitball.base.values": "Ball Impacts impacts",
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names.split()}
__all__ = [
    "Ball",
    "Batch",
    "Drawn",
    "Exported",
    "Film",
    "Fit",
    "FitballError",
    "Frames",
    "ImpactTable",
    "Impacts",
    "Model",
    "Rebound",
    "Result",
    "Scene",
    "Verdict",
    "__version__",
    "batch",
    "bench",
    "calibrate",
    "check",
    "compare",
    "contact_time",
    "export",
    "impacts",
    "load_batch",
    "load_fit",
    "load_scene",
    "load_table",
    "model",
    "model_from",
    "plan",
    "plot",
    "predict",
    "rederive",
    "regime_name",
    "simulate",
    "track",
]


def __dir__() -> list[str]:
    return sorted(__all__)


# Checkers know the names above, and that there are no others.
if not TYPE_CHECKING:

    def __getattr__(name: str) -> Any:
        if name not in _HOME_OF:
            raise AttributeError(f"module 'fitball' has no attribute '{name}'")
        return getattr(import_module(_HOME_OF[name]), name)
