"""How every formula of this package is compiled with numba, and the cache of compiled functions on disk.

The cache only saves time: where it cannot be written or read back, functions are compiled again.

numba optimises every function it meets and turns it into machine code with two wrappers, though hardly one in six is
ever called from Python. Here that is done for the caller alone, with everything it calls linked in, which takes a third
less time. The arithmetic is the same: the compiler may not reorder it.
"""

from __future__ import annotations

import hashlib
import multiprocessing
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import llvmlite
import numba
from numba.core import event
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.typing.templates import make_concrete_template
from numba.extending import intrinsic

Function = TypeVar("Function", bound=Callable[..., Any])

LOOP_PACKAGES = ("control", "missions", "model", "sim")
"""Packages beside this module whose constants are compiled into the loop."""

SHIPPED = Path(__file__).parent / "kernels"
"""Functions that a wheel carries, compiled for a generic processor; used where sources and compilers are the same."""

NO_CACHE_NOTE = (
    "Note: the compiled simulator cannot be stored on disk ({}), so every run compiles it again; set NUMBA_CACHE_DIR "
    "to a folder that can be written to."
)
REBUILT_NOTE = "Note: the compiled simulator on disk could not be read ({}) and is compiled again."


def compile_function(function: Function, **options: Any) -> Function:
    """Compile on first call and store the result on disk; IEEE arithmetic, so that runs repeat bit for bit."""
    dispatcher: Any = numba.njit(error_model="numpy", **options)(function)
    try:
        dispatcher._cache = _CheckedCache(function)
    except (RuntimeError, OSError):  # a read-only installation without a home folder
        _print_once(NO_CACHE_NOTE.format("no folder for it can be written to"))
    _Callee.attach_to(dispatcher)
    return cast(Function, dispatcher)


def compile_for_views(function: Function) -> Function:
    """As `compile_function`, for a function that neither makes arrays nor lets go of any: nobody counts references.

    Counting them for every array of a tuple that is passed on takes longer than what short functions compute.
    """
    return compile_function(function, _nrt=False)


def compile_inlined(function: Function) -> Function:
    """As `compile_for_views`, for a function that loops call which pass on more than they compute: it becomes part of
    them."""
    return compile_function(function, _nrt=False, forceinline=True)


def is_compiled(dispatcher: Any, types: tuple[Any, ...]) -> bool:
    """Whether a compiled function for these argument types is on disk, or there is nowhere to keep it."""
    stored = dispatcher._cache
    return not isinstance(stored, _CheckedCache) or stored.has_overload(types, dispatcher.targetctx)


def ship_overload(dispatcher: Any, types: tuple[Any, ...]) -> None:
    """Store a function compiled for these argument types where wheels carry it (.ci/release)."""
    dispatcher._cache.ship_overload(types, dispatcher.overloads[types])


def inline_function(function: Function) -> Function:
    """Inlined wherever a compiled function calls it, without which loops over tractors do not vectorise."""
    return cast(Function, numba.njit(error_model="numpy", inline="always")(function))


def _emit_array_without_owner(typingctx: Any, array: Any) -> Any:
    """The same array without its owner, which the caller has to keep alive.

    Every view of an array with an owner counts references with locked instructions: a third of the time of a loop
    that takes one for every tractor and step.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        bare = context.make_array(array)(context, builder, value=args[0])
        bare.meminfo = bare.meminfo.type(None)
        bare.parent = bare.parent.type(None)
        return bare._getvalue()

    return array(array), generate


drop_owner: Any = intrinsic(_emit_array_without_owner)


class _CheckedCache(FunctionCache):
    """numba's cache, made safe: numba trusts its files and does not notice a changed callee in another module."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        own = self._impl.locator.get_source_stamp()
        home = _find_package(function)
        self._cache_file = IndexDataCacheFile(self._cache_path, self._impl.filename_base, (own, _hash_sources(home)))
        self._shipped_file = IndexDataCacheFile(
            str(SHIPPED / function.__module__), self._impl.filename_base, (llvmlite.__version__, _hash_sources(home))
        )

    def has_overload(self, signature: Any, target_context: Any) -> bool:
        """Whether there is a result on disk, or one that was shipped."""
        key = self._index_key(signature, target_context.codegen())
        try:
            return key in self._cache_file._load_index() or _generalise(key) in self._shipped_file._load_index()
        except Exception:  # a file that is truncated or corrupt
            return False

    def load_overload(self, signature: Any, target_context: Any) -> Any:
        """The cached result, or None: a file that is truncated or corrupt is dropped."""
        try:
            return super().load_overload(signature, target_context) or self._load_shipped(signature, target_context)
        except Exception as error:
            _print_once(REBUILT_NOTE.format(type(error).__name__))
            self._clear_cache()
            return None

    def _load_shipped(self, signature: Any, target_context: Any) -> Any:
        """The result that was shipped for a generic processor of this kind, or None."""
        if not SHIPPED.is_dir():
            return None
        try:
            data = self._shipped_file.load(_generalise(self._index_key(signature, target_context.codegen())))
            return None if data is None else self._impl.rebuild(target_context, data)
        except Exception:  # a damaged file is as good as none, and no reason to drop what this machine compiled
            return None

    def ship_overload(self, signature: Any, result: Any) -> None:
        """Store a result among those that are shipped; it has to be compiled for a generic processor."""
        Path(self._shipped_file._cache_path).mkdir(parents=True, exist_ok=True)
        self._shipped_file.save(_generalise(self._index_key(signature, result.codegen)), self._impl.reduce(result))

    def save_overload(self, signature: Any, result: Any) -> None:
        """Store a result, or continue without: the disk may be full."""
        try:
            super().save_overload(signature, result)
        except Exception as error:
            self.disable()
            _print_once(NO_CACHE_NOTE.format(getattr(error, "strerror", None) or type(error).__name__))

    def _clear_cache(self) -> None:
        try:
            self.flush()
        except OSError:
            self.disable()


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


class _Callee:
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


def _generalise(key: Any) -> Any:
    """The key of a result for a generic processor: the kind of machine stays, its model and features go."""
    signature, (triple, *_), hashes = key
    return signature, (triple, "generic", ""), hashes


def _find_package(function: Callable[..., Any]) -> Path:
    """The folder of the package of a function, the outermost; of its module where that is no part of a package."""
    depth, path = function.__module__.count("."), Path(function.__code__.co_filename)
    return path.parents[depth - 1] if depth else path


@cache
def _hash_sources(home: Path) -> str:
    """Digest of the modules whose functions may be compiled in, with their constants: those of the loop, and of the
    caller's package those with compiled functions. Constants of other packages (ROUNDING) are not noticed."""
    package = Path(__file__).parent
    own = home.rglob("*.py") if home.is_dir() else (home,)
    texts = {path: path.read_bytes() for path in sorted({*package.rglob("*.py"), *own})}
    digest = hashlib.sha256()
    for path, text in texts.items():
        if path.parent == package or path.parent.name in LOOP_PACKAGES or b"vehicle.jit" in text:
            digest.update(text)
    return digest.hexdigest()


@cache
def _print_once(sentence: str) -> None:
    """Print a sentence on standard error, once, and in the main process only."""
    if multiprocessing.parent_process() is None:
        print(sentence, file=sys.stderr, flush=True)
