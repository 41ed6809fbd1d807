"""What kernels hand each other, by name: the ball and its contact, the oscillators it is made of, a state, a piece.

SI units throughout. Core is body 1 (`M1`, `I1`, `omega_1`), shell body 2; squared frequencies [1/s^2] are called
`..._squared`, so that `omega_2` is the shell's spin and nothing else.
"""

from __future__ import annotations

from typing import Generic, NamedTuple

from fitball.models.kernels.dual import Number
from fitball.values import FloatArray

# A float array of two dimensions: ports lay it out by rows.
Stack = FloatArray


class Oscillator(NamedTuple, Generic[Number]):
    """`x'' + 2 decay x' + natural_squared x = 0`: `damped_squared = natural_squared - decay^2`, negative when
    overdamped; `frequency = sqrt(|damped_squared|)` [1/s].
    """

    decay: Number
    damped_squared: Number
    natural_squared: Number
    frequency: Number


class Oscillators(NamedTuple, Generic[Number]):
    """The twist of core against shell, and the vertical motion that drives it."""

    torsion: Oscillator[Number]
    vertical: Oscillator[Number]


class Swing(NamedTuple, Generic[Number]):
    """An oscillator's `C = exp(-a t) cos(w t)` and `S = exp(-a t) sin(w t)/w` [s] at a time, and a bound of `C`.

    Overdamped, `envelope` and `fast` are the exponentials of the two poles, their mean is `C`; else `fast` is idle.
    """

    cosine: Number
    sine: Number
    envelope: Number
    fast: Number


class Basis(NamedTuple, Generic[Number]):
    """The swings of both oscillators at one time."""

    torsion: Swing[Number]
    vertical: Swing[Number]


class Series(NamedTuple):
    """How the functions of one piece are held: in the basis if `terms` is 0, else as that many Taylor terms in
    `t/length`; `length` [s] is how long they are good for.
    """

    terms: int
    length: float


class VerticalMotion(NamedTuple, Generic[Number]):
    """`cor` of the whole ball, mass on the spring [kg], the spring; end of compression and release [s]."""

    cor: Number
    riding_mass: Number
    spring: Oscillator[Number]
    t_force: Number
    t_contact: Number


class Joint(NamedTuple, Generic[Number]):
    """Moments of inertia [kg m^2] and the torsional spring [N m] and damper [N m s] between them;
    `slide_squared` is its damped frequency squared while the contact slides.
    """

    core: Number
    shell: Number
    stiffness: Number
    damping: Number
    slide_squared: Number


class Contact(NamedTuple, Generic[Number]):
    """All that decides one contact: ball, joint, court, and the state just before landing.

    `eps` [m] is the offset of the normal force, acting during slip too if `eps_in_slide`; `landing` [N s] the impulse
    that stops the shell; `shell_spin` whether the shell's spin is the ball's, instead of the mean of both.
    """

    mass: Number
    radius: Number
    joint: Joint[Number]
    mu: Number
    eps: Number
    eps_in_slide: bool
    shell_spin: bool
    landing: Number
    vertical: VerticalMotion[Number]
    v_x: Number
    v_y: Number
    omega: Number


class Coupling(NamedTuple, Generic[Number]):
    """What follows from the constants of a contact: `inertia = I1 + I2`, `gyration = I2 + M R^2`,
    `lever = M R/gyration` (friction per torque at zero slip), the offset while sliding, the twist in either state.
    """

    inertia: Number
    gyration: Number
    lever: Number
    eps_slide: Number
    slide: Oscillator[Number]
    grip: Oscillator[Number]


class Load(NamedTuple, Generic[Number]):
    """Normal force [N], its rate [N/s], and the core's momentum towards the court [N s]."""

    force: Number
    force_rate: Number
    momentum: Number


class State(NamedTuple):
    """The ball `time` after landing: compression and its rate, twist angle `theta_1 - theta_2`, velocity along the
    court, spins of core and shell, and their angular momentum `I1 omega_1 + I2 omega_2`.
    """

    time: float
    y: float
    y_rate: float
    angle: float
    v_x: float
    omega_1: float
    omega_2: float
    spin_sum: float


class Mode(NamedTuple):
    """What the contact point does next: a phase, or UNDECIDED.

    `side`: direction of slip; of a hold, and of the grip it gives way to, the side of the cone on which the grip with
    offset lies outside. `order`: zeros of the slip known to be at the start. `broke`: a grip has just ended.
    """

    phase: int
    side: float
    order: int
    broke: bool


class Piece(NamedTuple):
    """A contact is solved in pieces: phases, or near resonance parts of them. Phase, what ended it and to which side,
    how long it lasted [s], and how it was held.
    """

    phase: int
    ending: int
    side: float
    time: float
    series: Series


class Weights(NamedTuple):
    """A contact function: a constant, and what it takes of twist, twist rate, normal force, and impulse since the
    start.
    """

    constant: float
    angle: float
    rate: float
    force: float
    impulse: float


class Scratch(NamedTuple):
    """Scratch of one thread: contact function, twist and force as coefficients, the stack of `first_zero`."""

    function: FloatArray
    twist: FloatArray
    drive: FloatArray
    stack: Stack


class Bounce(NamedTuple):
    """One impact solved; `pieces` of it stand in the phase log. All but `status` NaN or 0 where that is not OK."""

    status: int
    v_x2: float
    v_y2: float
    omega_2: float
    contact_time: float
    regime: int
    pieces: int
