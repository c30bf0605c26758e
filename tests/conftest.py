"""Shape checks on every function with a jaxtyping signature, and reproducible property tests."""

import importlib.util
import pkgutil
from pathlib import Path

import hypothesis
from jaxtyping import install_import_hook

import wrenchflow


def _is_kernel(name: str) -> bool:
    # Compiled kernels are left alone: the hook would wrap functions that numba has to see bare.
    spec = importlib.util.find_spec(name)
    return spec is None or spec.origin is None or "wrenchflow.compiled import" in Path(spec.origin).read_text()


_hook = install_import_hook(
    [
        module.name
        for module in pkgutil.walk_packages(wrenchflow.__path__, "wrenchflow.")
        if not module.ispkg and not _is_kernel(module.name)
    ],
    "beartype.beartype",
)

hypothesis.settings.register_profile("reproducible", derandomize=True, deadline=None, max_examples=50)
hypothesis.settings.load_profile("reproducible")
