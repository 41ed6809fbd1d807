"""The contact time of a force record: against pulses integrated step by step, noise, and what
records have besides one pulse.
"""

import numpy as np
import pytest
from scipy import signal
from support.near import assert_near

import fitball
from fitball.base.errors import ParameterError


def half_sine(t, start=0.01):
    """A pulse of 1,000 N and 5 ms."""
    share = (t - start) / 5e-3
    inside = (share > 0.0) & (share < 1.0)
    return np.where(inside, 1000.0 * np.sin(np.pi * share), 0.0)


def refused(t, force):
    """What is said of a record that has no contact time."""
    with pytest.raises(ParameterError) as caught:
        fitball.contact_time(t, force)
    assert caught.value.code == "force-record"
    return str(caught.value)


@pytest.mark.parametrize("damping", [0.0, 0.03, 0.05, 0.1, 0.15])
@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_the_contact_time_of_a_force_record(damping, noise):
    """Against a core on a spring and damper, followed step by step until the force vanishes
    (without damping half a sine, which lasts pi); a threshold of 5 % is wrong by more.
    """
    step = 1e-4
    x = 0.0
    v = 1.0
    force = [2.0 * damping]
    while force[-1] >= 0.0:
        # Velocity before place: symplectic, of first order.
        v -= step * (x + 2.0 * damping * v)
        x += step * v
        force.append(x + 2.0 * damping * v)
    duration = step * len(force)
    assert damping > 0.0 or duration == pytest.approx(np.pi, rel=1e-3)
    t = np.linspace(-1.0, duration + 1.0, 200)
    record = np.interp(
        t,
        step * np.arange(len(force)),
        force,
        left=0.0,
        right=0.0,
    )
    rng = np.random.default_rng(3)
    record += noise * rng.normal(size=t.size)
    unit = 5e-3 / np.pi
    measured = fitball.contact_time(unit * t, 900.0 * record)
    share = 0.012 if noise else 0.005
    assert_near(measured, unit * duration, share)
    above = t[record > 0.05 * record.max()]
    off = np.ptp(above) - duration
    assert abs(off) > 0.015 * duration


@pytest.mark.parametrize(
    ("t", "force"),
    [
        ([0, 1, 2], [0, 1, 0]),
        ([0, 1, 2, 3, 3], [0, 1, 2, 1, 0]),
        ([0, 1, 2, 3, 4], [2, 3, 2, 1, 0]),
        ([0, 1, 2, 3, 4], [0, -1, -2, -1, 0]),
        ([0, 1, 2, 3, 4], [0, 1, np.nan, 1, 0]),
    ],
)
def test_what_is_no_force_record(t, force):
    with pytest.raises(ParameterError) as caught:
        fitball.contact_time(t, force)
    assert caught.value.code == "force-record"


T = np.arange(0.0, 0.1, 2e-5)
PULSE = half_sine(T)


@pytest.mark.parametrize("level", [0.0, 60.0, -300.0])
@pytest.mark.parametrize("slope", [0.0, 300.0])
def test_the_level_at_rest_is_taken_off(level, slope):
    """Also where it drifts by 3 % of the peak over the record."""
    force = PULSE + level + slope * T
    assert_near(fitball.contact_time(T, force), 5e-3, 0.01)


@pytest.mark.parametrize(
    ("noise", "length", "rate"),
    [
        (0.017, 0.1, 1e4),
        (0.015, 0.2, 5e4),
        (0.01, 0.5, 1e5),
        (0.02, 0.1, 1e4),
        (0.02, 0.02, 1e4),
    ],
)
def test_the_stated_sd_is_the_scatter_over_noise(noise, length, rate):
    """Of a hundred records with noise, long ones too, whose noise far from the pulse does not
    count.
    """
    t = np.arange(0.0, length, 1.0 / rate)
    rng = np.random.default_rng(5)
    pulse = half_sine(t, 0.007)
    measured = []
    for _ in range(100):
        force = pulse + 1000.0 * noise * rng.normal(size=t.size)
        measured.append(fitball.contact_time(t, force, return_sd=True))
    times, sds = np.transpose(measured)
    assert_near(times.mean(), 5e-3, 0.005)
    # The scatter of a hundred is known to 7 %. Where the ends are sought it is a little smaller.
    stated = np.sqrt(np.mean(sds**2))
    assert 0.6 < times.std() / stated < 1.3
    off = np.abs(times - 5e-3)
    assert np.all(off < 5.0 * sds)


