"""What a scene states that nothing of a table's fits uses, said in one note: `scene-not-used`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from fitball.base.errors import Note
from fitball.base.text import listed
from fitball.data.scene import CameraSection, Scene
from fitball.data.table import ImpactTable

# What fits share with a camera; the rest of its section reads films.
_OF_FITS = ("scale", "clock", "tilt", "court_height", "row_delay")
OF_FILMS = tuple(name for name in CameraSection.__struct_fields__ if name not in _OF_FITS)
# Keys that a note names.
_NAMED_KEYS = 12


def idle_keys(table: ImpactTable, scene: Scene) -> Iterator[str]:
    """Keys of a scene, `[air] density`, that no fit of this table uses: those that read films, and
    air and drag where no ball falls or rises in a height or a time.
    """
    yield from stated_of_camera(scene, OF_FILMS)
    for name in scene.flight:
        if name != "drag":
            yield f"[flight] {name}"
    falls = any("heights" in entry or "flights" in entry for entry in table.read)
    if table.has_tangential and not falls:
        if "drag" in scene.flight:
            yield "[flight] drag"
        for name in scene.air:
            yield f"[air] {name}"


def stated_of_camera(scene: Scene, names: Iterable[str]) -> Iterator[str]:
    """The keys of a camera, of these names, that a scene states: `[camera] fps`."""
    usual = CameraSection()
    for name in names if scene.camera is not None else ():
        if getattr(scene.camera, name) != getattr(usual, name):
            yield f"[camera] {name}"


def idle_note(keys: Iterable[str], of: str) -> Iterator[Note]:
    """The note on keys of a scene that are not used by `of`, such as `this fit`; none without."""
    named = [*dict.fromkeys(keys)]
    if named:
        words = f"Not used by {of}: {listed(named, most=_NAMED_KEYS)} of the scene."
        yield Note("scene-not-used", words)
