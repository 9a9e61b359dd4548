"""docs/configuration.md is made from the schema, and must be the current one."""

from pathlib import Path

from common.config.describe import documentation

PAGE = Path(__file__).parents[3] / "docs" / "configuration.md"


def test_the_page_is_current():
    assert PAGE.read_text("utf-8") == documentation(), "run `make docs`"
