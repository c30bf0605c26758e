"""Who asks for what nobody should: scripts that act on an arena's controller, each whenever it wants to.

A script is a generator: resumed, it acts; what it yields is after how many ticks it wants to act again. Every random
number comes from the generator that it is given.
"""

import contextlib
import math
from collections.abc import Callable, Iterator

import numpy as np
from numpy.random import Generator

from safety.arena import Arena
from safety.packets import bad_plans, plans
from wrenchflow.control.config import Impedance
from wrenchflow.errors import ControlError
from wrenchflow.spatial import compose, exp_so3, make_pose

Script = Iterator[int]
Adversary = Callable[[Arena, Generator], Script]

KEPT = ("K_lin", "K_rot", "damping_ratio", "wrench", "x_offset")
NOT_FINITE = (np.nan, np.inf, -np.inf)


def retarget(arena: Arena, pose: np.ndarray, ticks: int, every_s: float = math.inf) -> None:
    """Ask for another target and leave the rest of the request as it is."""
    controller = arena.controller
    kept = {name: controller.req[0][name].copy() for name in KEPT}
    controller.ask(controller.target_pose, pose, ticks=ticks, impedance=Impedance(), every_s=every_s)
    for name, value in kept.items():
        controller.req[0][name] = value


def moved(arena: Arena, by_m: np.ndarray, turn_rad: np.ndarray | float = 0.0) -> np.ndarray:
    """The place's target, moved and turned in its own frame."""
    turn = np.zeros(3) + turn_rad
    return compose(arena.base_target, make_pose(np.asarray(by_m, float), exp_so3(turn)))


def seen_twist(arena: Arena) -> np.ndarray:
    """The twist that the controller saw last [m/s, rad/s]. Shape (6,)."""
    obs = arena.controller.obs[0]
    return obs["J"] @ obs["dq"]


def duty(arena: Arena, rng: Generator) -> Script:
    """What the place is for, and no harm meant: the target twenty times a second."""
    while True:
        retarget(arena, arena.base_target, 50)
        yield 50


def random_jumps(arena: Arena, rng: Generator) -> Script:
    """Targets anywhere near or far, in no time or in some."""
    while True:
        size = rng.choice([0.002, 0.02, 0.2])
        pose = moved(arena, rng.normal(size=3) * size, rng.normal(size=3) * rng.choice([0.02, 0.3]))
        retarget(arena, pose, int(rng.choice([1, 10, 100])))
        yield int(rng.integers(1, 200))


def bang_bang(arena: Arena, rng: Generator) -> Script:
    """The target to and fro along one line, at a rate that shakes the arm."""
    line, size = rng.normal(size=3), rng.choice([0.01, 0.1])
    line *= size / np.linalg.norm(line)
    turn = rng.normal(size=3) * rng.choice([0.0, 0.2])
    period = int(rng.integers(40, 400))
    while True:
        for sign in (1.0, -1.0):
            retarget(arena, moved(arena, sign * line, sign * turn), 1)
            yield period


def resonance(arena: Arena, rng: Generator) -> Script:
    """The target always ahead of the motion: a spring that only ever pulls along."""
    size = rng.choice([0.01, 0.05])
    while True:
        velocity = seen_twist(arena)[:3]
        along = velocity / max(float(np.linalg.norm(velocity)), 1e-4)
        retarget(arena, np.concatenate([arena.base_target[:3] + size * along, arena.base_target[3:]]), 1)
        yield 5


def gain_pumping(arena: Arena, rng: Generator) -> Script:
    """Stiff while the spring drives the arm, soft while it holds it back: the classical way to make it swing up."""
    stiff, soft = rng.choice([900.0, 1500.0, 1e5]), rng.choice([0.0, 50.0, 200.0])
    offset = rng.normal(size=3) * 0.02
    retarget(arena, moved(arena, offset), 1)
    while True:
        ctl, req = arena.controller.ctl[0], arena.controller.req[0]
        twist = seen_twist(arena)
        drives = float(ctl["e"][:3] @ twist[:3]) > 0.0, float(ctl["e"][3:] @ twist[3:]) > 0.0
        req["K_lin"] = np.eye(3) * (stiff if drives[0] else soft)
        req["K_rot"] = np.eye(3) * (stiff if drives[1] else soft) * 0.04
        yield 2


