"""What would help most after a fit: commands that run on its table, with names filled in.

Each command changes something: a comparison has models that can differ, a level has labels, a noise
is another than that of the fit. `FIT` stands for the folder of the fit, which pages and the command
line fill in.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

from fitball.base.numbers import fixed, signed
from fitball.base.text import listed
from fitball.data.bundled import descriptions, path_of_source
from fitball.data.table import SPIN_CHOICE
from fitball.inference.fitted import Fitted
from fitball.inference.judgement.adequacy_words import REMEDIES
from fitball.inference.problem.problem import base_of
from fitball.inference.schema import ResidualTest
from fitball.models.registry import candidates
from fitball.models.specs import SPECS
from fitball.report.frame_rows import frame_rows
from fitball.report.own_folder import FIT

# Kinds of patterns that another model may describe.
_OF_MODELS = ("bias", "trend", "group", "parameter", "law", "linked")
# Fewest impacts of which a comparison can leave one out.
_LEAST_COMPARED = 3
# The option that a pattern names itself.
_OPTION = re.compile(r" \((--pool [^()]*)\)$")
# Sds from which a shift by an assumption matters.
_LARGE_SHIFT = 2.0


def useful_next(fit: Fitted) -> str:
    """A sentence on what would help most: to remove a misfit, to determine what is not, to decide
    between variants that matter; empty if none of these is needed.
    """
    advice = next(_advice(fit), "")
    return f"Most useful next: {advice}." if advice else ""


def better_variants(fit: Fitted) -> str:
    """A sentence on the variant that predicts left-out impacts surely better than the fit, with the
    command; empty without any.
    """
    variants = [variant for variant in fit.alternatives if variant.better]
    variants.sort(key=lambda variant: variant.score or 0.0, reverse=True)
    if not variants:
        return ""
    best, *others = variants
    name, _, option = best.choice.partition("=")
    if name == SPIN_CHOICE:
        command = f"add columns omega_1 = 0 and {SPIN_CHOICE} = {option} rad/s, or measure spins"
    elif name == "noise":
        command = _command(fit, "calibrate", f"--noise {option}")
    else:
        command = _command(fit, "calibrate", f"--model {best.model}")
    score = f"{signed(best.score or 0.0)} ± {fixed(best.error, 1)}"
    more = f"; better too: {listed(other.choice for other in others)}" if others else ""
    return f"Better than this fit is {best.choice} (score {score}): {command}{more}."


def remedy(fit: Fitted, test: ResidualTest) -> str:
    """What to do about a pattern that was found, with commands for this table: another model first,
    then a parameter for each label where labels may differ in it.
    """
    compared = _compare(fit, test.kind)
    pooled = _OPTION.search(test.pattern)
    if pooled is not None:
        return _or(compared, _command(fit, "calibrate", pooled[1]))
    if test.kind == "group":
        return _or(compared, _pool_of_group(fit, test))
    if test.kind == "outlier":
        check = "check these rows"
        if fit.run.choices.noise or fit.run.scene.measurement.get("noise"):
            return check
        again = _command(fit, "calibrate", "--noise student-t")
        return f"{check}; {again} gives outliers less weight"
    if test.kind == "parameter":
        return compared or REMEDIES["trend"]
    if test.kind == "trend" and not compared and not fit.run.table.has_tangential:
        return _of_drops(fit)
    if test.kind in _OF_MODELS:
        return _or(compared, REMEDIES[test.kind])
    return REMEDIES.get(test.kind, "")


def _advice(fit: Fitted) -> Iterator[str]:
    """What would help, the most helpful first, as words for a sentence."""
    tests = [test for test in fit.adequacy.tests if test.found and test.kind in REMEDIES]
    remedies = [remedy(fit, test) for test in tests]
    yield from _of_bounds(fit)
    fails = fit.adequacy.answer == "does not describe"
    if fails and any(note.code == "misread" for note in fit.notes):
        yield f"{_command(fit, 'check')}, which says how else the table may be read"
    of_models = [
        words for test, words in zip(tests, remedies, strict=True) if test.kind in _OF_MODELS
    ]
    if of_models:
        # Where labels differ that is told beside the comparison.
        yield next((words for words in of_models if "--pool " in words), of_models[0])
    if fails:
        yield _compare(fit, "trend") or _of_drops(fit)
    yield from remedies
    yield from _of_undetermined(fit)
    yield from _of_variants(fit)


def _of_drops(fit: Fitted) -> str:
    """What helps where the model of vertical impacts fails and no law of restitution is better."""
    if len(fit.run.table) < _LEAST_COMPARED:
        return "more impacts"
    return (
        "the restitution at each tested speed (section Drop test), a narrower range of speeds, or "
        "a model of your own (`--model FILE.py:NAME`)"
    )


def _of_undetermined(fit: Fitted) -> Iterator[str]:
    """What helps to determine parameters of the model that the data do not."""
    rows = fit.summary
    undetermined = rows["verdict"].isin(("prior-dominated", "one-sided"))
    poor = rows.index[undetermined & rows["kind"].isin(("model", "level"))]
    timed = any(observable.column.timed for observable in fit.problem.observables)
    if "k_y" in poor and not timed and fit.problem.contact_time is None:
        stiff = listed(name for name in poor if name in ("k_y", "k_theta"))
        yield f"the contact time, or `gap_time` from a film; it determines {stiff}"
    if len(poor):
        target = ",".join(map(str, poor))
        plan = f"`fitball plan {FIT} --target {shlex.quote(target)}` proposes them"
        if fit.posterior is None:
            plan = f"a plan of them begins with the posterior, {_command(fit, 'calibrate')}"
        yield f"impacts that determine {listed(poor)}; {plan}"


def _of_bounds(fit: Fitted) -> Iterator[str]:
    """What to do where a best value lies on a hard bound of its prior."""
    for name, estimate in fit.parameters.items():
        if estimate.rule == "at-bound":
            best = f"its best value lies on the bound {estimate.point:.4g} of {estimate.prior}"
            base = SPECS.get(base_of(name))
            if base is None or base.prior == estimate.prior:
                yield f"another prior of {name}: {best}"
            else:
                wider = f"--prior {shlex.quote(f'{name}={base.prior}')}"
                yield f"another prior, {_command(fit, 'calibrate', wider)}: {best}"


def _of_variants(fit: Fitted) -> Iterator[str]:
    """Which data decide between variants that fit equally well and matter."""
    frame = fit.variants
    choices = frame["as_good"].astype(bool) & (frame["instead_of"] != "")
    matter = frame_rows(frame[choices & (frame["moved"] > _LARGE_SHIFT)])
    if matter:
        farthest = max(matter, key=lambda row: row.number("moved"))
        choice = farthest.text("choice")
        yield f"data that decide between `{farthest.text('instead_of')}` and `{choice}`"


def _compare(fit: Fitted, kind: str) -> str:
    """The command that compares models on this table, for a pattern of a `kind`; empty where it has
    too few impacts, or models cannot differ in such a pattern: those of drops differ in the law of
    restitution, which is no difference between labels, and which the fit has tried.
    """
    table = fit.run.table
    models = candidates(
        tangential=table.has_tangential,
        spin=table.has_spin,
        timed=table.has_times,
    )
    of_labels = kind in ("group", "parameter") and not table.has_tangential
    if len(table) < _LEAST_COMPARED or len(models) < 2 or of_labels:
        return ""
    laws = [variant for variant in fit.alternatives if variant.instead_of.startswith("cor=")]
    if not table.has_tangential and laws and not any(variant.better for variant in laws):
        return ""
    return _command(fit, "compare")


def _pool_of_group(fit: Fitted, test: ResidualTest) -> str:
    """The command that fits a parameter to each label of a column in which a bias was found: the
    restitution of a vertical velocity, else the friction; empty where that is done already, or
    there is no such column of labels.
    """
    levels = {(level.parameter, level.column) for level in fit.problem.forward.levels}
    names = {spec.name for spec in fit.problem.forward.model.parameters}
    parameter = "cor_10" if test.column == "v_y2" or "mu" not in names else "mu"
    for column in fit.run.table.labels:
        is_group = f" in {column} " in test.pattern
        if is_group and parameter in names and (parameter, column) not in levels:
            return _command(fit, "calibrate", f"--pool {shlex.quote(f'{parameter}={column}')}")
    return ""


def _command(fit: Fitted, verb: str, options: str = "") -> str:
    """A command on the table of a fit, read as it was; of a table in memory the function of
    Python.
    """
    read = fit.run.table.read
    sources = [entry.get("source", "") for entry in read]
    if not sources or not all(Path(source.partition("#")[0]).is_file() for source in sources):
        return f"`fitball.{verb}`" + (f" with `{options}`" if options else "")
    words = ["fitball", verb, *map(_source_name, sources)]
    for name in ("columns", "flip", "ignore"):
        if read[0].get(name):
            words += [f"--{name}", read[0][name]]
    if verb != "check":
        if any(note.code == "misread" for note in fit.notes):
            words.append("--as-read")
        words += _choices(fit, verb, options)
    return f"`{' '.join([shlex.join(words), options]).strip()}`"


def _choices(fit: Fitted, verb: str, options: str) -> list[str]:
    """The options by which the fit was chosen that count in another one, but for what its `options`
    say.
    """
    choices = fit.run.choices
    words = list[str]()
    stated_model = verb != "calibrate" or "--model " in options
    if choices.model and not stated_model and ".py:" not in choices.model:
        words += ["--model", choices.model]
    for name in ("fix", "prior", "pool"):
        chosen = getattr(choices, name).items()
        pairs = [f"{key}={value}" for key, value in chosen if f"{key}=" not in options]
        if pairs:
            words += [f"--{name}", ",".join(pairs)]
    if choices.noise and "--noise" not in options:
        words += ["--noise", choices.noise]
    return words


def _source_name(source: str) -> str:
    """A table as the command line takes it: of a bundled one the name."""
    name = Path(source).stem
    bundled = name in descriptions() and path_of_source(name) == Path(source)
    return name if bundled else source


def _or(*commands: str) -> str:
    """Commands of which one will serve; those that are empty are left out."""
    return ", or ".join(filter(None, commands))
