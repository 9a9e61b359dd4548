"""The browser of `make test-page`: headless Chromium, which asks nothing of anybody else."""

import io
import os
import shutil
from contextlib import contextmanager
from pathlib import Path

from PIL import Image

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
UNNAMED = """() => [...document.querySelectorAll("button, input, select, canvas, [role=img], [role=tab]")]
    .filter((each) => !each.closest("[hidden]") && !each.textContent.trim() && !each.title)
    .filter((each) => !each.getAttribute("aria-label") && !each.labels?.length)
    .filter((each) => !each.parentElement.closest("[role=img]"))
    .map((each) => each.outerHTML.slice(0, 120))"""
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
def opened(browser, address, fragment="", expected=None, **options):
    """A page that fails at the end when anything in it failed, or was asked of elsewhere; but for what is expected."""
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
    surprising = [each for each in wrong if expected is None or expected not in each]
    assert not surprising, surprising


def assert_within_reach(page):
    """Nothing lies beyond the page's sides, and whoever cannot see hears what each thing is."""
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), "something sticks out"
    unnamed = page.evaluate(UNNAMED)
    assert not unnamed, unnamed


def picture(page, name, **options):
    """Write a picture of the documents anew, where HD_PAGE_PICTURES asks for it."""
    if os.environ.get("HD_PAGE_PICTURES"):
        page.wait_for_function("() => !document.querySelector('#notices > *')")
        with Image.open(io.BytesIO(page.screenshot(**options))) as shot:
            # A page has few colours: the 256 most frequent ones as they are take a third of the bytes.
            plain = shot.convert("RGB")
            counted = sorted(plain.getcolors(plain.width * plain.height), reverse=True)[:256]
            palette = Image.new("P", (1, 1))
            palette.putpalette([part for _, colour in counted for part in colour])
            plain.quantize(palette=palette, dither=Image.Dither.NONE).save(PICTURES / f"{name}.png", optimize=True)