def axis_pumping(arena: Arena, rng: Generator) -> Script:
    """The stiff axis of an anisotropic spring turned after the motion, so that stiffness changes hands all the time."""
    while True:
        velocity = seen_twist(arena)[:3]
        n = velocity / max(float(np.linalg.norm(velocity)), 1e-6)
        arena.controller.req[0]["K_lin"] = np.eye(3) * 100.0 + 1300.0 * np.outer(n, n)
        yield 3


def damping_pumping(arena: Arena, rng: Generator) -> Script:
    """Damped while the arm comes to rest anyway, and not damped while it speeds up."""
    high = rng.choice([1.0, 2.0, 100.0])
    while True:
        ctl = arena.controller.ctl[0]
        speeds_up = float(ctl["e"] @ seen_twist(arena)) > 0.0
        arena.controller.req[0]["damping_ratio"] = 0.0 if speeds_up else high
        yield 2


def random_gains(arena: Arena, rng: Generator) -> Script:
    """Stiffness and damping ratio anywhere, sound or not: huge, tiny, negative, not symmetric."""
    while True:
        req = arena.controller.req[0]
        root = rng.normal(size=(3, 3))
        for name, scale in (("K_lin", 600.0), ("K_rot", 25.0)):
            size = scale * rng.choice([1e-9, 0.1, 1.0, 3.0, 1e6, 1e300])
            req[name] = (
                root @ root.T * size,
                np.eye(3) * size,
                -np.eye(3) * size,
                np.eye(3) * size + size * 0.1 * np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 0]]),
                np.diag([size, 0.0, 0.0]),
            )[rng.integers(5)]
        req["damping_ratio"] = rng.choice([-1.0, 0.0, 0.3, 0.9, 5.0, 1e308])
        yield int(rng.integers(1, 60))
        req["K_lin"], req["K_rot"], req["damping_ratio"] = np.eye(3) * 600.0, np.eye(3) * 25.0, 0.9
        yield int(rng.integers(1, 60))


def rubbish(arena: Arena, rng: Generator) -> Script:
    """NaN and infinity in a request, wherever there is room, and a sound one now and then."""
    names = [name for name, (kind, _) in arena.controller.req.dtype.fields.items() if kind.base.kind == "f"]
    while True:
        sound = arena.controller.req.copy()
        for name in rng.choice(names, 2):
            value = np.array(arena.controller.req[0][name])
            value.flat[rng.integers(value.size)] = rng.choice(NOT_FINITE)
            arena.controller.req[0][name] = value
        yield int(rng.integers(1, 30))
        arena.controller.req[:] = sound
        yield int(rng.integers(1, 30))


def no_rotations(arena: Arena, rng: Generator) -> Script:
    """Rotations that are none, that mirror, that turn too far, and quaternions that flip or are not of unit length."""
    while True:
        req, pose = arena.controller.req[0], moved(arena, np.zeros(3), rng.normal(size=3) * 0.1)
        kind = rng.integers(5)
        if kind == 0:
            req["R_start"] = req["R_start"] * rng.choice([0.0, 0.5, 1.01, -1.0])
        elif kind == 1:
            req["R_start"][:, rng.integers(3)] *= -1.0
        elif kind == 2:
            req["turn"] = rng.normal(size=3) * 10.0 ** rng.integers(0, 4)
        elif kind == 3:
            pose[3:] *= -1.0
            retarget(arena, pose, 10)
        else:
            pose[3:] *= rng.choice([1e-3, 0.7, 3.0])
            retarget(arena, pose, 10)
        yield int(rng.integers(1, 60))
        retarget(arena, arena.base_target, 50)
        yield int(rng.integers(1, 60))


