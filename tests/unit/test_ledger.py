"""The account of the safety layer: stretches of modes, interventions by name, energies, and nothing lost or made up."""

import itertools
import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wrenchflow.control.safeguards import MODES, NO_CAUSE, SAFEGUARDS
from wrenchflow.episode import Episode, Event, Stream
from wrenchflow.ledger import Ledger
from wrenchflow.signals import GOVERNOR

NAMES = tuple(SAFEGUARDS)
T0, TICK = 1_577_836_800_000_000_000, 1_000_000


def ledger(modes, causes=None, acting=None, **columns) -> Ledger:
    """A ledger of a tick for each entry of `modes`, with causes and acting safeguards by name."""
    n = len(modes)
    data = np.zeros((n, GOVERNOR.width))
    number = {"": NO_CAUSE} | {name: k for k, name in enumerate(NAMES)}
    data[:, 0] = [MODES.index(mode) for mode in modes]
    data[:, 1] = [number[cause] for cause in (causes or [""] * n)]
    for k, names in enumerate(acting or ()):
        data[k, 2] = sum(1 << number[name] for name in names)
    for name, values in columns.items():
        data[:, GOVERNOR.columns.index(name)] = values
    t = T0 + np.arange(n, dtype=np.int64) * TICK
    return Ledger(governor=Stream(t, data, GOVERNOR, "base"), modes=MODES, safeguards=NAMES)


def at(tick: int) -> int:
    return T0 + tick * TICK


def test_modes_become_events_with_their_cause_and_what_is_ordinary_does_not():
    of = ledger(
        ["hold"] * 3 + ["run"] * 4 + ["hold"] * 2 + ["run"] * 2 + ["retreat"] * 2 + ["hold"] * 2 + ["latched"],
        [""] * 7 + ["silence"] * 4 + ["force"] * 4 + ["emergency-stop"],
    )
    assert of.events == (
        Event(at(7), at(9), "safety", "hold: silence"),
        Event(at(11), at(13), "safety", "retreat: force"),
        Event(at(13), at(15), "safety", "hold: force"),
        Event(at(15), at(15), "safety", "latched: emergency-stop"),
    )
    said = of.summary()
    assert said["ticks"] == {"waiting": 3, "run": 6, "hold": 4, "retreat": 2, "latched": 1}
    assert said["entered"] == {"hold: silence": 1, "retreat: force": 1, "hold: force": 1, "latched: emergency-stop": 1}


def test_a_mode_that_gets_another_cause_is_another_event():
    of = ledger(["hold"] * 4, ["plan-end", "plan-end", "silence", "silence"])
    assert [event.label for event in of.events] == ["hold: plan-end", "hold: silence"]


def test_refusals_are_events_and_what_is_near_is_one_of_them():
    acting = [("gate-request",) if k in (5, 6, 40, 300) else () for k in range(400)]
    of = ledger(["run"] * 400, acting=acting)
    assert of.events == (
        Event(at(5), at(41), "safety", "refused"),
        Event(at(300), at(301), "safety", "refused"),
    )
    named = replace(of, refusals=((at(5), "past"), (at(6), "replayed"), (at(40), "past")))
    assert [event.label for event in named.events] == ["refused: past, replayed", "refused: segment"]
    assert of.summary()["interventions"] == {"gate-request": 4}


def test_safeguards_that_act_all_the_time_are_counted_and_no_events():
    acting = [("leash",) if k % 2 else ("emergency-stop", "leash-rotation") for k in range(10)] + [()] * 10
    of = ledger(["hold"] * 5 + ["run"] * 15, acting=acting)
    assert of.events == ()
    said = of.summary()
    assert said["interventions"] == {"leash": 5, "leash-rotation": 5, "emergency-stop": 5}
    assert said["leash_share"] == pytest.approx(10 / 15)  # The first five ticks waited.


def test_interventions_are_told_by_safeguard_with_their_ticks():
    acting = [("torque",) if 10 <= k < 20 or k in (25, 200) else () for k in range(300)]
    of = ledger(["run"] * 300, acting=acting)
    assert list(of.interventions()) == ["torque"]
    first, second = of.interventions()["torque"]
    assert (first.start_ns, first.stop_ns, first.ticks) == (at(10), at(26), 11)
    assert (second.start_ns, second.stop_ns, second.ticks) == (at(200), at(201), 1)


def test_energies_are_those_at_the_end_and_extremes_are_found():
    of = ledger(["run"] * 4, tank=[2.0, 0.4, 1.0, 1.5], damped=[0, 1, 2, 3], force=[0, 30, np.nan, 5], impact=np.nan)
    said = of.summary()
    assert (said["energy_j"]["tank"], said["work_j"]["damped"], said["tank_min_j"]) == (1.5, 3.0, 0.4)
    assert (said["peak_force_n"], said["peak_impact_n"]) == (30.0, 0.0)
    json.loads(json.dumps(said, allow_nan=False))


def test_an_episode_without_names_or_rows_has_no_ledger():
    of = ledger(["run"] * 3)
    streams = {"governor": of.governor}
    assert Ledger.of(Episode("1", "t", streams)) is None
    assert Ledger.of(Episode("1", "t", {}, (), {"governor": of.names})) is None
    again = Ledger.of(Episode("1", "t", streams, (), {"governor": json.loads(json.dumps(of.names))}))
    assert again is not None
    assert again.summary() == of.summary()


@given(
    st.lists(
        st.tuples(st.sampled_from(MODES), st.sampled_from(["", *NAMES]), st.sets(st.sampled_from(NAMES))), min_size=1
    )
)
def test_every_tick_has_one_mode_and_every_intervention_is_counted_once(ticks):
    of = ledger([mode for mode, _, _ in ticks], [cause for _, cause, _ in ticks], [acting for _, _, acting in ticks])
    said = of.summary()
    assert sum(said["ticks"].values()) == len(ticks)
    assert sum(said["interventions"].values()) == sum(len(acting) for _, _, acting in ticks)
    for name, count in said["interventions"].items():
        assert sum(stretch.ticks for stretch in of.interventions()[name]) == count
    stretches = of.mode_stretches
    assert all(a.stop_ns == b.start_ns and a.label != b.label for a, b in itertools.pairwise(stretches))
    assert (stretches[0].start_ns, stretches[-1].stop_ns) == (at(0), at(len(ticks) - 1))
    assert sum(said["entered"].values()) == sum(stretch.label not in ("run", "waiting") for stretch in stretches)
