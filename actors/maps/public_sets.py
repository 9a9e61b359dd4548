"""The public sets of maps: where they come from, under which licence, and whether a folder holds one."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from actors.maps.files import MapFile, list_maps
from actors.maps.recommended import Recommendation, read_folder, read_preset
from actors.maps.sources import DEFAULT_SCALE
from common.errors import ConfigError, MapError
from common.tasks import NAVIGATION

Track = Callable[[Iterable[MapFile], int], Iterable[MapFile]]


@dataclass(frozen=True, slots=True)
class PublicSet:
    """A set of maps that others have published.

    Attributes:
        name: here.
        task: that its maps are for.
        repository: owner and name on GitHub.
        folder: of the maps within the repository.
        count: of maps; None where this project has only seen a part.
        licence: of the repository.
        use: what it may be used for.
        preset: with the settings recommended for it; None for the defaults, which are the protocol of the public maps.
        preparation: how its pictures become maps; empty where they are maps already.
    """

    name: str
    task: str
    repository: str
    folder: str
    count: int | None
    licence: str
    use: str
    preset: str | None = None
    preparation: str = ""

    @property
    def source(self) -> str:
        """What to give to ``--maps``, with FOLDER for the folder of its maps."""
        return "FOLDER" if self.preset is None else f"{self.preset}:FOLDER"

    @property
    def recommendation(self) -> Recommendation:
        """The settings recommended for it, without those of the folder's own ``worlds.toml``."""
        return Recommendation() if self.preset is None else read_preset(self.preset)

    @property
    def commands(self) -> str:
        """Commands that fetch it."""
        owner_and_name = f"https://github.com/{self.repository}"
        return f"git clone --depth 1 {owner_and_name} && ls {self.repository.partition('/')[2]}/{self.folder}"


_ARIADNE: Final = "marmotlab/ARiADNE"
_CONTEXT: Final = "marmotlab/Context_Aware_Navigation"
_MIT: Final = "MIT"
_BENCH: Final = "benchmark: never train on it"
_START: Final = "paint the robot's start yellow, or give it as start in worlds.toml"

PUBLIC_SETS: Final = {
    each.name: each
    for each in (
        PublicSet("exploration-train", "exploration", _ARIADNE, "DungeonMaps/train", None, _MIT, "training"),
        PublicSet("exploration-easy", "exploration", _ARIADNE, "DungeonMaps/easy", 100, _MIT, _BENCH),
        PublicSet("exploration-medium", "exploration", _ARIADNE, "DungeonMaps/medium", 100, _MIT, _BENCH),
        PublicSet("exploration-complex", "exploration", _ARIADNE, "DungeonMaps/complex", 100, _MIT, _BENCH),
        PublicSet("navigation-train", "navigation", _CONTEXT, "DungeonMaps/pp/train", 5018, _MIT, "training"),
        PublicSet("navigation-test", "navigation", _CONTEXT, "DungeonMaps/pp/test", 200, _MIT, _BENCH),
        PublicSet(
            "floorplans",
            "exploration",
            "castacks/MapEx",
            "kth_test_maps",
            None,
            "none stated",
            "transfer test: never train or tune on it",
            preset="floorplans",
            preparation=f"crop each plan to its largest connected floor at 0.1 m a pixel, and {_START}",
        ),
        PublicSet(
            "cmu",
            "exploration",
            "marmotlab/ARiADNE-ROS-Planner",
            "demo",
            1,
            _MIT,
            "transfer test: never train or tune on it",
            preset="cmu",
            preparation="trace the walls of the picture demo_indoor.png at 0.25 m a pixel (130 m x 100 m), floor white "
            f"and the rest black, and {_START}",
        ),
    )
}


@dataclass(frozen=True, slots=True)
class FolderCheck:
    """What a folder holds.

    Attributes:
        maps: number of maps.
        problems: one sentence for each thing that is wrong.
    """

    maps: int
    problems: tuple[str, ...]


def find_set(name: str) -> PublicSet:
    """Return a set by its name; ConfigError for an unknown one."""
    if name not in PUBLIC_SETS:
        raise ConfigError(f"unknown set {name!r}: expected one of {', '.join(PUBLIC_SETS)}")
    return PUBLIC_SETS[name]


def check_folder(wanted: PublicSet, folder: Path, track: Track | None = None) -> FolderCheck:
    """Load every map of a folder as an evaluation would, and compare their number with the set's.

    Args:
        wanted: the set that the folder should hold.
        folder: of the maps.
        track: passes the maps on while it shows how far it is.

    Raises:
        MapError: there is no such folder.
    """
    if not folder.is_dir():
        raise MapError(f"{folder}: there is no such folder: fetch the set with `{wanted.commands}`")
    own = read_folder(folder)
    scale = wanted.recommendation.over(own).metres_per_pixel or DEFAULT_SCALE
    files = list_maps(folder, dict(own.places))
    problems = []
    if not files:
        problems.append(f"no maps: expected the folder {wanted.folder} of {wanted.repository}")
    elif wanted.count is not None and len(files) != wanted.count:
        problems.append(f"expected {wanted.count} maps, got {len(files)}: fetch it again")
    for file in files if track is None else track(files, len(files)):
        try:
            file.load(scale, require_target=wanted.task == NAVIGATION.name)
        except MapError as error:
            problems.append(str(error))
    return FolderCheck(len(files), tuple(problems))