def push_into(arena: Arena, rng: Generator) -> Script:
    """A target half a metre behind whatever is there, again and again from a little way off."""
    while True:
        retarget(arena, moved(arena, [0.0, 0.0, 0.5]), int(rng.choice([1, 300])))
        yield int(rng.integers(200, 900))
        retarget(arena, moved(arena, [0.0, 0.0, -rng.uniform(0.01, 0.06)]), int(rng.choice([1, 100])))
        yield int(rng.integers(100, 500))


def disturbance(arena: Arena, rng: Generator) -> Script:
    """The offset that is tracked besides the target, put to the same use."""
    while True:
        arena.controller.req[0]["x_offset"] = rng.normal(size=3) * rng.choice([0.0, 0.01, 1.0, 100.0])
        yield int(rng.integers(1, 80))


def feed_forward(arena: Arena, rng: Generator) -> Script:
    """A wrench besides the spring that always points where the arm is going."""
    force_n, moment_nm = rng.choice([5.0, 30.0, 1e6]), rng.choice([0.0, 1.0, 1e6])
    while True:
        twist = seen_twist(arena)
        wrench = np.zeros(6)
        for half, size in ((slice(0, 3), force_n), (slice(3, 6), moment_nm)):
            wrench[half] = size * twist[half] / max(float(np.linalg.norm(twist[half])), 1e-9)
        arena.controller.req[0]["wrench"] = wrench
        yield 3


def silence(arena: Arena, rng: Generator) -> Script:
    """Requests that expire, and nobody who asks again for a while."""
    while True:
        pose = moved(arena, rng.normal(size=3) * 0.03)
        retarget(arena, pose, int(rng.choice([1, 100, 1000])), every_s=float(rng.choice([0.02, 0.05, 0.1])))
        yield int(rng.choice([30, 90, 400, 1600]))


def last_words(arena: Arena, rng: Generator) -> Script:
    """A few requests that expire, and after them nobody who ever asks again."""
    for _ in range(rng.integers(1, 4)):
        pose = moved(arena, rng.normal(size=3) * 0.03)
        retarget(arena, pose, int(rng.choice([1, 100, 300])), every_s=float(rng.choice([0.02, 0.05, 0.1])))
        yield int(rng.choice([30, 90, 150]))


def wrong_clock(arena: Arena, rng: Generator) -> Script:
    """A clock of the robot that goes back, jumps ahead, or stands still."""
    while True:
        yield int(rng.integers(300, 800))
        kind, ticks = rng.integers(4), int(rng.integers(1, 8))
        now_ns = int(arena.controller.obs[0]["t_ns"])
        shift_ns = int(rng.choice([1_500_000, 3_000_000, 50_000_000, 10**12]))

        def tamper(obs: np.ndarray, kind: int = kind, now_ns: int = now_ns, shift_ns: int = shift_ns) -> None:
            obs["t_ns"] = (now_ns, obs["t_ns"] - shift_ns, obs["t_ns"] + shift_ns, np.iinfo(np.int64).min)[kind]

        arena.tampers["clock"] = tamper
        yield ticks
        del arena.tampers["clock"]


def bad_sensor(arena: Arena, rng: Generator) -> Script:
    """A force sensor that freezes, dies or shouts, in contact or not."""
    while True:
        yield int(rng.integers(200, 900))
        kind, frozen = rng.integers(4), arena.controller.obs[0]["wrench"].copy()

        def tamper(obs: np.ndarray, kind: int = kind, frozen: np.ndarray = frozen) -> None:
            obs["wrench"] = (frozen, np.full(6, np.nan), np.zeros(6), frozen + 1e4)[kind]

        arena.tampers["sensor"] = tamper
        yield int(rng.choice([1, 5, 300]))
        del arena.tampers["sensor"]


def bad_state(arena: Arena, rng: Generator) -> Script:
    """A robot that says for a few ticks that it is not anywhere."""
    while True:
        yield int(rng.integers(500, 2000))
        name = rng.choice(["q", "dq", "x", "R", "J", "M", "coriolis", "tau", "tau_external"])
        value = rng.choice(NOT_FINITE)

        def tamper(obs: np.ndarray, name: str = name, value: float = value) -> None:
            obs[name].flat[0] = value

        arena.tampers["state"] = tamper
        yield int(rng.integers(1, 10))
        del arena.tampers["state"]


