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
    collections = [piece for piece in axis.collections if isinstance(piece, LineCollection)]
    return [np.array(piece.get_segments()) for piece in collections]


def cut_off(figure):
    """Dots and ends of bars that lie outside of their panels."""
    outside = 0
    for axis in figure.axes:
        unjoined = [line for line in axis.lines if line.get_linestyle() == "None"]
        dotted = [piece for piece in axis.collections if not isinstance(piece, LineCollection)]
        ends = [piece for piece in bars(axis) if piece.size]
        points = [np.empty((0, 2))]
        points += [line.get_xydata() for line in unjoined]
        points += [piece.get_offsets() for piece in dotted]
        points += [piece.reshape(-1, 2) for piece in ends]
        x, y = np.concatenate(points).astype(float).T
        outside += count_outside(x, axis.get_xlim())
        outside += count_outside(y, axis.get_ylim())
    return outside


def count_outside(values, limits):
    """How many numbers are not within two limits; those that are no number count as within."""
    below = values < min(limits)
    above = values > max(limits)
    return int(np.count_nonzero(below | above))
