"""Tracked impacts for a person as one document, and as JSON: what was found, with which errors, what was assumed."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fitball.data.scene import Quantity
from fitball.inference.problem.camera import CAMERA_SPECS
from fitball.report.form.document import Document, Picture, Row, Section, Table, Words, on_terminal
from fitball.report.form.numbers import Scale, digits, fixed, handy, listed, percent, plus_minus
from fitball.tracks.frames import AFTER, BEFORE, CONTACT, NINE, Check, SessionNoise, TrackedImpact, Tracks
from fitball.tracks.impacts import columns_of, measured
from fitball.tracks.lines import FRAMES, five_frame_lines, line_errors
from fitball.visible import one_line
from fitball.wording import spoken

SPEEDS = ("v_x1", "v_y1", "v_x2", "v_y2")
SPINS = ("omega_1", "omega_2", "gap_turn")
WORDS = {
    "v_x1": "incident velocity along the court", "v_y1": "incident velocity towards it", "omega_1": "incident spin",
    "v_x2": "rebound velocity along the court", "v_y2": "rebound velocity away from it", "omega_2": "rebound spin",
    "gap_time": "time between the flights, T", "gap_path": "path between the flights, P",
    "gap_turn": "turn between the flights, Q",
}  # fmt: skip
NO_SPIN = "A fit takes incident spins as zero: its intervals are too narrow for balls that spin."
# Pictures of impacts on a page, notes and refusals of the first screen.
MOST_PICTURES, FIRST_NOTES = 12, 3


def pictured(tracks: Tracks) -> list[TrackedImpact]:
    """The impacts of which a page has a picture: all, or of many the first, those with notes before others."""
    order = sorted(range(len(tracks.impacts)), key=lambda k: (not _doubtful(tracks.impacts[k]), k))
    return [tracks.impacts[k] for k in sorted(order[:MOST_PICTURES])]


def picture_name(impact: TrackedImpact, tracks: Tracks) -> str:
    """The name of its picture."""
    return f"impact-{tracks.impacts.index(impact)}"


def _doubtful(impact: TrackedImpact) -> bool:
    return bool(impact.notes) or (bool(impact.pairs) and not impact.sure)


def track_document(
    tracks: Tracks, sources: Sequence[str], folder: Path | None = None, images: Collection[str] = (),
    command: str | None = None,
) -> Document:  # fmt: skip
    """The report: the answer first, then each impact, the session, and how it was done."""
    shown = pictured(tracks)
    left = len(tracks.impacts) - len(shown)
    pictures: list[Any] = [
        Picture(picture_name(impact, tracks), _caption(impact), f"track and residuals of impact {impact.id}")
        for impact in shown
        if picture_name(impact, tracks) in images
    ]
    if left and pictures:
        pictures.append(
            Words([f"Pictures of {len(shown)} of {len(tracks.impacts)} impacts; tracks.csv has the frames of all."])
        )
    session: list[Any] = [Table("Session", _session_rows(tracks), ["what"]), Words(_session_words(tracks), "list")]
    if "session" in images:
        session.append(
            Picture("session", "Coefficient of restitution and gaps over speed.", "COR and gaps over incident speed")
        )
    lines = Table.from_rows("Five-frame lines", _line_rows(tracks), count=len(tracks.impacts), rest="`impacts.csv`")
    spins = Table.from_rows("Candidates", _spin_rows(tracks), ["taken"], rest="`spins.csv`")
    sections = [
        Section("impacts", "Impacts", [
            Table.from_rows("Impacts", _impact_rows(tracks), count=len(tracks.impacts), rest="`impacts.csv`"),
            Words([
                "Standard errors are those of each impact alone. Errors that the session shares are in "
                "`impacts.toml`, and `impacts_covariance.csv` has how errors of an impact belong together."
            ], only="page"),
        ]),
        Section("spins", "Spins", [
            Words(_spin_words(tracks)), spins,
        ]),
        Section("tracks", "Tracks", pictures),
        Section("session", "Session", session),
        Section("camera", "What a fit takes from here", [Table("Camera", _camera_rows(tracks), ["prior"])]),
        Section("lines", f"Straight lines through {FRAMES} frames", [Words(_line_words(tracks)), lines]),
        Section("refused", "Tracks without an impact", [Words(_refused(tracks), "list")]),
        Section("notes", "Notes", [Words([one_line(note) for note in _notes(tracks)], "list")]),
        Section("assumed", "What was taken as known", [Words(_assumed(tracks), "list")]),
    ]  # fmt: skip
    if command is not None:
        sections.append(Section("command", "Command", [Words([command], "code")]))
    return Document(_title(tracks, sources), _lead(tracks, sources, folder), sections)


def render(tracks: Tracks, sources: Sequence[str], folder: Path | None = None) -> str:
    """The report on a terminal."""
    return on_terminal(track_document(tracks, sources, folder))


def _title(tracks: Tracks, sources: Sequence[str]) -> str:
    return f"{_count(len(tracks.impacts), 'impact')} from {_count(len(sources), 'file')} of positions"


def _count(number: int, name: str) -> str:
    return f"{number:,} {name}{'' if number == 1 else 's'}"


def _lead(tracks: Tracks, sources: Sequence[str], folder: Path | None) -> list[Any]:
    found = f"{_count(len(tracks.impacts), 'impact')} found in {_count(len(sources), 'file')}"
    without = f"; {_count(len(tracks.refused), 'track')} without one" if tracks.refused else ""
    texts = [f"{found}{without}."]
    texts += [
        f"Noise of a frame{f' in session {one_line(name)}' if name else ''}: {_noise(noise)}."
        for name, noise in [*tracks.noise.items()][:3]
    ]
    texts += _spin_words(tracks)
    doubts = [f"Impact {one_line(it.id)}: {one_line(it.notes[0])}" for it in tracks.impacts if it.notes]
    doubts = [*_refused(tracks)[:FIRST_NOTES], *doubts[:FIRST_NOTES]]
    parts: list[Any] = [
        Words(texts, "lead", rank="first"),
        Table.from_rows("Errors", _error_rows(tracks), ["what"], rank="first", spare="what"),
        Words(doubts, "list", only="terminal", rank="first"),
        # On a terminal notes come before the report.
        Words([one_line(note) for note in tracks.notes[: 2 * FIRST_NOTES]], "list", only="page"),
    ]
    if folder is not None:
        go_on = spoken(f"fitball calibrate {folder / 'impacts.csv'}", "fitball.calibrate(result.table)")
        report = f"Report: {folder / 'tracks.html'}"
        parts.append(Words([report, f"Next: {go_on}"], "lead", only="terminal", rank="first"))
    return parts


def _noise(noise: SessionNoise) -> str:
    texts = [f"{digits(1e3 * noise.x, 2)} mm along the court", f"{digits(1e3 * noise.y, 2)} mm upwards"]
    if np.isfinite(noise.angle) and noise.angle > 0.0:
        texts.append(f"{digits(np.degrees(noise.angle), 2)} deg of the mark")
    return f"{listed(texts)}; outliers {percent(noise.outliers, fine=True)}"


def _scale(name: str) -> Scale:
    return (
        handy(name, {"gap_time": "s", "gap_path": "m", "gap_turn": "rad"}.get(name, ""))
        if name.startswith("gap")
        else Scale("rad/s" if name.startswith("omega") else "m/s")
    )


def _error_rows(tracks: Tracks) -> list[Row]:
    """Median and range of the standard errors, and how far five-frame lines are off."""
    rows = []
    off = line_errors(tracks.impacts)
    for name in columns_of(tracks):
        scale = _scale(name)
        sds = scale.factor * np.array([it.sd(name) for it in tracks.impacts if name in measured(it)])
        if not sds.size:
            continue
        row = {
            "quantity": name, "impacts": f"{sds.size:,}",
            "standard error": f"{digits(float(np.median(sds)), 2)} {scale.unit}",
            "from": digits(float(sds.min()), 2), "to": digits(float(sds.max()), 2),
        }  # fmt: skip
        if name in SPEEDS:
            column = off[:, SPEEDS.index(name)]
            rms = float(np.sqrt(np.nanmean(column**2))) if np.isfinite(column).any() else np.nan
            row[f"{FRAMES}-frame lines differ by"] = f"{digits(rms, 2)} {scale.unit}"
        rows.append(row | {"what": WORDS[name]})
    return rows


def _impact_rows(tracks: Tracks) -> list[Row]:
    sessions = len({impact.track.session for impact in tracks.impacts}) > 1
    rows = []
    for impact in tracks.impacts:
        row: Row = {"impact": one_line(impact.id)}
        if sessions:
            row["session"] = one_line(impact.track.session)
        own = measured(impact)
        for name in columns_of(tracks):
            scale = _scale(name)
            value, sd = scale.factor * impact.values[NINE.index(name)], scale.factor * impact.sd(name)
            row[f"{name} [{scale.unit}]"] = plus_minus(value, sd) if name in own else "-"
        row["frames"] = f"{_frames(impact, BEFORE)} + {_frames(impact, AFTER)}"
        row["outliers"] = str(int((impact.weight[_flying(impact)] < 0.5).sum()))
        rows.append(row)
    return rows


def _flying(impact: TrackedImpact) -> np.ndarray[Any, np.dtype[np.bool_]]:
    return np.asarray((impact.role == BEFORE) | (impact.role == AFTER))


def _frames(impact: TrackedImpact, role: int) -> int:
    return int((impact.role == role).sum())


def _spin_words(tracks: Tracks) -> list[str]:
    marked = [impact for impact in tracks.impacts if impact.pairs]
    if not marked:
        return [f"No marks: spins were not measured. {NO_SPIN}"] if tracks.impacts else []
    open_ = [impact for impact in marked if not impact.sure]
    blank = len(tracks.impacts) - len(marked)
    left = f"{blank} of {len(tracks.impacts)} impacts have no marks: their spins are empty"
    more = [f"{left}, and a fit leaves these rows out."] if blank and len(open_) < len(marked) else []
    if not open_:
        return [f"Spins of all {len(marked)} impacts with marks are sure.", *more]
    if len(open_) == len(marked):
        return [
            f"The spins of no impact are sure: they are empty in impacts.csv. {NO_SPIN} "
            "A higher frame rate or a single dot as mark determines them; spins.csv has the candidates."
        ]
    return [
        f"Spins of {len(marked) - len(open_)} of {len(marked)} impacts with marks are sure. The others are empty in "
        "impacts.csv, and a fit leaves these rows out; spins.csv has the candidates.",
        *more,
    ]


def _spin_rows(tracks: Tracks) -> list[Row]:
    """Candidates of the impacts whose spins are not sure."""
    rows = []
    for impact in tracks.impacts:
        if impact.sure:
            continue
        for pair in sorted(impact.pairs, key=lambda pair: -pair.probability):
            sds = np.sqrt(np.diagonal(pair.covariance))
            rows.append({
                "impact": one_line(impact.id), "omega_1 [rad/s]": plus_minus(pair.omega_1, float(sds[0])),
                "omega_2 [rad/s]": plus_minus(pair.omega_2, float(sds[1])),
                "gap_turn [deg]": plus_minus(np.degrees(pair.turn), float(np.degrees(sds[2]))),
                "probability": fixed(pair.probability, 3) if pair.probability >= 5e-4 else "< 0.001",
            })  # fmt: skip
    return rows


def _caption(impact: TrackedImpact) -> str:
    texts = [f"Impact {one_line(impact.id)}, {one_line(impact.track.source)}"]
    for name in ("gap_time", "gap_path", "gap_turn"):
        if name in measured(impact):
            scale = _scale(name)
            texts.append(f"{name} {scale.plus_minus(impact.values[NINE.index(name)], impact.sd(name))} {scale.unit}")
    contact = _frames(impact, CONTACT)
    texts.append(f"{_count(contact, 'frame')} of the contact left out")
    return ". ".join(["; ".join(texts), *map(one_line, impact.notes)])


def _session_rows(tracks: Tracks) -> list[list[str]]:
    names = list(dict.fromkeys([*tracks.noise, *tracks.gravity, *tracks.scale]))
    rows = [["what", *([one_line(name) or "all" for name in names])]]

    def line(words: str, cells: Sequence[str]) -> None:
        if any(cell != "-" for cell in cells):
            rows.append([words, *cells])

    noise = [tracks.noise.get(name) for name in names]
    line("noise along the court [mm]", [_cell(1e3 * it.x) if it else "-" for it in noise])
    line("noise upwards [mm]", [_cell(1e3 * it.y) if it else "-" for it in noise])
    line("noise of the mark [deg]", [_cell(float(np.degrees(it.angle))) if it else "-" for it in noise])
    line("outliers", ["-" if it is None else percent(it.outliers, fine=True) for it in noise])
    line("factor of slow errors", [_cell(it.slow) if it else "-" for it in noise])
    line("pairs of near and far frames", ["-" if it is None else f"{it.pairs:,}" for it in noise])
    line("gravity [m/s^2]", [_check(tracks.gravity.get(name)) for name in names])
    line("scale by the radius", [_check(tracks.scale.get(name)) for name in names])
    return rows


def _cell(value: float) -> str:
    return digits(value, 2)


def _check(found: Check | None) -> str:
    return "-" if found is None else plus_minus(found.value, found.sd)


def _session_words(tracks: Tracks) -> list[str]:
    texts = []
    if any(noise.slow > 1.0 for noise in tracks.noise.values()):
        texts.append("The factor of slow errors widens all standard errors of positions and is included in them.")
    return texts


def _camera_rows(tracks: Tracks) -> list[list[str]]:
    rows = [["parameter", "prior", "meaning"]]
    for name, spec in CAMERA_SPECS.items():
        stated = getattr(tracks.camera, name)
        if isinstance(stated, Quantity):
            unit, factor = spec.handy or (spec.unit, 1.0)
            text = f"{stated.value * factor:.5g}, held"
            if stated.sd is not None:
                text = plus_minus(stated.value * factor, stated.sd * factor)
            rows.append([name, f"{text} {unit}".strip(), spec.meaning])
    return rows


def _line_words(tracks: Tracks) -> list[str]:
    off = line_errors(tracks.impacts)
    if not np.isfinite(off).any():
        return []
    rms = float(np.sqrt(np.nanmean(off**2)))
    ours = float(np.sqrt(np.mean([it.sd(name) ** 2 for it in tracks.impacts for name in SPEEDS])))
    return [
        f"Straight lines through {FRAMES} frames on each side differ from these speeds by {digits(rms, 2)} m/s (root "
        f"mean square). The standard error of the flights is {digits(ours, 2)} m/s."
    ]


def _line_rows(tracks: Tracks) -> list[Row]:
    rows = []
    for impact in tracks.impacts:
        row: Row = {"impact": one_line(impact.id)}
        for name, value in zip(SPEEDS, five_frame_lines(impact), strict=True):
            places = _scale(name).decimals(impact.sd(name))
            row[f"{name} [m/s]"] = plus_minus(impact.values[NINE.index(name)], impact.sd(name))
            row[f"line {name[2:]}"] = fixed(float(value), places)
        rows.append(row)
    return rows


def _refused(tracks: Tracks) -> list[str]:
    return [one_line(f"{it.id} ({it.source}): {it.reason}") for it in tracks.refused]


def _notes(tracks: Tracks) -> list[str]:
    own = [f"impact {impact.id}: {note}" for impact in tracks.impacts for note in impact.notes]
    files = list(dict.fromkeys(note for impact in tracks.impacts for note in impact.track.notes))
    return list(dict.fromkeys([*tracks.notes, *files, *own]))


def _assumed(tracks: Tracks) -> list[str]:
    ball, air, filmed = tracks.filmed.ball, tracks.filmed.air, tracks.filmed
    court = "not stated" if filmed.court is None else f"at {1e3 * filmed.court:g} mm in the coordinates of the film"
    least, most = (1e3 * time for time in filmed.contact_time[1:])
    return [
        f"ball: {1e3 * ball.mass:g} g, radius {1e3 * ball.radius:g} mm",
        f"drag coefficient {air.drag:g} ± {air.drag_sd:g}, air {air.density:g} kg/m^3",
        f"height of the court: {court}",
        f"plausible time between the flights: {least:g} to {most:g} ms",
    ]


def track_json(tracks: Tracks) -> dict[str, Any]:
    """Impacts with their errors in SI, the session, refusals and notes, for other programs."""
    return {
        "impacts": [
            {
                "id": impact.id,
                "source": impact.track.source,
                "session": impact.track.session,
                "values": {name: float(impact.values[NINE.index(name)]) for name in measured(impact)},
                "sd": {name: impact.sd(name) for name in measured(impact)},
                "frames": [_frames(impact, BEFORE), _frames(impact, AFTER)],
                "spins_sure": impact.sure,
                "notes": list(impact.notes),
            }
            for impact in tracks.impacts
        ],
        "noise": {name: _finite(vars(noise)) for name, noise in tracks.noise.items()},
        "gravity": {name: _finite(vars(check)) for name, check in tracks.gravity.items()},
        "scale": {name: _finite(vars(check)) for name, check in tracks.scale.items()},
        "refused": [vars(item) for item in tracks.refused],
        "notes": list(tracks.notes),
    }


def _finite(values: dict[str, Any]) -> dict[str, Any]:
    return {name: value if np.isfinite(value) else None for name, value in values.items()}
