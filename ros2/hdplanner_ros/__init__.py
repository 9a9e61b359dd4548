"""The nodes of HDPlanner as ROS 2 finds them."""
