"""The sentences and remedies of adequacy; its rules are in `adequacy`."""

from collections.abc import Callable, Mapping, Sequence

from fitball.base.columns import COLUMNS
from fitball.base.display_units import PLAIN
from fitball.base.numbers import counted, percent
from fitball.base.text import listed
from fitball.inference.problem.camera import CAMERA_SPECS
from fitball.inference.schema import Answer, NoiseCheck, ResidualTest

# What to do where a kind of test finds a pattern.
REMEDIES = {
    "bias": "check zero and scale of this column",
    "trend": "another model, or a narrower range of impacts",
    "row": "check whether ball, court or camera changed in the course of the session",
    "group": "fit a parameter to each label of that column",
    "parameter": "fit this parameter to each label of that column",
    "drift": "check whether ball, court or camera changed in the course of the session",
    "law": "friction may depend on the speed: fit slow and fast impacts apart",
    "growth": "state the error of each measurement in columns such as `v_x2_sd`",
    "outlier": "check these rows; `--noise student-t` gives outliers less weight",
    "linked": "state errors of the incident state in columns such as `v_1_sd`",
    "camera": "state it in [camera] of the scene, with its sd, and it is fitted",
}
# Patterns that a sentence names, the surest: `tests` of the fit has all of them.
NAMED_PATTERNS = 3
# Impacts that a sentence names, at most.
NAMED_IMPACTS = 6
# Sds by which a misfit moves a parameter, for it to be mentioned: no usual interval is as wide.
MENTIONED_SHIFT = 5.0
# Settings of the camera that are ratios near 1: what they differ by begins at the third digit.
RATIO_SETTINGS = ("scale", "clock")
# Digits of such a ratio: thousandths of it matter.
DIGITS_OF_RATIO = 4
# Digits of any other number: a noise of some tens of impacts is known to a tenth.
DIGITS_OF_NUMBER = 2
# The answers, as sentences begin with them.
_HEADS: Mapping[Answer, str] = {
    "describes": "The model describes the data",
    "describes except": "The model describes the data, with exceptions",
    "does not describe": "The model does not describe the data",
}


def described(
    answer: Answer,
    tests: Sequence[ResidualTest],
    noise: Sequence[NoiseCheck],
    moved: Mapping[str, float],
    impacts: int,
    measured: Callable[[str], str],
) -> str:
    """The sentence of an answer, with the patterns of `tests`, and the quantity that they move most
    where that is far. If the model describes the data, these patterns are far below the noise.
    """
    objections = [f"residuals of {_noise(check, measured)}" for check in noise if check.found]
    objections += [f"{test.pattern}{_share(test.explained)}" for test in tests[:NAMED_PATTERNS]]
    if len(tests) > NAMED_PATTERNS:
        objections.append(f"{len(tests) - NAMED_PATTERNS} more")
    head = _HEADS[answer]
    text = "; ".join(objections)
    if answer == "describes":
        fine = f"With {impacts:,} impacts, patterns far below the noise are significant: {text}."
        text = f"{head}. {fine}" if tests else f"{head}: no residual test finds a pattern."
    else:
        text = f"{head}: {text}."
    name = max(moved, key=lambda name: moved[name], default="")
    if name and moved[name] >= MENTIONED_SHIFT:
        shift = f"{moved[name]:.0f} of its sds, which no interval includes"
        text += f" The misfit shifts {name} by {shift}."
    return text


def too_few(
    blind: Mapping[str, float],
    counts: Mapping[str, int],
    *,
    alike: bool,
    impacts: int,
) -> str:
    """The sentence that the data are too few to test the model. `blind` has by column the share of
    the variance that would be noticed, `counts` the measurements of every column; all impacts may
    be `alike` in their incidence.
    """
    if alike:
        return (
            f"All {counted(impacts, 'impact')} have the same incidence: residuals cannot test "
            "the model."
        )
    count = max(counts[name] for name in blind)
    few = counted(count, "impact")
    if len(blind) < len(counts):
        few = f"{counted(count, 'measurement')} of {listed(blind)}"
    verb = "is" if count == 1 else "are"
    least = min(blind.values())
    limit = "no misfit would be noticed"
    if least < 1.0:
        size = percent(least).replace(">", "more than")
        limit = f"only a misfit of {size} of the residual variance would be noticed"
    rest = listed(name for name in counts if name not in blind)
    more = f" In {rest}, no residual test finds a pattern." if rest else ""
    return f"{few} {verb} too few to test the model: {limit}.{more}"


def noises(noise: Sequence[NoiseCheck], measured: Callable[[str], str]) -> str:
    """The sentence with the residuals of each column beside the noise stated or expected."""
    if not noise:
        return ""
    texts = "; ".join(_noise(check, measured) for check in noise)
    return f"Residuals: {texts}."


def _noise(check: NoiseCheck, measured: Callable[[str], str]) -> str:
    """The size of a column's residuals beside the noise that was stated or expected."""
    unit = COLUMNS[check.column].display_unit
    size = unit.with_unit(unit.number(check.size, DIGITS_OF_NUMBER))
    reference = unit.with_unit(unit.number(check.reference, DIGITS_OF_NUMBER))
    kind = "stated" if check.stated else "expected"
    ratio = PLAIN.number(check.size / check.reference, DIGITS_OF_NUMBER)
    beyond = " beyond its stated errors" if check.beyond else ""
    name = of_size(check.column, measured(check.column))
    return f"{name} {size}{beyond}, {ratio} × the {kind} {reference}"


def of_size(column: str, measured: str) -> str:
    """What has a size in the unit of a column: that of a height or a time `measured` for it is the
    speed made from it.
    """
    return column if measured == column else f"speed of {measured}"


def _share(explained: float) -> str:
    """The share of the residual variance that a pattern explains, in brackets; "" for none."""
    if explained <= 0.0:
        return ""
    return f" ({percent(explained)} of the residual variance)"


def outliers(column: str, ids: Sequence[str]) -> str:
    """The pattern of impacts that are far off in a column, in words."""
    noun = "impacts" if len(ids) > 1 else "impact"
    return f"{column}: {noun} {listed(ids, most=NAMED_IMPACTS)} far off"


def camera(key: str, value: float) -> str:
    """The pattern of a camera setting `value`, in SI, that would explain residuals, in words."""
    unit = CAMERA_SPECS[key].display_unit
    digits = DIGITS_OF_RATIO if key in RATIO_SETTINGS else DIGITS_OF_NUMBER
    return f"{key} of the camera as if {unit.with_unit(unit.number(value, digits))}"
