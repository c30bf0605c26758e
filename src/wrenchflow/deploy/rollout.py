"""A policy on the simulated arm in virtual time: what it sees, what it plans, and the core that follows at 1 kHz."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float, Float32

from wrenchflow.calibration import calibration_meta
from wrenchflow.config import to_mapping
from wrenchflow.control.controller import TICK_NS
from wrenchflow.control.packet import MOST_WAYPOINTS
from wrenchflow.control.plan import Plan, packet_of
from wrenchflow.deploy.config import DeployConfig
from wrenchflow.deploy.link import Link
from wrenchflow.deploy.receipts import Receipts
from wrenchflow.deploy.virtual_mailbox import VirtualMailbox
from wrenchflow.episode import Episode, Stream
from wrenchflow.observation import HISTORY_NS, observe
from wrenchflow.policy.policy import Policy
from wrenchflow.process.config import ProcessConfig
from wrenchflow.process.live import LiveWrench
from wrenchflow.recording.black_box import BlackBox
from wrenchflow.rig import Rig
from wrenchflow.signals import POSE
from wrenchflow.sim.attempt import EVALUATE, Attempt, episode_id
from wrenchflow.sim.streams import streams_of
from wrenchflow.sim.tasks.task import Task

# A wrench reaches us one tick after it was measured, so the state of a stamp is complete two ticks after it.
_MEASURE_TICKS = 2
_SLICE_TICKS = 10  # Success is looked at this often.
_TAIL_TICKS = HISTORY_NS // TICK_NS + 8


class Rollout:
    """One attempt of a policy: looks when its step comes, follows the plan until the next.

    Attributes:
        attempt: The scene, the arm and the record.
        seen: What the policy was shown at each step, newest last. Shape (width,) each.
    """

    def __init__(self, attempt: Attempt, policy: Policy, link: Link) -> None:
        """Begin at the end of the tare; `link` is the way of the policy's plans to the arm."""
        self.attempt, self._policy = attempt, policy
        felt = ProcessConfig(filter=policy.wrench_filter)
        self._feel = LiveWrench(streams_of(attempt.plant.recorded), attempt.tare, attempt.rig, felt)
        self._felt = attempt.plant.count  # Rows whose wrench has been worked off.
        self._mailbox, self._receipts = VirtualMailbox(link, attempt.link_rng), Receipts(attempt)
        self._t_ns = attempt.start_ns
        self.seen: list[Float32[np.ndarray, " width"]] = []
        goal = attempt.scene.T_base_goal_perceived
        first_ns = attempt.plant.rows["t_ns"][:1].copy()
        self._goal = Stream(first_ns, goal[None].copy(), POSE, "base")

    @property
    def over(self) -> bool:
        """Whether the task is done, or its time has run out."""
        return self.attempt.over

    @property
    def goal_pose(self) -> Float[np.ndarray, " 7"]:
        """The goal as perceived."""
        return self._goal.data[0]

    def look(self) -> Float32[np.ndarray, "n_obs_steps width"]:
        """Let the state of this step's stamp arrive, and give the features of the last steps, the newest last."""
        self._run((self._t_ns - self.attempt.now_ns) // TICK_NS + _MEASURE_TICKS)
        self._feel.push(*self.attempt.samples_since(self._felt))
        self._felt = self.attempt.plant.count
        rows = self.attempt.plant.recorded[-_TAIL_TICKS:]
        streams = {**streams_of(rows), "wrench": self._feel.tail, "goal_pose": self._goal}
        features = self._policy.features
        seen = observe(streams, np.array([self._t_ns]), features.observation_names)
        self.seen.append(features.encode(seen)[0])
        n = self._policy.n_obs_steps
        padded = [self.seen[0]] * (n - len(self.seen)) + self.seen[-n:]
        return np.stack(padded)

    def plan(self, poses: Float[np.ndarray, "n 7"]) -> None:
        """Send off the policy's plan for this step; what no packet holds of it comes with a later one."""
        policy, poses = self._policy, poses[:MOST_WAYPOINTS]
        plan = Plan.of_poses(
            self._t_ns + policy.period_ns * np.arange(1, len(poses) + 1),
            poses,
            self.attempt.impedance,
            t_obs_ns=self._t_ns,
            period_ns=policy.period_ns * policy.n_action_steps,
            seq=self._mailbox.sent,
        )
        self._mailbox.send(self.attempt.now_ns, packet_of(plan))

    def follow(self) -> None:
        """Let the arm follow what has arrived, until the next step or the end."""
        self._t_ns += self._policy.period_ns
        while not self.over and (left := (self._t_ns - self.attempt.now_ns) // TICK_NS) > 0:
            self._run(min(_SLICE_TICKS, left))

    def _run(self, ticks: int) -> None:
        """Let ticks pass, stopping at each at which a plan arrives."""
        stop_ns = self.attempt.now_ns + ticks * TICK_NS
        while (now_ns := self.attempt.now_ns) < stop_ns:
            packet = self._mailbox.receive(now_ns)
            if packet is not None:
                self._receipts.receive(packet)
            until_ns = min(stop_ns, self._mailbox.next_ns or stop_ns)
            self.attempt.follow((until_ns - now_ns) // TICK_NS)

    def episode(self, id: str, **meta: Any) -> Episode:
        """The recording."""
        mailbox = self._mailbox
        plans = {"sent": mailbox.sent, "lost": mailbox.lost, "overtaken": mailbox.overtaken}
        plans |= self._receipts.summary()
        return self.attempt.episode(id, {}, [], policy={"steps": len(self.seen)}, plans=plans, **meta)


def roll_out(
    indices: Sequence[int],
    policy: Policy,
    task: Task,
    model: Any,
    rig: Rig,
    config: DeployConfig,
    boxes: Sequence[BlackBox] = (),
    without: Sequence[str] = (),
) -> list[Episode]:
    """Run some attempts side by side, with one inference for all of them at each step.

    Args:
        indices: Numbers of the attempts; with the seed they determine scene and noise.
        policy: What decides.
        task: What is attempted.
        model: Of the task with the arm of `rig`.
        rig: The robot cell.
        config: Seed, gains, and the way of the plans.
        boxes: One for each, where its rows are stored, so that something is left if it does not end well.
        without: Safeguards that are left out, to see what each is worth.
    """
    rollouts: list[Rollout] = []
    for index, box in zip(indices, boxes or [None] * len(indices), strict=True):
        keep = box.rows if box else None
        seed = (config.seed, index, EVALUATE)
        attempt = Attempt(task, model, rig, config, seed=seed, keep=keep, without=without)
        rollout = Rollout(attempt, policy, config.link)
        rollouts.append(rollout)
        if box is not None:
            box.tell = partial(
                rollout.episode,
                rollout_id(config, index),
                deploy=to_mapping(config),
                **calibration_meta(config.calibration),
            )
    step = 0
    while running := [rollout for rollout in rollouts if not rollout.over]:
        observations = np.stack([rollout.look() for rollout in running])
        if step % policy.n_action_steps == 0:
            goals = np.stack([rollout.goal_pose for rollout in running])
            plans = policy.act(observations, goals, [rollout.attempt.rng for rollout in running])
            for rollout, poses in zip(running, plans, strict=True):
                rollout.plan(poses)
        for rollout in running:
            rollout.follow()
        step += 1
    return [
        rollout.episode(rollout_id(config, index), deploy=to_mapping(config), **calibration_meta(config.calibration))
        for index, rollout in zip(indices, rollouts, strict=True)
    ]


def rollout_id(config: DeployConfig, index: int) -> str:
    """Name of a rollout, which is no demonstration's."""
    return episode_id(f"rollout-{config.task}", config.seed, index)
