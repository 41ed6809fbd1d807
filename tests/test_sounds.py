"""Bounces that are heard: their times against recordings whose times are known."""

import numpy as np
import pytest
from scipy.io import wavfile
from support.sounds import G, recording, times_of_bounces

from fitball.base.errors import InputError
from fitball.data.load import load_table
from fitball.data.scene import Scene, ValueWithSd
from fitball.tracks.sounds import hear
from fitball.video.onsets import bounces_in
from fitball.video.sound import read_sound

ROOMS = {
    "quiet": {"echo": 0.0, "hum": 0.0, "noise": 1e-5},
    "usual": {},
    "echo": {"echo": 1.0},
    "hum": {"hum": 0.2},
    "noise": {"noise": 0.02},
    "clipped": {"loud": 8.0},
    "soft ball": {"slap": 0.05},
    "16 kHz": {"rate": 16_000},
}


# Recordings by coders, with what these move a time by [s].
PHONES = [("a.flac", "flac", 5e-5), ("a.mp3", "mp3", 5e-4)]


def silent(_stage, _share):
    """No progress is shown."""


@pytest.mark.parametrize("room", ROOMS)
def test_times_are_right_to_a_fifth_of_a_millisecond_and_their_sds_hold(room):
    """A time that all share is free: intervals alone are measured."""
    settings = ROOMS[room]
    errors, sds, heard = [], [], 0
    for seed in range(4):
        signal, times = recording(seed, speed=3.6 + 0.3 * seed, cor=0.70 + 0.02 * seed, **settings)
        [bounces] = bounces_in(signal, settings.get("rate", 48_000.0))
        nearest = np.array([np.argmin(np.abs(times - time)) for time in bounces.time])
        assert np.diff(nearest).tolist() == np.diff(bounces.number).tolist()
        off = bounces.time - times[nearest]
        assert np.abs(off).max() < 2e-3
        errors += (off - np.average(off, weights=bounces.sd**-2.0)).tolist()
        sds += bounces.sd.tolist()
        heard += bounces.time.size
    standard = np.array(errors) / np.array(sds)
    assert heard >= 0.8 * 4 * times.size
    clear = np.array(sds) < 3e-4
    assert clear.sum() >= 0.6 * heard
    assert np.sqrt(np.mean(np.square(np.array(errors)[clear]))) < 2e-4
    assert np.sqrt(np.mean(standard**2)) < 1.2
    assert np.abs(standard).max() < 3.5


def test_a_clap_meanwhile_and_a_bounce_that_is_not_heard_are_named(tmp_path):
    signal, times = recording(5)
    # A door slams over the third bounce, which is then noise; somebody claps after the first.
    start = int((times[2] - 0.02) * 48_000)
    signal[start : start + 3000] = signal[:3000]
    clap = int((times[0] + 0.31) * 48_000)
    signal[clap : clap + 400] += 0.3 * np.random.default_rng(1).normal(size=400)
    path = tmp_path / "drops.wav"
    wavfile.write(path, 48_000, np.round(30_000 * np.clip(signal, -1, 1)).astype("i2"))
    found = hear([path], Scene(), silent)
    assert found.bounces["bounce"].tolist() == [1, 2, 4, 5, 6, 7]
    assert found.bounces["interval [s]"].isna().tolist() == [False, True, *[False] * 3, True]
    assert {note.code for note in found.notes} == {"bounce-missed", "other-sounds", "contact-time"}


def test_two_drops_in_a_recording_are_two_runs(tmp_path):
    signal, times = recording(2, count=5)
    path = tmp_path / "drops.wav"
    twice = np.concatenate([signal, signal])
    wavfile.write(path, 48_000, twice.astype("f4"))
    found = hear([path], Scene(), silent)
    assert found.bounces["run"].tolist() == ["drops-1"] * 5 + ["drops-2"] * 5
    per_run = found.bounces["interval [s]"].to_numpy().reshape(2, 5)[:, :4]
    assert np.abs(per_run - np.diff(times)).max() < 2e-4


