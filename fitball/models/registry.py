"""Models by name, their options, and what a comparison tries; a new model is one row."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple

from fitball.base.errors import ModelError, suggestion
from fitball.base.values import Ball
from fitball.models import grip_slip, two_mass
from fitball.models.model import Model
from fitball.models.own import model_from

# The choices of `two-mass`: those of which the assumptions balance the ball's momentum.
TWO_MASS = {
    "normal": "momentum",
    "offset": "contact",
    "torsion": "matched",
    "inertia": "tied",
    "spin": "mean",
    "release": "zero_force",
    "cor": "saturating",
}
# The choice of rigid balls.
RIGID = {"cor": "saturating"}
# The choices of Jafri's thesis (2004), whose equations are solved without its slips.
THESIS_EXACT = {
    **TWO_MASS,
    "normal": "inner",
    "offset": "grip",
    "spin": "shell",
    "release": "zero_displacement",
}


class Entry(NamedTuple):
    """What other rooms know of a model.

    `compose` makes it of its name, its text, the ball, whether there is motion along the court, and
    its options. `options` are the default ones, which can be changed among `choices`. `equations`
    says in words what a ball is in the model, and whose equations these are. `works` are keys of
    `report/references.bib`. `masses` is 1 for a rigid ball. If it is `spinless`, a comparison tries
    it on data without spins too.
    """

    compose: Callable[[str, str, Ball, bool, Mapping[str, str]], Model]
    options: Mapping[str, str] = {}
    choices: Mapping[str, tuple[str, ...]] = {}
    equations: str = ""
    works: tuple[str, ...] = ()
    masses: int = 1
    spinless: bool = False


MODELS: Mapping[str, Entry] = {
    "two-mass": Entry(
        two_mass.compose,
        TWO_MASS,
        two_mass.CHOICES,
        equations="a core and a shell, after Jafri 2004",
        works=("jafri2004",),
        masses=2,
    ),
    "thesis-exact": Entry(
        two_mass.compose,
        THESIS_EXACT,
        equations="Jafri 2004",
        works=("jafri2004",),
        masses=2,
    ),
    "grip-slip": Entry(
        grip_slip.compose,
        RIGID,
        grip_slip.CHOICES,
        equations="after Walton 1993 and Cross 2002",
        works=("walton1993", "foerster1994", "cross2002", "garwin1969"),
        spinless=True,
    ),
    "brody": Entry(
        grip_slip.compose,
        RIGID,
        grip_slip.CHOICES,
        equations="Brody 1984",
        works=("brody1984",),
        spinless=True,
    ),
}
# The model of data with spins where no other is named.
DEFAULT = "two-mass"
# The model of data with motion along the court but without spins.
DEFAULT_SPINLESS = "brody"
# The model of drops, where a mass ratio is no more than an upper end of COR.
DEFAULT_DROPS = "two-mass+normal=total"
# Choices that act without motion along the court.
VERTICAL_CHOICES = ("normal", "release", "cor")
# The choice of a law, which says nothing of the motion along the court.
LAW_CHOICE = "cor"
# What a comparison tries only where it is named: normal=inner breaks the momentum balance of the
# ball, cor=root is of bodies that keep a dent.
UNLIKELY = ("normal=inner", "cor=root")


def model(
    text: str = "two-mass", *, ball: Ball | None = None, tangential: bool = True, **options: str
) -> Model:
    """A model of the bounce by its name, or of a function in a file, FILE.py:NAME.

    Names are `two-mass` (normal momentum|total|inner, offset contact|grip, torsion matched|free,
    inertia tied|table, spin mean|shell, release zero_force|zero_displacement, cor
    saturating|power|line|root), `thesis-exact`, `grip-slip` (cor saturating|power|line|root) and
    `brody` (cor saturating|power|line|root). The first option of each choice is the default.

    All but thesis-exact have a law of restitution with value `cor_10` and slope `cor_slope` at 10
    m/s: cor=saturating is `COR = c (1 + (v/v_0)^q)^(-1/q)`, c = mass_ratio with normal=momentum,
    else 1; `power`, `line`; `root`, v^(-1/4) of bodies that yield, without a slope to fit.

    Args:
        text: a name, with options as `+NAME=OPTION`, or FILE.py:NAME
        ball: mass, radius and inertia of the ball; by default those of an ITF ball
        tangential: whether the ball moves along the court too, else vertically alone
        options: options by keyword, such as `offset="grip"`

    Raises:
        ModelError: the name is unknown (`unknown-model`), an option is unknown (`unknown-option`)
            or named twice (`option-twice`), or the function is no model (`own-model`), as a
            function itself instead of its name.
        ParameterError: a prior of the function is missing or cannot be read (`prior`).

    Example:
        >>> import fitball
        >>> fitball.model("two-mass+offset=grip").text
        'two-mass+offset=grip'
        >>> [spec.name for spec in fitball.model("brody").parameters]
        ['mu', 'cor_10', 'cor_slope']
    """
    ball = Ball() if ball is None else ball
    refuse_what_is_no_name(text)
    if ".py:" in text:
        if options:
            raise ModelError(
                f"model {text} is a function, without options: read {', '.join(options)}",
                "unknown-option",
            )
        return replace(model_from(text), ball=ball, tangential=tangential)
    name, *settings = text.split("+")
    if name not in MODELS:
        raise ModelError(f"unknown model '{name}': {suggestion(name, MODELS)}", "unknown-model")
    entry = MODELS[name]
    pairs = [setting.partition("=")[::2] for setting in settings]
    pairs += options.items()
    chosen = dict(pairs)
    if len(chosen) < len(pairs):
        raise ModelError(f"model {text}: an option is named twice; name it once", "option-twice")
    for choice, value in chosen.items():
        if choice not in entry.choices:
            hint = suggestion(choice, entry.choices) if entry.choices else "it has none"
            raise ModelError(f"model {name} has no option '{choice}': {hint}", "unknown-option")
        if value not in entry.choices[choice]:
            hint = suggestion(value, entry.choices[choice])
            raise ModelError(f"unknown {choice}={value} of model {name}: {hint}", "unknown-option")
    all_options = {**entry.options, **chosen}
    return entry.compose(name, _text(name, all_options), ball, tangential, all_options)


def refuse_what_is_no_name(name: object) -> None:
    """Let a text pass, for it may name a model. People pass their function itself, whatever the
    types say.

    Raises:
        ModelError: it is no text (`own-model`).
    """
    if not isinstance(name, str):
        raise ModelError(
            f"read a model of type {type(name).__name__}; expected a name or a Model, as "
            "fitball.model_from(function) makes it of a function",
            "own-model",
        )


def model_of_data(text: str, *, ball: Ball, tangential: bool) -> Model:
    """The model that a scene or a saved fit names as `text`: these are data, and run no file.

    Raises:
        ModelError: the name is unknown (`unknown-model`), an option is unknown (`unknown-option`)
            or named twice (`option-twice`), or the text names a function of a file (`own-model`).
    """
    if ".py:" in text:
        words = (
            f"model {text}: a scene or a saved fit names no function of a file; if you trust "
            "it, name it (--model)"
        )
        raise ModelError(words, "own-model")
    return model(text, ball=ball, tangential=tangential)


def _text(name: str, options: Mapping[str, str]) -> str:
    """A model as `--model` takes it, with the options that are not its default."""
    default = MODELS[name].options
    changes = [f"{choice}={value}" for choice, value in options.items() if value != default[choice]]
    return "+".join([name, *changes])


def option_variants(chosen: Model) -> tuple[str, ...]:
    """Texts of all models that differ from `chosen` in one option, as `--model` takes them.

    Without motion along the court only VERTICAL_CHOICES differ. A user's function has no options.
    """
    if chosen.name not in MODELS:
        return ()
    texts = []
    for choice, values in MODELS[chosen.name].choices.items():
        if not chosen.tangential and choice not in VERTICAL_CHOICES:
            continue
        others = [value for value in values if value != chosen.options[choice]]
        texts += [_text(chosen.name, {**chosen.options, choice: value}) for value in others]
    return tuple(texts)


def candidates(
    *,
    tangential: bool,
    spin: bool,
    timed: bool = False,
    quick: bool = False,
) -> tuple[str, ...]:
    """Texts of the models that a comparison tries, the default model of such data last.

    Data have motion along the court if `tangential`, else models differ in their law of
    restitution; spins if `spin`; and times of the contact if `timed`, for which models need a time
    axis. If `quick` the variants of the default model are left out.
    """
    if not tangential:
        laws = [f"{LAW_CHOICE}={law}" for law in two_mass.CHOICES[LAW_CHOICE][1:]]
        return (*(f"{DEFAULT_DROPS}+{law}" for law in laws if law not in UNLIKELY), DEFAULT_DROPS)
    if not spin:
        spinless = [name for name, entry in MODELS.items() if entry.spinless]
        if timed:
            return (*spinless, DEFAULT)
        spinless.remove(DEFAULT_SPINLESS)
        return (*spinless, DEFAULT_SPINLESS)
    others = [name for name in MODELS if name != DEFAULT]
    if not quick:
        variants = option_variants(model(DEFAULT))
        others += [text for text in variants if text.partition("+")[2] not in UNLIKELY]
    return (*others, DEFAULT)
