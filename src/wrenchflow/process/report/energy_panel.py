"""The work that the robot does on its environment over time, by the sensor and by the joints."""

from wrenchflow.episode import Episode
from wrenchflow.errors import WrenchflowError
from wrenchflow.force_filter import FilterConfig
from wrenchflow.pages import theme
from wrenchflow.pages.time_plot import DASHED, MAIN, Line, Panel
from wrenchflow.process.metrics.energy import work_of
from wrenchflow.process.metrics.force import Felt
from wrenchflow.rig import rig_of


def energy_panel(clean: Episode, filter: FilterConfig) -> tuple[Panel | None, str]:
    """A row of the plot of a clean episode, None where no work is known; and what cannot be told, empty if all can."""
    try:
        felt = Felt.of(clean, rig_of(clean.meta, "its metadata").sensor.rate_hz)
    except WrenchflowError as error:
        return None, str(error)
    work = work_of(clean, felt, filter)
    if isinstance(work, str):
        return None, work
    lines = [Line(name="by the sensor", t_ns=work.t, values=work.wrench_j, colour=theme.COLOURS[0], style=MAIN)]
    lacking = "" if work.joints_j is not None else "work by the joints: there are no external torques of seven joints"
    if work.joints_j is not None:
        lines.append(
            Line(name="by the joints", t_ns=work.t, values=work.joints_j, colour=theme.COLOURS[1], style=DASHED)
        )
    what = "on the environment, since the start; both are the same energy"
    return Panel(quantity="work", what=what, unit="J", lines=tuple(lines), height_px=130, has_zero=True), lacking
