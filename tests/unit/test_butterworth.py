"""Our Butterworth sections against scipy's, which takes a second to import, and what makes a filter a Butterworth."""

import subprocess
import sys

import numpy as np
import pytest
from scipy import signal

from wrenchflow.butterworth import design, steady_state

CUTOFFS = (1.0, 10.0, 40.0, 50.0, 150.0, 200.0, 330.0, 499.0)


@pytest.mark.parametrize("cutoff_hz", CUTOFFS)
@pytest.mark.parametrize("order", [2, 4])
def test_the_orders_that_are_used_are_scipys_to_the_last_bit(order: int, cutoff_hz: float):
    theirs = signal.butter(order, cutoff_hz, fs=1000.0, output="sos")
    np.testing.assert_array_equal(design(cutoff_hz, 1000.0, order), theirs)
    np.testing.assert_array_equal(steady_state(design(cutoff_hz, 1000.0, order)), signal.sosfilt_zi(theirs))


@pytest.mark.parametrize("cutoff_hz", CUTOFFS)
@pytest.mark.parametrize("order", [1, 2, 3, 4, 5, 6, 7, 8])
def test_it_answers_every_frequency_as_scipys_does(order: int, cutoff_hz: float):
    at_hz = np.linspace(0.0, 499.9, 97)
    _, theirs = signal.sosfreqz(signal.butter(order, cutoff_hz, fs=1000.0, output="sos"), at_hz, fs=1000.0)
    _, ours = signal.sosfreqz(design(cutoff_hz, 1000.0, order), at_hz, fs=1000.0)
    np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("order", [1, 3, 4, 7])
def test_it_passes_a_constant_and_half_the_power_at_its_cutoff(order: int):
    sections = design(40.0, 1000.0, order)
    _, (still, edge) = signal.sosfreqz(sections, [0.0, 40.0], fs=1000.0)
    assert abs(still) == pytest.approx(1.0, abs=1e-12)
    assert abs(edge) == pytest.approx(np.sqrt(0.5), abs=1e-9)


def test_who_changes_a_design_changes_nobody_elses():
    design(40.0, 1000.0, 4)[:] = 0.0
    assert design(40.0, 1000.0, 4).any()


def test_nothing_that_moves_an_arm_waits_for_scipys_signals():
    loaded = "import sys, wrenchflow.collect.folder; sys.exit('scipy.signal' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", loaded], check=False).returncode == 0
