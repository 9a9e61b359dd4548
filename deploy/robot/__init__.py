"""The simulated robot: PyBullet behind the ROS 2 topics of a real one. The one part of `deploy` that knows `actors`."""
