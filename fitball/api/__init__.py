"""The Python interface; the verbs of the command line call the same functions.

Offers: `calibrate`, `load_fit`, `Fit`, `predict`, `compare`, `Comparison`, `simulate`, `Course`, `plan`, `Plan`,
`export`, `port`, `plot`, `cite`, `check`. `tracking` has `track`: it needs more of scipy.
May import: exports, report, inference, tracks, models, data, scheduling.
"""

from fitball.api.calibrating import Comparison, Run, begin, calibrate, compare, pose
from fitball.api.fit import Fit, cite, export, load_fit, plan, plot, port, predict, simulate
from fitball.api.predicting import Plan
from fitball.api.reading import Checked, check
from fitball.api.simulating import Course

__all__ = [
    "Checked", "Comparison", "Course", "Fit", "Plan", "Run", "begin", "calibrate", "check", "cite", "compare",
    "export", "load_fit", "plan", "plot", "port", "pose", "predict", "simulate",
]  # fmt: skip
