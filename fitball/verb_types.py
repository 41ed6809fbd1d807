"""Names in the signatures of verbs and their methods: types for checkers, and for
`typing.get_type_hints` what loads them only then, so that the command line begins without any.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ForwardRef

if TYPE_CHECKING:
    from fitball.batches.batch import Batch as Batch
    from fitball.data.read import Sources as Sources
    from fitball.data.read import TableSource as TableSource
    from fitball.data.scene import Scene as Scene
    from fitball.models.model import Model as Model
    from fitball.results.drawn import Drawn as Drawn
    from fitball.results.exported import Exported as Exported
    from fitball.results.film import Film as Film
    from fitball.results.fit import Fit as Fit
    from fitball.results.result import Frames as Frames
else:

    def _later(module: str, name: str) -> ForwardRef:
        """A name of a module that is imported when the reference is resolved."""
        return ForwardRef(f"__import__('importlib').import_module('{module}').{name}")

    Batch = _later("fitball.batches.batch", "Batch")
    Sources = _later("fitball.data.read", "Sources")
    TableSource = _later("fitball.data.read", "TableSource")
    Scene = _later("fitball.data.scene", "Scene")
    Model = _later("fitball.models.model", "Model")
    Drawn = _later("fitball.results.drawn", "Drawn")
    Exported = _later("fitball.results.exported", "Exported")
    Film = _later("fitball.results.film", "Film")
    Fit = _later("fitball.results.fit", "Fit")
    Frames = _later("fitball.results.result", "Frames")
