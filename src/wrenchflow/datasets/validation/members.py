"""Whether episodes repeat, and whether what trains also validates: by content, recording and mask."""

import hashlib
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from wrenchflow.datasets.validation.problems import Problems


class Members:
    """Remembers of each episode what tells a copy: a hash of its content, and its recording."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self._hashes: list[bytes] = []
        self._recordings: list[str] = []

    def add(self, name: str, content: Iterable[np.ndarray], recording: str = "") -> None:
        """Take in an episode.

        Args:
            name: What it is called.
            content: What a policy would see and do: two episodes of equal content are copies.
            recording: The recording that it is from; empty where nobody says.
        """
        digest = hashlib.blake2b(digest_size=16)
        for values in content:
            digest.update(np.ascontiguousarray(values).tobytes())
        self.names.append(name)
        self._hashes.append(digest.digest())
        self._recordings.append(recording)

    def check(self, masks: Mapping[str, Sequence[str]], problems: Problems) -> None:
        """Look for copies, for masks that name what is not there, and for episodes on both sides of a split.

        Args:
            masks: Names of the episodes in each mask.
            problems: Where to say it.
        """
        first: dict[bytes, str] = {}
        for name, content in zip(self.names, self._hashes, strict=True):
            if content in first:
                problems.add("duplicate", f"holds the same numbers as {first[content]}", episode=name)
            first.setdefault(content, name)
        there = set(self.names)
        for mask, members in masks.items():
            for member in sorted(set(members) - there):
                problems.add("mask", f"names {member}, which is not there", column=f"mask/{mask}")
            repeated = len(members) - len(set(members))
            if repeated:
                problems.add("mask", f"names {repeated} episodes twice", column=f"mask/{mask}")
        for mask in masks:
            if mask != "train" and not mask.endswith("_train"):
                continue
            other = f"{mask.removesuffix('train')}valid"
            self._check_split(mask, masks[mask], other, masks.get(other, ()), problems)

    def _check_split(
        self, mask: str, train: Sequence[str], other: str, valid: Sequence[str], problems: Problems
    ) -> None:
        both = sorted(set(train) & set(valid))
        for name in both:
            problems.add("leakage", f"is in both {mask} and {other}", episode=name)
        for what, keys in (("the same recording", self._recordings), ("the same numbers", self._hashes)):
            of = dict(zip(self.names, keys, strict=True))
            trains = {of[name]: name for name in train if of.get(name)}
            for name in valid:
                if name not in both and of.get(name) and of[name] in trains:
                    problems.add(
                        "leakage", f"is in {other} and of {what} as {trains[of[name]]} in {mask}", episode=name
                    )