@pytest.mark.parametrize("at_rest", [30, 3000])
def test_the_stated_sd_is_that_of_differences(at_rest):
    """JCGM 100:2008, Eq. 10, by differences of one force after the other; what all forces of a
    pulse share is the error of the level, a median, which counts where little is at rest.
    """
    count = 100
    force = np.zeros(2 * at_rest + count)
    shape = np.linspace(0.0, 1.0, count)
    # A pulse that rises faster than it falls: its skewness counts too.
    pulse = slice(at_rest, at_rest + count)
    force[pulse] = 1000.0 * np.sin(np.pi * shape**0.9)
    rng = np.random.default_rng(3)
    force += 0.5 * rng.normal(size=force.size)
    # The pulse is taken with a few forces before and after it. None of these is the median.
    near = slice(at_rest - 12, at_rest + count + 12)
    force[near] += 0.3 * np.sign(force[near])
    t = 5e-5 * np.arange(force.size)
    duration, sd = fitball.contact_time(t, force, return_sd=True)
    slopes = np.zeros(force.size)
    for k in range(near.start, near.stop):
        changed = force.copy()
        changed[k] += 1e-5
        change = fitball.contact_time(t, changed) - duration
        slopes[k] = change / 1e-5
    outside = force[slopes == 0.0]
    away = np.abs(outside - np.median(outside))
    noise = 1.4826 * np.median(away)
    of_forces = np.linalg.norm(slopes)
    error_of_median = np.sqrt(np.pi / 2.0 / outside.size)
    of_level = error_of_median * slopes.sum()
    assert_near(sd, noise * np.hypot(of_forces, of_level), 0.05)
    # Both are seen: 5 % of the whole are less than either where little is at rest.
    assert at_rest > count or 0.4 < of_level / of_forces < 1.0


def test_a_record_without_noise_has_no_error():
    _, sd = fitball.contact_time(T, PULSE, return_sd=True)
    assert sd == 0.0


def test_other_signals_are_refused():
    late = half_sine(T, 0.08)
    assert "second pulse at 0.08" in refused(T, PULSE + 0.6 * late)
    assert "second pulse at 0.01" in refused(T, 0.6 * PULSE + late)
    assert "-force" in refused(T, -PULSE)
    assert "-force" in refused(T, 200.0 - PULSE)
    assert "1e-06*t" in refused(1e6 * T, PULSE)
    assert "0.001*t" in refused(1e3 * T, PULSE)
    assert "largest" in refused(T, np.minimum(PULSE, 700.0))
    rng = np.random.default_rng(2)
    assert refused(T, rng.normal(size=T.size))
    assert "equal" in refused(T, np.ones(T.size))


def on_a_plate(frequency):
    """The force that a plate on a spring, damping 0.02, shows of the pulse."""
    rate = 2.0 * np.pi * frequency
    damping = 2.0 * 0.02 * rate
    plate = ([rate**2], [1.0, damping, rate**2])
    _, force, _ = signal.lsim(plate, PULSE, T)
    return force


@pytest.mark.parametrize("frequency", [200.0, 400.0, 800.0])
def test_a_plate_that_rings_is_refused(frequency):
    """Its time would be off by 8 % and more."""
    assert "oscillates" in refused(T, on_a_plate(frequency))


def test_a_plate_far_above_the_pulse_is_no_matter():
    force = on_a_plate(4000.0)
    assert_near(fitball.contact_time(T, force), 5e-3, 0.005)


@pytest.mark.parametrize(
    ("recovery", "is_refused"),
    [
        (0.01, True),
        (0.02, True),
        (0.2, False),
    ],
)
def test_an_amplifier_that_undershoots_is_refused(recovery, is_refused):
    """A high pass of first order with that time constant [s]."""
    force = signal.lfilter(
        [1.0, -1.0],
        [1.0, -np.exp(-2e-5 / recovery)],
        PULSE,
    )
    if is_refused:
        assert "below rest" in refused(T, force)
    else:
        assert_near(fitball.contact_time(T, force), 5e-3, 0.01)


def test_steps_of_a_converter_are_no_flat_top():
    in_steps = 20.0 * np.round(PULSE / 20.0)
    assert_near(fitball.contact_time(T, in_steps), 5e-3, 0.005)


@pytest.mark.parametrize("samples", [2, 3, 5, 7])
def test_pulses_between_few_samples_are_refused(samples):
    """By where the samples lie the time of half a sine would be off by 95, 25, 8 and 4 %."""
    step = 5e-3 / samples
    for shift in np.linspace(0.0, step, 6, endpoint=False):
        t = np.arange(0.0, 0.05, step)
        refused(t, half_sine(t, 0.01 + shift))


@pytest.mark.parametrize("samples", [10, 20, 40])
def test_ten_samples_of_a_pulse_are_enough(samples):
    step = 5e-3 / samples
    for shift in np.linspace(0.0, step, 6, endpoint=False):
        t = np.arange(0.0, 0.05, step)
        duration = fitball.contact_time(t, half_sine(t, 0.01 + shift))
        assert_near(duration, 5e-3, 2.0 / samples**2)
