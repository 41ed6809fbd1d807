"""The roads to impacts: from tables of positions, from films, from recordings of bounces."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from fitball.base.errors import Fault, InputError, ParameterError
from fitball.base.progress import Progress
from fitball.base.text import one_line
from fitball.data.bundled import bundled_file
from fitball.data.read import TableSource
from fitball.data.scene import Scene
from fitball.tracks.film import Filmed
from fitball.tracks.tracking import track
from fitball.tracks.types import FilmOptions
from fitball.video.media import is_film, is_sound

if TYPE_CHECKING:
    from fitball.tracks.watch import Watched

# Part of a refusal that is in the film, and not in how it was read.
_LOOK = "See what was tracked with --film-only"


class TableOptions(NamedTuple):
    """What is stated of tables of positions: the user's header cells by our names, and the name of
    the ball among several objects.
    """

    columns: Mapping[str, str]
    ball: str = ""


class Wanted(NamedTuple):
    """What is wanted of films: positions alone (`film_only`), or the bounces that are heard
    (`sound`); the court by a film on which the ball rolls, or by two points.
    """

    film_only: bool = False
    sound: bool = False
    roll: TableSource = ""
    court: str = ""


def impacts_of(
    sources: Sequence[TableSource],
    scene: Scene,
    tables: TableOptions,
    films: FilmOptions,
    wanted: Wanted,
    as_read: bool,
    progress: Progress,
) -> Filmed:
    """The impacts in tables of positions, films or recordings, of one kind in a call.

    Raises:
        ParameterError: sources are of several kinds (`mixed-sources`), or an option is of another
            kind (`other-option`).
        InputError, FolderError, ParameterError: those of `track`, `watch` or `hear`.
    """
    sources = [_with_bundled(source) for source in sources]
    kinds = {_kind(source) for source in sources}
    if len(kinds) > 1:
        words = "films, recordings and tables of positions were given together; one kind a call"
        raise ParameterError(words, "mixed-sources")
    kind = kinds.pop() if kinds else "table"
    for option in _idle(kind, tables, films, wanted):
        words = f"{option} says nothing of {_NAMES[kind]}: leave it out"
        raise ParameterError(words, "other-option")
    if kind == "table":
        columns, ball = tables
        roll, court = wanted.roll, wanted.court
        return track(sources, scene, columns, as_read, progress, ball, roll, court)
    paths = [Path(str(source)) for source in sources]
    if kind == "sound" or wanted.sound:
        return _of_sound(paths, scene, progress)
    return _of_films(paths, scene, films, wanted, as_read, progress)


_NAMES = {"table": "a table of positions", "film": "a film", "sound": "a recording"}


def _with_bundled(source: TableSource) -> TableSource:
    """The bundled film that a source names, if there is no such file; another source as it is."""
    if isinstance(source, str | Path) and not Path(source).exists():
        bundled = bundled_file(str(source), "tracks")
        if bundled is not None and is_film(bundled):
            return bundled
    return source


def _kind(source: TableSource) -> str:
    """What a source is, by its name: "film", "sound" or "table"."""
    if is_film(source):
        return "film"
    return "sound" if is_sound(source) else "table"


def _idle(kind: str, tables: TableOptions, films: FilmOptions, wanted: Wanted) -> Iterator[str]:
    """The options that were stated and say nothing of sources of this kind."""
    usual = FilmOptions()
    of_films = {
        "--from": films.begin != usual.begin,
        "--to": films.end != usual.end,
        "--region": films.region is not None,
        "--tilt": films.tilt is not None,
        "--film-only": wanted.film_only,
        "--sound": wanted.sound,
    }
    of_court = {"--roll": not _is_none(wanted.roll), "--court": bool(wanted.court)}
    of_tables = {"--columns": bool(tables.columns), "--ball": bool(tables.ball)}
    idle = {
        "table": of_films,
        "film": of_tables,
        "sound": of_films | of_court | of_tables,
    }[kind]
    yield from (option for option, stated in idle.items() if stated)


def _is_none(source: TableSource) -> bool:
    """Whether a source is not stated."""
    return isinstance(source, str) and not source


def _of_sound(paths: Sequence[Path], scene: Scene, progress: Progress) -> Filmed:
    """The bounces that are heard, as impacts."""
    import pandas as pd

    from fitball.tracks.sounds import hear

    heard = hear(paths, scene, progress)
    none = pd.DataFrame()
    return Filmed(
        impacts=heard.impacts,
        tracks=none,
        spins=none,
        session=none,
        refused=heard.refused,
        scene=heard.scene,
        notes=heard.notes,
        scales=none,
        heard=heard,
    )


def _of_films(
    paths: Sequence[Path],
    scene: Scene,
    films: FilmOptions,
    wanted: Wanted,
    as_read: bool,
    progress: Progress,
) -> Filmed:
    """The impacts, or the positions alone, of films."""
    import pandas as pd

    # What finds balls takes long to import, and tables do not need it.
    from fitball.tracks.watch import watch

    by_court = bool(wanted.court) or not _is_none(wanted.roll)
    films = films._replace(level=not by_court)
    watched = watch(paths, scene, films, progress)
    if wanted.film_only:
        none = pd.DataFrame()
        return Filmed(
            impacts=none,
            tracks=none,
            spins=none,
            session=none,
            refused=watched.refused,
            scene=watched.scene,
            notes=watched.notes,
            scales=none,
            watched=watched,
        )
    roll = _rolled(wanted.roll, scene, films, progress)
    try:
        film = track(
            [watched.positions], watched.scene, {}, as_read, progress, "", roll, wanted.court
        )
    except InputError as error:
        raise _of_film(paths, watched, error) from None
    return replace(
        film,
        refused={**watched.refused, **film.refused},
        notes=(*watched.notes, *film.notes),
        watched=watched,
    )


def _rolled(roll: TableSource, scene: Scene, films: FilmOptions, progress: Progress) -> TableSource:
    """The positions of a ball that rolls along the court on a film, or in a table; "" without."""
    from fitball.tracks.watch import watch

    if _is_none(roll) or not is_film(roll):
        return roll
    # The part is that of the other films.
    rolling = FilmOptions(region=films.region, tilt=films.tilt, level=False, rolling=True)
    return watch([Path(str(roll))], scene, rolling, progress).positions


def _of_film(paths: Sequence[Path], watched: Watched, error: InputError) -> InputError:
    """An error in positions as one of the films that have them, with the faults of the others."""
    names = ", ".join(one_line(path.name) for path in paths[:3])
    first, *rest = error.faults
    words = f"{first.message}. {_LOOK}"
    others = [Fault("no-ball", f"{name}: {why}") for name, why in watched.refused.items()]
    return InputError(names, [Fault(first.code, words), *rest, *others], error.hints)
