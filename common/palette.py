"""The colours of everything that people look at: terminal, page, plots, videos and markers.

One thing has one colour wherever it is drawn. Shapes differ as well (beacons are triangles, viewpoints dots, the robot
a disc with a nose), so that nothing is told by colour alone. Red that fills an area means *stop* or *fault* and nothing
else. The page's style sheets get these colours as custom properties, from `style_sheet`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

Rgb = tuple[int, int, int]
"""Red, green and blue, 0 to 255."""


@dataclass(frozen=True, slots=True)
class Colour:
    """One meaning in both schemes, as ``#rrggbb``.

    Attributes:
        light: on a light ground; what pictures, videos and plots are drawn with.
        dark: on a dark ground.
    """

    light: str
    dark: str

    @property
    def rgb(self) -> Rgb:
        """The light one as numbers."""
        return rgb(self.light)

    def rgba_on_dark(self, opacity: float = 1.0) -> tuple[float, float, float, float]:
        """Return the one on a dark ground as ROS markers have it, 0 to 1."""
        red, green, blue = rgb(self.dark)
        return red / 255.0, green / 255.0, blue / 255.0, opacity


def rgb(text: str) -> Rgb:
    """Return ``#rrggbb`` as numbers."""
    number = int(text.removeprefix("#"), 16)
    return number >> 16, number >> 8 & 255, number & 255


# The belief.
UNKNOWN: Final = Colour("#adb2ba", "#1a1d22")
FREE: Final = Colour("#f4f4f0", "#3d434d")
OCCUPIED: Final = Colour("#343840", "#d5d8d2")
UNSEEN_WALL: Final = Colour("#969ba4", "#2a2e35")
FRONTIER: Final = Colour("#e07b00", "#ff9d2e")

# The viewpoint graph and what is chosen in it.
EDGE: Final = Colour("#8e96a3", "#6f7987")
VIEWPOINT: Final = Colour("#6b7482", "#9aa3b1")
VISITED: Final = Colour("#4a515c", "#707987")
USEFUL: Final = Colour("#2f8fdd", "#5cb1f5")
BEACON: Final = Colour("#b3261e", "#ff7a70")
WAYPOINT: Final = Colour("#1e9e4a", "#8fe36b")
TARGET: Final = Colour("#b3261e", "#ff7a70")
BANNED: Final = Colour("#c2185b", "#ff6fa3")

# The robot.
ROBOT: Final = Colour("#14783c", "#3fcf73")
WAY: Final = Colour("#3566b8", "#7ea6e0")
SCAN: Final = Colour("#7b3fb5", "#c59bf2")
PERSON: Final = Colour("#e8a33d", "#f0b45c")
ATTENTION: Final = Colour("#7b3fb5", "#c59bf2")

# Curves: training behind, evaluation before it, what it is compared with.
CURVE_BEHIND: Final = Colour("#9ecae1", "#41627a")
CURVE: Final = Colour("#08519c", "#7cc0f5")
YARDSTICK: Final = Colour("#777777", "#8b93a0")

# How things stand.
GOOD: Final = Colour("#14783c", "#3fcf73")
BUSY: Final = Colour("#2463b0", "#6fb1ff")
CAUTION: Final = Colour("#8a5300", "#ffb454")
FAULT: Final = Colour("#c01818", "#ff5a52")
TEXT: Final = Colour("#1e1e1e", "#e8eaed")


def style_sheet() -> str:
    """Return the colours as CSS custom properties, those of the dark scheme where that is asked for."""
    colours = {name.lower().replace("_", "-"): each for name, each in globals().items() if isinstance(each, Colour)}
    light = "".join(f"  --{name}: {each.light};\n" for name, each in colours.items())
    dark = "".join(f"  --{name}: {each.dark};\n" for name, each in colours.items())
    return (
        f":root {{\n{light}}}\n"
        f"@media (prefers-color-scheme: dark) {{\n:root:not([data-scheme='light']) {{\n{dark}}}\n}}\n"
        f":root[data-scheme='dark'] {{\n{dark}}}\n"
    )
