"""The one decorator with which kernels are compiled, typed so that a checker sees through it."""

from __future__ import annotations

import gc
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import numba
from numba.core import event

from fitball import first_compile
from fitball.models.kernels.entry import Entry
from fitball.models.kernels.kept import KernelFiles
from fitball.models.kernels.link_only import LinkOnlyCompiler

P = ParamSpec("P")
R = TypeVar("R")


def _kernel_sources() -> tuple[tuple[str, float, int], ...]:
    """Name, modification time and size of every file kernels may live in."""
    files = sorted(Path(__file__).parents[1].rglob("*.py"))
    return tuple((file.name, file.stat().st_mtime, file.stat().st_size) for file in files)


SOURCES = _kernel_sources()


# What a kernel that only kernels call can do without: ways in for the interpreter, which for states of nested tuples
# are longer than the kernel. It takes a quarter off what a cold start compiles.
INNER: dict[str, Any] = {
    "_nrt": False,
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
    "pipeline_class": LinkOnlyCompiler,
}


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a kernel that allocates nothing: cached on disk, free of the interpreter lock, strict IEEE arithmetic.

    `error_model="numpy"` lets a division by zero give an infinity instead of an exception, so that a
    batch is never stopped by one impact; every kernel marks such an impact by its status. References to arrays
    are not counted: their owner is the allocating kernel above, and the counting took a fifth of the time.
    """
    return cast("Callable[P, R]", _compile(function, {"_nrt": False, "no_cfunc_wrapper": True}))


def inner(function: Callable[P, R]) -> Callable[P, R]:
    """As `compiled`, for what kernels call: linked into them, not kept on disk; called from Python it is Python."""
    return cast("Callable[P, R]", _inner(function, INNER))


def inlined(function: Callable[P, R]) -> Callable[P, R]:
    """As `inner`, always expanded where it is called: for what is apart for order's sake, called once or twice."""
    return cast("Callable[P, R]", _inner(function, {**INNER, "forceinline": True}))


def inner_allocating(function: Callable[P, R]) -> Callable[P, R]:
    """As `inner`, for kernels that make arrays."""
    return cast("Callable[P, R]", _inner(function, {**INNER, "_nrt": True}))


def compiled_allocating(function: Callable[P, R]) -> Callable[P, R]:
    """As `compiled`, for kernels that make arrays."""
    return cast("Callable[P, R]", _compile(function, {"no_cfunc_wrapper": True}))


def calling(*entries: Entry[..., Any]) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """As `compiled_allocating`, for kernels that call others at their `entries`: these are linked before them."""

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        dispatcher = _compile(function, {"no_cfunc_wrapper": True})
        alone = dispatcher.compile

        def link_entries() -> None:
            for entry in entries:
                entry.link()

        if kept(dispatcher):
            dispatcher._cache._cache_file.loaded = link_entries

        def compile_with(signature: Any) -> Any:
            for entry in entries:
                entry.named += 1
            try:
                return alone(signature)
            finally:
                for entry in entries:
                    entry.named -= 1

        dispatcher.compile = compile_with
        return cast("Callable[P, R]", dispatcher)

    return decorate


def apart(function: Callable[P, R]) -> Callable[P, R]:
    """As `inner`, with machine code of its own, which an `Entry` leads to."""
    options = {"_nrt": False, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    return cast("Callable[P, R]", _without_entry(_compile(function, options)))


def _made(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    njit: Any = numba.njit
    common = {"nogil": True, "error_model": "numpy"}
    try:
        dispatcher = njit(**common, **options)(function)
    except KeyError:
        # The option is numba's own affair; a numba without it counts references, which costs time only.
        dispatcher = njit(**common)(function)
    _blind_to_literals(dispatcher)
    return dispatcher


def _inner(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    # Two processes may compile kernels that call the same inner one: on disk their copies would be mixed up.
    return _without_entry(_made(function, options))


def _compile(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    dispatcher = _made(function, options)
    try:
        dispatcher.enable_caching()
    except RuntimeError:
        # Neither the folder of the sources nor that of the user can be written to: each run compiles for itself.
        return dispatcher
    _keep_whole(dispatcher)
    return dispatcher


def on_disk(kernel: Any, kinds: Any) -> bool:
    """Whether there is a kernel on disk that is compiled for these kinds of arguments."""
    if not kept(kernel):
        return False
    cache = kernel._cache
    return bool(cache._cache_file.place(cache._index_key(kinds, kernel.targetctx.codegen())).exists())


def kept(kernel: Any) -> bool:
    """Whether a kernel that is compiled is kept on disk."""
    return isinstance(getattr(kernel._cache, "_cache_file", None), KernelFiles)


def _without_entry(dispatcher: Any) -> Any:
    """Let calls from Python run the function as it is written: the compiled one has no way in for them."""
    dispatcher._insert = lambda *_entry: None
    dispatcher._compile_for_args = lambda *_args, **_named: dispatcher.py_func
    return dispatcher


def _blind_to_literals(dispatcher: Any) -> None:
    """Let a constant argument be one of its type: numba would compile the kernel for each such constant once more."""
    plain = dispatcher.get_call_template
    of_type: Callable[[Any], Any] = numba.types.unliteral

    def template(args: Sequence[Any], kws: Mapping[str, Any]) -> Any:
        return plain(tuple(map(of_type, args)), {name: of_type(kind) for name, kind in kws.items()})

    dispatcher.get_call_template = template


class _Compilations(event.Listener):
    """Passes on what numba tells of our kernels, once for all that one call compiles."""

    def __init__(self) -> None:
        self.kernels: list[bool] = []
        self.collected = False

    def on_start(self, event: Any) -> None:
        """A function is about to be compiled, perhaps for one that is being compiled."""
        dispatcher = event.data["dispatcher"]
        ours = dispatcher.py_func.__module__.startswith("fitball.")
        self.kernels.append(ours and not any(self.kernels))
        if self.kernels[-1]:
            # A compiler makes little but objects that stay: a seventh of its time went into looking through them.
            self.collected = gc.isenabled()
            gc.disable()
            folder = dispatcher.stats.cache_path
            first_compile.tell(first_compile.Compiling(dispatcher.py_func.__name__, folder))

    def on_end(self, event: Any) -> None:  # noqa: ARG002 - numba's face
        """It is compiled, or failed."""
        if self.kernels.pop():
            if self.collected:
                gc.enable()
            first_compile.tell(None)


event.register("numba:compile", _Compilations())  # type: ignore[no-untyped-call]


def _keep_whole(dispatcher: Any) -> None:
    """Let a kernel be kept in files of ours, which expire when it or any other of the models changes.

    Numba stamps a cached function with its own file only, and so would go on running an old copy of a kernel it
    calls in another file. Where its cache is not built as expected it is left out: slow to start, never stale.
    """
    cache = dispatcher._cache
    try:
        place, stem, save = Path(cache._cache_path), cache._impl.filename_base, cache.save_overload
        cache._cache_file = KernelFiles(place, stem, (numba.__version__, *SOURCES))
    except AttributeError:
        dispatcher._cache = numba.core.caching.NullCache()
        return

    def save_if_possible(signature: Any, made: Any) -> None:
        # No room, or a folder that can no longer be written to: the kernel is there, the next run compiles it again.
        with suppress(OSError):
            save(signature, made)

    cache.save_overload = save_if_possible
