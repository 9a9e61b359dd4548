"""Optional packages: which extra brings them, and how to install it from where this installation came from."""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Final
from urllib.parse import unquote, urlsplit

from common.errors import ConfigError

if TYPE_CHECKING:
    from importlib.metadata import Distribution

PROJECT: Final = "hdplanner"

# Packages whose import name is not the name under which they are installed.
_INSTALLED_AS: Final = {
    "PIL": "pillow",
    "imageio_ffmpeg": "imageio-ffmpeg",
    "mcap_ros2": "mcap-ros2-support",
    "rerun": "rerun-sdk",
    "yaml": "pyyaml",
}
# Extras that gather others; naming them would install far more than what is missing.
_GATHERING: Final = {"all", "dev"}
# The first Python without a ready-made wheel of PyBullet.
_NO_PYBULLET: Final = (3, 12)


class MissingPackageError(ConfigError):
    """An optional package is not installed.

    Attributes:
        package: name under which it is installed.
    """

    def __init__(self, what: str, package: str, extras: tuple[str, ...], instead: str = "") -> None:
        if package == "pybullet" and sys.version_info >= _NO_PYBULLET:
            python = ".".join(map(str, sys.version_info[:2]))
            way = f"which has no ready-made wheel for Python {python}: use Python 3.11"
        else:
            way = f"which is not installed: {install_command(*extras)}"
        super().__init__(f"{what} needs the package {package}, {way}{f', or {instead}' if instead else ''}")
        self.package = package


@contextmanager
def optional(what: str, *extras: str, instead: str = "") -> Iterator[None]:
    """Say in one sentence what to install when an optional package is missing within the `with`.

    Args:
        what: what needs the package, in the singular: the sentence continues with "needs the package".
        extras: extras to install; without one, the extra that the missing package belongs to.
        instead: what also helps, such as ``use --sim grid``.

    Raises:
        MissingPackageError: an optional package cannot be imported. A module of this project that is missing is a
            defect, and raises as it is.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        package = package_of(error)
        if package is None or not (extras or extras_with(package)):
            raise
        raise MissingPackageError(what, package, extras or extras_with(package)[:1], instead) from error


def package_of(error: ModuleNotFoundError) -> str | None:
    """Return the package whose import failed, None where the error does not tell."""
    module = (error.name or "").partition(".")[0]
    return _INSTALLED_AS.get(module, module) or None


def extras_with(package: str, first: str | None = None) -> tuple[str, ...]:
    """Return the extras that bring a package, as the installed metadata has them.

    Args:
        package: name under which it is installed.
        first: extra to put first where it is among them.
    """
    installed = _installed()
    found = []
    for requirement in (installed.requires if installed else None) or ():
        name = re.match(r"[\w.-]+", requirement)
        extra = re.search(r"extra == [\"']([\w-]+)[\"']", requirement)
        if name and extra and name[0].lower() == package.lower() and extra[1] not in _GATHERING:
            found.append(extra[1])
    return tuple(sorted(found, key=lambda each: each != first))


def install_command(*extras: str) -> str:
    """Return the command that adds extras to this installation.

    The project is on no package registry, so the command names the checkout or the wheel that this installation was
    made from; pip notes it (PEP 610).
    """
    wanted = f"[{','.join(extras)}]" if extras else ""
    source, options = _source()
    if source is None:
        return f"pip install '.{wanted}' in the checkout (or 'FILE.whl{wanted}' with the wheel)"
    return f"{_pip()} install {options}'{source}{wanted}'"


def _installed() -> Distribution | None:
    """Return the metadata of this installation, None where it has none."""
    # It brings a parser of e-mails, which help does not need.
    from importlib.metadata import PackageNotFoundError, distribution

    try:
        return distribution(PROJECT)
    except PackageNotFoundError:
        return None


def _source() -> tuple[str | None, str]:
    """Return where this installation came from, None where that is gone or unknown, and the options of pip."""
    installed = _installed()
    noted = installed.read_text("direct_url.json") if installed else None
    if noted is None:
        return None, ""
    origin = json.loads(noted)
    url = urlsplit(origin.get("url", ""))
    path = Path(unquote(url.path))
    if url.scheme != "file" or not path.exists():
        return None, ""
    return str(path), "-e " if origin.get("dir_info", {}).get("editable") else ""


def _pip() -> str:
    """Return how to call this environment's pip: a bare ``pip`` would be another environment's unless it is active."""
    inside = sys.prefix != sys.base_prefix
    return "pip" if inside and os.environ.get("VIRTUAL_ENV") == sys.prefix else f"{sys.executable} -m pip"
