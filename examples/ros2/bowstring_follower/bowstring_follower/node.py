"""ROS 2 node: topics and parameters around `TipFollower`."""

from __future__ import annotations

import rclpy
from geometry_msgs.msg import PointStamped
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from bowstring.errors import NoSolutionError
from bowstring_follower.follower import TipFollower


class FollowerNode(Node):
    """Subscribes to targets of the tip, publishes commands and the predicted tip."""

    def __init__(self) -> None:
        super().__init__("bowstring_follower")
        value = {
            name: self.declare_parameter(name, default).value
            for name, default in (
                ("robot_file", "rao2021"),
                ("base_frame", "base"),
                ("rate", 50.0),
                ("max_tension", 0.0),  # 0: the default of the robot
                ("max_speed", 0.05),
                ("max_tension_rate", 20.0),
            )
        }
        self.frame = value["base_frame"]
        self.follower = TipFollower(
            value["robot_file"],
            value["rate"],
            value["max_tension"] or None,
            value["max_speed"],
            value["max_tension_rate"],
        )
        self.tendons = self.create_publisher(JointState, "tendons", 10)
        self.displacements = self.create_publisher(Float64MultiArray, "tendon_displacements", 10)
        self.tip = self.create_publisher(PointStamped, "predicted_tip", 10)
        self.create_subscription(PointStamped, "tip_target", self.on_target, 1)
        self.create_timer(1.0 / value["rate"], self.on_cycle)

    def on_target(self, message: PointStamped) -> None:
        """Take a target in the base frame."""
        frame = message.header.frame_id
        if frame not in ("", self.frame):
            self.get_logger().error(f"target in frame {frame!r}, expected {self.frame!r}; ignored")
            return
        point = message.point
        try:
            said = self.follower.set_target([point.x, point.y, point.z])
        except (ValueError, NoSolutionError) as error:
            self.get_logger().error(f"target ignored: {error}")
            return
        if said:
            self.get_logger().warning(said)

    def on_cycle(self) -> None:
        """Publish the next command."""
        try:
            command = self.follower.step()
        except NoSolutionError as error:
            self.get_logger().error(f"the last command stays: {error}")
            command = self.follower.command
        now = self.get_clock().now().to_msg()
        tendons = JointState()
        tendons.header.stamp = now
        tendons.name = self.follower.names
        tendons.position = command.tendon_lengths.tolist()
        tendons.effort = command.tensions.tolist()
        self.tendons.publish(tendons)
        self.displacements.publish(Float64MultiArray(data=command.displacements.tolist()))
        tip = PointStamped()
        tip.header.stamp, tip.header.frame_id = now, self.frame
        tip.point.x, tip.point.y, tip.point.z = command.tip_position.tolist()
        self.tip.publish(tip)


def main() -> None:
    """Run the node until it is interrupted."""
    rclpy.init()
    node = FollowerNode()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
