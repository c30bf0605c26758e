"""What a person reads when something is wrong, word for word: what, got, expected, and what is available."""

import numpy as np
import pytest

from wrenchflow import errors
from wrenchflow.control.config import ControlConfig, Impedance
from wrenchflow.control.controller import Controller
from wrenchflow.episode import Episode, Stream
from wrenchflow.errors import WrenchflowError, unknown
from wrenchflow.rig import load_rig
from wrenchflow.signals import WRENCH
from wrenchflow.sim.tasks import make_task
from wrenchflow.spatial import IDENTITY_POSE


def wrench(stamps: list[int]) -> Stream:
    return Stream(np.array(stamps, np.int64), np.zeros((len(stamps), 6)), WRENCH)


def ask_for_no_time() -> None:
    controller = Controller(load_rig("panda_peg"), ControlConfig())
    controller.ask(IDENTITY_POSE, IDENTITY_POSE, ticks=0, impedance=Impedance())


@pytest.mark.parametrize(
    ("act", "kind", "text"),
    [
        (
            lambda: Episode("0007", "peg", {"tcp_pose": wrench([0]), "joint_states": wrench([0])})["wrench"],
            "StreamError",
            "stream 'wrench' is not in episode 0007. It has: joint_states, tcp_pose.",
        ),
        (
            lambda: wrench([1, 2, 2]),
            "StreamError",
            "stamps must strictly increase, but stamp 2 is 2 after 2.",
        ),
        (
            lambda: wrench([1]).column("fzz"),
            "StreamError",
            "no column 'fzz' in a 'wrench'. It has: fx, fy, fz, tx, ty, tz.",
        ),
        (
            lambda: make_task("peg-insert"),
            "ConfigError",
            "unknown task 'peg-insert'. Did you mean 'peg-insertion'? Available: connector-insertion, peg-insertion, "
            "surface-wiping.",
        ),
        (
            lambda: load_rig("ur5"),
            "ConfigError",
            "unknown rig 'ur5'. Available: panda_peg, panda_plug, panda_wiper. A rig of your own is named by its .toml "
            "file.",
        ),
        (ask_for_no_time, "ControlError", "a segment lasts at least 1 tick, got 0."),
    ],
)
def test_known_errors_read_so(act, kind, text):
    with pytest.raises(WrenchflowError) as error:
        act()
    assert (type(error.value).__name__, str(error.value)) == (kind, text)


def test_a_name_near_to_nothing_gets_no_hint():
    assert unknown("task", "xyz", []) == "unknown task 'xyz'. Available: none."
    assert unknown("key", "q", ["b", "a"]) == "unknown key 'q'. Available: a, b."


def test_every_error_is_one_of_ours():
    kinds = [value for name, value in vars(errors).items() if name.endswith("Error")]
    assert len(kinds) >= 9
    assert all(issubclass(kind, WrenchflowError) for kind in kinds)
