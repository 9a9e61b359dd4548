"""The robot side: a bridge that drives a robot by a trained policy or a classical planner, and a simulated robot."""
