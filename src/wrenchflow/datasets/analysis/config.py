"""What a person may set about `analyze`; loads nothing heavy, so that the command line can show it at once."""

from dataclasses import dataclass

from wrenchflow.config import require_at_least, require_between, require_finite, require_positive


@dataclass(frozen=True, kw_only=True)
class AnalysisConfig:
    """How a data set is looked at.

    Attributes:
        task: Rank the episodes by how relevant they are to this task, in plain words.
        voxel_m: Edge of the cells in which the workspace is counted [m].
        twin_rad: Root mean square distance of joint angles below which two episodes are nearly the same [rad].
        twin_m: The same of the tool's position, where no joint angles are known [m].
        hand_mass_kg: What hangs at the flange of an arm without a force sensor [kg]; of DROID, a Robotiq 2F-85 and what
            holds it and a camera.
        hand_com_m: Its centre of mass in the flange frame [m].
        tare_s: How long an episode is taken to begin without contact [s]: what is felt then is the sensors' bias.
        torque_std_nm: Standard uncertainty of a joint's measured torque, less gravity, after the tare [N.m]. Nobody
            publishes it for Pandas of many labs: an assumption, which each episode puts to the test.
    """

    task: str = ""
    voxel_m: float = 0.02
    twin_rad: float = 0.02
    twin_m: float = 0.002
    hand_mass_kg: float = 1.0
    hand_com_m: tuple[float, ...] = (0.0, 0.0, 0.06)
    tare_s: float = 0.5
    torque_std_nm: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0, 0.4, 0.4, 0.4)

    def __post_init__(self) -> None:
        require_between(0.001, 1.0, voxel_m=self.voxel_m)
        require_positive(twin_rad=self.twin_rad, twin_m=self.twin_m, tare_s=self.tare_s)
        require_at_least(0.0, hand_mass_kg=self.hand_mass_kg)
        require_finite("hand_com_m", self.hand_com_m)
        require_finite("torque_std_nm", self.torque_std_nm, positive=True)
        require_between(7, 7, **{"number of torque_std_nm": len(self.torque_std_nm)})
        require_between(3, 3, **{"number of hand_com_m": len(self.hand_com_m)})
