"""Texts of trackers that are no table with a header: MTrack2 of ImageJ, MOTChallenge, VIA. Each is
read to the positions and times of one bounce of which six frames are lost.
"""

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from support.trackers import (
    BALL_BY_FRAME,
    CAMERA,
    FRAME,
    METRES,
    RACKET,
    RACKET_BY_FRAME,
    TIME,
    X,
    clip,
    csv_text,
    deeplabcut,
    labelled_hdf5,
    mot_boxes,
    mtrack2,
    via_regions,
)

from fitball.base.errors import InputError
from fitball.data.scene import CameraSection, Scene
from fitball.tracks.read import read_tracks

SEVERAL = [RACKET_BY_FRAME, BALL_BY_FRAME, BALL_BY_FRAME]


def read(folder, text, ball="", name="film.txt"):
    """Tracks and the codes of notes of a file with this text."""
    path = folder / name
    path.write_text(text, encoding="utf-8")
    tracks, notes = read_tracks([path], Scene(camera=CameraSection(**CAMERA)), {}, ball)
    return tracks, [note.code for note in notes]


def assert_is_the_bounce(track, places=3e-8):
    """Hold that positions are those of the film, rounded, and times but for where they begin."""
    assert_allclose(track.time - track.time[0], TIME - TIME[0], atol=1e-9)
    assert_allclose(np.diff(track.x), np.diff(METRES[:, 0]), atol=places)
    assert_allclose(np.diff(track.y), np.diff(METRES[:, 1]), atol=places)


# ---- MTrack2


@pytest.mark.parametrize("name", ["Results.txt", "Results.xls", "Results.csv"])
@pytest.mark.parametrize("summary", [True, False])
def test_results_of_mtrack2(tmp_path, summary, name):
    (track,), notes = read(tmp_path, mtrack2([BALL_BY_FRAME], summary), name=name)
    assert_is_the_bounce(track)
    assert track.frame.tolist() == (FRAME + 1).tolist()
    assert "rows-counted" not in notes


@pytest.mark.parametrize("most", [75, 2, 1])
def test_tracks_of_mtrack2_side_by_side_and_in_blocks(tmp_path, most):
    text = mtrack2(SEVERAL, most=most)
    racket, first, second = read(tmp_path, text)[0]
    assert [racket.id, first.id, second.id] == ["1", "2", "3"]
    assert_allclose(racket.x, 2e-3 * RACKET[:, 0], atol=1e-8)
    for ball in (first, second):
        assert_is_the_bounce(ball)
    (track,), notes = read(tmp_path, text, ball="2")
    assert_is_the_bounce(track)
    assert "objects" in notes
    with pytest.raises(InputError) as caught:
        read(tmp_path, text, ball="9")
    assert caught.value.code == "no-object"


def test_results_of_mtrack2_whose_trailing_blanks_were_cut(tmp_path):
    text = "\r\n".join(line.rstrip() for line in mtrack2([BALL_BY_FRAME]).splitlines())
    (track,), _ = read(tmp_path, text)
    assert_is_the_bounce(track)


def test_results_of_mtrack2_as_spreadsheets_write_them(tmp_path):
    text = mtrack2([RACKET_BY_FRAME, BALL_BY_FRAME])
    words = {
        "Tracks 1 to 2": "Tracks,1,to,2,,,",
        "\t": ",",
        "Distance traveled": "Distance,traveled",
    }
    for their, other in words.items():
        text = text.replace(their, other)
    _, ball = read(tmp_path, text)[0]
    assert_is_the_bounce(ball)


def test_blanks_in_place_of_tabs_lose_the_tracks_of_mtrack2(tmp_path):
    """One track alone has its places; of several it is not known whose they are."""

    def with_blanks(tracks):
        return "\n".join(" ".join(line.split()) for line in mtrack2(tracks).splitlines())

    (track,), _ = read(tmp_path, with_blanks([BALL_BY_FRAME]))
    assert_is_the_bounce(track)
    with pytest.raises(InputError) as caught:
        read(tmp_path, with_blanks([RACKET_BY_FRAME, BALL_BY_FRAME]))
    (fault,) = caught.value.faults
    assert (fault.code, fault.line) == ("row-length", 1)


def test_a_fault_of_mtrack2_is_told_by_its_line(tmp_path):
    lines = mtrack2([RACKET_BY_FRAME]).splitlines()
    lines[2] = "1\tx300\t400\t "
    with pytest.raises(InputError) as caught:
        read(tmp_path, "\n".join(lines))
    (fault,) = caught.value.faults
    assert (fault.code, fault.line, fault.column) == ("not-a-number", 3, "x")


# ---- MOTChallenge

