"""The way from a policy to the arm in virtual time: it takes a while, not always the same, and loses some."""

from dataclasses import dataclass, field
from heapq import heappop, heappush

import numpy as np

from wrenchflow.control.controller import TICK_NS
from wrenchflow.deploy.link import Link


@dataclass(order=True, frozen=True)
class _Letter:
    arrival_ns: int
    number: int
    tick_ns: int = field(compare=False)
    packet: np.ndarray = field(compare=False)


class VirtualMailbox:
    """One slot that the newest arrival takes: nobody waits, and nothing queues up.

    Every packet costs two draws, whatever becomes of it, so that what is lost shifts nobody else's delay.

    Attributes:
        sent: Packets so far.
        lost: Those that never arrive.
        overtaken: Those that another one replaced before anybody looked.
    """

    def __init__(self, link: Link, rng: np.random.Generator) -> None:
        """Begin empty; every random number is from `rng`."""
        self._link, self._rng = link, rng
        self._underway: list[_Letter] = []
        self.sent = self.lost = self.overtaken = 0

    def send(self, sent_ns: int, packet: np.ndarray) -> None:
        """Send a copy of a packet off, at a tick of the loop; it arrives at one too, the first after its delay."""
        jitter, chance = abs(self._rng.standard_normal()), self._rng.random()
        delay_ns = round((self._link.latency_s + self._link.jitter_s * jitter) * 1e9)
        if chance < self._link.loss:
            self.lost += 1
        else:
            tick_ns = sent_ns + -(-delay_ns // TICK_NS) * TICK_NS
            heappush(self._underway, _Letter(sent_ns + delay_ns, self.sent, tick_ns, packet.copy()))
        self.sent += 1

    @property
    def next_ns(self) -> int | None:
        """The tick at which the next packet arrives; None while none is underway."""
        return self._underway[0].tick_ns if self._underway else None

    def receive(self, now_ns: int) -> np.ndarray | None:
        """Empty the slot: of the packets that have arrived, the one that arrived last, or None."""
        packet = None
        while self._underway and self._underway[0].tick_ns <= now_ns:
            self.overtaken += packet is not None
            packet = heappop(self._underway).packet
        return packet
