"""`kernel`: the one way that a function here is compiled, and the one place that says where the machine code is kept.

Under `NUMBA_DISABLE_JIT=1` a kernel is the plain Python function that it was written as.
"""

import hashlib
import os
import sys
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, cast

import numba
from numba.core import config
from numba.core.dispatcher import Dispatcher

_PACKAGE = Path(__file__).parent
_options: Any = config  # A module whose names numba sets at run time.


def kernel[F: Callable[..., Any]](function: F) -> F:
    """Compile a function on its first call, without the GIL, and keep the machine code for the next process.

    Reordering of float operations is off, so that a kernel gives the bits that its plain Python would give; a division
    by zero gives inf or NaN, as numpy does. Numba looks for changes in a kernel's own file only. So every file that
    names `wrenchflow.compiled` is part of the cache folder's name, and the constants that a kernel reads must stand in
    such a file too.
    """
    folder = cache_folder()
    before = _options.CACHE_DIR
    # Numba reads the option when it decorates; put back, it leaves the kernels of other packages where they are.
    _options.CACHE_DIR = str(folder or before)
    try:
        return cast(F, numba.njit(cache=folder is not None, nogil=True, fastmath=False, error_model="numpy")(function))
    finally:
        _options.CACHE_DIR = before


@cache
def cache_folder() -> Path | None:
    """Where this version's machine code is kept; None where nothing can be written, so that each process compiles."""
    try:
        folder = _user_cache() / f"kernels-{sources_hash(_PACKAGE)}"
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except (OSError, RuntimeError):  # RuntimeError: a user without a home.
        return None


def is_cold(*kernels: Callable[..., Any]) -> bool:
    """Whether one of these has to be compiled before it can run: it never was, or its file has changed since.

    A folder of machine code that is not empty says little: another command may have filled it with kernels of its own,
    or another copy of these sources, which numba keeps apart.
    """
    return any(isinstance(one, Dispatcher) and not _kept(one) for one in kernels)


def _kept(dispatcher: Any) -> bool:
    # Numba gives no other access to what it would load; a kernel whose machine code is kept nowhere has no such file.
    file = getattr(dispatcher._cache, "_cache_file", None)
    return file is not None and bool(file._load_index())


def sources_hash(package: Path) -> str:
    """Hash of all source files under `package` that hold kernels, by name and content."""
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        source = path.read_bytes()
        if b"wrenchflow.compiled" in source or path == Path(__file__):
            digest.update(path.relative_to(package).as_posix().encode() + b"\0" + source + b"\0")
    return digest.hexdigest()[:16]


def _user_cache() -> Path:
    if os.environ.get("NUMBA_CACHE_DIR"):
        return Path(os.environ["NUMBA_CACHE_DIR"]) / "wrenchflow"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "wrenchflow"
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local")) / "wrenchflow"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "wrenchflow"
