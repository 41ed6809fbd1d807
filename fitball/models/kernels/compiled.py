"""How kernels are compiled, linked and kept on disk.

What only kernels call becomes code that is linked into what Python calls and optimised there: Numba makes machine
code of every function, optimised by itself, and then once more as part of each that calls it, which for kernels that
are all expanded into one batch is half of a cold start.

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
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any, ParamSpec, TypeVar, cast
from weakref import WeakKeyDictionary

import llvmlite.binding as llvm
import numba
from numba.core import codegen, compiler, event, typed_passes, untyped_passes
from numba.core.compiler_machinery import register_pass
from numba.core.serialize import dumps
from numba.core.types.functions import BaseFunction

from fitball import environment

IDLE = (
    untyped_passes.InlineClosureLikes,
    untyped_passes.MakeFunctionToJitFunction,
    untyped_passes.InlineInlinables,
    untyped_passes.LiteralUnroll,
    typed_passes.InlineOverloads,
    typed_passes.NopythonRewrites,
)


class Library(codegen.JITCodeLibrary):
    """Machine code of a kernel and all that it calls, which is optimised once: numba's first round, for counts of
    references, finds none in kernels.
    """

    def _optimize_final_module(self) -> None:
        passes, builder = self._codegen._module_pass_manager()
        passes.run(self._final_module, builder)


class LinkOnlyLibrary(Library):
    """Code for the libraries it is linked into, which do with it all that is to be done."""

    def add_llvm_module(self, ll_module: Any) -> None:
        """Add it as it is."""
        ll_module.data_layout = self._codegen._data_layout
        self._final_module.link_in(ll_module)

    def _optimize_final_module(self) -> None:
        pass

    def _get_module_for_linking(self) -> Any:
        self._ensure_finalized()
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == llvm.Linkage.external:
                function.linkage = llvm.Linkage.linkonce_odr
        return self._final_module

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True


@register_pass(mutates_CFG=True, analysis_only=False)
class Lowering(typed_passes.NativeLowering):
    """Lowers into a library of ours."""

    _name = "lowering_once"

    def run_pass(self, state: Any) -> bool:
        """Lower the function of `state`."""
        state.library = Library(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        return bool(super().run_pass(state))


@register_pass(mutates_CFG=True, analysis_only=False)
class LinkOnlyLowering(typed_passes.NativeLowering):
    """Lowers into a library that has no machine code."""

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


class Compiler(compiler.CompilerBase):
    """Numba's compiler less its idle passes, for kernels that Python calls."""

    lowering: type[Any] = Lowering

    def define_pipelines(self) -> list[Any]:
        """The passes."""
        manager = compiler.DefaultPassBuilder.define_nopython_pipeline(self.state)
        manager.passes = [
            (self.lowering if one is typed_passes.NativeLowering else one, words)
            for one, words in manager.passes
            if one not in IDLE
        ]
        manager.finalize()
        return [manager]


class LinkOnlyCompiler(Compiler):
    """For those that only kernels call: up to the code that is linked."""

    lowering = LinkOnlyLowering


def _remember_calls() -> None:
    """Let numba find what a function makes of some kinds of arguments once: at each operator it asks dozens
    of templates, which took a sixth of a cold start.
    """
    plain = BaseFunction.get_call_type
    found: WeakKeyDictionary[Any, dict[Any, Any]] = WeakKeyDictionary()

    def get_call_type(self: Any, context: Any, args: Any, kws: Any) -> Any:
        if kws:
            return plain(self, context, args, kws)
        known = found.setdefault(self, {})
        if args not in known:
            known[args] = plain(self, context, args, kws)
        return known[args]

    BaseFunction.get_call_type = get_call_type  # type: ignore[method-assign]


_remember_calls()
SEAL = hashlib.sha256().digest_size


class KernelFiles:
    """Replaces numba's files of one function: `stem` begins their names, `stamp` says of which sources and of
    which numba they are.
    """

    def __init__(self, folder: Path, stem: str, stamp: tuple[Any, ...]) -> None:
        self.folder, self.stem, self.stamp = folder, stem, stamp

    def place(self, key: object) -> Path:
        """Where the kernel is kept for what numba calls its key: kinds of arguments, processor, bytecode."""
        return self.folder / f"{self.stem}.{hashlib.sha256(repr(key).encode()).hexdigest()[:16]}.nbc"

    def load(self, key: object) -> Any:
        """What was saved, or None without a file that is whole and of these sources."""
        try:
            content = self.place(key).read_bytes()
        except OSError:
            return None
        if content[:SEAL] != self._seal(key, content[SEAL:]):
            return None
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
    stopped by one impact; every kernel marks such an impact by its status. Kernels make no arrays but views, and
    count no references to them, which took a fifth of the time: the owner is whoever calls from Python.
    """
    dispatcher = _made(function, {"_nrt": False, "no_cfunc_wrapper": True, "pipeline_class": Compiler})
    # Where neither the folder of the sources nor that of the user can be written to, each run compiles for itself.
    with suppress(RuntimeError):
        dispatcher.enable_caching()
        _keep_whole(dispatcher)
    return cast("Callable[P, R]", dispatcher)


def inner(function: Callable[P, R]) -> Callable[P, R]:
    """As `compiled`, for what kernels call: linked into them, not kept on disk, where two processes that compile
    kernels which call the same one would mix up their copies.

    Called from Python it is Python.
    """
    return cast("Callable[P, R]", _without_entry(_made(function, INNER)))


def inlined(function: Callable[P, R]) -> Callable[P, R]:
    """As `inner`, always expanded where it is called: for what is apart for order's sake, called once or twice."""
    return cast("Callable[P, R]", _without_entry(_made(function, {**INNER, "forceinline": True})))


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


def to_be_made(kernel: Any) -> bool:
    """Whether a kernel that is compiled is kept on disk, and was not yet for any kind of arguments."""
    files = getattr(kernel._cache, "_cache_file", None)
    return isinstance(files, KernelFiles) and not any(files.folder.glob(f"{files.stem}.*"))


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
    """Passes on numba's events about our kernels, once for all that one call compiles."""

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
            environment.report_compiling(environment.Compiling(dispatcher.py_func.__name__, folder))

    def on_end(self, event: Any) -> None:  # noqa: ARG002 - numba's face
        """It is compiled, or failed."""
        if self.kernels.pop():
            if self.collected:
                gc.enable()
            environment.report_compiling(None)


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

    def save_if_possible(signature: Any, compiled: Any) -> None:
        # No room, or a folder that can no longer be written to: the kernel is there, the next run compiles it again.
        with suppress(OSError):
            save(signature, compiled)

    cache.save_overload = save_if_possible
