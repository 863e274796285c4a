"""A ROS 2 node that plays an exported skill with crisp_controllers.

    gplfd export skill.npz --out opening.json --frame=X,Y,Z,QW,QX,QY,QZ --tool ...
    python examples/ros2_node.py opening.json

NOT TRIED ON HARDWARE: it was only tested with a mock of rclpy. Read
docs/robot.md and its checklist first.

The node publishes set-points on target_pose and six stiffnesses on target_stiffness. It
begins when current_pose is at the first set-point, and plays one sample per tick until
the demonstrations end. It stops permanently if the hand leaves the path or its pose is
no longer received. The controller then holds the last set-point with the last
stiffness.
"""

import argparse
import json
import math
import operator
from pathlib import Path

import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from std_msgs.msg import Float64MultiArray

START = 0.01, 0.05
"""Largest distance and angle between hand and first set-point at the start [m, rad]."""
LARGEST_ERROR, LONGEST_SILENCE = 0.10, 0.05
"""Distance of hand and path [m], and age of the pose [s], at which the node stops."""


class Player(Node):
    """Publishes one sample per tick."""

    def __init__(self, table, whole):
        super().__init__("gplfd_player")
        self.frame, samples = table["frame"]["name"], table["samples"]
        until = math.inf if whole else table["demonstrated_until_s"]
        columns = "position", "quaternion_xyzw", "path_position", "stiffness"
        rows = zip(samples["time"], *(samples[name] for name in columns), strict=True)
        self.rows = [row for time, *row in rows if time <= until]
        self.next, self.hand, self.silent = 0, None, 0.0
        self.period = 1.0 / table["rate_hz"]
        self.pose = self.create_publisher(PoseStamped, "target_pose", 1)
        self.stiffness = self.create_publisher(Float64MultiArray, "target_stiffness", 1)
        self.create_subscription(PoseStamped, "current_pose", self.observe, 1)
        self.create_timer(self.period, self.tick)

    def observe(self, message):
        p, q = message.pose.position, message.pose.orientation
        self.hand, self.silent = ((p.x, p.y, p.z), (q.x, q.y, q.z, q.w)), 0.0

    def tick(self):
        if self.hand is None:
            return
        position, quaternion, path, stiffness = self.rows[self.next]
        place, orientation = self.hand
        away, log = math.dist(place, path), self.get_logger()
        if self.next == 0:
            cosine = abs(sum(map(operator.mul, orientation, quaternion)))
            angle = 2.0 * math.acos(min(cosine, 1.0))
            if away > START[0] or angle > START[1]:
                log.warn(f"waiting: the hand is {away:.3f} m, {angle:.3f} rad away")
                return
        elif away > LARGEST_ERROR or self.silent > LONGEST_SILENCE:
            seen = f"{away:.3f} m away {self.silent:.3f} s ago"
            log.error(f"stopped: the hand was {seen}")
            raise SystemExit(1)
        self.silent += self.period
        # One sample per tick: a late timer makes the motion slower, not less stable.
        self.stiffness.publish(Float64MultiArray(data=stiffness))
        message = PoseStamped()
        message.header.frame_id = self.frame
        message.header.stamp = self.get_clock().now().to_msg()
        p, q = message.pose.position, message.pose.orientation
        p.x, p.y, p.z = position
        q.x, q.y, q.z, q.w = quaternion
        self.pose.publish(message)
        self.next += 1
        if self.next == len(self.rows):
            self.get_logger().info("played to the end; the controller holds the hand")
            raise SystemExit(0)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="play an exported skill")
    parser.add_argument("file", help="JSON file of gplfd export --frame")
    parser.add_argument("--whole", action="store_true", help="beyond demonstrations")
    arguments = parser.parse_args()
    table = json.loads(Path(arguments.file).read_text(encoding="utf-8"))
    if table["frame"]["name"] != "base":
        parser.error(f"{arguments.file} is in the task frame; export it with --frame")
    rclpy.init()
    node = Player(table, arguments.whole)
    try:
        rclpy.spin(node)
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
