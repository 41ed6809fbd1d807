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
}
# The choices of Jafri's thesis (2004), whose equations are solved without its slips.
THESIS_EXACT = {
    **TWO_MASS,
    "normal": "inner",
    "offset": "grip",
    "spin": "shell",
    "release": "zero_displacement",
}


class Entry(NamedTuple):
    """All that others know of a model. `compose` makes it of text, ball, whether there is motion
    along the court, and its `options` (by default these), which can be changed among `choices`.

    `equations` says in words what a ball is in it and whose equations these are; `works` are keys
    of `report/references.bib`. It has `masses`, one of a rigid ball. `spinless`: a comparison tries
    it where no spin was measured too.
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
        equations="after Walton 1993 and Cross 2002",
        works=("walton1993", "foerster1994", "cross2002", "garwin1969"),
        spinless=True,
    ),
    "brody": Entry(
        grip_slip.compose,
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
VERTICAL = ("normal", "release")


def model(
    text: str = "two-mass", *, ball: Ball | None = None, tangential: bool = True, **options: str
) -> Model:
    """`two-mass` (normal momentum|total|inner, offset contact|grip, torsion matched|free, inertia
    tied|table, spin mean|shell, release zero_force|zero_displacement), `thesis-exact`, `grip-slip`,
    `brody`, with options as `+NAME=OPTION` or by keyword; FILE.py:NAME. Raises ModelError
    (`unknown-model`, `unknown-option`, `option-twice`, `own-model`).

    One law of restitution holds at every speed: `COR = c (1 + (v/v_0)^q)^(-1/q)`, with value
    `cor_10` and slope `cor_slope` at 10 m/s; c = mass_ratio with normal=momentum, else 1.
    """
    ball = Ball() if ball is None else ball
    if ".py:" in text:
        if options:
            raise ModelError(
                f"model {text} is a function, without options: read {', '.join(options)}",
                "unknown-option",
            )
        return replace(model_from(text), ball=ball, tangential=tangential)
    name, *parts = text.split("+")
    if name not in MODELS:
        raise ModelError(f"unknown model '{name}': {suggestion(name, MODELS)}", "unknown-model")
    entry = MODELS[name]
    pairs = [*(part.partition("=")[::2] for part in parts), *options.items()]
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
    every = {**entry.options, **chosen}
    return entry.compose(name, _text(name, every), ball, tangential, every)


def model_of_data(text: str, *, ball: Ball, tangential: bool) -> Model:
    """The model that a scene or a saved fit names: these are data, and run no file. Raises
    ModelError as `model`, and for a function of a file (`own-model`).
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
    parts = [name]
    for choice, value in options.items():
        if value != default[choice]:
            parts.append(f"{choice}={value}")
    return "+".join(parts)


def variants(chosen: Model) -> tuple[str, ...]:
    """Texts of all models that differ from `chosen` in one option, of those options that act
    without motion along the court if it has none; no text for a user's function.
    """
    if chosen.name not in MODELS:
        return ()
    texts = []
    for choice, values in MODELS[chosen.name].choices.items():
        if not chosen.tangential and choice not in VERTICAL:
            continue
        others = [value for value in values if value != chosen.options[choice]]
        texts += [_text(chosen.name, {**chosen.options, choice: value}) for value in others]
    return tuple(texts)


def candidates(*, tangential: bool, spin: bool, quick: bool = False) -> tuple[str, ...]:
    """Texts of the models that can differ on data with motion along the court (`tangential`) and
    with `spin`, or without, the default there last; if `quick` none of the variants.
    """
    if not tangential:
        return (DEFAULT_DROPS,)
    if not spin:
        spinless = [name for name, entry in MODELS.items() if entry.spinless]
        spinless.remove(DEFAULT_SPINLESS)
        return (*spinless, DEFAULT_SPINLESS)
    others = [name for name in MODELS if name != DEFAULT]
    if not quick:
        # normal=inner breaks the momentum balance of the ball; who wants it in a comparison names
        # it.
        others += [text for text in variants(model(DEFAULT)) if "normal=inner" not in text]
    return (*others, DEFAULT)
