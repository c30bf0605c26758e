import os
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np

from wrenchflow.compiled import kernel, sources_hash
from wrenchflow.filtering import lowpass, window_mean


def test_a_changed_kernel_file_names_another_cache_and_a_changed_other_file_does_not(tmp_path: Path):
    law, other = tmp_path / "law.py", tmp_path / "other.py"
    law.write_text("from wrenchflow.compiled import kernel\nGAIN = 1.0\n")
    other.write_text("x = 1\n")
    before = sources_hash(tmp_path)
    other.write_text("x = 2\n")
    assert sources_hash(tmp_path) == before
    law.write_text("from wrenchflow.compiled import kernel\nGAIN = 2.0\n")
    assert sources_hash(tmp_path) != before


def test_a_kernel_is_cold_until_it_was_compiled_and_again_when_its_file_was_changed(tmp_path: Path):
    law = tmp_path / "law.py"
    law.write_text("from wrenchflow.compiled import kernel\n@kernel\ndef f(x):\n    return x + 1\n")
    program = (
        "import sys, law; from wrenchflow.compiled import is_cold;print(is_cold(law.f)); law.f(*map(int, sys.argv[1:]))"
    )
    own = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}

    def said(program: str, *arguments: str, **more: str) -> str:
        command = [sys.executable, "-c", program, *arguments]
        return subprocess.run(
            command, env={**own, **more}, cwd=tmp_path, check=True, capture_output=True, text=True
        ).stdout.strip()

    # Another kernel fills the folder, which says nothing of this one.
    said("from wrenchflow.so3 import log_into; import numpy as np; log_into(np.eye(3), np.zeros(4))")
    assert said(program, "1") == "True"
    assert said(program, "1") == "False"
    law.write_text(law.read_text().replace("+ 1", "+ 2"))
    assert said(program, "1") == "True"
    assert said(program, "1") == "False"
    assert said(program, "1", NUMBA_DISABLE_JIT="1") == "False"  # Then nothing is compiled at all.


def test_a_division_by_zero_gives_inf_and_other_packages_keep_their_cache():
    before = numba.config.CACHE_DIR

    @kernel
    def ratio(a, b):
        return a / b

    assert ratio(1.0, 0.0) == float("inf")
    assert before == numba.config.CACHE_DIR


def test_kernels_are_plain_python_without_the_compiler_and_give_the_same_bits(tmp_path: Path):
    program = (
        "import numpy as np, wrenchflow.filtering as f;"
        "x = np.random.default_rng(0).normal(size=(50, 6)); t = np.arange(50) * 1_000_000;"
        "y = f.lowpass(x, 40.0, 1000.0);"
        "np.save('bits.npy', [y[::7], f.window_mean(t, y, t[::7], 9_000_000)])"
    )
    plain = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    subprocess.run([sys.executable, "-c", program], env=plain, cwd=tmp_path, check=True)
    x, t = np.random.default_rng(0).normal(size=(50, 6)), np.arange(50) * 1_000_000
    y = lowpass(x, 40.0, 1000.0)
    expected = np.array([y[::7], window_mean(t, y, t[::7], 9_000_000)])
    assert np.load(tmp_path / "bits.npy").tobytes() == expected.tobytes()
