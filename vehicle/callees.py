"""How compiled functions are compiled into others: linked into their caller, without machine code of their own.

numba optimises every function it meets and turns it into machine code with two wrappers, though hardly one in six is
ever called from Python. Here that is done for the caller alone, with everything it calls linked in, which takes a third
less time. The arithmetic is the same: the compiler may not reorder it.
"""

from __future__ import annotations

from typing import Any

from numba.core import event
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.typing.templates import make_concrete_template


class _LinkedLibrary(JITCodeLibrary):
    """Code that is linked into its callers, which optimise it and turn it into machine code."""

    def _optimize_final_module(self) -> None:
        """Left to the caller."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


class _LinkedPipeline(Compiler):
    """numba's pipeline up to code that can be linked."""

    def __init__(
        self, typingctx: Any, targetctx: Any, library: Any, args: Any, return_type: Any, flags: Any, locals: Any
    ) -> None:
        flags.no_compile = flags.no_cpython_wrapper = flags.no_cfunc_wrapper = True
        library = _LinkedLibrary(targetctx.codegen(), "callee")
        super().__init__(typingctx, targetctx, library, args, return_type, flags, locals)


class Callee:
    """What other compiled functions see of a compiled function.

    `attach_to` a dispatcher replaces the two methods by which numba types and finds a callee.
    """

    def __init__(self, dispatcher: Any) -> None:
        self._dispatcher = dispatcher
        self._compiler = type(dispatcher._compiler)(
            dispatcher.py_func, dispatcher.targetdescr, dispatcher.targetoptions, {}, _LinkedPipeline
        )
        self._overloads: dict[tuple[Any, ...], tuple[Any, object]] = {}

    @classmethod
    def attach_to(cls, dispatcher: Any) -> None:
        """Let compiled functions that call the dispatcher's function link it."""
        callee = cls(dispatcher)
        dispatcher.get_call_template, dispatcher.get_overload = callee._get_call_template, callee._get_overload

    def _get_call_template(self, args: Any, kws: Any) -> tuple[Any, Any, Any, dict[str, Any]]:
        """As numba's method: how the function is typed for these arguments, after it was compiled for them."""
        pysig, args = self._compiler.fold_argument_types(args, kws)
        if tuple(args) not in self._overloads:
            self._compile(tuple(args))
        name = self._dispatcher.py_func.__name__
        signatures = [signature for signature, _ in self._overloads.values()]
        return make_concrete_template(f"CallTemplate({name})", key=name, signatures=signatures), pysig, args, {}

    def _compile(self, args: tuple[Any, ...]) -> None:
        details = {"dispatcher": self._dispatcher, "args": args, "return_type": None}
        with event.trigger_event("numba:compile", data=details):
            result = self._compiler.compile(args, None)
        handle = object()
        self._dispatcher.targetctx.insert_user_function(handle, result.fndesc, [result.library])
        self._overloads[args] = result.signature, handle

    def _get_overload(self, args: Any) -> object:
        """As numba's method: by what the code of the function is found."""
        return self._overloads[tuple(args)][1]
