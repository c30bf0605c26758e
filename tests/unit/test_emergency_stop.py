"""The first signal stops the arm and nothing else; what comes after it is heard as before."""

import signal

import pytest

from wrenchflow.collect.config import CollectConfig
from wrenchflow.control.emergency_stop import EmergencyStop
from wrenchflow.errors import ControlError, Terminated
from wrenchflow.sim.startup import check_cell


@pytest.fixture(autouse=True)
def _handlers():
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1)
    before = {number: signal.getsignal(number) for number in numbers}
    signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize(
    ("number", "end"),
    [(signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, Terminated), (signal.SIGUSR1, ControlError)],
)
def test_the_first_signal_stops_and_the_run_ends_when_it_is_asked(number, end):
    stopped = []
    with EmergencyStop() as stop:
        stop.require_none("")
        stop.stops(lambda: stopped.append(1))
        signal.raise_signal(number)
        assert stopped == [1]
        with pytest.raises(end) as told:
            stop.require_none("3 of 5 episodes are in 'raw'.")
    assert told.value.__notes__ == ["3 of 5 episodes are in 'raw'."]


def test_a_second_ctrl_c_is_heard_and_a_button_that_bounces_is_not():
    stopped = []
    with EmergencyStop() as stop:
        stop.stops(lambda: stopped.append(1))
        for _ in range(5):
            signal.raise_signal(signal.SIGUSR1)
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert len(stopped) == 6
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_who_begins_after_a_stop_is_stopped_at_once():
    stopped = []
    with EmergencyStop() as stop:
        signal.raise_signal(signal.SIGUSR1)
        stop.stops(lambda: stopped.append(1))
    assert stopped == [1]


def test_a_check_of_the_cell_that_is_stopped_has_failed():
    with EmergencyStop() as stop:
        signal.raise_signal(signal.SIGUSR1)
        with pytest.raises(ControlError):
            check_cell(CollectConfig(), stop)
