"""Work over processes: the only place that knows joblib and Dask. Imports: environment, errors."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any


def as_completed(
    make: Callable[[Any], Any], items: Sequence[Any], cores: int | None = None, address: str = ""
) -> Iterator[tuple[int, Any]]:
    """`make` of each item with its place, as they are done; a FitballError is returned, not raised. An item whose
    worker dies is tried once more alone, then returned as MachineError (`worker-died`). `address` is a Dask
    scheduler's. Functions of one's own travel by cloudpickle.
    """
