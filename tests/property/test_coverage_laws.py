"""Laws of coverage: the order in which demonstrations come changes nothing, and none of them makes it less."""

import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wrenchflow.collect.coverage import BINS, Box, Coverage, empty_coverage
from wrenchflow.collect.demonstration import Demonstration
from wrenchflow.sim.attempt import DEMONSTRATE, Outcome, generators
from wrenchflow.sim.tasks import NAMES, scenery

BOXES = {
    "starts_box": Box(low_m=(-0.02, -0.02, 0.03), high_m=(0.02, 0.02, 0.05)),
    "goals_box": Box(low_m=(0.4, -0.1, 0.12), high_m=(0.5, 0.1, 0.12)),
}
NOTHING = Coverage(**BOXES)
near = st.floats(-0.2, 0.6)
points = st.tuples(near, near, near)


# Plain values: a shape check draws random numbers, which no strategy may.
attempts = st.tuples(st.booleans(), st.sampled_from(["steady", "brisk", "scripted"]), points, points)


def shown_by(success, who, start_m, goal_m) -> Demonstration:
    outcome = Outcome(success=success, duration_s=1.0, progress=0.0, failure="")
    return Demonstration(id="a", samples=1, outcome=outcome, who=who, start_m=start_m, goal_m=goal_m)


some = st.lists(attempts, max_size=8)


def of(shown) -> Coverage:
    coverage = NOTHING
    for one in shown:
        coverage = coverage.with_(shown_by(*one))
    return coverage


@given(some.flatmap(lambda shown: st.tuples(st.just(shown), st.permutations(shown))))
def test_the_order_changes_nothing(both):
    shown, mixed = both
    assert of(mixed) == of(shown)


@given(some, some, some)
def test_parts_may_be_put_together_in_any_way(a, b, c):
    assert of(a) | of(b) == of(a + b) == of(b) | of(a)
    assert (of(a) | of(b)) | of(c) == of(a) | (of(b) | of(c))
    assert of(a) | NOTHING == of(a)


@given(some, attempts)
def test_one_more_is_never_less(shown, one):
    before, one = of(shown), shown_by(*one)
    after = before.with_(one)
    assert before.starts <= after.starts
    assert before.goals <= after.goals
    assert sum(after.tried.values()) == len(shown) + 1
    assert after.tried[one.who] == before.tried.get(one.who, 0) + 1
    assert after.done[one.who] - before.done.get(one.who, 0) == one.outcome.success
    assert len(after.starts) <= BOXES["starts_box"].cells == 27
    assert len(after.goals) <= BOXES["goals_box"].cells == 9
    assert before == of(shown)  # A value: what it made is another one.


@given(some)
def test_the_same_place_twice_is_covered_once(shown):
    twice = of(shown + shown)
    assert (twice.starts, twice.goals) == (of(shown).starts, of(shown).goals)
    assert twice.done == {who: 2 * count for who, count in of(shown).done.items()}


@given(some)
def test_it_travels_to_another_process(shown):
    assert pickle.loads(pickle.dumps(of(shown))) == of(shown)


@given(points)
def test_what_lies_outside_belongs_to_the_nearest_cell(point):
    box = BOXES["starts_box"]
    nearest = np.clip(point, box.low_m, box.high_m)
    assert box.cell(point) == box.cell(nearest.tolist())
    assert all(0 <= number < BINS for number in box.cell(point))


def test_cells_are_equal_parts():
    box = Box(low_m=(0.0,), high_m=(3.0,))
    assert [box.cell([x]) for x in (0.0, 0.99, 1.01, 1.99, 2.01, 3.0)] == [(0,), (0,), (1,), (1,), (2,), (2,)]


@pytest.mark.parametrize("task", NAMES)
def test_all_cells_of_a_task_can_be_reached(task):
    made, _, model = scenery(task)
    nothing, goals = empty_coverage(task), set()
    for index in range(150):
        scene = made.draw(model, generators((1, index, DEMONSTRATE))[0])
        goals.add(nothing.goals_box.cell(scene.T_base_goal_perceived[:3].tolist()))
    assert len(goals) > 0.6 * nothing.goals_box.cells
