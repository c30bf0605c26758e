"""The virtual mailbox: how long packets take, which are lost, and that only the last one in is read."""

import numpy as np
import pytest
from scipy.stats import halfnorm, kstest

from wrenchflow.control.packet import PACKET
from wrenchflow.deploy.link import Link
from wrenchflow.deploy.virtual_mailbox import VirtualMailbox
from wrenchflow.errors import ConfigError

MS = 1_000_000
START_NS = 1_577_836_800_000_000_000


def packet(seq: int) -> np.ndarray:
    made = np.zeros(1, PACKET)
    made["seq"] = seq
    return made


def arrivals(link: Link, seed: int, count: int) -> dict[int, int]:
    """Delay [ns] of each packet that arrives, by its number; they are sent too far apart to meet."""
    mailbox, delays = VirtualMailbox(link, np.random.default_rng(seed)), {}
    for seq in range(count):
        sent_ns = START_NS + seq * 10_000 * MS
        mailbox.send(sent_ns, packet(seq))
        if mailbox.next_ns is not None:
            assert mailbox.receive(mailbox.next_ns - 1) is None
            delays[seq] = mailbox.next_ns - sent_ns
            got = mailbox.receive(mailbox.next_ns)
            assert got is not None
            assert got["seq"][0] == seq
            assert mailbox.next_ns is None
    assert (mailbox.sent, mailbox.lost, mailbox.overtaken) == (count, count - len(delays), 0)
    return delays


@pytest.mark.parametrize(
    ("latency_s", "ticks"), [(0.0, 0), (0.07, 70), (0.0007, 1), (0.12, 120), (0.1200001, 121), (0.05, 50)]
)
def test_a_latency_without_jitter_is_kept_to_the_tick_rounded_up(latency_s: float, ticks: int):
    assert set(arrivals(Link(latency_s=latency_s), 0, 20).values()) == {ticks * MS}


def test_jitter_is_half_normal_on_top_of_the_latency_and_never_early():
    delays = np.array(list(arrivals(Link(latency_s=0.05, jitter_s=0.03), 1, 4000).values()))
    assert (delays % MS == 0).all()
    assert delays.min() >= 50 * MS
    # Rounded up: uniformly spread over the tick before, what arrives is what was drawn.
    spread_s = (delays - np.random.default_rng(0).random(len(delays)) * MS) * 1e-9 - 0.05
    assert kstest(spread_s, halfnorm(scale=0.03).cdf).pvalue > 0.01


def test_the_share_of_loss_is_kept_and_what_is_lost_shifts_no_other_delay():
    whole, holed = (arrivals(Link(latency_s=0.05, jitter_s=0.03, loss=loss), 2, 4000) for loss in (0.0, 0.1))
    assert len(whole) == 4000
    assert abs(len(holed) - 3600) < 4 * np.sqrt(4000 * 0.1 * 0.9)
    assert holed == {seq: whole[seq] for seq in holed}
    assert arrivals(Link(loss=1.0), 0, 50) == {}


def test_the_same_generator_gives_the_same_arrivals_and_another_one_others():
    link = Link(latency_s=0.02, jitter_s=0.05, loss=0.2)
    assert arrivals(link, 3, 200) == arrivals(link, 3, 200)
    assert arrivals(link, 3, 200) != arrivals(link, 4, 200)


def test_of_several_the_one_that_arrives_last_wins_whoever_was_sent_first():
    # With this much jitter packets sent 5 ms apart overtake each other; who was read is told by the delays alone.
    link, count = Link(jitter_s=0.1), 400
    alone = arrivals(link, 5, count)
    mailbox = VirtualMailbox(link, np.random.default_rng(5))
    expected, read = {}, {}
    for seq in range(count):
        mailbox.send(START_NS + seq * 5 * MS, packet(seq))
        expected.setdefault(START_NS + seq * 5 * MS + alone[seq], []).append(seq)
    while (now_ns := mailbox.next_ns) is not None:
        got = mailbox.receive(now_ns)
        assert got is not None
        read[now_ns] = int(got["seq"][0])
    assert read.keys() == expected.keys()
    assert all(read[now_ns] in seqs for now_ns, seqs in expected.items())
    assert [seq for _, seq in sorted(read.items())] != sorted(read.values())  # Some arrive out of their order.
    assert mailbox.overtaken == sum(len(seqs) - 1 for seqs in expected.values()) > 0


def test_within_a_tick_the_exact_times_decide_and_then_the_order_of_sending():
    class Scripted(np.random.Generator):
        """Draws what it is told."""

        jitters = iter((0.9, -0.2, 0.9, 0.4))

        def standard_normal(self) -> float:
            return next(self.jitters)

        def random(self) -> float:
            return 0.5

    mailbox = VirtualMailbox(Link(jitter_s=1e-3), Scripted(np.random.PCG64(0)))
    for seq in range(4):
        mailbox.send(START_NS, packet(seq))
    assert mailbox.receive(START_NS) is None
    got = mailbox.receive(START_NS + MS)
    assert got is not None
    assert got["seq"][0] == 2
    assert mailbox.overtaken == 3
    assert mailbox.receive(START_NS + MS) is None


def test_a_packet_is_what_it_was_when_it_was_sent():
    mailbox, sent = VirtualMailbox(Link(latency_s=0.01), np.random.default_rng(0)), packet(1)
    mailbox.send(START_NS, sent)
    sent["seq"] = 2
    got = mailbox.receive(START_NS + 10 * MS)
    assert got is not None
    assert got["seq"][0] == 1


@pytest.mark.parametrize(
    "change",
    [
        {"latency_s": -0.1},
        {"latency_s": np.nan},
        {"jitter_s": -1.0},
        {"jitter_s": np.inf},
        {"loss": 1.1},
        {"loss": -0.1},
    ],
)
def test_a_link_that_makes_no_sense_is_refused(change: dict[str, float]):
    with pytest.raises(ConfigError, match=f"{next(iter(change))} is"):
        Link(**change)
