"""Films of a few small frames, written by PyAV as cameras write them."""

from fractions import Fraction

import numpy as np
import pytest

# Width and height of a frame [px].
SIZE = (64, 48)


def frame_of(number, size=SIZE):
    """An RGB picture, brighter in its left half, with a dark square that moves by a pixel."""
    width, height = size
    picture = np.zeros((height, width, 3), np.uint8)
    picture[:, : width // 2] = 200
    row = 2 + number % (height - 8)
    picture[row : row + 5, 5:10] = 0
    return picture


def write(
    path,
    count=20,
    rate=240,
    codec="libx264",
    pixels="yuv420p",
    size=SIZE,
    tags=None,
    rotation=None,
    codec_options=None,
    container_options=None,
    stamps=None,
    tick=None,
    numbers=None,
    square=None,
):
    """Write a film. `tags` are metadata, `stamps` those of frames in ticks [s], `numbers` which
    picture each frame shows.
    """
    av = pytest.importorskip("av")
    with av.open(str(path), "w", options=container_options or {}) as container:
        container.metadata.update(tags or {})
        stream = container.add_stream(codec, rate=rate, options=codec_options or {})
        stream.width, stream.height = size
        stream.pix_fmt = pixels
        if square is not None:
            stream.codec_context.sample_aspect_ratio = square
        if tick is not None:
            stream.codec_context.time_base = tick
        if rotation is not None:
            stream.set_display_rotation(rotation)
        for k in range(count):
            picture = frame_of(k if numbers is None else numbers[k], size)
            frame = av.VideoFrame.from_ndarray(picture, "rgb24").reformat(format=pixels)
            frame.pts = k if stamps is None else stamps[k]
            frame.time_base = Fraction(1, rate) if tick is None else tick
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def tagged(path, tags, rate=30, count=20):
    """Write a film with tags as phones write them."""
    options = {"movflags": "use_metadata_tags"}
    return write(path, count, rate, tags=tags, container_options=options)
