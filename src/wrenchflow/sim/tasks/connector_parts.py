"""What a connector is made of: a shell of capsules with two latch noses, and a chamfered socket with two springs."""

import math
from dataclasses import dataclass

import mujoco
import numpy as np

from wrenchflow.sim.panda import ARM_CONTYPE, WORLD_CONTYPE
from wrenchflow.spatial import quat_of

# Latch noses meet springs and nothing else, as if they ran in grooves: bits of their own, beside the arm's and world's.
_NOSE_CONTYPE, _SPRING_CONTYPE = 4, 8
_SUNK_M = 0.005  # Rubber reaches into the walls, for what sinks in is pushed out by the nearest face.
_COLLAR_M = 0.035  # Half width of the flat around the mouth.
_RUBBER_M = 0.0015  # What can be pressed of it; the steel below holds.
_SPRING_DEPTH_M = 0.0015  # Of the springs below the mouth.
_STEEL, _FIXTURE, _MOUTH = (0.66, 0.68, 0.72, 1.0), (0.32, 0.46, 0.62, 1.0), (0.95, 0.7, 0.25, 1.0)
_DARK, _BRASS, _RUBBER = (0.16, 0.17, 0.2, 1.0), (0.85, 0.65, 0.2, 1.0), (0.1, 0.1, 0.1, 1.0)


