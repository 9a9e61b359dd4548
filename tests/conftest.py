"""What holds for all tests."""

from hypothesis import settings

# Kernels compile in the first example, and machines are shared: an example's time says nothing.
settings.register_profile("hdplanner", deadline=None)
settings.load_profile("hdplanner")
