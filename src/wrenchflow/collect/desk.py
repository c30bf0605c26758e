"""What stands around somebody who demonstrates: the device, the keys, the board and the window on the scene."""

from dataclasses import dataclass

from wrenchflow.collect.board.board import Board
from wrenchflow.collect.devices.device import TeleopDevice
from wrenchflow.collect.viewer import SceneViewer
from wrenchflow.collect.wishes import Wishes


@dataclass(frozen=True, kw_only=True)
class Desk:
    """Any of it may be missing.

    Attributes:
        device: What the arm is moved with; None where an operator is a program.
        wishes: What is wanted done with an attempt.
        board: Where it is shown how far all is.
        viewer: The window.
    """

    device: TeleopDevice | None = None
    wishes: Wishes | None = None
    board: Board | None = None
    viewer: SceneViewer | None = None
