"""All checks of one run, as the tests, the search and the long run use them."""

from safety.arena import Arena
from safety.energy import check_passive, check_tank, check_work
from safety.findings import Finding
from safety.ledger import check_ledger
from safety.limits import (
    check_caps,
    check_contact,
    check_finite,
    check_leash,
    check_speed,
    check_torque,
    check_workspace,
)
from safety.modes import check_silence
from safety.slew import check_slew
from safety.trace import Trace
from safety.transparency import check_transparent

# What noise of the measured joints may hide of the true work: at once [J], and each second [W].
NOISE_J, NOISE_W = 0.01, 0.01
# What is left of a perfect measurement: rounding, and the curvature of a tick's motion.
EXACT_J = 1e-6


def check(arena: Arena, trace: Trace) -> list[Finding]:
    """Every invariant that holds in any run, whoever asked for whatever."""
    config = arena.config
    noise = (NOISE_J, NOISE_W) if arena.noisy else (EXACT_J, 0.0)
    found = [
        *check_tank(trace),
        *check_work(trace, config, *noise),
        *check_ledger(trace, config, *noise, arena.plant.measurement.joint_position_noise_rad),
        *check_torque(trace, arena.rig, config),
        *check_finite(trace),
        *check_silence(trace),
        *check_slew(trace, config),
        *check_transparent(trace),
        *check_leash(trace, config),
        *check_contact(trace, config),
        *check_speed(trace, config),
        *check_caps(trace, config),
        *check_workspace(trace, arena.rig),
    ]
    # A nullspace spring has a potential that nobody counts, and a noisy arm is not where it seems to be.
    if not arena.noisy and config.nullspace_nm_rad == 0.0:
        found += check_passive(trace)
    return found
