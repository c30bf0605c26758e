"""What `process` may say of a recording is explained to who reads it."""

from pathlib import Path

from wrenchflow.process.anomalies.mask import CODES
from wrenchflow.process.assess import NO_CONTACT, REFUSED, UNREADABLE
from wrenchflow.process.loaded import ALWAYS_LOADED
from wrenchflow.process.metric import NAMES

DOCS = Path(__file__).parents[2] / "docs"
KINDS = {*CODES, NO_CONTACT, REFUSED, UNREADABLE, ALWAYS_LOADED}


def test_every_kind_of_finding_is_in_the_pages_about_force():
    table = (DOCS / "force.md").read_text()
    assert {kind for kind in KINDS if f"`{kind}`" not in table} == set()
    both = table + (DOCS / "troubleshooting.md").read_text()
    symptoms = ("noise", "spikes", "missing", "differ between operators", "too large", "simulation", "unstable")
    assert {symptom for symptom in symptoms if symptom not in both.lower()} == set()


def test_figures_that_troubleshooting_names_are_there():
    text = (DOCS / "troubleshooting.md").read_text()
    named = {"max_force", "snr_force_db", "noise", "free_residual", "max_force_raw", "force_rate_rms", "energy_gap"}
    assert {name for name in named if f"`{name}`" not in text} == set()
    assert named | {"work_wrench_j", "contacts"} <= set(NAMES)
