"""How kernels are compiled, linked and kept on disk.

What only kernels call becomes code that is linked into what Python calls and optimised there: Numba makes machine
code of every function, optimised by itself, and then once more as part of each that calls it, which for kernels that
are all expanded into one batch is half of a cold start. What several batches call has machine code of its own
(`Entry`).

On disk each kernel has a file for each kind of arguments, sealed with a checksum. Numba's own files end a run in a
traceback when one is cut short, end the process when its machine code is damaged, and mix up kernels that two
processes compile at once. Here a file that is not whole counts as none.
"""

# mypy: allow-untyped-calls
from __future__ import annotations

import gc
import hashlib
import os
import pickle
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from inspect import Parameter, Signature
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any, Generic, ParamSpec, TypeVar, cast

import llvmlite.binding as llvm
import numba
import numpy as np
from numba.core import cgutils, codegen, compiler, event, typed_passes, untyped_passes
from numba.core.compiler_machinery import register_pass
from numba.core.serialize import dumps
from numba.core.typing.templates import Signature as Kinds
from numba.extending import intrinsic

from fitball import environment
from fitball.values import FloatArray

IDLE = (
    untyped_passes.InlineClosureLikes,
    untyped_passes.MakeFunctionToJitFunction,
    untyped_passes.InlineInlinables,
    untyped_passes.LiteralUnroll,
    typed_passes.InlineOverloads,
    typed_passes.NopythonRewrites,
)


class LinkOnlyLibrary(codegen.JITCodeLibrary):
    """Code for the libraries it is linked into."""

    def _optimize_final_module(self) -> None:
        """Leave it to these."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True


@register_pass(mutates_CFG=True, analysis_only=False)
class LinkOnlyLowering(typed_passes.NativeLowering):
    """Lowers into such a library."""

    _name = "link_only_lowering"

    def run_pass(self, state: Any) -> bool:
        """Lower the function of `state`."""
        state.library = LinkOnlyLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.flags.no_compile = True
        super().run_pass(state)
        # Callers find a function by its entry point; anything unique does, as none is ever entered.
        entry = object()
        state["cr"] = state.cr._replace(cfunc=entry)
        state.targetctx.insert_user_function(entry, state.cr.fndesc, [state.library])
        return True


class LinkOnlyCompiler(compiler.CompilerBase):
    """Numba's compiler, up to the code that is linked."""

    def define_pipelines(self) -> list[Any]:
        """The passes: numba's own, less those that are idle."""
        manager = compiler.DefaultPassBuilder.define_nopython_pipeline(self.state)
        manager.passes = [
            (LinkOnlyLowering if one is typed_passes.NativeLowering else one, words)
            for one, words in manager.passes
            if one not in IDLE
        ]
        manager.finalize()
        return [manager]


SEAL = hashlib.sha256().digest_size


class KernelFiles:
    """Stands in for numba's files of one function: `stem` begins their names, `stamp` says of which sources and of
    which numba they are. `loaded` is called before machine code that came from disk is linked.
    """

    def __init__(self, folder: Path, stem: str, stamp: tuple[Any, ...]) -> None:
        self.folder, self.stem, self.stamp = folder, stem, stamp
        self.loaded: Callable[[], None] = lambda: None

    def place(self, key: object) -> Path:
        """Where the kernel is kept for what numba calls its key: kinds of arguments, processor, bytecode."""
        return self.folder / f"{self.stem}.{hashlib.sha256(repr(key).encode()).hexdigest()[:16]}.nbc"

    def load(self, key: object) -> Any:
        """What was saved, or None where there is none that is whole and of these sources."""
        try:
            content = self.place(key).read_bytes()
        except OSError:
            return None
        if content[:SEAL] != self._seal(key, content[SEAL:]):
            return None
        self.loaded()
        return pickle.loads(content[SEAL:])

    def save(self, key: object, data: object) -> None:
        """Keep it, whole or not at all. Raises OSError."""
        content: bytes = dumps(data)
        place = self.place(key)
        with NamedTemporaryFile(dir=self.folder, prefix=f".{self.stem}.", suffix=".tmp", delete=False) as file:
            try:
                file.write(self._seal(key, content) + content)
                file.close()
                os.replace(file.name, place)  # noqa: PTH105 - a name of tempfile's
            except BaseException:
                Path(file.name).unlink(missing_ok=True)
                raise

    def _seal(self, key: object, content: bytes) -> bytes:
        return hashlib.sha256(repr((self.stamp, key)).encode() + content).digest()


