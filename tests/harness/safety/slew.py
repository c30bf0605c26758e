"""I7: whatever stiffness and damping ratio are let through keep the stability condition of variable impedance.

Kronander and Billard (2016): with one constant a, a M <= D and K' + a D' <= 2 a K. Here it is looked at as it is
written, with the matrix D = 2 zeta sqrt(m) K^(1/2) of the largest inertia, by eigenvalues, and no use is made of rates.
"""

import numpy as np

from safety.findings import Finding, worst_of
from safety.trace import Trace
from wrenchflow.control.config import ControlConfig
from wrenchflow.control.safeguards import LATCHED

TICK_S = 0.001


def square_root(K: np.ndarray) -> np.ndarray:
    """Symmetric root of symmetric matrices. Shape (n, 3, 3)."""
    values, U = np.linalg.eigh(K)
    return np.einsum("nij,nj,nkj->nik", U, np.sqrt(np.maximum(values, 0.0)), U)


def check_slew(trace: Trace, config: ControlConfig) -> list[Finding]:
    """I7, a tick's change of stiffness and of damping ratio, for translation and for rotation."""
    before, after = trace.before, trace.after
    governed = (after["mode"] != LATCHED) & np.isfinite(after["K_lin"]).all((1, 2)) & (before["tick"] > 0)
    found = []
    c = config
    blocks = {
        "K_lin": (c.stiffness_min_n_m, c.stiffness_max_n_m, c.stiffness_fall_n_m_s, c.slew_inertia_kg),
        "K_rot": (c.stiffness_min_nm_rad, c.stiffness_max_nm_rad, c.stiffness_fall_nm_rad_s, c.slew_inertia_kg_m2),
    }
    for name, (low, high, fall, inertia) in blocks.items():
        unit = "N/m" if name == "K_lin" else "N.m/rad"
        changed = governed & (
            (before[name] != after[name]).any((1, 2)) | (before["damping_ratio"] != after["damping_ratio"])
        )
        excess, drop, range_off = (np.full(len(trace), -np.inf) for _ in range(3))
        K0, K1 = before[name][changed], after[name][changed]
        zeta0, zeta1 = (each["damping_ratio"][changed][:, None, None] for each in (before, after))
        a = 2.0 * config.damping_ratio_min * np.sqrt(low / inertia)
        D0, D1 = (2.0 * zeta * np.sqrt(inertia) * square_root(K) for zeta, K in ((zeta0, K0), (zeta1, K1)))
        # To first order in a tick; K at its end is at most what it was with the second-order part.
        condition = (K1 - K0) + a * (D1 - D0) - 2.0 * a * TICK_S * K0
        if changed.any():
            excess[changed] = np.linalg.eigvalsh(condition).max(1)
            drop[changed] = -np.linalg.eigvalsh(K1 - K0).min(1)
            values = np.linalg.eigvalsh(K1)
            range_off[changed] = np.maximum(low - values.min(1), values.max(1) - high)
        found += [
            worst_of(f"I7 slew of {name} [{unit} a tick over]", excess, 1e-9 * high, changed),
            worst_of(f"I7 fall of {name} [{unit} a tick]", drop, fall * TICK_S * (1.0 + 1e-9), changed),
            worst_of(f"I7 range of {name} [{unit} outside]", range_off, 1e-9 * high, changed),
        ]
    zeta = after["damping_ratio"]
    outside = np.maximum(config.damping_ratio_min - zeta, zeta - config.damping_ratio_max)
    return [*found, worst_of("I7 range of damping ratio [outside]", outside, 1e-12)]
