"""Robot model: its file, checks, and built-in robots."""

from bowstring.robot.model import Robot
from bowstring.robot.reader import load_robot, robot_names, robot_schema

__all__ = ["Robot", "load_robot", "robot_names", "robot_schema"]
