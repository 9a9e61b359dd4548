"""Recordings: what went over a robot's topics, as bags that ROS 2 and Foxglove open, and their replay."""
