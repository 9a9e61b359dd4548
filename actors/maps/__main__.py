"""Look at maps: ``python -m actors.maps compare`` and ``python -m actors.maps show``."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray

from actors.maps.generators import find_generator
from actors.maps.pictures import contact_sheet, distributions
from actors.maps.png import write_png
from actors.maps.sources import fixed_set, open_sources
from actors.maps.statistics import MEASURES, distance, measure_all
from common.cli import CommandApp, command_errors, output_console, whole_table
from common.errors import MapError
from common.extensions import GENERATOR_PREFIX, GENERATORS

app = CommandApp(help="Look at maps: compare two sets, show them, write generated ones as PNG.", no_args_is_help=True)

Count = Annotated[int, typer.Option(min=1, help="Maps to take, spread evenly over a folder.")]
Scale = Annotated[float, typer.Option(help="Metres per pixel.")]


@app.command()
@command_errors
def compare(
    maps: Annotated[str, typer.Option(help="A folder of maps, or any other source.")],
    generator: Annotated[str, typer.Option(help="A generator with its parameters, such as rooms?style=navigation.")],
    count: Count = 300,
    plot: Annotated[Path | None, typer.Option(help="Also write the distributions into this PNG file.")] = None,
    markdown: Annotated[bool, typer.Option(help="Print the table as Markdown.")] = False,
) -> None:
    """Compare what a generator makes with the maps of a folder.

    Example: python -m actors.maps compare --maps train/ --generator rooms --count 300
    """
    sets = {name: _measure(name, count) for name in (maps, _generator(generator))}
    first, second = sets.values()
    titles = ("measure", "maps", "generator", "maps, quantiles", "generator, quantiles", "distance")
    rows = [
        (
            name.replace("_", " "),
            _mean(first[name]),
            _mean(second[name]),
            _quantiles(first[name]),
            _quantiles(second[name]),
            _number(distance(first[name], second[name])),
        )
        for name in MEASURES
    ]
    console = output_console()
    if markdown:
        lines = ["| " + " | ".join(titles) + " |", "|" + " --- |" * len(titles)]
        console.out("\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows]), highlight=False)
    else:
        table = whole_table(*titles, title=f"{maps} and {_generator(generator)}", caption=_CAPTION)
        for row in rows:
            table.add_row(*row)
        console.print(table)
    if plot is not None:
        named = {Path(maps).name if Path(maps).is_dir() else maps: first, _generator(generator): second}
        distributions(named, MEASURES, _folder_of(plot))


@app.command()
@command_errors
def generators() -> None:
    """List the generators and their parameters as Markdown."""
    lines = []
    for name in GENERATORS.names():
        kind = find_generator(name)
        lines += [f"### `{name}`", "", inspect.cleandoc(kind.__doc__ or ""), "", "| parameter | default | meaning |"]
        lines += ["| --- | --- | --- |"]
        for parameter, field in kind.model_fields.items():
            default = "style's own" if field.default is None else field.default
            lines.append(f"| `{parameter}` | {default} | {field.description} |")
        lines.append("")
    output_console().out("\n".join(lines), highlight=False)


@app.command()
@command_errors
def show(
    source: Annotated[str, typer.Argument(help="A folder or a file of maps, or generator:NAME[?key=value&...].")],
    out: Annotated[Path, typer.Option(help="The contact sheet, a PNG file.")],
    count: Count = 20,
    columns: Annotated[int, typer.Option(min=1, help="Maps per row.")] = 5,
    width: Annotated[int, typer.Option(min=16, help="Width of one map, pixels.")] = 160,
) -> None:
    """Draw maps side by side.

    Example: python -m actors.maps show generator:tunnel --out tunnel.png
    """
    contact_sheet(fixed_set(open_sources([source], None, "exploration"), count), _folder_of(out), columns, width)


@app.command()
@command_errors
def check(
    sources: Annotated[list[str], typer.Argument(help="Folders, files or generators, as in maps.train.")],
    task: Annotated[str, typer.Option(help="Name of a task; some need maps with a target.")] = "exploration",
    scale: Annotated[float | None, typer.Option(help="Metres per pixel, instead of the sources' own.")] = None,
) -> None:
    """Open sources of maps and load the first world of each.

    Example: python -m actors.maps check generator:rooms maps/train
    """
    open_sources(sources, scale, task)


@app.command()
@command_errors
def write(
    source: Annotated[str, typer.Argument(help="generator:NAME[?key=value&...], or a folder.")],
    out: Annotated[Path, typer.Option(help="Folder for the PNG maps; made when missing.")],
    count: Count = 100,
) -> None:
    """Write maps in the public PNG format, to store and to share.

    Example: python -m actors.maps write generator:office --out office/ --count 500
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise MapError(f"{out}: cannot make the folder ({error.strerror}): choose another one") from error
    for number, world in enumerate(fixed_set(open_sources([source], None, "exploration"), count)):
        write_png(world, out / f"{number}.png")


_CAPTION = (
    "Lengths in blocks of 16 px. Mean (standard deviation); quantiles 5, 25, 50, 75, 95 %. Distance: mean gap between "
    "the quantile functions, in standard deviations of the maps."
)


def _generator(text: str) -> str:
    return text if text.startswith(GENERATOR_PREFIX) else GENERATOR_PREFIX + text


def _measure(spec: str, count: int) -> dict[str, NDArray[np.float64]]:
    return measure_all(fixed_set(open_sources([spec], None, "exploration"), count))


def _mean(values: NDArray[np.float64]) -> str:
    finite = values[np.isfinite(values)]
    return f"{finite.mean():.2f} ({finite.std():.2f})" if len(finite) else "-"


def _quantiles(values: NDArray[np.float64]) -> str:
    finite = values[np.isfinite(values)]
    if not len(finite):
        return "-"
    return ", ".join(f"{value:.3g}" for value in np.quantile(finite, (0.05, 0.25, 0.5, 0.75, 0.95)))


def _number(value: float) -> str:
    return "-" if np.isnan(value) else f"{value:.2f}"


def _folder_of(path: Path) -> Path:
    if not path.parent.is_dir():
        raise MapError(f"{path}: there is no folder {path.parent}: make it first")
    return path


if __name__ == "__main__":
    app()
