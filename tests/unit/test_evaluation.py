"""Success, intervals and peak force, against numbers from elsewhere."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binomtest

from wrenchflow.config import to_mapping
from wrenchflow.deploy.config import DeployConfig
from wrenchflow.deploy.evaluation import (
    Verdict,
    judge,
    paired_p_value,
    peak_force_n,
    spread,
    summarise,
    wilson_interval,
)

MS = 1_000_000


def verdict(success: bool, failure: str = "missed", peak_force_n: float = 10.0, duration_s: float = 4.0) -> Verdict:
    named = "" if success else failure
    return Verdict(id="x", success=success, failure=named, duration_s=duration_s, peak_force_n=peak_force_n)


def test_the_interval_is_wilsons():
    # Values that are printed in many places for 95 %.
    assert wilson_interval(8, 10) == pytest.approx((0.4902, 0.9433), abs=5e-5)
    assert wilson_interval(0, 10) == pytest.approx((0.0, 0.2775), abs=5e-5)
    assert wilson_interval(0, 0) == (0.0, 1.0)
    for k, n in ((0, 1), (1, 1), (5, 200), (184, 200), (200, 200)):
        expected = binomtest(k, n).proportion_ci(0.95, method="wilson")
        assert wilson_interval(k, n) == pytest.approx((expected.low, expected.high), abs=1e-4)
        low, high = wilson_interval(k, n)
        assert 0.0 <= low <= k / n <= high <= 1.0


def test_two_arms_are_compared_where_they_differ():
    # Nine scenes that only the first arm solves, one that only the second does: 2 (1 + 10) / 2^10.
    first = [verdict(True)] * 9 + [verdict(False)] + [verdict(True)] * 40 + [verdict(False)] * 7
    second = [verdict(False)] * 9 + [verdict(True)] + [verdict(True)] * 40 + [verdict(False)] * 7
    assert paired_p_value(first, second) == pytest.approx(22 / 1024)
    assert paired_p_value(second, first) == pytest.approx(22 / 1024)
    assert paired_p_value(first, first) == 1.0
    with pytest.raises(ValueError):
        paired_p_value(first, second[:-1])


def test_a_summary_counts_each_failure_by_its_name():
    made = [verdict(True, duration_s=2.0), verdict(True, duration_s=4.0), verdict(False, "timeout")]
    made += [verdict(False, "jammed", peak_force_n=30.0), verdict(False, "timeout")]
    summary = summarise(made)
    assert (summary["attempts"], summary["successes"], summary["success_rate"]) == (5, 2, 0.4)
    assert summary["success_interval"] == list(wilson_interval(2, 5))
    assert summary["failures"] == {"jammed": 1, "timeout": 2}
    # How long it takes is said of successes only; how hard it presses, of all.
    assert summary["duration_s"] == {"median": 3.0, "p95": pytest.approx(3.9), "max": 4.0}
    assert summary["peak_force_n"]["max"] == 30.0


def test_no_values_have_no_spread():
    assert spread([]) == {"median": None, "p95": None, "max": None}
    assert summarise([verdict(False)])["duration_s"]["median"] is None
    assert summarise([])["success_rate"] == 0.0


@pytest.fixture
def attempt(recording):
    """A recording with a push of so many newtons, that says of itself how it went."""

    def make(push_n: float, failure: str = "", **changes):
        direction = np.array([0.0, 0.6, -0.8])
        episode = recording(push_n=tuple(push_n * direction), **changes)
        return episode.with_meta(
            result={"success": not failure, "failure": failure, "duration_s": 1.5, "progress": 1.0}
        )

    return make


def test_the_peak_is_of_the_compensated_force_after_a_low_pass(attempt):
    # A second-order Butterworth low-pass answers a step with 4.3 % of overshoot. Bias (2.4 N) and weight (4.4 N) of the
    # recording would be far off if they were left in.
    assert peak_force_n(attempt(20.0, noise=0.0), 50.0) == pytest.approx(20.0 * 1.0432, rel=2e-3)
    noisy = [peak_force_n(attempt(20.0, seed=seed), 50.0) for seed in range(4)]
    assert noisy == pytest.approx([20.9] * 4, abs=0.7)
    # A lower cutoff takes longer than the push lasts, so it shows less.
    assert peak_force_n(attempt(20.0, noise=0.0), 0.5) < 15.0


def test_what_happens_before_the_end_of_the_tare_is_no_peak(attempt):
    calm = attempt(0.0, noise=0.0)
    assert peak_force_n(calm, 50.0) < 1e-6
    raw, tare = calm["wrench_raw"], calm.events_of("phase")[0]
    knocked, late_tare = raw.data.copy(), replace(tare, start_ns=tare.start_ns + 250 * MS)
    knocked[:100, :3] += 30.0
    episode = replace(calm.with_stream("wrench_raw", replace(raw, data=knocked)), events=(late_tare,))
    assert peak_force_n(episode, 50.0) < 1e-6


@pytest.mark.parametrize(
    ("push_n", "failure", "success", "named"),
    [
        (10.0, "", True, ""),
        (30.0, "", False, "over-force"),
        (10.0, "jammed", False, "jammed"),
        (30.0, "missed", False, "missed"),
    ],
)
def test_who_presses_too_hard_has_not_succeeded(attempt, push_n, failure, success, named):
    judged = judge(attempt(push_n, failure), DeployConfig(force_limit_n=25.0, force_cutoff_hz=50.0))
    assert (judged.success, judged.failure, judged.id, judged.duration_s) == (success, named, "0007", 1.5)
    assert to_mapping(judged)["peak_force_n"] == judged.peak_force_n
