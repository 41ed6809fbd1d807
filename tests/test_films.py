"""Films as cameras and phones write them: stamps, rates, turned pictures, damaged files."""

import sys
from fractions import Fraction

import numpy as np
import pytest
from support.clips import frame_of, tagged, write

from fitball.base.errors import FolderError, InputError, ParameterError
from fitball.video.films import open_film
from fitball.video.stamps import rate_of, read_stamps

av = pytest.importorskip("av")

ANDROID = {"com.android.capture.fps": "240.000000", "com.android.version": "14"}
APPLE = {
    "com.apple.quicktime.make": "Apple",
    "com.apple.quicktime.full-frame-rate-playback-intent": "0",
}


def codes(clip):
    """The codes of the notes of a clip."""
    return [note.code for note in clip.notes]


def test_frames_are_those_that_were_written_in_order_at_each_call(tmp_path):
    clip = open_film(write(tmp_path / "a.mp4"))
    assert (clip.width, clip.height, clip.count, clip.rate_source) == (64, 48, 20, "stamps")
    assert clip.camera_rate == pytest.approx(240.0)
    for _ in range(2):
        frames = list(clip.frames())
        assert [frame.number for frame in frames] == list(range(20))
        assert [frame.time for frame in frames] == pytest.approx(np.arange(20) / 240.0)
    white = frames[7].luma[frames[7].luma > 120]
    expected = frame_of(7)[..., 0] > 120
    assert np.mean((frames[7].luma > 120) == expected) > 0.98
    assert white.size == pytest.approx(expected.sum(), rel=0.03)
    assert frames[0].chroma.shape == (24, 32, 2)


@pytest.mark.parametrize(
    ("name", "options", "chroma", "levels"),
    [
        ("a.mov", {"codec": "libx265", "pixels": "yuv420p10le"}, (24, 32), (16.0, 235.0)),
        ("a.mp4", {"pixels": "yuv422p"}, (48, 32), (16.0, 235.0)),
        ("a.mp4", {"pixels": "yuvj420p"}, (24, 32), (0.0, 255.0)),
        ("a.avi", {"codec": "mjpeg", "pixels": "yuvj422p"}, (48, 32), (0.0, 255.0)),
        ("a.avi", {"codec": "mpeg4"}, (24, 32), (16.0, 235.0)),
        ("a.mts", {}, (24, 32), (16.0, 235.0)),
    ],
)
def test_codes_of_pictures(tmp_path, name, options, chroma, levels):
    """A picture of black and light grey has its levels, whatever the code."""
    quiet = {"x265-params": "log-level=none"} if options.get("codec") == "libx265" else {}
    clip = open_film(write(tmp_path / name, codec_options=quiet, **options))
    frame = next(clip.frames())
    assert frame.chroma.shape[:2] == chroma
    assert (clip.black, clip.white) == levels
    bright = (np.median(frame.luma[:, 15:30]) - clip.black) / (clip.white - clip.black)
    assert bright == pytest.approx(200.0 / 255.0, abs=0.02)
    assert clip.times == pytest.approx(np.arange(20) / 240.0, abs=1e-4)


