"""Evaluation: run planners on worlds, recount what they did, compare them and show the results."""
