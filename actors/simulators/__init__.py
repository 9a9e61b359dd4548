"""Simulated worlds: `grid`, and `pybullet` in kinematic and dynamic fidelity."""
