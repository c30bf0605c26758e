"""The example in docs/collecting.md reads what `collect` wrote."""

import re
from pathlib import Path

PAGE = Path(__file__).parents[2] / "docs" / "collecting.md"


def test_the_example_reads_a_demonstration(chain, monkeypatch, capsys):
    (example,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    monkeypatch.chdir(chain.folder)
    found: dict = {}
    exec(compile(example, PAGE.name, "exec"), found)
    first = min((chain.folder / "raw").glob("*.mcap")).stem
    printed = capsys.readouterr().out
    assert printed.startswith(f"{first} scripted {{'success': True,")
    assert "in base axes, at most" in printed
    assert 0 < len(found["while_searching"]) < len(found["target"])
