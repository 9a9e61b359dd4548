"""How often a costly property is tried: less in a quick run, as often as its test says in `make test-all`."""

from hypothesis import settings

THOROUGH = "thorough"


def examples(most: int) -> int:
    """Return the number of examples: `most` where pytest runs with `--hypothesis-profile=thorough`, else a third."""
    return most if settings.get_current_profile_name() == THOROUGH else max(5, most // 3)
