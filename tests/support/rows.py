"""Rows of frames, and intervals by Student's t."""

import numpy as np
from scipy.stats import t


def row(frame, **wanted):
    """The only row with these values."""
    for name, value in wanted.items():
        frame = frame[frame[name] == value]
    assert len(frame) == 1, frame
    return frame.iloc[0]


def interval_of_mean(values, error=None):
    """Student's interval of 95 %; the error is a share of the sd, 1/sqrt(n) of a mean."""
    count = len(values)
    if error is None:
        error = 1.0 / np.sqrt(count)
    return t.interval(
        0.95,
        count - 1,
        values.mean(),
        error * values.std(ddof=1),
    )
