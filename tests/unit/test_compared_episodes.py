"""How episodes are compared: collectors by known variances, relevance by words, contact by planted touches."""

import numpy as np
import pytest

from wrenchflow.datasets.analysis.collectors import spreads
from wrenchflow.datasets.analysis.figures import EpisodeFigures
from wrenchflow.datasets.analysis.findings import find
from wrenchflow.datasets.analysis.relevance import rank, words_of
from wrenchflow.datasets.analysis.touch import touching
from wrenchflow.datasets.analysis.trajectory import Labels
from wrenchflow.datasets.analysis.twins import Twins


def episode(id: str, *, task: str = "", collector: str = "", success: bool | None = True, **values) -> EpisodeFigures:
    return EpisodeFigures(
        id=id,
        place=id,
        labels=Labels(task=task, collector=collector, success=success),
        values=values,
        missing=(),
        shape=np.zeros(0, np.float32),
        shape_of="",
    )


def test_spread_between_collectors_is_what_was_drawn():
    rng = np.random.default_rng(2)
    made = []
    for person in range(60):
        middle = 20.0 + 4.0 * rng.normal()
        for take in range(int(rng.integers(3, 30))):
            force = middle + 2.0 * rng.normal()
            made.append(episode(f"{person}-{take}", task="press", collector=f"p{person}", peak_force_n=force))
    (spread,) = spreads(made)
    assert (spread.collectors, spread.figure) == (60, "peak_force_n")
    assert spread.between == pytest.approx(4.0, rel=0.2)
    assert spread.within == pytest.approx(2.0, rel=0.05)


def test_collectors_who_do_not_differ_have_no_spread_between_them():
    rng = np.random.default_rng(3)
    made = [episode(f"{i}", task="press", collector=f"p{i % 4}", path_m=rng.normal()) for i in range(400)]
    (spread,) = spreads(made)
    assert spread.ratio < 0.2
    assert not spreads(made[:8])  # Two episodes of each say nothing of a spread.


def test_relevance_follows_telling_words_and_leaves_out_what_is_wrong():
    tasks = ("insert the plug into the socket", "wipe the table", "plugs are inserted", "open the drawer")
    made = [episode(f"{i}", task=tasks[i % 4], not_finite=int(i == 4)) for i in range(12)]
    made.append(episode("failed", task=tasks[0], success=False))
    ranked = rank("Insert a plug", made, find(made), [Twins(first=0, second=8, apart=0.0, of="joints")])
    taken = {made[one.episode].id for one in ranked if one.is_taken}
    assert taken == {"0", "2", "6", "10"}
    why = {made[one.episode].id: one.why for one in ranked}
    assert "not-finite" in why["4"]
    assert "nearly the same as 0" in why["8"]
    assert "failure" in why["failed"]
    assert "no word" in why["1"]


def test_words_of_other_languages_and_numbers_are_words():
    assert words_of("Öffne die Schublade 2!") == {"öffn", "die", "schublad", "2"}
    assert words_of("inserting") == words_of("inserts") == words_of("inserted")


@pytest.mark.parametrize("bias_n", [0.0, 7.5])
def test_contact_is_found_whatever_the_bias(bias_n):
    rng = np.random.default_rng(4)
    force = bias_n + rng.normal(0.0, 0.05, (400, 3))
    force[150:260, 2] -= 6.0
    found = touching(force, 10)
    assert found is not None
    assert (found[150:260]).all()
    assert found[:150].sum() + found[260:].sum() == 0
    assert touching(np.full((400, 3), np.nan), 10) is None
