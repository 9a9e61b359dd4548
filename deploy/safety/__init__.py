"""What keeps the robot safe when anything fails.

Nothing is imported here: the watchdog's process takes only the modules that it needs, to be at work soon.
"""
