"""Names in the signatures of verbs and their methods: types for checkers, and for
`typing.get_type_hints` what loads them only then, so that the command line begins without any.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ForwardRef

if TYPE_CHECKING:
    from fitball.batches.batch import Batch as Batch
    from fitball.data.load import Sources as Sources
    from fitball.data.read import TableSource as TableSource
    from fitball.data.scene import Scene as Scene
    from fitball.models.model import Model as Model
    from fitball.results.drawn import Drawn as Drawn
    from fitball.results.exported import Exported as Exported
    from fitball.results.film import Film as Film
    from fitball.results.fit import Fit as Fit
    from fitball.results.result import Frames as Frames
else:

    def _public(name: str) -> ForwardRef:
        """A public name, which loads what it names when the reference is resolved."""
        return ForwardRef(f"__import__('fitball').{name}")

    def _of_data(name: str) -> ForwardRef:
        """A name of `fitball.data.load`, which is imported when the reference is resolved."""
        return ForwardRef(f"__import__('fitball.data.load').data.load.{name}")

    Batch = _public("Batch")
    Drawn = _public("Drawn")
    Exported = _public("Exported")
    Film = _public("Film")
    Fit = _public("Fit")
    Frames = _public("Frames")
    Model = _public("Model")
    Scene = _public("Scene")
    Sources = _of_data("Sources")
    TableSource = _of_data("TableSource")
