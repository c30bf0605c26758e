"""Laws of curation: conditions mean what Python means by them, and splits neither lose, repeat nor leak anything."""

import random
from collections import Counter

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wrenchflow.datasets.curation.choose import split
from wrenchflow.datasets.curation.expression import parse
from wrenchflow.datasets.curation.selection import Entry, Selection
from wrenchflow.datasets.curation.split_config import SplitConfig
from wrenchflow.errors import ConfigError, DatasetError

KNOWN = {"a": 1.0, "b": 2, "task": "peg", "ok": True, "kinds": ["spike"], "max_force": 3.0}

numbers = st.sampled_from(["a", "b", "1.5", "2", "(a + b)", "(a * 2)", "-b", "(a - 0.5)"])
comparisons = st.one_of(
    st.tuples(numbers, st.sampled_from(["<", "<=", ">", ">=", "==", "!="]), numbers).map(" ".join),
    st.tuples(st.just("task"), st.sampled_from(["==", "!="]), st.sampled_from(["'peg'", "'wipe'"])).map(" ".join),
    st.sampled_from(["task in ['peg', 'x']", "task not in ('wipe',)", "ok", "1 < a < b", "has('spike')"]),
)
conditions = st.recursive(
    comparisons,
    lambda inner: st.one_of(
        inner.map(lambda one: f"not ({one})"),
        st.tuples(inner, st.sampled_from(["and", "or"]), inner).map(lambda parts: "({}) {} ({})".format(*parts)),
    ),
    max_leaves=6,
)
rows = st.fixed_dictionaries(
    {
        "a": st.sampled_from([0.5, 1.5, 2.0, 3.0]),
        "b": st.sampled_from([1, 2, 3]),
        "task": st.sampled_from(["peg", "wipe"]),
        "ok": st.booleans(),
        "kinds": st.sampled_from([[], ["spike"]]),
    }
)


@given(conditions, rows)
def test_a_condition_is_what_python_says(text, row):
    expected = eval(text, {"__builtins__": {}}, {**row, "has": lambda kind: kind in row["kinds"]})
    assert parse(text, KNOWN).matches(row) is bool(expected)


@given(conditions, rows, st.sets(st.sampled_from(["a", "b", "task", "ok", "kinds"]), min_size=1))
def test_what_is_unknown_decides_nothing_that_any_value_would_not(text, row, missing):
    """If a condition is decided with values missing, it is decided alike whatever they are."""
    found = parse(text, KNOWN).matches({name: None if name in missing else value for name, value in row.items()})
    if found is not None:
        assert found is parse(text, KNOWN).matches(row)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("max_forc > 1", "Did you mean 'max_force'"),
        ("task > 3", "a text with a number"),
        ("task + 1 > 3", "reckons with a text"),
        ("a.b > 1", "'a.b' is not allowed"),
        ("__import__('os').system('x')", "is not allowed"),
        ("open('x')", "is not allowed"),
        ("[x for x in a]", "is not allowed"),
        ("a > 1; b", "is no expression"),
        ("a >", "is no expression"),
        ("", "is no expression"),
        ("a is 1", "compares by something else"),
        ("task in 'peg'", "'in' takes a list"),
        ("a ** 2 > 1", "is not allowed"),
        ("x" * 5000, "5000 characters"),
        ("(" * 900 + "a" + ")" * 900, "expression"),
        ("not " * 900 + "a", "nested too deep"),
    ],
)
def test_what_is_no_condition_is_refused_with_the_reason(text, expected):
    with pytest.raises(ConfigError) as refused:
        parse(text, KNOWN)
    assert expected in str(refused.value)


def test_division_by_zero_and_missing_columns_are_unknown():
    assert parse("a / b > 1", KNOWN).matches({"a": 1.0, "b": 0}) is None
    assert parse("peak_force_n > 1", KNOWN).matches({}) is None
    assert parse("peak_force_n > 1", KNOWN).matches({"max_force": 2.0}) is True


entries = st.builds(
    lambda raw, task, success, operator: (raw, task, success, operator),
    st.integers(0, 60),
    st.sampled_from(["peg", "wipe"]),
    st.booleans(),
    st.sampled_from(["ann", "bob", "eve", "dan"]),
)


def selection_of(made) -> Selection:
    return Selection(
        entries=tuple(
            Entry(
                folder="clean",
                file=f"{i}.mcap",
                sha256=f"{i:064x}",
                id=f"{i}",
                task=task,
                operator=operator,
                success=success,
                raw_sha256=f"raw{raw}",
            )
            for i, (raw, task, success, operator) in enumerate(made)
        )
    )


@settings(max_examples=60)
@given(st.lists(entries, min_size=3, max_size=80), st.sampled_from(["demonstration", "operator"]), st.integers(0, 3))
def test_a_split_neither_loses_nor_leaks(made, by, seed):
    selection = selection_of(made)
    config = SplitConfig(by=by, seed=seed)
    keys = {entry.operator if by == "operator" else entry.demonstration for entry in selection.entries}
    if len(keys) < 3:
        with pytest.raises(DatasetError, match="groups by"):
            split(selection, config)
        return
    found = split(selection, config)
    assert [entry.id for entry in found.entries] == [entry.id for entry in selection.entries]
    sides: dict[str, set[str]] = {}
    for entry in found.entries:
        sides.setdefault(entry.operator if by == "operator" else entry.demonstration, set()).add(entry.split)
    assert all(len(each) == 1 for each in sides.values())
    given = Counter(next(iter(each)) for each in sides.values())
    for name in ("train", "valid", "test"):
        assert abs(given[name] - getattr(config, name) * len(sides)) <= 1.0
    shuffled = list(selection.entries)
    random.Random(seed).shuffle(shuffled)
    again = split(Selection(entries=tuple(shuffled)), config)
    if len({entry.demonstration: (entry.task, entry.success) for entry in selection.entries}) == len(made):
        assert {e.id: e.split for e in again.entries} == {e.id: e.split for e in found.entries}


def test_each_stratum_gives_each_side_its_share():
    made = [(i, "peg" if i % 3 else "wipe", bool(i % 2), "ann") for i in range(600)]
    found = split(selection_of(made), SplitConfig())
    for task in ("peg", "wipe"):
        for success in (True, False):
            sides = Counter(e.split for e in found.entries if (e.task, e.success) == (task, success))
            total = sum(sides.values())
            assert abs(sides["train"] - 0.8 * total) <= 2
            assert abs(sides["valid"] - 0.1 * total) <= 2
