"""What every program of this project needs of its process: logs, locks, threads, children, files, machine code."""