def hand(arena: Arena, rng: Generator) -> Script:
    """Somebody who takes the arm by its tool, pulls it about, and lets go: energy that no controller gave."""
    while True:
        arena.hand_n = np.zeros(3)
        yield int(rng.integers(100, 500))
        arena.hand_n = rng.normal(size=3) * rng.choice([5.0, 20.0])
        yield int(rng.integers(50, 600))


def shaking_hand(arena: Arena, rng: Generator) -> Script:
    """Somebody who pushes the way that the arm is going, as one pushes a swing."""
    while True:
        velocity = seen_twist(arena)[:3]
        arena.hand_n = 15.0 * velocity / max(float(np.linalg.norm(velocity)), 0.02)
        yield 5


def together(*adversaries: Adversary) -> Adversary:
    """One adversary that is several at once."""

    def play(arena: Arena, rng: Generator) -> Script:
        scripts = [
            adversary(arena, child) for adversary, child in zip(adversaries, rng.spawn(len(adversaries)), strict=True)
        ]
        due, now = [0] * len(scripts), 0
        while True:
            for i, script in enumerate(scripts):
                if due[i] <= now:
                    due[i] = now + max(1, next(script))
            wait = min(due) - now
            now += wait
            yield wait

    return play


def operator(arena: Arena, rng: Generator) -> Script:
    """Somebody at the stop, who resets whatever is latched after a while."""
    while True:
        yield int(rng.integers(100, 400))
        if arena.controller.mode == "latched":
            # Who resets an arm that cannot be read is told so.
            with contextlib.suppress(ControlError):
                arena.controller.reset()
        elif rng.random() < 0.03:
            arena.controller.stop()


# Who decides where the target is; and who rides on one of these.
CARRIERS: dict[str, Adversary] = {
    "duty": duty,
    "random jumps": random_jumps,
    "bang-bang": bang_bang,
    "resonance": resonance,
    "push into": push_into,
    "silence": silence,
    "plans": plans,
    "bad plans": bad_plans,
}
RIDERS: dict[str, tuple[Adversary, Adversary]] = {
    "gain pumping": (bang_bang, gain_pumping),
    "axis pumping": (bang_bang, axis_pumping),
    "damping pumping": (bang_bang, damping_pumping),
    "feed-forward": (random_jumps, feed_forward),
    "random gains": (duty, random_gains),
    "rubbish": (duty, rubbish),
    "no rotations": (duty, no_rotations),
    "disturbance": (duty, disturbance),
    "wrong clock": (duty, wrong_clock),
    "bad sensor": (duty, bad_sensor),
    "bad state": (duty, bad_state),
    "hand": (duty, hand),
    "shaking hand": (duty, shaking_hand),
}


def anything(arena: Arena, rng: Generator) -> Script:
    """A carrier and three riders at once, drawn again now and then."""
    riders = [rider for name, (_, rider) in RIDERS.items() if "hand" not in name]
    while True:
        carrier = list(CARRIERS.values())[rng.integers(len(CARRIERS))]
        chosen = [riders[i] for i in rng.choice(len(riders), 3, replace=False)]
        script, left = together(carrier, *chosen)(arena, rng.spawn(1)[0]), int(rng.integers(300, 1500))
        while left > 0:
            wait = min(next(script), left)
            left -= wait
            yield wait
        arena.tampers.clear()


ADVERSARIES: dict[str, Adversary] = {
    **CARRIERS,
    **{name: together(*pair) for name, pair in RIDERS.items()},
    "anything": anything,
}


# Who needs a long run to do any harm.
PATIENT: dict[str, Adversary] = {"last words": last_words}


def scripts_of(arena: Arena, name: str, seed: int) -> tuple[Script, ...]:
    """An adversary by name, and an operator beside it who resets what it latched."""
    first, second = np.random.default_rng((seed, 29, *name.encode())).spawn(2)
    return (ADVERSARIES | PATIENT)[name](arena, first), operator(arena, second)
