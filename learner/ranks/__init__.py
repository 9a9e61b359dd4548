"""Several learner processes that share each update: rank 0 owns bus, journal and replay, the others only compute."""
