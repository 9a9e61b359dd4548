"""Evaluation at a large scale: a building of 130 m x 100 m, a robot under physics, a 3D lidar, sensing on the way."""