def test_speeds_are_those_of_flights_less_the_contact(tmp_path):
    """In vacuum: v = g T/2, whose contacts are known here."""
    signal, times = recording(3)
    _, contacts, speeds = times_of_bounces(7, 4.4, 0.75)
    path = tmp_path / "drops.wav"
    wavfile.write(path, 48_000, np.round(30_000 * signal).astype("i2"))
    contact = ValueWithSd(float(contacts.mean()), 0.3e-3)
    scene = Scene(contact_time=contact, air={"density": 0.3}, flight={"drag": 0.01})
    found = hear([path], scene, silent).bounces
    landing = found["v_y1 [m/s]"].to_numpy()[1:]
    assert landing == pytest.approx(speeds[1:], abs=4e-3)
    off = (landing - speeds[1:]) / found["v_y1_sd [m/s]"].to_numpy()[1:]
    assert np.abs(off).max() < 3.5
    expected = 0.5 * G * (np.diff(times) - contact.value)
    assert found["v_y2 [m/s]"].to_numpy()[:-1] == pytest.approx(expected, abs=2e-3)


def test_the_table_is_a_series_that_calibrate_reads(tmp_path):
    signal, times = recording(3)
    path = tmp_path / "drops.wav"
    wavfile.write(path, 48_000, np.round(30_000 * signal).astype("i2"))
    found = hear([path], Scene(), silent)
    table = load_table(found.impacts)
    assert len(table) == times.size - 2
    frame = table.to_frame()
    expected = found.bounces["cor"].dropna().to_numpy()
    assert frame["v_y2 [m/s]"].to_numpy() == pytest.approx(expected * frame["v_y1 [m/s]"], rel=1e-6)


@pytest.mark.parametrize(
    ("samples", "code"),
    [
        (np.zeros(48_000, "i2"), "no-sound"),
        (np.ones(400, "i2"), "length-of-sound"),
        (np.random.default_rng(0).integers(-999, 999, 96_000).astype("i2"), "no-bounces"),
    ],
)
def test_recordings_without_bounces_are_refused(tmp_path, samples, code):
    path = tmp_path / "a.wav"
    wavfile.write(path, 48_000, samples)
    with pytest.raises(InputError) as caught:
        hear([path], Scene(), silent)
    assert caught.value.code == code


@pytest.mark.parametrize("kept", [0.5, 0.99])
def test_a_wav_that_is_cut_off_is_refused(tmp_path, kept):
    signal, _ = recording(3)
    path = tmp_path / "a.wav"
    wavfile.write(path, 48_000, signal.astype("f4"))
    whole = path.read_bytes()
    path.write_bytes(whole[: int(kept * len(whole))])
    with pytest.raises(InputError) as caught:
        read_sound(path)
    assert caught.value.code == "broken-film"


@pytest.mark.parametrize(("name", "codec", "most"), PHONES)
def test_recordings_of_phones_are_decoded_whole(tmp_path, name, codec, most):
    av = pytest.importorskip("av")
    signal, times = recording(3)
    samples = np.round(30_000 * signal).astype("i2")
    path = tmp_path / name
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=48_000)
        stream.layout = "mono"
        frame = av.AudioFrame.from_ndarray(samples[None], format="s16", layout="mono")
        frame.sample_rate = 48_000
        frame.pts = 0
        for packet in [*stream.encode(frame), *stream.encode()]:
            container.mux(packet)
    read = read_sound(path)
    assert read.signal.size >= signal.size
    found = hear([path], Scene(), silent).bounces
    assert len(found) >= 5
    delay = found["time [s]"].to_numpy()[:, None] - times
    nearest = np.argmin(np.abs(delay), axis=1)
    assert np.ptp(delay[np.arange(len(found)), nearest]) < 2.0 * most
