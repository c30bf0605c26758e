"""What the safety layer costs a tick inside the compiled loop: a whole tick, and the bare law on the same state.

Observations of a peg that is pressed on the block, moved about and asked for another stiffness every 20 ms are recorded
first. Then each is given to the whole tick, and to the law alone (damping design, error, torque) on a copy of the
controller, with the clock read between them by compiled code. The safety layer is the difference. Run it as
`python benchmarks/governor_cost.py`.
"""

import numpy as np
from numba import types

from sim_loop import scene
from wrenchflow.compiled import kernel
from wrenchflow.control.config import Impedance
from wrenchflow.control.damping import design_damping
from wrenchflow.control.energy import error_into
from wrenchflow.control.impedance import _law, tick
from wrenchflow.control.records import OBS
from wrenchflow.control.torque import limit_torque

TICKS = 20_000
GOALS_US = {"median": 1.0, "p99.9": 10.0}
_MONOTONIC = 1
_clock_gettime = types.ExternalFunction("clock_gettime", types.intc(types.intc, types.uintp))


@kernel
def _now_ns(time):
    _clock_gettime(_MONOTONIC, time.ctypes.data)
    return time[0] * 1_000_000_000 + time[1]


@kernel
def _law_alone(obs, ctl):
    if ctl.tick % ctl.design_ticks == 0:
        design_damping(obs.J, obs.M, ctl.K_lin, ctl.K_rot, ctl.damping_ratio, ctl.D, ctl.P, ctl.inertia)
    error_into(ctl, obs.x, obs.R)
    for j in range(ctl.tau_wanted.shape[0]):
        ctl.tau_wanted[j] = 0.0
    _law(obs, ctl)
    limit_torque(ctl)
    ctl.tick += 1


@kernel
def _measure(seen, req, schedule, ctl, bare, time, took):
    for k in range(seen.shape[0]):
        before = _now_ns(time)
        tick(seen[k], req[0], schedule[0], ctl[0])
        between = _now_ns(time)
        _law_alone(seen[k], bare[0])
        after = _now_ns(time)
        took[k, 0], took[k, 1], took[k, 2] = between - before, after - between, _now_ns(time) - after


def main() -> None:
    """Record, replay, print."""
    plant, controller = scene(True)
    rng, target = np.random.default_rng(0), controller.target_pose
    seen, took, ticks_each = np.zeros(TICKS, OBS), np.zeros((TICKS, 3), np.int64), 20
    time = np.zeros(2, np.int64)
    # Compiled before it is timed.
    _measure(seen[:1], controller.req, controller.schedule, controller.ctl.copy(), controller.ctl.copy(), time, took)
    acted: set[str] = set()
    for start in range(0, TICKS, ticks_each):
        wanted = target.copy()
        wanted[:3] += rng.normal(size=3) * 0.002
        stiff = Impedance(translation_n_m=rng.uniform(300.0, 900.0), rotation_nm_rad=rng.uniform(15.0, 35.0))
        controller.ask(controller.target_pose, wanted, ticks=ticks_each, impedance=stiff)
        begun = controller.ctl.copy(), controller.schedule.copy()
        for k in range(start, start + ticks_each):
            plant.read(controller.obs)
            seen[k] = controller.obs[0]
            plant.write(controller.tick())
            acted |= set(controller.acting)
        ctl, schedule = begun
        rows = slice(start, start + ticks_each)
        _measure(seen[rows], controller.req, schedule, ctl, ctl.copy(), time, took[rows])
        assert ctl["tau"].tobytes() == controller.ctl["tau"].tobytes(), "what was timed is not what was done"
    whole, law, clock = (took[:, i] * 1e-3 for i in range(3))
    governor = whole - law
    print(f"{TICKS} ticks, {controller.mode}; acted: {', '.join(sorted(acted))}")
    for name, values in (("whole tick", whole - np.median(clock)), ("law alone", law - np.median(clock))):
        print(f"{name:12} median {np.median(values):6.2f} us, p99.9 {np.percentile(values, 99.9):6.2f} us")
    for name, value in (("median", np.median(governor)), ("p99.9", np.percentile(governor, 99.9))):
        print(f"safety layer {name:6} {value:6.2f} us (goal {GOALS_US[name]:g})")


if __name__ == "__main__":
    main()
