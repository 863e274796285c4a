"""Write bags with poses and forces, as from a robot with a wrist sensor.

    pip install '.[ros]'
    python examples/bag_with_forces.py

Opens six doors and writes bags/door_0 to bags/door_5 (ROS 2, MCAP). The topic /ee_pose
has poses of the hand in the frame of the robot's base, z up. The topic /wrist_ft is a
WrenchStamped of the environment on the hand, in the axes of the hand.
docs/your-data.md shows the next steps: import the bags, learn from them, and open a
door.
"""

import itertools
from pathlib import Path

import gymnasium as gym
import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from gplfd_env import ENVIRONMENT_ID
from gplfd_experiments.episodes.rollout import rollout
from gplfd_policies import make_agent

DOORS = {0.35: 0.0, 0.40: 3.0, 0.47: 6.0, 0.53: 2.0, 0.60: 8.0, 0.65: 5.0}
"""Doors by radius [m], with the moments of their closers [N m]."""
BASE = Rotation.from_matrix([[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
"""Axes of the task frame (x towards the robot, y up) in the base (x ahead, z up)."""
HANDLE = np.array([0.8, 0.0, 1.0])
STORE = get_typestore(Stores.ROS2_HUMBLE)


def message(kind, *parts):
    return STORE.types[f"{kind.replace('/', '/msg/')}"](*parts)


def opened(door):
    """Yield time, pose and wrench after every control period of an opening."""
    env, agent = gym.make(ENVIRONMENT_ID, door=door), make_agent("oracle", ())
    log = rollout(env, agent, policy="oracle", door="door", seed=0)
    env.close()
    rows = zip(log.times, log.motion.ee_pose, log.forces.wrench, strict=True)
    for time, pose, wrench in itertools.islice(rows, 1, None):
        turn = Rotation.from_rotvec(pose[3:])
        force, moment = turn.inv().apply(wrench.reshape(2, 3))
        position, quaternion = HANDLE + BASE.apply(pose[:3]), (BASE * turn).as_quat()
        yield time, position, quaternion, force, moment


def write_bag(folder, rows):
    kinds = {"/ee_pose": "PoseStamped", "/wrist_ft": "WrenchStamped"}
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        topics = {
            name: bag.add_connection(name, f"geometry_msgs/msg/{kind}", typestore=STORE)
            for name, kind in kinds.items()
        }
        for seconds, position, quaternion, force, moment in rows:
            stamp = round(1e9 * (1000.0 + seconds))
            time = message("builtin_interfaces/Time", stamp // 10**9, stamp % 10**9)
            header = message("std_msgs/Header", time, "base")
            point = message("geometry_msgs/Point", *position)
            turn = message("geometry_msgs/Quaternion", *quaternion)
            vectors = (message("geometry_msgs/Vector3", *v) for v in (force, moment))
            contents = {
                "/ee_pose": message("geometry_msgs/Pose", point, turn),
                "/wrist_ft": message("geometry_msgs/Wrench", *vectors),
            }
            for name, content in contents.items():
                stamped = message(f"geometry_msgs/{kinds[name]}", header, content)
                data = STORE.serialize_cdr(stamped, topics[name].msgtype)
                bag.write(topics[name], stamp, data)


folder = Path("bags")
folder.mkdir()
for number, (radius, moment) in enumerate(DOORS.items()):
    door = {"radius": radius, "closer": {"preload": moment}}
    write_bag(folder / f"door_{number}", opened(door))
print(f"{len(DOORS)} bags in {folder}")