BEHIND = {
    "results": ("0.97", "-1", "-1", "-1"),
    "detections": ("-1", "-1", "-1", "-1"),
    "truth": ("1", "7", "0.95"),
    "seven": ("0.97",),
}


@pytest.mark.parametrize("sign", [",", ", ", " ", "\t", ";"])
@pytest.mark.parametrize("kind", [*BEHIND])
def test_boxes_of_motchallenge_have_no_header(tmp_path, kind, sign):
    text = mot_boxes([BALL_BY_FRAME], BEHIND[kind]).replace(",", sign)
    (track,), notes = read(tmp_path, text)
    assert_is_the_bounce(track)
    assert_allclose(track.x, 2e-3 * X, atol=1e-7)
    assert notes.count("no-header") == 1
    assert "rows-counted" not in notes


def test_ids_of_motchallenge_are_objects(tmp_path):
    text = mot_boxes([RACKET_BY_FRAME, BALL_BY_FRAME])
    racket, ball = read(tmp_path, text)[0]
    assert_is_the_bounce(ball)
    assert len(racket.x) == len(RACKET)
    (track,), _ = read(tmp_path, text, ball="2")
    assert_is_the_bounce(track)


@pytest.mark.parametrize(
    "columns",
    [
        ["frame", "x", "y"],
        ["frame", "x", "y", "x", "y", "x", "y"],
        ["frame", "frame", "x", "y", "none", "x", "y"],
        ["frame", "frame", "x", "y", "x", "y", "x", "x", "y", "x"],
    ],
)
def test_other_numbers_without_a_header_are_refused(tmp_path, columns):
    table = clip(frame=FRAME, none=-1.0)[columns]
    with pytest.raises(InputError) as caught:
        read(tmp_path, csv_text(table, index=False, header=False))
    assert caught.value.code == "no-positions"


# ---- VGG Image Annotator


@pytest.mark.parametrize("kind", ["rect", "circle", "point"])
def test_regions_of_the_vgg_image_annotator(tmp_path, kind):
    (track,), notes = read(tmp_path, via_regions([BALL_BY_FRAME], kind), name="via.csv")
    assert_is_the_bounce(track, places=1e-9)
    assert_allclose(track.x, 2e-3 * X)
    assert track.frame.tolist() == FRAME.tolist()
    assert "rows-counted" not in notes
    racket, ball = read(tmp_path, via_regions([RACKET_BY_FRAME, BALL_BY_FRAME], kind))[0]
    assert_is_the_bounce(ball, places=1e-9)
    assert_allclose(racket.x, 2e-3 * RACKET[:, 0])


@pytest.mark.parametrize("shape", ['{""name"": ""polygon"", ""all_points_x"": [1]}', "rect", "[1]"])
def test_regions_of_other_shapes_are_refused(tmp_path, shape):
    header, first, *_ = via_regions([BALL_BY_FRAME]).splitlines()
    text = "\n".join([header, first, f'1.png,0,{{}},1,0,"{shape}",{{}}'])
    with pytest.raises(InputError) as caught:
        read(tmp_path, text, name="via.csv")
    (fault,) = caught.value.faults
    assert (fault.code, fault.line) == ("no-positions", 3)


# ---- pictures that were labelled in DeepLabCut


def labelled(parts=("ball", "racket")):
    """A table of labelled pictures, whose index has a folder, a film and a picture."""
    table = deeplabcut(parts)
    pictures = [("labeled-data", "film7", f"img{frame:04d}.png") for frame in FRAME]
    return table.set_axis(pd.MultiIndex.from_tuples(pictures))


def test_labelled_pictures_have_three_columns_of_an_index(tmp_path):
    table = labelled()
    (track,), notes = read(tmp_path, csv_text(table), name="CollectedData.csv")
    assert_is_the_bounce(track, places=1e-9)
    assert track.id == "film7"
    assert {"rows-counted", "above-header"}.isdisjoint(notes)
    labelled_hdf5(tmp_path / "CollectedData.h5", table)
    for source in (table, tmp_path / "CollectedData.h5"):
        (track,), _ = read_tracks([source], Scene(camera=CameraSection(**CAMERA)), {})
        assert_is_the_bounce(track, places=1e-9)
        assert track.id == "film7"


def test_pictures_of_several_films_are_several_clips(tmp_path):
    first = labelled()
    second = first.rename(index={"film7": "film8"})
    tracks, _ = read(tmp_path, csv_text(pd.concat([first, second])), name="CollectedData.csv")
    assert [track.id for track in tracks] == ["film7", "film8"]
    for track in tracks:
        assert_is_the_bounce(track, places=1e-9)
