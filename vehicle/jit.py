"""The one setting with which every formula of this room is compiled, and where the results are kept.

What is kept on disk only saves time: where it cannot be written or read back, functions are compiled again.
"""

from __future__ import annotations

import hashlib
import multiprocessing
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.extending import intrinsic

Function = TypeVar("Function", bound=Callable[..., Any])

WITHOUT = (
    "Note: the compiled simulator cannot be kept on disk ({}), so every run compiles anew; set NUMBA_CACHE_DIR to a "
    "folder that takes files."
)
REBUILT = "Note: the compiled simulator on disk could not be read ({}) and is compiled anew."


def compiled(function: Function) -> Function:
    """Compile on first call and keep the result on disk; IEEE arithmetic, so that runs repeat bit for bit."""
    dispatcher: Any = numba.njit(error_model="numpy")(function)
    try:
        dispatcher._cache = _Kept(function)
    except (RuntimeError, OSError):  # no folder takes files: a read-only installation without a home
        _remark(WITHOUT.format("no folder for it takes files"))
    return cast(Function, dispatcher)


def inlined(function: Function) -> Function:
    """Written out wherever a compiled function calls it: loops over tractors are made of vectors only so."""
    return cast(Function, numba.njit(error_model="numpy", inline="always")(function))


def _unowned(typingctx: Any, array: Any) -> Any:
    """The same array without its owner, whom somebody else has to keep alive.

    Views of an array with an owner count it, with locked instructions: in a loop that takes one for every tractor and
    step that was a third of all time.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        bare = context.make_array(array)(context, builder, value=args[0])
        bare.meminfo = bare.meminfo.type(None)
        bare.parent = bare.parent.type(None)
        return bare._getvalue()

    return array(array), generate


unowned: Any = intrinsic(_unowned)


class _Kept(FunctionCache):
    """The store of numba, which trusts its files, and does not see that a callee in another module has changed."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        own = self._impl.locator.get_source_stamp()
        home = Path(function.__code__.co_filename).parent
        self._cache_file = IndexDataCacheFile(self._cache_path, self._impl.filename_base, (own, _sources(home)))

    def load_overload(self, signature: Any, target_context: Any) -> Any:
        """The kept result, or None: a file that is cut off or garbage is forgotten."""
        try:
            return super().load_overload(signature, target_context)
        except Exception as error:
            _remark(REBUILT.format(type(error).__name__))
            self._forget()
            return None

    def save_overload(self, signature: Any, result: Any) -> None:
        """Keep a result, or go on without: the disk may be full."""
        try:
            super().save_overload(signature, result)
        except Exception as error:
            self.disable()
            _remark(WITHOUT.format(getattr(error, "strerror", None) or type(error).__name__))

    def _forget(self) -> None:
        try:
            self.flush()
        except OSError:
            self.disable()


@cache
def _sources(home: Path) -> str:
    """A digest of the modules that may be compiled in: this room's, and those at `home` that use it."""
    room = Path(__file__).parent
    texts = {path: path.read_bytes() for path in sorted({*room.rglob("*.py"), *home.glob("*.py")})}
    digest = hashlib.sha256()
    for path, text in texts.items():
        if path.parent == room or b"vehicle.jit" in text:
            digest.update(text)
    return digest.hexdigest()


@cache
def _remark(sentence: str) -> None:
    """Say a sentence on standard error, once, and in the first process only."""
    if multiprocessing.parent_process() is None:
        print(sentence, file=sys.stderr, flush=True)
