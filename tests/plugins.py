"""Packages outside the tree, as strangers write them: modules, and entry points that an installer would have noted."""

from pathlib import Path


def install(folder: Path, name: str, entry_points: str, **modules: str) -> None:
    """Put a package into a folder of the module path, as an installer leaves it there."""
    for module, text in modules.items():
        (folder / f"{module}.py").write_text(text, "utf-8")
    info = folder / f"{name}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n", "utf-8")
    (info / "entry_points.txt").write_text(entry_points, "utf-8")
