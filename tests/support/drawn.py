"""What a figure shows: dots, bars and whether any is cut off."""

import numpy as np
from matplotlib.collections import LineCollection


def dots(axis, *markers):
    """Places (dots, 2) of markers without a line."""
    lines = [
        line
        for line in axis.lines
        if line.get_marker() in markers and line.get_linestyle() == "None"
    ]
    return np.concatenate([line.get_xydata() for line in lines])


def bars(axis):
    """Ends (bars, 2 ends, 2) of bars, a piece for each call that drew some."""
    return [
        np.array(one.get_segments()) for one in axis.collections if isinstance(one, LineCollection)
    ]


def cut_off(figure):
    """Dots and ends of bars that lie outside of their panels."""
    found = 0
    for axis in figure.axes:
        places = [line.get_xydata() for line in axis.lines if line.get_linestyle() == "None"]
        places += [ends.reshape(-1, 2) for ends in bars(axis) if ends.size]
        places += [
            np.asarray(one.get_offsets())
            for one in axis.collections
            if not isinstance(one, LineCollection)
        ]
        for k, ends in enumerate((axis.get_xlim(), axis.get_ylim())):
            along = np.concatenate(
                [np.asarray(one, float)[:, k] for one in places] or [np.empty(0)]
            )
            along = along[np.isfinite(along)]
            found += int(((along < min(ends)) | (along > max(ends))).sum())
    return found
