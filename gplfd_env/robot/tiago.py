"""The TIAGo-like robot: configuration that its URDF lacks."""

from typing import Final

from gplfd_env.robot.config import BASE_RADIUS, Capsule, RobotConfig, tabulated_stances

TIAGO_LIKE: Final = RobotConfig(
    name="tiago-like",
    urdf="tiago_like.urdf",
    arm=tuple(f"arm_{i}_joint" for i in range(1, 8)),
    tool="gripper_link",
    grasp_point=(0.0, 0.0, -0.185),
    approach=(0.0, 0.0, -1.0),
    stand=False,
    armature=(0.3, 0.3, 0.15, 0.15, 0.05, 0.05, 0.05),
    root="base_footprint",
    lift="torso_lift_joint",
    sensor="wrist_ft_link",
    # Half a turn about x at all joint angles.
    sensor_rotation=((0.0, -1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, -1.0)),
    forearm="arm_4_link",
    head=("head_link", (0.10, 0.0, 0.05)),
    hand_camera=((0.0, -0.12, -0.01), (-1.0, 0.0, 0.0), (0.0, -0.83, -0.56)),
    capsules=(
        Capsule("base_body", "base_link", (0, 0, 0.17, 0, 0, 0.19), BASE_RADIUS),
        Capsule(
            "column_body", "torso_fixed_link", (-0.03, 0, 0.15, -0.03, 0, 0.5), 0.16
        ),
        Capsule(
            "chest_body", "torso_lift_link", (0.03, 0, -0.15, 0.03, 0, -0.05), 0.16
        ),
        Capsule("head_body", "head_link", (0, 0, 0, 0, 0, 0.05), 0.12),
        Capsule(
            "shoulder_body", "arm_1_link", (0, 0, -0.03, 0.125, 0.0195, -0.031), 0.06
        ),
        Capsule("upper_arm_body", "arm_3_link", (0, 0, 0, -0.01, -0.013, -0.21), 0.055),
        Capsule("elbow_body", "arm_4_link", (0, 0, 0.005, -0.162, 0.02, 0.027), 0.05),
        Capsule("forearm_body", "arm_5_link", (0, 0, 0, 0, 0, 0.15), 0.045),
        Capsule("palm_body", "gripper_link", (0, 0, 0.04, 0, 0, -0.06), 0.045),
    ),
    stances=tabulated_stances("tiago-like"),
)
