"""The Panda's forward kinematics against the simulator's model of it."""

import mujoco
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from wrenchflow.kinematics import flange_pose, panda_tcp
from wrenchflow.rig import load_rig
from wrenchflow.sim.panda import make_arm
from wrenchflow.spatial import rotation_of

RIG = load_rig("panda_peg")
MODEL = make_arm(RIG).compile()


@given(q=st.lists(st.floats(-3.0, 3.0), min_size=7, max_size=7))
def test_flange_and_tool_are_where_the_simulator_has_them(q):
    data = mujoco.MjData(MODEL)
    data.qpos[:] = q
    mujoco.mj_kinematics(MODEL, data)
    tcp_pose = panda_tcp(np.array(RIG.T_flange_tcp))
    for name, pose in (("flange", flange_pose(np.array(q))), ("tcp", tcp_pose(np.array(q)))):
        np.testing.assert_allclose(pose[:3], data.site(name).xpos, atol=1e-9)
        np.testing.assert_allclose(rotation_of(pose[3:]), data.site(name).xmat.reshape(3, 3), atol=1e-9)
