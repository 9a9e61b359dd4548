"""Whether the programs would understand a command line, without running it."""

from __future__ import annotations

import ast
import importlib
import re
import shlex
from collections.abc import Iterator
from enum import Enum
from functools import cache
from typing import Any

import typer

from actors.maps.generators import make_generator
from common.config.load import RUN
from common.config.tree import ConfigTree
from common.errors import HDError
from common.planners.registry import planner_names
from deploy.profiles import DEPLOY
from deploy.ros_arguments import BEGIN
from tests.docs.pages import ROOT, Piece
from tests.docs.sources import FOLDERS, PROJECT, modules

SCRIPTS: dict[str, str] = PROJECT["project"]["scripts"]
EXTRAS = frozenset(PROJECT["project"]["optional-dependencies"])
TARGETS = frozenset(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE))
# Modules that are programs of their own, by `python -m`.
_PROGRAMS = {"actors.maps": "actors.maps.__main__:app"}
_TREES: dict[str, ConfigTree] = {"hd-deploy": DEPLOY}
_ASSIGNMENT = re.compile(r"^\w+=")
_GENERATOR = re.compile(r"generator:([a-z]\w*)(?![\w:])(?:\?([\w=.&-]+))?")
# What stands for something of the reader's own: NAME, <name>, {name}, $name, ...
_PLACEHOLDER = re.compile(r"[A-Z]{2,}|[<>{}$…]|^[A-Z]$|\.\.\.")
# Planners that evaluation adds to those of the registry.
_MORE_PLANNERS = {"omniscient"}


class BadCommandError(Exception):
    """A command line that its program would refuse."""


@cache
def program(name: str) -> Any:
    """Return the command of a script or of a module, as Typer makes it."""
    module, _, attribute = (SCRIPTS.get(name) or _PROGRAMS[name]).partition(":")
    if attribute == "main":
        # A script's entry point imports its command line when it is called.
        module = module.replace(".__main__", ".cli")
    return typer.main.get_command(importlib.import_module(module).app)


def all_options() -> set[str]:
    """Return every option that any program has."""
    options = {"--help"}
    commands = [program(name) for name in [*SCRIPTS, *_PROGRAMS]]
    while commands:
        command = commands.pop()
        commands += getattr(command, "commands", {}).values()
        options |= {option for parameter in command.params for option in (*parameter.opts, *parameter.secondary_opts)}
    return options


def help_texts() -> Iterator[Piece]:
    """Yield what the help of each command says, at the command's name."""
    commands = [(name, program(name)) for name in [*SCRIPTS, *_PROGRAMS]]
    while commands:
        name, command = commands.pop()
        commands += [(f"{name} {each}", part) for each, part in getattr(command, "commands", {}).items()]
        yield from (Piece(f"{name} --help", text) for text in (command.help, command.epilog) if text)


def examples(text: str) -> list[str]:
    """Return the command lines of a help text: those that stand alone on a line, and those in backticks."""
    starts = "|".join(re.escape(f"{name} ") for name in (*SCRIPTS, "python -m"))
    alone = [re.split(r"\s{2,}", line.strip())[0] for line in re.findall(rf"^\s*(?:{starts}).*$", text, re.MULTILINE)]
    return alone + [" ".join(span.split()) for span in re.findall(rf"`((?:{starts})[^`]+)`", text)]


def command_lines(block: str) -> Iterator[list[str]]:
    """Yield the simple commands of a block of shell, taken apart into words."""
    lines = re.sub(r"(?:^|(?<=\s))#\s.*$", "", block.replace("\\\n", " "), flags=re.MULTILINE)
    lexer = shlex.shlex(lines.replace("\n", " ;\n"), posix=True, punctuation_chars=";&|")
    lexer.whitespace_split = True
    lexer.commenters = ""
    try:
        found = list(lexer)
    except ValueError as error:
        raise BadCommandError(f"{block!r}: {error}") from error
    words: list[str] = []
    for word in found:
        if set(word) <= set(";&|"):
            if words:
                yield words
            words = []
        else:
            words.append(word)
    if words:
        yield words


