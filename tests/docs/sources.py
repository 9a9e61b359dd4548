"""What the code says in words: docstrings, comments and the texts of its messages."""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from tests.docs.pages import ROOT, Piece

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
# The packages that are shipped, and the folders of programs and tests beside them.
PACKAGES = tuple(name.rstrip("*") for name in PROJECT["tool"]["setuptools"]["packages"]["find"]["include"])
FOLDERS = (*PACKAGES, *(name for name in ("benchmarks", "examples", "scripts", "tests") if (ROOT / name).is_dir()))


@cache
def modules() -> dict[str, ast.Module]:
    """Every module of the packages and the benchmarks by its dotted name, parsed."""
    found = {}
    for folder in (*PACKAGES, "benchmarks"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = ast.parse(path.read_text("utf-8"))
    return found


def path_of(module: str) -> str:
    """Return the path of a module below the root."""
    path = Path(*module.split("."))
    return str(path / "__init__.py" if (ROOT / path).is_dir() else path.with_suffix(".py"))


def definitions(tree: ast.AST) -> Iterator[ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef]:
    """Yield the classes and functions of a module, inner ones too; expressions hold none and are not walked."""
    for child in ast.iter_child_nodes(tree):
        if isinstance(child, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            yield child
        if isinstance(child, ast.stmt | ast.excepthandler | ast.match_case):
            yield from definitions(child)


# Examples of use in docstrings are code, with variables of their own.
_EXAMPLE = re.compile(r"::\n\n(?:(?: {4}.*)?\n)*(?: {4}.*)?")


@cache
def docstrings() -> tuple[Piece, ...]:
    """Return every docstring, without its examples of use."""
    return tuple(_docstrings())


@cache
def comments() -> tuple[Piece, ...]:
    """Return every comment."""
    return tuple(_comments())


@cache
def messages() -> tuple[Piece, ...]:
    """Return every text that is no docstring; what is put into it at run time stands there as X."""
    return tuple(_messages())


def _docstrings() -> Iterator[Piece]:
    for name, tree in modules().items():
        path = path_of(name)
        for node in (tree, *definitions(tree)):
            text = ast.get_docstring(node)
            if text:
                yield Piece(f"{path}:{getattr(node, 'lineno', 1)}", _EXAMPLE.sub("", text))


def _comments() -> Iterator[Piece]:
    for name in modules():
        path = path_of(name)
        for number, line in enumerate((ROOT / path).read_text("utf-8").splitlines(), 1):
            mark = re.search(r"(?:^|\s)# (.*)", line)
            if mark:
                yield Piece(f"{path}:{number}", mark[1])


def _messages() -> Iterator[Piece]:
    for name, tree in modules().items():
        path = path_of(name)
        for node in _texts(tree):
            text = node.value if isinstance(node, ast.Constant) else "".join(_part(value) for value in node.values)
            yield Piece(f"{path}:{node.lineno}", str(text))


def _texts(tree: ast.AST) -> Iterator[ast.Constant | ast.JoinedStr]:
    """Yield texts, a joined one as one; docstrings and other bare texts are left out."""
    for child in ast.iter_child_nodes(tree):
        if isinstance(child, ast.JoinedStr) or (isinstance(child, ast.Constant) and isinstance(child.value, str)):
            yield child
        elif not (isinstance(child, ast.Expr) and isinstance(child.value, ast.Constant)):
            yield from _texts(child)


def _part(value: ast.expr) -> str:
    return str(value.value) if isinstance(value, ast.Constant) else "X"
