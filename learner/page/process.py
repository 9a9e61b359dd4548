"""The process of a training's page, as the learner starts it: ``python -m learner.page.process``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from common.config import BusConfig, RunConfig
from common.page.options import PageSettings
from common.page.process import PageProcess
from common.page.source import Site
from learner.local_actors import local_endpoint
from learner.page.source import Training

SITE: Final = Site("training", Path(__file__).parent / "static")
"""The files of the page."""


def start_page(settings: PageSettings, config: RunConfig, folder: Path) -> PageProcess:
    """Start the page of a run as a process that ends with this one.

    Args:
        settings: of the page.
        config: of the run.
        folder: of the run.

    Raises:
        PageError: it does not start.
    """
    request = {"bus": config.bus.model_dump(mode="json"), "run": config.name, "folder": str(folder.resolve())}
    return PageProcess(__name__, settings, request)


def _make(request: Mapping[str, Any]) -> tuple[Site, Training]:
    bus = BusConfig.model_validate(request["bus"])
    return SITE, Training(bus, [local_endpoint(bus.listen)], request["run"], Path(request["folder"]))


if __name__ == "__main__":
    from common.page.serve import page_main

    page_main(_make)
