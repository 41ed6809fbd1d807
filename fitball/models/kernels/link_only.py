"""How kernels that only kernels call are compiled: to code that is linked into what Python calls and optimised there.

Numba makes machine code of every function, optimised by itself, and then once more as part of each that calls it; for
kernels that are all expanded into one batch that is half of a cold start. The passes left out serve what kernels do
not have: closures, comprehensions, expressions of whole arrays.
"""

# mypy: allow-untyped-calls
from __future__ import annotations

from typing import Any

from numba.core import codegen, compiler, typed_passes, untyped_passes
from numba.core.compiler_machinery import register_pass

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