P = ParamSpec("P")
R = TypeVar("R")


class Entry(Generic[P, R]):
    """A compiled kernel that the linker knows by name, for one kind of arguments: of these and of the result it is
    given examples. Kernels that `call` it name it in their decorator, `calling`, so that it is linked before them
    where these come from disk; where they are compiled it is linked last, when another process may have compiled it.
    """

    def __init__(self, kernel: Callable[P, R], arguments: Sequence[Any], result: R) -> None:
        self.kernel: Any = kernel
        self.name = f"fitball.{self.kernel.__name__}"
        self.signature = Kinds(numba.typeof(result), tuple(map(numba.typeof, arguments)), None)
        self.call = cast("Callable[P, R]", intrinsic(self._typed()))
        # How many of the kernels that are being compiled name it.
        self.named = 0
        self._linked = False

    def link(self) -> None:
        """Compile the kernel or read it from disk, if that was not done, and tell the linker where it is.

        Raises TypeError where it gives something else than its example says.
        """
        if self._linked:
            return
        self.kernel.compile(self.signature.args)
        made = self.kernel.overloads[self.signature.args]
        if made.signature.return_type != self.signature.return_type:
            raise TypeError(f"{self.name} gives {made.signature.return_type}, not {self.signature.return_type}")
        llvm.add_symbol(self.name, made.library.get_pointer_to_function(made.fndesc.llvm_func_name))
        self._linked = True

    def _typed(self) -> Any:
        """The call, as numba wants it from `intrinsic`."""

        def typed(_context: Any, *_kinds: Any) -> Any:
            if not self.named:
                # From disk the code would call nothing, and end the process.
                raise numba.TypingError(f"{self.name} is not linked: name it in @calling")
            return self.signature, self._emit

        names = ["context", *(f"x{k}" for k in range(len(self.signature.args)))]
        typed.__signature__ = Signature([Parameter(name, Parameter.POSITIONAL_ONLY) for name in names])  # type: ignore[attr-defined]
        return typed

    def _emit(self, context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        self.link()
        conventions, given, taken = context.call_conv, self.signature.return_type, self.signature.args
        kind = conventions.get_function_type(given, taken)
        function = cgutils.get_or_insert_function(builder.module, kind, self.name)
        status, result = conventions.call_function(builder, function, given, taken, values)
        with cgutils.if_unlikely(builder, status.is_error):
            conventions.return_status_propagate(builder, status)
        return result


def read_only(shape: tuple[int, ...]) -> FloatArray:
    """An array as kernels are given impacts."""
    array = np.zeros(shape)
    array.flags.writeable = False
    return array


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
    """Compile a kernel that Python calls: cached on disk, free of the interpreter lock, strict IEEE arithmetic.

    `error_model="numpy"` lets a division by zero give an infinity instead of an exception, so that a batch is never
    stopped by one impact; every kernel marks such an impact by its status.
    """
    return cast("Callable[P, R]", _compile(function, {"no_cfunc_wrapper": True}))


def inner(function: Callable[P, R]) -> Callable[P, R]:
    """As `compiled`, for what kernels call and what makes no arrays: linked into them, not kept on disk.

    Called from Python it is Python. References to arrays are not counted: their owner is the kernel above, and the
    counting took a fifth of the time.
    """
    return cast("Callable[P, R]", _inner(function, INNER))


def inlined(function: Callable[P, R]) -> Callable[P, R]:
    """As `inner`, always expanded where it is called: for what is apart for order's sake, called once or twice."""
    return cast("Callable[P, R]", _inner(function, {**INNER, "forceinline": True}))


def inner_allocating(function: Callable[P, R]) -> Callable[P, R]:
    """As `inner`, for kernels that make arrays."""
    return cast("Callable[P, R]", _inner(function, {**INNER, "_nrt": True}))


def calling(*entries: Entry[..., Any]) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """As `compiled`, for kernels that call others at their `entries`: these are linked before them."""

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
            environment.tell(environment.Compiling(dispatcher.py_func.__name__, folder))

    def on_end(self, event: Any) -> None:  # noqa: ARG002 - numba's face
        """It is compiled, or failed."""
        if self.kernels.pop():
            if self.collected:
                gc.enable()
            environment.tell(None)


event.register("numba:compile", _Compilations())


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
