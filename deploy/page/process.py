"""The process of a page of robots, as a bridge or a demonstration starts it: ``python -m deploy.page.process``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from common.page.options import PageSettings, require_packages
from common.page.process import PageProcess
from common.page.source import Site
from deploy.config import DeployConfig
from deploy.page.source import Robots

SITE: Final = Site("robots", Path(__file__).parent / "static")
"""The files of the page."""


def start_page(settings: PageSettings, config: DeployConfig) -> PageProcess:
    """Start the page of a network's robots as a process that ends with this one.

    Raises:
        PageError: it does not start.
        ConfigError: the extra `page` is not installed.
    """
    require_packages()
    return PageProcess(__name__, settings, {"config": config.model_dump_json()})


def _make(request: Mapping[str, Any]) -> tuple[Site, Robots]:
    return SITE, Robots(DeployConfig.model_validate_json(request["config"]))


if __name__ == "__main__":
    from common.page.serve import page_main

    page_main(_make)
