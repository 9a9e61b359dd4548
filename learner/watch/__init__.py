"""What people see of a run: status, live view, metrics, learning curves."""
