"""What people see of a run: status, live view, metrics, evaluation rounds, learning curves."""
