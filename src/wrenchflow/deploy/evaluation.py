"""What came out of a set of attempts: success with its interval, peak force, time, and failures by name."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from wrenchflow.deploy.config import DeployConfig
from wrenchflow.episode import Episode
from wrenchflow.filtering import lowpass
from wrenchflow.process.calibration import bias_window, estimate_bias
from wrenchflow.process.compensation import WrenchPipeline
from wrenchflow.process.config import BiasConfig
from wrenchflow.process.stamps import held_pose
from wrenchflow.rig import rig_of


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """How one attempt went.

    Attributes:
        id: Of the episode.
        success: Done, without pressing too hard.
        failure: Empty for a success, `over-force` for one that pressed too hard.
        duration_s: How long it took [s].
        peak_force_n: Largest low-passed force [N].
        leash_share: Share of the ticks in which the safety layer's leash was active: where it is long, the layer and
            not who acts limits the force.
    """

    id: str
    success: bool
    failure: str
    duration_s: float
    peak_force_n: float
    leash_share: float = 0.0


def wilson_interval(successes: int, attempts: int, z: float = 1.96) -> tuple[float, float]:
    """Wilson's score interval of a rate, for z = 1.96 at 95 %.

    Source: Wilson, *Probable Inference, the Law of Succession, and Statistical Inference* (1927).
    """
    if attempts == 0:
        return 0.0, 1.0
    p, n = successes / attempts, attempts
    centre = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n)) / (1 + z * z / n)
    return max(0.0, centre - half), min(1.0, centre + half)


def peak_force_n(episode: Episode, cutoff_hz: float) -> float:
    """Largest norm of the tared, compensated force after a second-order low-pass, from the end of the tare on [N]."""
    rig, raw = rig_of(episode.meta, episode.id), episode["wrench_raw"]
    start_ns, stop_ns = bias_window(episode, BiasConfig())
    pose = episode["tcp_pose"]
    bias = estimate_bias(raw, pose, episode["joint_states"], rig, start_ns=start_ns, stop_ns=stop_ns)
    before, held = held_pose(pose, raw.t)
    wrench = WrenchPipeline(rig, bias).compensate(raw.data[before:], held[:, 3:])
    smooth = lowpass(wrench[:, :3], cutoff_hz, rig.sensor.rate_hz, order=2)
    return float(np.linalg.norm(smooth[raw.t[before:] >= stop_ns], axis=1).max(initial=0.0))


def judge(episode: Episode, limits: DeployConfig) -> Verdict:
    """Judge one recorded attempt by the limits of force."""
    result = episode.meta["result"]
    peak_n = peak_force_n(episode, limits.force_cutoff_hz)
    failure = "over-force" if result["success"] and peak_n > limits.force_limit_n else result["failure"]
    return Verdict(
        id=episode.id,
        success=not failure,
        failure=failure,
        duration_s=result["duration_s"],
        peak_force_n=peak_n,
        leash_share=episode.meta.get("safety", {}).get("leash_share", 0.0),
    )


def summarise(verdicts: Sequence[Verdict]) -> dict[str, Any]:
    """Plain figures of a set of attempts, as `evaluation.json` holds them."""
    successes = sum(verdict.success for verdict in verdicts)
    peaks_n = [verdict.peak_force_n for verdict in verdicts]
    done_s = [verdict.duration_s for verdict in verdicts if verdict.success]
    return {
        "attempts": len(verdicts),
        "successes": successes,
        "success_rate": successes / len(verdicts) if verdicts else 0.0,
        "success_interval": list(wilson_interval(successes, len(verdicts))),
        "peak_force_n": spread(peaks_n),
        "duration_s": spread(done_s),
        "leash_share": spread([verdict.leash_share for verdict in verdicts]),
        "failures": dict(sorted(Counter(verdict.failure for verdict in verdicts if not verdict.success).items())),
    }


def paired_p_value(first: Sequence[Verdict], second: Sequence[Verdict]) -> float:
    """How likely two arms on the same scenes would differ this much by chance (exact McNemar test, two-sided).

    Source: McNemar, *Note on the sampling error of the difference between correlated proportions* (1947).
    """
    pairs = [(a.success, b.success) for a, b in zip(first, second, strict=True)]
    from scipy.stats import binomtest  # Two seconds of import, which no worker has to pay.

    only_first, only_second = pairs.count((True, False)), pairs.count((False, True))
    if only_first + only_second == 0:
        return 1.0
    return float(binomtest(only_first, only_first + only_second, 0.5).pvalue)


def spread(values: Sequence[float]) -> dict[str, float | None]:
    """Median, 95th percentile and maximum; None where there are no values."""
    if not values:
        return {"median": None, "p95": None, "max": None}
    return {
        "median": float(np.median(values)),
        "p95": float(np.percentile(values, 95)),
        "max": float(np.max(values)),
    }
