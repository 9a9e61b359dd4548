"""The browser of `make test-page`: headless Chromium, which asks nothing of anybody else."""

import os
import shutil
from contextlib import contextmanager
from pathlib import Path

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FLAGS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
PATIENCE = 120.0
PICTURES = Path(__file__).parents[2] / "docs" / "pictures"


@contextmanager
def chromium():
    """A browser, for as long as it is needed."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=FLAGS, timeout=1e3 * PATIENCE)
        yield browser
        browser.close()


@contextmanager
def opened(browser, address, fragment="", **options):
    """A page that fails at the end when anything in it failed, or was asked of elsewhere."""
    wrong = []
    context = browser.new_context(**{"viewport": {"width": 1400, "height": 900}, **options})
    page = context.new_page()
    page.set_default_timeout(1e3 * PATIENCE)
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("console", lambda said: wrong.append(said.text) if said.type == "error" else None)
    page.on("request", lambda asked: None if asked.url.startswith(address) else wrong.append(asked.url))
    page.goto(address + fragment)
    try:
        yield page
    finally:
        context.close()
    assert not wrong


def picture(page, name, **options):
    """Write a picture of the documents anew, where HD_PAGE_PICTURES asks for it."""
    if os.environ.get("HD_PAGE_PICTURES"):
        # Notices go after five seconds.
        page.wait_for_timeout(5500)
        page.screenshot(path=PICTURES / f"{name}.png", **options)