def check(words: list[str], *, whole: bool = False) -> None:
    """Check a simple command; a program that is not ours passes.

    Args:
        words: of the command.
        whole: it is meant to be given as it stands, so what its program requires must be there.

    Raises:
        BadCommandError: there is no such program, command, option, setting, planner, generator, extra, target or file,
            an option lacks its value, or something required is missing.
    """
    words = words[: words.index(">")] if ">" in words else list(words)
    while words and (_ASSIGNMENT.match(words[0]) or words[0] in ("sudo", "exec", "nice")):
        words.pop(0)
    if not words:
        return
    name, arguments = words[0].rpartition("/")[2], words[1:]
    if name in SCRIPTS:
        _check_program(name, arguments, whole=whole)
    elif re.fullmatch(r"python[\d.]*", name) and arguments[:1] == ["-m"]:
        _check_module(arguments[1], arguments[2:], whole=whole)
    elif name == "pytest":
        _check_files(arguments)
    elif name == "pip":
        check_extras(" ".join((name, *arguments)))
    elif name == "make":
        for target in arguments:
            if target not in TARGETS and not _ASSIGNMENT.match(target):
                raise BadCommandError(f"the Makefile has no target {target!r}")
    elif words[0].startswith(tuple(f"{folder}/" for folder in FOLDERS)):
        _check_files(words[:1])
    elif name == "bash":
        _check_files(arguments[:1])
    elif name.startswith("hd-"):
        raise BadCommandError(f"there is no command {name!r}")


def check_extras(text: str) -> None:
    """Check the extras of this package that a text names; BadCommandError for an unknown one, or a name to install."""
    if re.search(r"pip install (?:-\S+ )*'?hdplanner(?![\w.-])", text):
        raise BadCommandError("hdplanner is on no package registry: pip installs a checkout or a wheel")
    for names in re.findall(r"(?:hdplanner|\.)\[([a-z,]+)\]", text):
        unknown = set(names.split(",")) - EXTRAS
        if unknown:
            raise BadCommandError(f"there is no extra {sorted(unknown)}: {sorted(EXTRAS)}")


def check_generators(text: str) -> None:
    """Check the generators that a text names, and their parameters; BadCommandError for an unknown one."""
    for name, query in _GENERATOR.findall(text):
        pairs = (pair.partition("=") for pair in query.strip("&.").split("&") if "=" in pair)
        try:
            make_generator(name, {key: value for key, _, value in pairs if not _PLACEHOLDER.search(value)})
        except HDError as error:
            raise BadCommandError(str(error)) from error


def check_setting(tree: ConfigTree, text: str) -> None:
    """Check `section.field=value`; the value only where it is one.

    Raises:
        BadCommandError: the tree has no such setting, or it does not take the value.
    """
    path, equals, value = text.partition("=")
    if path in ("SECTION.FIELD", "X"):
        return
    if tree.field_at(path.strip()) is None:
        raise BadCommandError(f"unknown setting {path!r}")
    if equals and not _PLACEHOLDER.search(value):
        try:
            tree.load(overrides=[text])
        except HDError as error:
            # Settings that need each other are given together, here one is looked at alone.
            if path in str(error).split(":")[1]:
                raise BadCommandError(str(error)) from error


