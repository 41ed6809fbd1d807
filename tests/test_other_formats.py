"""Files that are no table are named, with the package that reads them: for impacts and positions
alike. Beginnings are those of files that the packages wrote.
"""

import io

import numpy as np
import pytest
import scipy.io
import scipy.io.wavfile

import fitball
from fitball.base.errors import InputError

# A file's name, how it begins, what its remedy names.
BEGINNINGS = [
    ("rig.tdms", b"TDSm\x0e\0\0\0h\x12\0\0", "nptdms"),
    ("renamed.csv", b"TDSm\x0e\0\0\0h\x12\0\0", "nptdms"),
    ("clip.tif", b"II*\0\x0e\0\0\0\x0e\0\0\x01", "tifffile"),
    ("labels.slp", b"\x89HDF\r\n\x1a\n\0\0", "sleap_io"),
    ("data.mat", b"MATLAB 7.3 MAT-file, Platform: GLNXA64\0", "h5py"),
    ("spots.xml", b'<?xml version="1.0"?>\n', "TrackMate"),
    ("lab.json", b'[{"v_x1": 1}]\n', "read_json"),
    ("book.csv", b"PK\x03\x04\x14\0", ".xlsx"),
]


def written(write, *arguments):
    """The bytes that a package writes."""
    file = io.BytesIO()
    write(file, *arguments)
    return file.getvalue()


SPEEDS = np.array([5.0, 4.0])
BY_PACKAGES = [
    ("a.mat", written(scipy.io.savemat, {"v": SPEEDS}), "scipy.io.loadmat"),
    ("a.wav", written(scipy.io.wavfile.write, 48_000, SPEEDS.astype("i2")), "wavfile"),
    ("a.npy", written(np.save, SPEEDS), "numpy.load"),
    ("a.npz", written(np.savez, SPEEDS), "numpy.load"),
]


@pytest.mark.parametrize("verb", [fitball.calibrate, fitball.track])
@pytest.mark.parametrize(("name", "data", "remedy"), [*BEGINNINGS, *BY_PACKAGES])
def test_other_formats_are_named_with_what_reads_them(tmp_path, name, data, remedy, verb):
    if verb is fitball.track and name == "a.wav":
        pytest.skip("sound is read")
    path = tmp_path / name
    path.write_bytes(data)
    with pytest.raises(InputError) as caught:
        verb(path)
    assert caught.value.code == "other-format"
    assert remedy in str(caught.value)


@pytest.mark.parametrize(
    ("verb", "name", "code"),
    [
        (fitball.calibrate, "clip.MP4", "film"),
        (fitball.track, "clip.trk", "film"),
        (fitball.track, "clip.MP4", "not-a-film"),
    ],
)
def test_a_film_is_no_table(tmp_path, verb, name, code):
    """`track` reads films; projects about films, and films that are tables, it does not."""
    if code == "not-a-film":
        pytest.importorskip("av")
    path = tmp_path / name
    path.write_text("v_y1,v_y2\n5,4\n4,3\n", encoding="utf-8")
    with pytest.raises(InputError) as caught:
        verb(path)
    assert caught.value.code == code


@pytest.mark.parametrize("name", ["a.mat", "a.dat", "a.db", "a.txt", "a.c3d"])
def test_a_table_of_text_is_read_whatever_its_ending(tmp_path, name):
    path = tmp_path / name
    path.write_text("v_y1,v_y2\n5,4\n4,3\n6,5\n", encoding="utf-8")
    assert len(fitball.load_table(path)) == 3


def test_a_file_of_bytes_is_no_damaged_text(tmp_path):
    """Random bytes are none that could be saved as text; a zero in a text is."""
    path = tmp_path / "rig.dat"
    text = b"v_y1,v_y2\n5,4\n4,3\n6,5\n"
    noise = np.random.default_rng(1).integers(0, 256, 4000, dtype=np.uint8).tobytes()
    wide = text.decode().encode("utf-16-le")
    codes = {}
    for name, data in {"noise": noise, "zero": text + b"5,\x004\n", "wide": wide}.items():
        path.write_bytes(data)
        try:
            codes[name] = len(fitball.load_table(path))
        except InputError as error:
            codes[name] = error.code
    assert codes == {"noise": "other-format", "zero": "encoding", "wide": 3}
