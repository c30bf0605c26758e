"""An emulated person at the arm, many periods at once and without Python: hand, device, target, control, physics."""

from wrenchflow.collect.follow import follow, note
from wrenchflow.collect.hand import operate
from wrenchflow.compiled import kernel
from wrenchflow.sim.engine import TICK_NS, advance


@kernel
def decide(hand, white, teleop, obs, req, ctl):
    """One period up to the request: the hand moves, its report is read, and the target follows.

    Args:
        hand: One `HAND` record, in an array as all records here.
        white: Standard normal numbers, a row a period. Shape (n, WHITE_WIDTH).
        teleop: One `TELEOP` record.
        obs: One `OBS` record.
        req: One `REQ` record.
        ctl: One `CTL` record.
    """
    now_ns = obs[0].t_ns + TICK_NS
    operate(hand[0], obs[0], ctl[0], teleop[0], white[hand[0].period])
    teleop[0].report_ns, teleop[0].is_sound = now_ns, 1
    follow(teleop[0], now_ns, req[0], ctl[0])


@kernel
def drive(hand, white, teleop, periods, measure, noise, drawn, obs, req, schedule, ctl, rows, seen, first, count):
    """Run `count` ticks, whole periods of them, and note each in `periods`, `PERIOD` records.

    The arguments from `measure` on are those of `sim.engine.advance`.
    """
    ticks = teleop[0].ticks
    for start in range(0, count, ticks):
        decide(hand, white, teleop, obs, req, ctl)
        note(teleop[0], hand[0].wanted.phase, periods[hand[0].period - 1])
        advance(measure, noise, drawn + start, obs, req, schedule, ctl, rows, seen, first + start, ticks)
