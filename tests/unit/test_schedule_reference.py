"""The compiled scheduler against an independent one in numpy and scipy, and against itself without the compiler."""

import os
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from wrenchflow.control.packet import PACKET
from wrenchflow.control.records import CTL
from wrenchflow.control.schedule import SCHEDULE, accept, evaluate, make_schedule

S, TICK_S, BLEND_S, LEAD_NS = 1e-9, 1e-3, 0.1, 5_000_000
ASKED = ("K_lin", "K_rot", "damping_ratio", "wrench")


def rate_of_spin(phi: np.ndarray, spin: np.ndarray) -> np.ndarray:
    """Rate of a rotation vector under an angular velocity; J_l is the integral of exp(s phi^) from 0 to 1."""
    x, y, z = phi
    block = np.zeros((6, 6))
    block[:3, :3], block[:3, 3:] = [[0, -z, y], [z, 0, -x], [-y, x, 0]], np.eye(3)
    return np.linalg.solve(expm(block)[:3, 3:], spin)


def tangent(before, before_s, after, after_s):
    """Slope at 0 of the parabola through -before, 0 and after, three times the slower secant at most."""
    through = np.stack([-before, np.zeros(3), after])
    slope = np.polyfit([-before_s, 0.0, after_s], through, 2)[1]
    most = 3.0 * min(np.linalg.norm(before) / before_s, np.linalg.norm(after) / after_s)
    return slope * min(1.0, most / max(np.linalg.norm(slope), 1e-300))


class Reference:
    """The same schedule, written from its description: lists of knots, nothing kept that can be worked out."""

    def __init__(self, ctl):
        self.t, self.x, self.R, self.how = [], [], [], []
        self.ctl = ctl
        self.seam = (0, *np.zeros((4, 3)))  # since when, and what decays since

    def segments(self):
        h = np.diff(self.t) * S
        turns = [(b * a.inv()).as_rotvec() for a, b in pairwise(self.R)]
        steps = np.diff(self.x, axis=0)
        v, w = np.zeros((2, len(self.t), 3))
        for i in range(1, len(self.t) - 1):
            v[i] = tangent(steps[i - 1], h[i - 1], steps[i], h[i])
            w[i] = tangent(turns[i - 1], h[i - 1], turns[i], h[i])
        return h, turns, v, w

    def way(self, t_ns):
        """Position and rotation on the spline, and what is asked along with them."""
        i = int(np.clip(np.searchsorted(self.t, t_ns, side="right") - 1, 0, len(self.t) - 1))
        if i + 1 == len(self.t):
            return self.x[i], self.R[i], self.how[i]
        h, turns, v, w = self.segments()
        u = max(0.0, (t_ns - self.t[i]) * S)
        x = CubicHermiteSpline([0.0, h[i]], self.x[i : i + 2], v[i : i + 2])(u)
        rates = [w[i], rate_of_spin(turns[i], w[i + 1])]
        phi = CubicHermiteSpline([0.0, h[i]], [np.zeros(3), turns[i]], rates)(u)
        return x, Rotation.from_rotvec(phi) * self.R[i], (1.0 - u / h[i]) * self.how[i] + u / h[i] * self.how[i + 1]

    def target(self, t_ns):
        x, R, how = self.way(t_ns)
        since, gap, gap_rate, turn, turn_rate = self.seam
        u = min((t_ns - since) * S, BLEND_S)
        fade = CubicHermiteSpline(
            [0.0, BLEND_S], [np.hstack([gap, turn]), np.zeros(6)], [np.hstack([gap_rate, turn_rate]), np.zeros(6)]
        )(u)
        return x + fade[:3], Rotation.from_rotvec(fade[3:]) * R, how

    def accept(self, packet, now_ns):
        new = packet["t"][: packet["count"]] > now_ns + LEAD_NS
        old_ways, old_targets = None, None
        if self.t:
            old_ways = [self.way(now_ns + j * 1_000_000) for j in range(2)]
            old_targets = [self.target(now_ns + j * 1_000_000) for j in range(2)]
        if not self.t or self.t[-1] <= now_ns:
            ctl = self.ctl
            self.t, self.x, self.R = [now_ns], [ctl["x_target"].copy()], [Rotation.from_matrix(ctl["R_target"])]
            self.how = [np.hstack([np.ravel(ctl[f"{name}_target"]) for name in ASKED])]
        for i in np.flatnonzero(new):
            keep = np.searchsorted(self.t, packet["t"][i])
            self.t = [*self.t[:keep], int(packet["t"][i])]
            self.x = [*self.x[:keep], packet["x"][i].copy()]
            self.R = [*self.R[:keep], Rotation.from_quat(packet["quat_wxyz"][i], scalar_first=True)]
            self.how = [*self.how[:keep], np.hstack([np.ravel(packet[name][i]) for name in ASKED])]
        if old_ways is None:
            return
        ways = [self.way(now_ns + j * 1_000_000) for j in range(2)]
        apart = [
            np.abs(a[0] - b[0]).max() + (a[1] * b[1].inv()).magnitude() for a, b in zip(ways, old_ways, strict=True)
        ]
        if max(apart) > 1e-12:
            gaps = [target[0] - way[0] for target, way in zip(old_targets, ways, strict=True)]
            turns = [(target[1] * way[1].inv()).as_rotvec() for target, way in zip(old_targets, ways, strict=True)]
            rates = (gaps[1] - gaps[0]) / TICK_S, (turns[1] - turns[0]) / TICK_S
            self.seam = (now_ns, gaps[0], rates[0], turns[0], rates[1])


