"""Files at a URL: object storage such as s3://BUCKET/FOLDER, or whatever else fsspec knows."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from common.errors import ConfigError, HDError
from common.system.extras import optional


class RemoteError(HDError):
    """Storage at a URL cannot be reached, or refuses something."""


def is_url(place: str) -> bool:
    """Return whether a place is a URL and no path of this machine."""
    return re.match(r"[a-z0-9+]+://", place) is not None


@contextmanager
def stored(place: str) -> Iterator[Path]:
    """Give a path to write a file to; what lies beside it there counts as well.

    Args:
        place: a path, which is given as it is, or the URL that everything is copied to at the end of the `with`.

    Raises:
        ConfigError: see `RemoteFolder`.
        RemoteError: the storage refuses the files.
    """
    if not is_url(place):
        yield Path(place)
        return
    url, _, name = place.rpartition("/")
    remote = RemoteFolder(url)
    with TemporaryDirectory() as folder:
        yield Path(folder) / name
        for file in sorted(Path(folder).iterdir()):
            remote.put(file, file.name)


@contextmanager
def fetched(places: Sequence[str | Path], suffixes: tuple[str, ...]) -> Iterator[list[Path]]:
    """Give paths of files and folders that may lie at URLs; those are copied here for as long as the `with` lasts.

    Args:
        places: paths and URLs.
        suffixes: how a URL of a file ends, and what is copied of a folder.

    Raises:
        ConfigError: see `RemoteFolder`.
        FileNotFoundError: there is no such file.
        RemoteError: the storage cannot be read.
    """
    with TemporaryDirectory() as temporary:
        paths = []
        for number, place in enumerate(map(str, places)):
            if not is_url(place):
                paths.append(Path(place))
                continue
            folder = Path(temporary) / str(number)
            folder.mkdir()
            url, _, name = place.rpartition("/") if place.endswith(suffixes) else (place, "", "")
            remote = RemoteFolder(url)
            for each in [name] if name else remote.names():
                if each.endswith(suffixes):
                    (folder / each).write_bytes(remote.get(each))
            paths.append(folder / name if name else folder)
        yield paths


class RemoteFolder:
    """A folder at a URL.

    Args:
        url: ``PROTOCOL://PLACE``; credentials come from the environment, as the protocol's package reads them.

    Raises:
        ConfigError: it is no URL, or a package that it needs is not installed.
    """

    def __init__(self, url: str) -> None:
        if not is_url(url):
            raise ConfigError(f"expected a URL such as s3://bucket/runs or file:///mnt/runs, got {url!r}")
        with optional(f"storage at {url}", "storage"):
            import fsspec
        self.url = url.rstrip("/")
        try:
            self._files, self._root = fsspec.core.url_to_fs(self.url)
        except ImportError as error:
            raise ConfigError(f"storage at {url}: {error}") from error
        except ValueError as error:
            raise ConfigError(
                f"storage at {url}: {error}; expected a protocol that fsspec knows, such as s3"
            ) from error

    def names(self, folder: str = "") -> list[str]:
        """Return what lies in a folder, as names within it, sorted; nothing where there is no such folder."""
        place = self._place(folder)
        try:
            self._files.invalidate_cache()
            return sorted(path.rstrip("/").rpartition("/")[2] for path in self._files.ls(place, detail=False))
        except FileNotFoundError:
            return []
        except Exception as error:
            raise self._error("list", folder, error) from error

    def put(self, file: Path, name: str) -> None:
        """Copy a file of this machine there, under a name that may have folders in it.

        Raises:
            FileNotFoundError: the file is gone.
            RemoteError: the storage refuses it.
        """
        content = file.read_bytes()
        try:
            self._files.makedirs(self._place(name).rpartition("/")[0], exist_ok=True)
            self._files.pipe_file(self._place(name), content)
        except Exception as error:
            raise self._error("write", name, error) from error

    def get(self, name: str) -> bytes:
        """Read a file.

        Raises:
            FileNotFoundError: there is none.
            RemoteError: it cannot be read.
        """
        try:
            content: Any = self._files.cat_file(self._place(name))
        except FileNotFoundError:
            raise
        except Exception as error:
            raise self._error("read", name, error) from error
        return bytes(content)

    def remove(self, name: str) -> None:
        """Delete a file or a folder with all that is in it; nothing happens where there is none."""
        try:
            self._files.rm(self._place(name), recursive=True)
        except FileNotFoundError:
            return
        except Exception as error:
            raise self._error("delete", name, error) from error

    def _place(self, name: str) -> str:
        return f"{self._root.rstrip('/')}/{name}".rstrip("/")

    def _error(self, verb: str, name: str, error: Exception) -> RemoteError:
        return RemoteError(f"cannot {verb} {self.url}/{name}: {type(error).__name__}: {error}")