def _check_program(name: str, arguments: list[str], *, whole: bool = False) -> None:
    command = program(name)
    if name == "hd-deploy" and BEGIN in arguments:
        # What follows is ROS 2's; `deploy.ros_arguments` has tests of its own.
        arguments = arguments[: arguments.index(BEGIN)]
    while hasattr(command, "commands") and arguments and not arguments[0].startswith("-"):
        if _PLACEHOLDER.search(arguments[0]):
            return
        if arguments[0] not in command.commands:
            raise BadCommandError(f"{name} has no command {arguments[0]!r}: {', '.join(command.commands)}")
        name, command, arguments = f"{name} {arguments[0]}", command.commands[arguments[0]], arguments[1:]
    options = {option: one for one in command.params for option in (*one.opts, *one.secondary_opts)}
    positional = [one.nargs for one in command.params if one.param_type_name == "argument"]
    places = 99 if any(number < 0 for number in positional) else sum(positional)
    if hasattr(command, "commands"):
        # Prose names an option by its program alone, whichever of its commands has it.
        options |= {option: one for part in command.commands.values() for one in part.params for option in one.opts}
    needed = [one for one in command.params if one.required] if whole and "--help" not in arguments else []
    missing = [one.opts[0] for one in needed if one.param_type_name == "option" and not {*one.opts} & {*arguments}]
    if missing:
        raise BadCommandError(f"{name} lacks {', '.join(missing)}")
    wanted = sum(max(one.nargs, 1) for one in needed if one.param_type_name == "argument")
    words = [word.strip("[]") if word.startswith("[-") else word for word in arguments]
    while words:
        word = words.pop(0)
        if word in ("--help", "-h", "--install-completion", "--show-completion"):
            continue
        if not re.match(r"-{1,2}[a-z]", word):
            wanted -= 1
            places -= not _PLACEHOLDER.fullmatch(word)
            continue
        option, equals, value = word.partition("=")
        if option not in options:
            raise BadCommandError(f"{name} has no option {option!r}")
        parameter = options[option]
        if parameter.is_flag:
            continue
        values = [value] if equals else [words.pop(0) for _ in range(min(parameter.nargs, len(words)))]
        # Prose may name an option alone.
        if (values or whole) and (len(values) < parameter.nargs or {*values} & {*options}):
            raise BadCommandError(f"{option} of {name} lacks its value")
        for given in values:
            _check_value(name.split()[0], parameter, given)
    if places < 0 and command.params:
        raise BadCommandError(f"{name} takes no further argument: {arguments}")
    if wanted > 0:
        raise BadCommandError(f"{name} lacks an argument: {arguments}")


def _check_value(script: str, parameter: Any, value: str) -> None:
    if _PLACEHOLDER.search(value) and parameter.name != "overrides":
        return
    tree = _TREES.get(script, RUN)
    if "--set" in parameter.opts:
        check_setting(tree, value)
    elif {"--preset", "--profile"} & set(parameter.opts) and value not in tree.preset_names():
        raise BadCommandError(f"there is no {parameter.opts[0]} {value!r}: {tree.preset_names()}")
    elif "--planner" in parameter.opts:
        unknown = {name for name in value.split(",") if ":" not in name} - {*planner_names(), *_MORE_PLANNERS}
        if unknown:
            raise BadCommandError(f"there is no planner {sorted(unknown)}")
    kind = parameter.type_descriptor.annotation
    if isinstance(kind, type) and issubclass(kind, int | float | Enum):
        try:
            kind(value)
        except ValueError:
            raise BadCommandError(f"{parameter.opts[0]} does not take {value!r}") from None


@cache
def _fuzzer() -> dict[str, ast.Module]:
    """Return the one program that lies beside the tests."""
    return {"tests.fuzz.__main__": ast.parse((ROOT / "tests" / "fuzz" / "__main__.py").read_text("utf-8"))}


def _check_module(name: str, arguments: list[str], *, whole: bool = False) -> None:
    if name == "pytest":
        _check_files(arguments)
    elif name in _PROGRAMS:
        _check_program(name, arguments, whole=whole)
    elif name.partition(".")[0] in FOLDERS:
        known_modules = {**modules(), **_fuzzer()}
        if not {name, f"{name}.__main__"} & set(known_modules) and not (ROOT / f"{name.replace('.', '/')}.py").exists():
            raise BadCommandError(f"there is no module {name}")
        main = known_modules.get(f"{name}.__main__", known_modules.get(name))
        known = {str(node.value) for node in ast.walk(main or ast.Module([], [])) if isinstance(node, ast.Constant)}
        for word in arguments:
            if re.match(r"--[a-z]", word) and word.partition("=")[0] not in known:
                raise BadCommandError(f"{name} has no option {word!r}")
        if name == "benchmarks":
            for word in arguments:
                if re.fullmatch(r"[a-z_]+", word) and f"benchmarks.{word}" not in modules():
                    raise BadCommandError(f"there is no benchmark {word!r}")


def _check_files(arguments: list[str]) -> None:
    for word in arguments:
        path = word.partition("::")[0]
        if "/" in path and not path.startswith("-") and not (ROOT / path).exists():
            raise BadCommandError(f"there is no file {path}")