def story(seed: int):
    """Plans as they come: when, and what. Unevenly spaced, turning far, now late, now after the end."""
    rng = np.random.default_rng(seed)
    now_ns = 10**18
    for k in range(12):
        packet = np.zeros(1, PACKET)
        plan, n = packet[0], int(rng.integers(1, 10))
        plan["seq"], plan["count"], plan["period_ns"], plan["t_obs_ns"] = k, n, 50_000_000, now_ns - 10_000_000
        t = now_ns - 60_000_000 + rng.integers(4_000_000, 90_000_000, size=n).cumsum()
        t[-1] = max(t[-1], now_ns + 30_000_000)
        plan["t"][:n] = t
        plan["x"][:n] = rng.normal(size=(n, 3)).cumsum(axis=0) * 0.02
        turn = Rotation.from_rotvec(rng.normal(size=(n, 3)) * rng.choice([0.05, 0.5, 1.2]))
        plan["quat_wxyz"][:n] = turn.as_quat(scalar_first=True) * rng.choice([1.0, -1.0], size=(n, 1))
        roots = rng.normal(size=(2, n, 3, 3)) * 10.0
        plan["K_lin"][:n], plan["K_rot"][:n] = roots @ np.swapaxes(roots, -1, -2)
        plan["damping_ratio"][:n], plan["wrench"][:n] = rng.uniform(0.5, 1.5, size=n), rng.normal(size=(n, 6))
        plan["gripper"][:n] = np.where(rng.random(n) < 0.5, rng.uniform(0.0, 0.08, size=n), np.nan)
        yield now_ns, packet
        now_ns += int(rng.choice([0, 20_000_000, 50_000_000, 800_000_000])) + 1_000_000


def followed(seed: int):
    """What becomes of a story: reasons, the schedule after each packet, and the targets a tick apart."""
    schedule, ctl = make_schedule((-0.5,) * 3, (0.5,) * 3), np.zeros(1, CTL)
    ctl[0]["R_target"], ctl[0]["K_lin_target"], ctl[0]["gripper_target"] = np.eye(3), np.eye(3), np.nan
    reasons, schedules, targets = [], [], []
    for (now_ns, packet), (next_ns, _) in pairwise(story(seed)):
        reasons.append(int(accept(packet[0], schedule[0], ctl[0], now_ns)))
        schedules.append(schedule.copy())
        for t_ns in range(now_ns, next_ns, 1_000_000):
            evaluate(schedule[0], t_ns, ctl[0])
            targets.append(ctl.copy())
    return np.array(reasons), np.concatenate(schedules), np.concatenate(targets)


def test_position_rotation_and_stiffness_are_those_of_the_reference():
    turned = 0.0
    for seed in range(4):
        schedule, ctl = make_schedule((-0.5,) * 3, (0.5,) * 3), np.zeros(1, CTL)
        ctl[0]["R_target"] = np.eye(3)
        reference = Reference(ctl[0])
        for (now_ns, packet), (next_ns, _) in pairwise(story(seed)):
            reference.accept(packet[0], now_ns)
            assert accept(packet[0], schedule[0], ctl[0], now_ns) == 0
            turned = max(turned, np.linalg.norm(schedule[0]["turn"][: schedule[0]["count"] - 1], axis=1).max())
            for t_ns in range(now_ns, min(next_ns, now_ns + 300_000_000), 11_000_000):
                evaluate(schedule[0], t_ns, ctl[0])
                x, R, how = reference.target(t_ns)
                np.testing.assert_allclose(ctl[0]["x_target"], x, atol=1e-10, rtol=0.0)
                assert (R.inv() * Rotation.from_matrix(ctl[0]["R_target"])).magnitude() < 1e-10
                asked = np.hstack([np.ravel(ctl[0][f"{name}_target"]) for name in ASKED])
                np.testing.assert_allclose(asked, how, atol=1e-9, rtol=0.0)
            evaluate(schedule[0], next_ns - 1_000_000, ctl[0])
    assert turned > 3.0  # Nearly half a turn in one segment was among them.


PLAIN = """
import sys
import numpy as np
sys.path.insert(0, sys.argv[1])
from test_schedule_reference import followed
from wrenchflow.control.schedule import evaluate
assert type(evaluate).__name__ == "function"
for seed in range(3):
    for name, value in zip(("reasons", "schedules", "targets"), followed(seed), strict=True):
        np.save(f"{name}{seed}.npy", value)
"""


@pytest.mark.slow
def test_without_the_compiler_every_bit_of_schedule_and_targets_is_the_same(tmp_path: Path):
    plain = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    subprocess.run([sys.executable, "-c", PLAIN, str(Path(__file__).parent)], env=plain, cwd=tmp_path, check=True)
    for seed in range(3):
        without = [np.load(tmp_path / f"{name}{seed}.npy") for name in ("reasons", "schedules", "targets")]
        reasons, schedules, targets = followed(seed)
        np.testing.assert_array_equal(without[0], reasons)
        for dtype, ours, theirs in ((SCHEDULE, schedules, without[1]), (CTL, targets, without[2])):
            for name in dtype.names:
                np.testing.assert_array_equal(theirs[name], ours[name], err_msg=name)


def test_a_story_has_all_that_it_should():
    # The comparisons above are worth what the stories are: blends that overlap, ends that are passed, poses that turn.
    jumps, ends = [], 0
    for seed in range(6):
        _, schedules, _ = followed(seed)
        jumps += list(schedules["seam_jump_m"])
        receipts_ns = np.array([now_ns for now_ns, _ in story(seed)])
        ends += (receipts_ns[1:] >= schedules["end_ns"]).sum()
    assert sum(jump > 1e-3 for jump in jumps) > 20
    assert ends > 5
