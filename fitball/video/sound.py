"""Recordings of sound, and the sound of films, as one signal."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np

from fitball.base.errors import FolderError, Note
from fitball.base.numbers import percent
from fitball.base.text import one_line
from fitball.base.values import FloatArray
from fitball.video.media import opened, refusal

# Longest recording [s]: five minutes of drops.
_LONGEST = 600.0
# Shortest: four bounces.
_SHORTEST = 0.3
# Lowest rate [1/s] whose samples are as fine as times are wanted.
_LEAST_RATE = 8000.0
# Share of a length that the container states by which the decoded one may differ.
_SAME_LENGTH = 0.02
# Time [s] by which it may: coders add silence to whole blocks.
_PADDING = 0.15
# Time [s] by which stamps may leave the count of samples.
_MOST_GAP = 2e-3
# Share of the largest sample from which samples are clipped, where so many are.
_CLIPPED = 0.999
_CLIPPED_SHARE = 1e-4


class Recording(NamedTuple):
    """A signal (samples,), at most 1 in size, of a `rate` [1/s], of the channel that is loudest
    over its own noise.
    """

    name: str
    signal: Annotated[FloatArray, "samples"]
    rate: float
    notes: tuple[Note, ...]


def read_sound(path: Path) -> Recording:
    """The sound of a recording or a film. WAV is read by SciPy, other formats by PyAV.

    Raises:
        FolderError: no such file (`not-found`).
        InputError: PyAV is needed and not installed (`no-pyav`); the file has no sound
            (`no-sound`), is damaged, or ends before its stated length (`broken-film`), is too
            short or too long (`length-of-sound`), or its rate is too low (`low-rate`).
    """
    channels, rate = _wav(path) if path.suffix.lower() == ".wav" else _decoded(path)
    length = channels.shape[1] / rate
    if not _SHORTEST < length < _LONGEST:
        words = f"lasts {length:.3g} s; expected {_SHORTEST:g} to {_LONGEST:g} s: cut it"
        raise refusal(path, "length-of-sound", words)
    if rate < _LEAST_RATE:
        words = f"has {rate:g} samples/s; expected at least {_LEAST_RATE:g}: record it anew"
        raise refusal(path, "low-rate", words)
    largest = np.abs(channels).max(axis=1)
    if not largest.any():
        raise refusal(path, "no-sound", "is silent; expected the sound of bounces")
    quiet = np.quantile(np.abs(channels), 0.5, axis=1)
    signal = channels[int(np.argmax(largest / (quiet + 1e-9 * largest.max())))]
    signal = signal / np.abs(signal).max()
    clipped = float(np.mean(np.abs(signal) > _CLIPPED))
    notes = list[Note]()
    if clipped > _CLIPPED_SHARE:
        words = f"{percent(clipped)} of the samples are at the limit: record it less loud"
        notes.append(Note("clipped", words))
    return Recording(path.stem, signal, rate, tuple(notes))


def _wav(path: Path) -> tuple[FloatArray, float]:
    """Channels (channels, samples) of a WAV file, and its rate [1/s]. Raises what `read_sound`
    does.
    """
    from scipy.io import wavfile

    try:
        with warnings.catch_warnings():
            # Chunks of other programs are passed over; a file that ends early is none to use.
            warnings.simplefilter("ignore", wavfile.WavFileWarning)
            warnings.filterwarnings("error", message="Reached EOF prematurely")
            rate, samples = wavfile.read(path)
    except FileNotFoundError:
        words = f"{one_line(str(path))}: no such file; expected a recording"
        raise FolderError(words, "not-found") from None
    except (OSError, ValueError, wavfile.WavFileWarning) as error:
        words = f"is no whole WAV file ({one_line(str(error))}): copy it again"
        raise refusal(path, "broken-film", words) from None
    return _as_floats(samples.reshape(len(samples), -1).T), float(rate)


def _as_floats(samples: Any) -> FloatArray:
    """Samples as numbers of at most 1, around zero."""
    floats = np.asarray(samples, dtype=np.float64)
    if samples.dtype == np.uint8:
        floats = floats - 128.0
    if samples.dtype.kind in "iu":
        floats = floats / float(2 ** (8 * samples.dtype.itemsize - 1))
    return floats


def _decoded(path: Path) -> tuple[FloatArray, float]:
    """Channels (channels, samples) of a recording or film by PyAV, and its rate [1/s]. Raises what
    `read_sound` does.
    """
    pieces = list[FloatArray]()
    count = 0
    gap = 0.0
    with opened(path) as container:
        if not container.streams.audio:
            raise refusal(path, "no-sound", "has no sound")
        stream = container.streams.audio[0]
        stream.thread_type = "AUTO"
        rate = float(stream.rate)
        stated = float(stream.duration * stream.time_base) if stream.duration else 0.0
        begin = None
        for frame in container.decode(stream):
            piece = _as_floats(frame.to_ndarray())
            if not frame.format.is_planar:
                piece = piece.reshape(-1, frame.layout.nb_channels).T
            if frame.pts is not None:
                time = float(frame.pts * frame.time_base)
                begin = time if begin is None else begin
                gap = max(gap, abs(time - begin - count / rate))
            pieces.append(piece)
            count += piece.shape[1]
            if count > _LONGEST * rate:
                break
    if not pieces:
        raise refusal(path, "no-sound", "has no sound that can be decoded; copy it again")
    length = count / rate
    if stated - length > _SAME_LENGTH * stated + _PADDING:
        words = f"states {stated:.4g} s, {length:.4g} s can be read: copy it again"
        raise refusal(path, "broken-film", words)
    if gap > _MOST_GAP:
        words = f"has gaps or repeats: its stamps leave the samples by {1e3 * gap:.3g} ms"
        raise refusal(path, "broken-film", f"{words}; copy it again")
    return np.concatenate(pieces, axis=1), rate
