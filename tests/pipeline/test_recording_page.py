"""The example in docs/recording.md runs, with all that is read there, and prints what the page says."""

import os
import re
import subprocess
import sys
from pathlib import Path

import wrenchflow

PAGE = Path(__file__).parents[2] / "docs" / "recording.md"
SOURCES = Path(wrenchflow.__file__).parents[1]


def test_the_example_prints_what_the_page_says(tmp_path):
    page = PAGE.read_text()
    blocks = r"```python\n(.*?)```"
    program = re.findall(blocks, page, re.DOTALL)[0]
    reading = "".join(re.findall(blocks, page.partition("## Reading")[2], re.DOTALL))
    (printed,) = re.findall(r"It prints\n\n((?:    .*\n)+)", page)
    within = "\n".join("    " + line if line else "" for line in reading.splitlines())
    program = program.replace("\n\nif __name__", f"\n{within}\n\n\nif __name__")
    (tmp_path / "record.py").write_text(program)
    path = os.pathsep.join(filter(None, [str(SOURCES), os.environ.get("PYTHONPATH", "")]))
    ran = subprocess.run(
        [sys.executable, "-W", "error", "record.py"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONPATH": path},
    )
    assert (ran.returncode, ran.stderr) == (0, "")
    assert ran.stdout.splitlines() == [line.strip() for line in printed.splitlines()]
