"""`fitball completion SHELL`: a script with which a shell completes the command line; and what it offers where.

The shell asks `fitball` itself, so that what it offers is what this version knows. Nothing heavy is imported for it.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from fitball.cli import known_names
from fitball.errors import ParameterError, suggestion
from fitball.exports.names import FORMAT_NAMES
from fitball.report.figures.names import FIGURES

SHELLS = ("bash", "zsh", "fish")
# Set by the script when the shell asks.
ASKED = "_ARGCOMPLETE"
TABLES = (".csv", ".tsv", ".txt", ".parquet", ".xlsx", ".ods")
HELP = "a script that completes the command line with Tab (bash, zsh, fish)"
DESCRIPTION = "Print a script with which a shell completes the command line."
EXAMPLE = """examples:
  eval "$(fitball completion bash)"                                        in ~/.bashrc
  eval "$(fitball completion zsh)"                                         in ~/.zshrc, after compinit
  fitball completion fish > ~/.config/fish/completions/fitball.fish

Then Tab completes verbs, options, tables, result folders, models, closures, parameters and kinds of figure."""

# Is told the word so far and what was parsed before it.
Offer = Callable[[str, argparse.Namespace], Iterable[str]]


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add what the verb may be asked."""
    parser.add_argument("shell", metavar="SHELL", help=f"{', '.join(SHELLS[:-1])} or {SHELLS[-1]}")


def run(args: argparse.Namespace) -> int:
    """Print the script."""
    if args.shell not in SHELLS:
        raise ParameterError(f"unknown shell '{args.shell}': {suggestion(args.shell, SHELLS)}")
    from argcomplete.shell_integration import shellcode

    print(shellcode(["fitball"], shell=args.shell).strip())
    return 0


def complete(parser: argparse.ArgumentParser) -> None:
    """Answer the shell and leave, if it is the shell that asks; else do nothing."""
    if ASKED not in os.environ:
        return
    import argcomplete

    for action in _actions(parser):
        if action.dest in OFFERS:
            _attach(action, OFFERS[action.dest])
        elif action.option_strings or action.choices is None:
            _attach(action, _among())
        if action.help and "{" in action.help:
            # Names that stand in for others would have to be looked up where it takes long.
            action.help = action.metavar if isinstance(action.metavar, str) else None
    argcomplete.autocomplete(parser, always_complete_options="long", exit_method=sys.exit)


def _actions(parser: argparse.ArgumentParser) -> Iterable[argparse.Action]:
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for child in dict.fromkeys(action.choices.values()):
                yield from _actions(child)
        else:
            yield action


def _attach(action: argparse.Action, offer: Offer) -> None:
    def completer(prefix: str, parsed_args: argparse.Namespace, **_more: object) -> list[str]:
        return list(offer(prefix, parsed_args))

    action.completer = completer  # type: ignore[attr-defined]


def _among(*names: str) -> Offer:
    return lambda _prefix, _parsed: names


def _files(prefix: str, wanted: Callable[[Path], bool]) -> list[str]:
    """Files below the folder that `prefix` names, and folders on the way to others."""
    head, slash, start = prefix.rpartition("/")
    folder = Path(head + slash).expanduser() if slash else Path()
    inside = sorted(folder.iterdir()) if folder.is_dir() else []
    found = [path for path in inside if path.name.startswith(start) and (start or not path.name.startswith("."))]
    ends = [(path.name, "/" if path.is_dir() else "") for path in found if path.is_dir() or wanted(path)]
    return [f"{head}{slash}{name}{end}" for name, end in ends]


def _ending(*endings: str) -> Offer:
    return lambda prefix, _parsed: _files(prefix, lambda path: path.suffix.lower() in endings)


def _tables(prefix: str, parsed: argparse.Namespace) -> Iterable[str]:
    from fitball.data.bundled import bundled_names

    return [*_ending(*TABLES)(prefix, parsed), *(name for name in bundled_names() if name.startswith(prefix))]


def _fits(prefix: str, _parsed: argparse.Namespace) -> Iterable[str]:
    """Folders, without a slash where they hold a fit, which is where the word ends."""
    places = _files(prefix, lambda path: path.name == "fit.json")
    ends = [(Path(place).expanduser() / "fit.json").is_file() for place in places]
    return [place.rstrip("/") if end else place for place, end in zip(places, ends, strict=True)]


def _models(prefix: str, _parsed: argparse.Namespace) -> Iterable[str]:
    """Names of models, the last of a list, each with its closures behind `+`."""
    before, comma, last = prefix.rpartition(",")
    model, *parts = last.split("+")
    if not parts:
        return [f"{before}{comma}{name}" for name in known_names.CLOSURES]
    stem = before + comma + "+".join([model, *parts[:-1]])
    return [f"{stem}+{text}" for text in _closures_of(model)]


def _closures_of(model: str) -> list[str]:
    known: Mapping[str, tuple[str, ...]] = known_names.CLOSURES.get(model, {})
    return [f"{name}={option}" for name, options in known.items() for option in options]


def _closures(_prefix: str, parsed: argparse.Namespace) -> Iterable[str]:
    return _closures_of(getattr(parsed, "model", None) or next(iter(known_names.CLOSURES)))


def _specs() -> Iterable[str]:
    from fitball.models.specs import SPECS

    return SPECS


def _parameters(prefix: str, _parsed: argparse.Namespace) -> Iterable[str]:
    return () if "=" in prefix else [f"{name}=" for name in (*_specs(), *known_names.NOISE_PARAMETERS)]


def _priors(prefix: str, parsed: argparse.Namespace) -> Iterable[str]:
    """Parameters, and behind one those priors of it that the literature has."""
    from fitball.data.literature import PREFIX, published_priors

    name, equals, _value = prefix.partition("=")
    if not equals:
        return _parameters(prefix, parsed)
    return [f"{name}={PREFIX}{prior.key}" for prior in published_priors() if prior.parameter == name]


# What is offered, by the name under which argparse keeps an argument; for others nothing.
OFFERS: Mapping[str, Offer] = {
    "data": _tables,
    "fit": _fits,
    "model": _models,
    "models": _models,
    "closure": _closures,
    "fix": _parameters,
    "prior": _priors,
    "values": _parameters,
    "pool": lambda _prefix, _parsed: [f"{name}={label}" for name in _specs() for label in known_names.LABELS],
    "offsets": _among(*known_names.LABELS),
    "noise": _among(*known_names.NOISES),
    "velocity_noise": _among(*known_names.VELOCITY_NOISES),
    "kind": _among(*FIGURES, "all"),
    "to": _among(*FORMAT_NAMES),
    "format": _among("png", "svg", "pdf"),
    "example": _among(*known_names.EXAMPLES),
    "shell": _among(*SHELLS),
    "config": _ending(".toml"),
    "force": _ending(*TABLES),
    "port": _ending(*TABLES),
    "csv": _ending(".csv"),
    "animate": _ending(".gif", ".mp4"),
    "target": lambda _prefix, _parsed: (*_specs(), "court pace", "impact="),
    "sensor": _among("contact_time=0.2ms", "force=20N", "camera=0.5", "drop=254cm", "none"),
    "cost": _among("contact_time=", "force=", "camera=", "drop="),
    "contours": _among("v_x2", "v_y2", "v_2", "theta_2", "omega_2", "contact_time"),
    "out": lambda prefix, _parsed: _files(prefix, lambda _path: True),
}
