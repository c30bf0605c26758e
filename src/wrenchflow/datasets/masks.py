"""Masks: which episodes belong together, by split, task, operator, or what a person asked for."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from wrenchflow.datasets.about import About
from wrenchflow.datasets.split import validation_ids
from wrenchflow.observation import Steps


@dataclass(frozen=True, kw_only=True)
class Member:
    """What decides which masks an episode is in.

    Attributes:
        recording_id: The recording that it is from: its parts are on one side of every split.
        task: The task that was attempted.
        operator: Who demonstrated; empty where nobody said so.
    """

    recording_id: str
    task: str
    operator: str

    @classmethod
    def of(cls, steps: Steps) -> "Member":
        """That of an episode."""
        return cls(recording_id=steps.recording_id, task=steps.task, operator=steps.operator)


def masks_of(members: Sequence[Member], about: About) -> Mapping[str, tuple[int, ...]]:
    """Numbers of the episodes in each mask.

    Returns:
        `train` and `valid`; `task_<name>` and `operator_<name>`; those that `about` names; and of each of these the
        part that trains and the part that validates, as `<name>_train` and `<name>_valid`.
    """
    if about.splits:
        sides = {name: {id for id, side in about.splits.items() if side == name} for name in ("valid", "test")}
    else:
        held_out = validation_ids({member.recording_id for member in members}, about.config.valid_fraction)
        sides = {"valid": held_out, "test": frozenset()}
    valid, test = ({i for i, each in enumerate(members) if each.recording_id in side} for side in sides.values())
    groups: dict[str, set[int]] = {}
    for i, member in enumerate(members):
        for kind, name in (("task", member.task), ("operator", member.operator)):
            if name:
                groups.setdefault(f"{kind}_{_plain(name)}", set()).add(i)
    for name, recordings in about.masks.items():
        groups[_plain(name)] = {i for i, member in enumerate(members) if member.recording_id in recordings}
    train = set(range(len(members))) - valid - test
    found = {"train": train, "valid": valid, **({"test": test} if test else {})}
    for name, group in sorted(groups.items()):
        found |= {name: group, f"{name}_train": group & train, f"{name}_valid": group & valid}
    return {name: tuple(sorted(group)) for name, group in found.items()}


def _plain(name: str) -> str:
    """A name that no format takes for a path."""
    return re.sub(r"[^\w.+-]", "_", name)
