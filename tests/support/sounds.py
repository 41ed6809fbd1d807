"""Recordings of a bouncing ball, synthesized: times of bounces are known to the digit.

The ball presses on the floor by a pulse whose length grows as it gets slower; the floor rings, the
skin slaps, the room answers with echoes and a tail; hum, noise and clipping follow.
"""

import numpy as np
from scipy.signal import fftconvolve, lfilter

G = 9.80665
# Modes of the floor: frequency [Hz], quality, share.
MODES = [(350.0, 6.0, 1.0), (900.0, 8.0, 0.6), (2100.0, 10.0, 0.3), (4200.0, 12.0, 0.15)]
# Echoes: delay [s], share.
ECHOES = [(0.0031, 0.4), (0.0087, 0.3), (0.021, 0.25)]


def times_of_bounces(count, speed, cor, growth=0.01, contact=4.7e-3, start=0.6):
    """Times [s] at which contacts begin, contact times [s] and landing speeds [m/s], in vacuum."""
    times, contacts, speeds = [start], [], []
    for k in range(count):
        contacts.append(contact * (speed / 5.0) ** -0.1)
        speeds.append(speed)
        speed *= cor + growth * k
        times.append(times[-1] + contacts[-1] + 2.0 * speed / G)
    return np.array(times[:-1]), np.array(contacts), np.array(speeds)


def recording(
    seed,
    rate=48_000,
    count=7,
    speed=4.4,
    cor=0.75,
    echo=0.2,
    hum=0.02,
    noise=0.003,
    slap=0.5,
    loud=1.0,
    vary=0.3,
    length=1.0,
):
    """Samples of a recording, at most 1 in size, and the times [s] of its bounces."""
    rng = np.random.default_rng(seed)
    times, contacts, speeds = times_of_bounces(count, speed, cor)
    size = int((times[-1] + length) * rate)
    clock = np.arange(size) / rate
    signal = np.zeros(size)
    burst = int(0.006 * rate)
    decay = np.exp(-np.arange(burst) / (0.0008 * rate))
    usual = rng.normal(size=burst) * decay
    for time, contact, fast in zip(times, contacts, speeds, strict=True):
        phase = np.clip((clock - time) / contact, 0.0, 1.0)
        push = np.gradient(np.sin(np.pi * phase) ** 1.2 * fast**1.2) * rate * 1e-3
        signal += 0.3 * push
        for frequency, quality, share in MODES:
            radius = np.exp(-np.pi * frequency / quality / rate)
            turn = 2.0 * np.pi * frequency / rate
            poles = [1.0, -2.0 * radius * np.cos(turn), radius**2]
            signal += share * lfilter([1.0 - radius], poles, push)
        own = (1.0 - vary) * usual + vary * rng.normal(size=burst) * decay
        signal += slap * fast**1.1 * placed(own, time * rate, size)
    signal /= np.abs(signal).max()
    room = np.zeros(int(0.5 * rate))
    room[0] = 1.0
    for delay, share in ECHOES:
        room[int(delay * rate)] += share * min(1.0, 5.0 * echo)
    tail = rng.normal(size=room.size) * np.exp(-23.0 * np.arange(room.size) / rate)
    tail[: int(0.002 * rate)] = 0.0
    signal = fftconvolve(signal, room + 0.05 * echo * tail)[:size]
    for harmonic, share in ((1.0, 1.0), (3.0, 0.5), (5.0, 0.2)):
        signal += hum * share * np.sin(2.0 * np.pi * 50.0 * harmonic * clock + harmonic)
    white = rng.normal(size=size)
    signal += noise * (white + 0.3 * lfilter([1.0], [1.0, -0.95], white))
    return np.clip(0.5 * loud * signal, -0.99, 0.99), times


def placed(burst, place, size):
    """A burst that begins at a sample that need not be whole, among so many samples."""
    whole = int(place)
    wide = 4 * burst.size
    turns = np.exp(-2j * np.pi * np.fft.rfftfreq(wide) * (place - whole))
    moved = np.fft.irfft(np.fft.rfft(burst, wide) * turns, wide)[: 2 * burst.size]
    signal = np.zeros(size)
    end = min(whole + moved.size, size)
    signal[whole:end] = moved[: end - whole]
    return signal
