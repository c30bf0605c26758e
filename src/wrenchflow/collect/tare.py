"""Who judges the tare before a demonstration, by the rules that `process` has for the recording of it."""

from collections.abc import Callable

from wrenchflow.collect.config import CollectConfig
from wrenchflow.errors import CalibrationError
from wrenchflow.process.calibration import estimate_bias
from wrenchflow.sim.attempt import Attempt, Tares
from wrenchflow.sim.streams import streams_of


def tares_of(config: CollectConfig, tell: Callable[[str], None] | None = None) -> Tares:
    """How an attempt is tared: refused and repeated where the arm moved or something touched it.

    Args:
        config: How often, and with what rest in between.
        tell: Hears why a tare is refused, while there is still something to be done about it.
    """

    def judge(attempt: Attempt) -> str:
        streams, tare = streams_of(attempt.plant.recorded), attempt.tare
        try:
            estimate_bias(
                streams["wrench_raw"],
                streams["tcp_pose"],
                streams["joint_states"],
                attempt.rig,
                start_ns=tare.start_ns,
                stop_ns=tare.stop_ns,
            )
        except CalibrationError as error:
            if tell is not None:
                tell(str(error))
            return str(error)
        return ""

    return Tares(judge=judge, most=config.tares, wait_s=config.tare_wait_s)
