"""Shape checks on every function with a jaxtyping signature, and reproducible property tests."""

import pkgutil

import hypothesis
from jaxtyping import install_import_hook

import wrenchflow

# Compiled kernels are left alone: the hook would wrap functions that numba has to see bare.
KERNELS = {"wrenchflow.filtering", "wrenchflow.control.impedance", "wrenchflow.control.governor", "wrenchflow.sim.engine"}

_hook = install_import_hook(
    [
        module.name
        for module in pkgutil.walk_packages(wrenchflow.__path__, "wrenchflow.")
        if not module.ispkg and module.name not in KERNELS
    ],
    "beartype.beartype",
)

hypothesis.settings.register_profile("reproducible", derandomize=True, deadline=None, max_examples=50)
hypothesis.settings.load_profile("reproducible")
