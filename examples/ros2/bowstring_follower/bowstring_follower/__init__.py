"""Follow targets of the tip by physics: the logic, and a thin ROS 2 node around it."""
