"""Transforms between frames over time, and the order of the stamps of messages: what mapping and safety both follow."""