@pytest.mark.parametrize(
    ("rotation", "bright", "readout"),
    [(90, "bottom", (1, 0)), (-90, "top", (-1, 0)), (180, "right", (0, -1))],
)
def test_turned_pictures_are_upright(tmp_path, rotation, bright, readout):
    """The bright half lies at the left of what is stored; players turn counterclockwise by the
    angle of the display matrix.
    """
    clip = open_film(write(tmp_path / "a.mp4", rotation=rotation))
    luma = next(clip.frames()).luma.astype(float)
    height, width = luma.shape
    assert (width, height) == (clip.width, clip.height)
    halves = {
        "top": luma[: height // 2],
        "bottom": luma[height // 2 :],
        "left": luma[:, : width // 2],
        "right": luma[:, width // 2 :],
    }
    assert max(halves, key=lambda side: halves[side].mean()) == bright
    assert clip.readout == readout


def test_android_slow_motion_is_stretched_by_a_whole_number(tmp_path):
    clip = open_film(tagged(tmp_path / "a.mp4", ANDROID, rate=30))
    assert (clip.rate_source, clip.stretch) == ("android tag", 8.0)
    assert clip.camera_rate == pytest.approx(240.0)
    assert clip.filmed(clip.times) == pytest.approx(np.arange(20) / 240.0, abs=1e-6)


def test_android_at_full_rate_is_not_stretched(tmp_path):
    clip = open_film(tagged(tmp_path / "a.mp4", ANDROID, rate=240))
    assert (clip.rate_source, clip.stretch) == ("android tag", 1.0)


@pytest.mark.parametrize(("played", "stretch"), [(239.981, 1.0), (29.97, 8.0), (30.0, 8.0)])
def test_stamps_are_finer_than_a_tag(played, stretch):
    rate = rate_of(played, ANDROID, 0.0)
    assert (rate.stretch, rate.camera) == (stretch, pytest.approx(stretch * played))
    assert not rate.notes


def test_a_tag_that_is_no_multiple_of_the_stamps_is_noted():
    rate = rate_of(25.0, ANDROID, 0.0)
    assert rate.stretch == pytest.approx(9.6)
    assert [note.code for note in rate.notes] == ["rates-differ"]
    assert rate_of(25.0, {"com.android.capture.fps": "x"}, 0.0).source == "stamps"


def test_slow_motion_of_an_iphone_asks_for_the_rate(tmp_path):
    path = tagged(tmp_path / "a.mov", APPLE, rate=30)
    clip = open_film(path)
    assert (clip.rate_source, clip.stretch, codes(clip)) == ("stamps", 1.0, ["no-rate-tag"])
    stated = open_film(path, fps=240.0)
    assert (stated.rate_source, stated.stretch, codes(stated)) == ("option", pytest.approx(8.0), [])
    assert not codes(open_film(tagged(tmp_path / "b.mov", APPLE, rate=240)))


def test_stamps_in_milliseconds_are_no_rate_of_250(tmp_path):
    """Matroska rounds to 1 ms: steps are 4 and 5 ms, their median is that of 250/s."""
    clip = open_film(write(tmp_path / "a.mkv", count=60))
    assert clip.camera_rate == pytest.approx(240.0, rel=1e-3)
    assert codes(clip) == ["rounded-stamps"]
    assert np.diff(clip.times) == pytest.approx(1.0 / 240.0, rel=1e-3)


def test_dropped_frames_keep_their_stamps(tmp_path):
    ticks = [k for k in range(30) if k not in (7, 8, 20)]
    path = write(tmp_path / "a.mp4", count=27, stamps=ticks, tick=Fraction(1, 240))
    clip = open_film(path)
    assert clip.camera_rate == pytest.approx(240.0)
    assert clip.times == pytest.approx(np.array(ticks) / 240.0, abs=1e-6)
    [note] = clip.notes
    assert note.code == "dropped-frames"
    assert "3 frames" in note.text


def test_a_variable_rate_keeps_each_stamp():
    rng = np.random.default_rng(4)
    stamps = np.cumsum(rng.uniform(0.012, 0.021, 200))
    stamps -= stamps[0]
    read = read_stamps(stamps, 1e-5)
    assert read.times.tolist() == stamps.tolist()
    assert read.rate == pytest.approx(1.0 / np.diff(stamps).mean(), rel=0.02)
    assert [note.code for note in read.notes] == ["variable-rate"]


def test_stamps_that_go_back_are_counted(tmp_path):
    """AVI has no presentation stamps: B-frames come with those of other frames."""
    clip = open_film(write(tmp_path / "a.avi"))
    assert codes(clip) == ["stamps-go-back"]
    assert clip.times == pytest.approx(np.arange(20) / 240.0)
    rows = [int(np.argmin(frame.luma[:, 7])) for frame in clip.frames()]
    assert rows == sorted(rows)


def test_repeated_frames_are_left_out_and_noted(tmp_path):
    numbers = [k // 2 for k in range(40)]
    clip = open_film(write(tmp_path / "a.mp4", count=40, numbers=numbers))
    assert codes(clip) == ["repeated-frames"]
    assert [frame.number for frame in clip.frames()][:5] == [0, 2, 4, 6, 8]
    # Where nothing moves for long, frames are alike and no repeats.
    still = open_film(write(tmp_path / "b.mp4", count=40, numbers=[0] * 30 + [*range(10)]))
    assert (still.count, codes(still)) == (40, [])


def test_a_part_of_a_film(tmp_path):
    path = write(tmp_path / "a.mp4", count=60)
    clip = open_film(path, begin=0.1, end=0.2)
    frames = list(clip.frames())
    assert [frames[0].number, frames[-1].number] == [24, 47]
    assert clip.filmed(clip.times)[0] == 0.0
    with pytest.raises(InputError) as caught:
        open_film(path, begin=0.24)
    assert caught.value.code == "few-frames"
    for wrong in ({"begin": 0.2, "end": 0.1}, {"begin": -1.0}):
        with pytest.raises(ParameterError) as refused:
            open_film(path, **wrong)
        assert refused.value.code == "film-part"
    with pytest.raises(ParameterError) as rate:
        open_film(path, fps=-240.0)
    assert rate.value.code == "out-of-bounds"


INTERLACED = {"flags": "+ilme+ildct", "x264-params": "interlaced=1:tff=1"}


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ({"codec_options": INTERLACED}, "interlaced"),
        ({"square": Fraction(4, 3)}, "no-square-pixels"),
        ({"size": (4160, 32)}, "large-picture"),
        ({"count": 3}, "few-frames"),
    ],
)
def test_films_that_cannot_be_measured(tmp_path, options, code):
    with pytest.raises(InputError) as caught:
        open_film(write(tmp_path / "a.mp4", **options))
    assert caught.value.code == code


def test_files_that_are_cut_off_or_changed(tmp_path):
    """Before the index, within the frames, and with bytes that were changed."""
    path = write(tmp_path / "a.mp4", count=60)
    whole = path.read_bytes()
    first = write(tmp_path / "b.mp4", 60, container_options={"movflags": "faststart"}).read_bytes()
    changed = bytearray(first)
    changed[first.index(b"mdat") + 900 :: 97] = bytes(
        len(changed[first.index(b"mdat") + 900 :: 97])
    )
    cases = {
        "cut.mp4": (whole[: len(whole) // 2], "not-a-film"),
        "late.mp4": (first[: int(0.7 * len(first))], "broken-film"),
        "bytes.mp4": (bytes(changed), "broken-film"),
        "empty.mp4": (b"", "not-a-film"),
        "text.mov": (b"v_y1,v_y2\n5,4\n", "not-a-film"),
        "list.mp4": (b"#EXTM3U\n#EXTINF:10,\nhttp://localhost/a.ts\n", "not-a-film"),
        "script.mp4": (b"ffconcat version 1.0\nfile a.mp4\n", "not-a-film"),
    }
    for name, (content, code) in cases.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError) as caught:
            open_film(tmp_path / name)
        assert (name, caught.value.code) == (name, code)
        assert name in str(caught.value)
    with pytest.raises(FolderError) as missing:
        open_film(tmp_path / "none.mp4")
    assert missing.value.code == "not-found"


def test_without_the_package_the_error_says_what_to_type(tmp_path, monkeypatch):
    path = write(tmp_path / "a.mp4")
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(InputError) as caught:
        open_film(path)
    assert caught.value.code == "no-pyav"
    assert 'pip install "fitball[film]"' in str(caught.value)
    assert "\n" not in str(caught.value)
