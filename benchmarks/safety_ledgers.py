"""Two ledgers to look at: a demonstration as it should be, and the same scene under somebody who means harm.

Writes a page with, for both, force, position, energy by kind, modes and what intervened. Run it as
`python benchmarks/safety_ledgers.py OUT.html`.
"""

import sys
from pathlib import Path

import numpy as np

from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.session import demonstrate
from wrenchflow.control.config import Impedance
from wrenchflow.episode import Episode
from wrenchflow.ledger import Ledger
from wrenchflow.pages.episode_plot import episode_figure
from wrenchflow.pages.page import page, section
from wrenchflow.pages.plot_block import plot_block
from wrenchflow.sim.attempt import EVALUATE, Attempt
from wrenchflow.sim.tasks import scenery
from wrenchflow.spatial import exp_so3, make_pose, rotation_of

PERIOD_TICKS = 20


def harassed(config: CollectConfig, seconds: float = 6.0) -> Episode:
    """Push into the block, stiff while the spring drives the arm and soft while it brakes it, with jumps and a shove.

    Whoever asks is sure to be heard: each request is sound, and comes fifty times a second.
    """
    task, rig, model = scenery(config.task, config.rig)
    attempt = Attempt(task, model, rig, config, seed=(config.seed, 0, EVALUATE))
    rng, controller = np.random.default_rng(0), attempt.controller
    home = attempt.target_pose.copy()
    while not attempt.over and attempt.elapsed_s < seconds:
        obs, ctl = controller.obs[0], controller.ctl[0]
        twist = obs["J"] @ obs["dq"]
        drives = float(ctl["e"] @ twist) > 0.0
        along = twist[:3] / max(float(np.linalg.norm(twist[:3])), 1e-3)
        is_pressing = attempt.elapsed_s > 0.5 * seconds
        goal = attempt.scene.T_base_goal if is_pressing else home
        position_m = goal[:3] + rng.normal(size=3) * 0.03 - [0.0, 0.0, 0.3 if is_pressing else 0.0]
        wanted = make_pose(position_m, exp_so3(rng.normal(size=3) * 0.1) @ rotation_of(home[3:]))
        controller.ask(
            attempt.target_pose,
            wanted,
            ticks=1,
            impedance=Impedance(
                translation_n_m=1500.0 if drives else 50.0,
                rotation_nm_rad=60.0 if drives else 2.0,
                damping_ratio=0.5 if drives else 2.0,
            ),
            wrench=np.concatenate([20.0 * along, np.zeros(3)]),
            every_s=PERIOD_TICKS * 1e-3,
        )
        attempt.target_pose = wanted
        attempt.follow(PERIOD_TICKS)
    return attempt.episode("adversary", {}, [])


def block(title: str, episode: Episode) -> str:
    """A section with a plot and what it adds up to."""
    ledger = Ledger.of(episode)
    assert ledger is not None
    summary = ledger.summary()
    acted = ", ".join(f"{name} {ticks}" for name, ticks in summary["interventions"].items()) or "nothing"
    text = f"<p>Tank at least {summary['tank_min_j']:.2f} J; ticks with an intervention: {acted}.</p>"
    return section(title, text, plot_block(episode_figure(episode, ""), title.split()[1]))


def main() -> int:
    """Write the page."""
    config = CollectConfig()
    normal, adversarial = demonstrate(0, config, scenes=EVALUATE), harassed(config)
    sections = [block("A demonstration", normal), block("An adversary on the same scene", adversarial)]
    Path(sys.argv[1]).write_text(page("What the safety layer books", sections, ""))
    return 0


if __name__ == "__main__":
    sys.exit(main())