@dataclass(frozen=True, kw_only=True)
class ConnectorShape:
    """Measures of plug and socket, and how soft they are.

    The plug's tip is a hollow shell, as of a USB plug: it touches with its rim, which is a ring of capsules.

    Attributes:
        half_length_m: Of the plug, along its x.
        half_width_m: Along its y.
        shell_m: How far the shell stands out of the plug's body.
        rim_radius_m: Of the capsules.
        clearance_m: Between plug and socket, a side.
        chamfer_m: Width and depth of the mouth's chamfers, 45 degrees.
        crest_m: Depth of the tip at which the noses are level with the springs.
        stop_m: Depth at which the tip meets the rubber.
        nose_radius_m: Of the noses and of the springs.
        interference_m: By which nose and spring overlap at the crest.
        latch_solref: Contact of noses and springs: -stiffness, -damping, mass-normalised [1/s^2, 1/s].
        latch_give: Largest impedance d of that contact. MuJoCo answers as if the spring bore d / (1 - d) times the mass
            that meets it: at 0.1 force follows from overlap, at 0.9 who coasts feels half of what a slow push does.
        stop_solref: Contact of the tip and the rubber.
        stop_give: Largest impedance of that contact; less is softer.
        friction: Of steel on steel; the noses roll off the springs without any.
    """

    half_length_m: float = 0.007
    half_width_m: float = 0.003
    shell_m: float = 0.012
    rim_radius_m: float = 0.0003
    clearance_m: float = 0.00025
    chamfer_m: float = 0.0005
    crest_m: float = 0.0060
    stop_m: float = 0.0061
    nose_radius_m: float = 0.0015
    interference_m: float = 0.0004
    latch_solref: tuple[float, float] = (-24000.0, -30.0)
    latch_give: float = 0.1
    stop_solref: tuple[float, float] = (0.1, 0.7)
    stop_give: float = 0.6
    friction: float = 0.2

    @property
    def capture_m(self) -> float:
        """How far off the middle, along x or y, the rim still meets a chamfer."""
        return self.clearance_m + self.chamfer_m + self.rim_radius_m

    @property
    def _steel(self) -> dict:
        # Stiff, for at MuJoCo's defaults a 20 N push sinks in by more than the clearance; but with a force that grows
        # from nothing over the first 0.1 mm, or a plug that slides has no contact at all in half of the ticks.
        return _contact(self.friction, (0.004, 1.0), 0.95, 0.0001)

    @property
    def _latch(self) -> dict:
        # Stiffness in place of a time constant: soft, with little of its own damping, so that the snap is a spring's.
        # It has no friction, which comes in with the slip, in full at 7 mm/s, so that who is slow would feel less.
        return {**_contact(0.0, self.latch_solref, self.latch_give, 0.0003), "condim": 1, "priority": 1}

    @property
    def _rubber(self) -> dict:
        return {**_contact(self.friction, self.stop_solref, self.stop_give, 0.0003), "priority": 1}

    def add_plug(self, plug: mujoco.MjsBody) -> None:
        """Add housing, shell and noses to a body whose origin is the middle of the tip, z outwards."""
        looks = {"contype": 0, "conaffinity": 0, "mass": 0.0, "type": mujoco.mjtGeom.mjGEOM_BOX}
        a, b, back_m = self.half_length_m, self.half_width_m, -self.shell_m
        plug.add_geom(pos=[0, 0, back_m - 0.012], size=[a + 0.0025, b + 0.0025, 0.012], rgba=_DARK, **looks)
        inner_m = self.rim_radius_m / 2.0
        plug.add_geom(
            pos=[0, 0, -self.shell_m / 2.0],
            size=[a - inner_m, b - inner_m, self.shell_m / 2.0 - inner_m],
            rgba=_STEEL,
            **looks,
        )
        for x, y in self._rim():
            plug.add_geom(
                type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                fromto=[x, y, back_m, x, y, -self.rim_radius_m],
                size=[self.rim_radius_m, 0, 0],
                rgba=_STEEL,
                contype=ARM_CONTYPE,
                conaffinity=WORLD_CONTYPE,
                mass=0.0,
                **self._steel,
            )
        for side in (-1.0, 1.0):
            plug.add_geom(
                type=mujoco.mjtGeom.mjGEOM_SPHERE,
                pos=[0, side * self._nose_m, -self.crest_m + _SPRING_DEPTH_M],
                size=[self.nose_radius_m, 0, 0],
                rgba=_BRASS,
                contype=_NOSE_CONTYPE,
                conaffinity=_SPRING_CONTYPE,
                mass=0.0,
                **self._latch,
            )

    @property
    def _nose_m(self) -> float:
        # Half of a nose stands out of the wall.
        return self.half_width_m - self.nose_radius_m / 2.0

    def _rim(self) -> list[tuple[float, float]]:
        """Centres of the rim's capsules: corners, three between them along x, one along y."""
        x, y = self.half_length_m - self.rim_radius_m, self.half_width_m - self.rim_radius_m
        along = [(share * x, side * y) for side in (-1.0, 1.0) for share in (-1.0, -0.5, 0.0, 0.5, 1.0)]
        return [*along, (-x, 0.0), (x, 0.0)]

    def add_socket(self, block: mujoco.MjsBody, base_m: float) -> None:
        """Add the socket to a body whose origin is the middle of the mouth, z up, and which stands `base_m` high."""
        hard = {"contype": WORLD_CONTYPE, "conaffinity": ARM_CONTYPE, "type": mujoco.mjtGeom.mjGEOM_BOX}
        hole = np.array([self.half_length_m, self.half_width_m]) + self.clearance_m
        mouth = hole + self.chamfer_m
        bottom_m = self.stop_m + _RUBBER_M
        for axis in (0, 1):
            for side in (-1.0, 1.0):
                _add_ring_box(
                    block, axis, side, hole, 0.006, (-self.chamfer_m, -bottom_m), _FIXTURE, hard | self._steel
                )
                _add_ring_box(block, axis, side, mouth, _COLLAR_M - 0.01, (0.0, -0.004), _MOUTH, hard | self._steel)
                self._add_chamfer(block, axis, side, hole, hard)
        block.add_geom(
            pos=[0, 0, -self.stop_m - 0.004], size=[*(hole + _SUNK_M), 0.004], rgba=_RUBBER, **hard, **self._rubber
        )
        depth_m = base_m - bottom_m
        block.add_geom(
            pos=[0, 0, -bottom_m - depth_m / 2.0],
            size=[0.04, 0.035, depth_m / 2.0],
            rgba=_FIXTURE,
            **hard,
            **self._steel,
        )
        apart_m = self._nose_m + 2.0 * self.nose_radius_m - self.interference_m
        for side in (-1.0, 1.0):
            block.add_geom(
                type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                fromto=[-0.003, side * apart_m, -_SPRING_DEPTH_M, 0.003, side * apart_m, -_SPRING_DEPTH_M],
                size=[self.nose_radius_m, 0, 0],
                rgba=_BRASS,
                contype=_SPRING_CONTYPE,
                conaffinity=_NOSE_CONTYPE,
                **self._latch,
            )

    def _add_chamfer(self, block: mujoco.MjsBody, axis: int, side: float, hole: np.ndarray, hard: dict) -> None:
        # The upper face of a box tilted by 45 degrees, from the wall's top edge to the mouth's. It is as long as the
        # mouth, so that neighbours meet in a mitre.
        out, along = np.eye(3)[axis] * side, np.eye(3)[1 - axis]
        up = np.array([0.0, 0.0, 1.0])
        slope, normal = (out + up) / math.sqrt(2.0), (up - out) / math.sqrt(2.0)
        thick_m, half_m = 0.001, self.chamfer_m / math.sqrt(2.0)
        middle = (hole[axis] + self.chamfer_m / 2.0) * out - self.chamfer_m / 2.0 * up
        rotation = np.stack([slope, np.cross(normal, slope), normal], axis=-1)
        block.add_geom(
            pos=list(middle - thick_m * normal),
            quat=list(quat_of(rotation)),
            size=[half_m, float(np.abs(along[:2]) @ hole) + self.chamfer_m, thick_m],
            rgba=_MOUTH,
            **hard,
            **self._steel,
        )


def _contact(friction: float, solref: tuple[float, float], most: float, width_m: float) -> dict:
    return {
        "friction": [friction, 0.0, 0.0],
        "solref": list(solref),
        "solimp": [0.0, most, width_m, 0.5, 2.0],
        "condim": 3,
    }


def _add_ring_box(
    block: mujoco.MjsBody,
    axis: int,
    side: float,
    inner: np.ndarray,
    width_m: float,
    top_bottom_m: tuple[float, float],
    rgba: tuple,
    contact: dict,
) -> None:
    """One side of a rectangular ring around `inner` half lengths; the sides along x are the longer ones."""
    half = np.empty(2)
    half[axis], half[1 - axis] = width_m / 2.0, inner[1 - axis] + (width_m if axis == 1 else 0.0)
    centre = np.zeros(2)
    centre[axis] = side * (inner[axis] + width_m / 2.0)
    top_m, bottom_m = top_bottom_m
    block.add_geom(
        pos=[*centre, (top_m + bottom_m) / 2.0],
        size=[*half, (top_m - bottom_m) / 2.0],
        rgba=rgba,
        **contact,
    )
