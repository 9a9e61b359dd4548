"""Pages, docstrings and messages name what is there: blocks run, commands parse, links and names lead somewhere."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterator
from functools import cache, partial

import pytest

from common.config.load import RUN
from deploy.profiles import DEPLOY
from tests.docs.commands import (
    EXTRAS,
    SCRIPTS,
    BadCommandError,
    all_options,
    check,
    check_extras,
    check_generators,
    check_setting,
    command_lines,
    examples,
    help_texts,
)
from tests.docs.pages import ROOT, Page, Piece, pages
from tests.docs.sources import FOLDERS, PACKAGES, comments, definitions, docstrings, messages, modules, path_of

LANGUAGES = {"sh", "python", "toml", "json", "text", "mermaid", "hex array", "hex delivery", "hex ack"}
PYTHON = [(page, block) for page in pages() for block in page.blocks() if block.language == "python"]
# Pages and folders in which people look; a path that begins with none of them is one of the reader's own.
_PATH = re.compile(rf"(?<![\w./-])(?:{'|'.join(FOLDERS)}|docs|\.ci)/[\w./*-]*[\w/*]")
_FILE = re.compile(r"(?<![\w./-])[\w-]+\.(?:py|md|service|urdf)(?![\w/])")
_DOTTED = re.compile(rf"(?<![\w./-])(?:{'|'.join(PACKAGES)}|benchmarks)(?:\.\w+)+(?![\w(])")
_SECTIONS = {
    name for tree in (RUN, DEPLOY) for name in {path.partition(".")[0] for path, _ in tree.all_fields() if "." in path}
}
_SETTING = re.compile(rf"(?<![\w./:{{-])(?:{'|'.join(sorted(_SECTIONS))})\.[a-z]\w*(?![\w./(*])")
_VARIABLE = re.compile(r"\bHD(?:ROBOT)?_([A-Z]+)__([A-Z_]+)=")
_METRIC = re.compile(r"[a-z]+/[a-z_]+")
# Groups of entry points, which look like modules.
_ENTRY_POINTS = {f"hdplanner.{kind}" for kind in ("planners", "simulators", "tasks", "generators")}
_GROUPS = ("episode_train", "episode_expert", "episode_evaluate", "evaluation")


def complain(found: list[str]) -> None:
    assert not found, f"{len(found)} names lead nowhere:\n" + "\n".join(found)


def refused(pieces: Iterator[Piece] | list[Piece], checks: Callable[[str], None]) -> list[str]:
    """Return a line for each piece that the check refuses."""
    found = []
    for piece in pieces:
        try:
            checks(piece.text)
        except BadCommandError as error:
            found.append(f"{piece.place}: {error}")
    return found


def check_lines(text: str, *, whole: bool = False) -> None:
    """Check lines of shell; BadCommandError when a program would not understand one."""
    for words in command_lines(text):
        check(words, whole=whole)
        check_generators(" ".join(words))


# --- pages ---------------------------------------------------------------------------------------------------------


def test_every_block_names_its_language():
    blocks = [block for page in pages() for block in page.blocks()]
    complain([f"{block.place}: {block.language!r}" for block in blocks if block.language not in LANGUAGES])


@pytest.mark.parametrize("page", sorted({page for page, _ in PYTHON}, key=str), ids=str)
def test_python_blocks_run(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    namespace = {"__name__": "page"}
    for block in [block for where, block in PYTHON if where == page]:
        code = compile(block.text, block.place, "exec")
        if not block.reason:
            exec(code, namespace)


def test_toml_blocks_are_toml():
    import tomllib

    for page in pages():
        for block in page.blocks():
            if block.language == "toml":
                tomllib.loads(block.text)


def test_commands_are_those_that_the_programs_understand():
    starts = (*SCRIPTS, "python -m ", "make ", "pip install ")
    spans = [span for page in pages() for span in page.spans() if span.text.startswith(starts)]
    blocks = [block for page in pages() for block in page.blocks() if block.language == "sh"]
    assert len(blocks) > 20 and len(spans) > 50
    complain(refused(blocks, partial(check_lines, whole=True)) + refused(spans, check_lines))


def test_examples_in_help_are_those_that_the_programs_understand():
    pieces = [Piece(text.place, line) for text in help_texts() for line in examples(text.text)]
    assert len(pieces) > 60
    complain(refused(pieces, partial(check_lines, whole=True)))


def test_generators_and_extras_are_there():
    pieces = [piece for page in pages() for piece in (*page.spans(), *page.blocks())]
    pieces += [*docstrings(), *messages()]
    complain(refused(pieces, check_extras) + refused(pieces, check_generators))


def test_installation_lists_every_extra():
    table = (ROOT / "docs" / "install.md").read_text("utf-8").partition("\n## ")[0]
    rows = re.findall(r"^\| (`.+?) \|", table, re.MULTILINE)
    assert {name for row in rows for name in re.findall(r"`(\w+)`", row)} == EXTRAS


def test_every_page_is_reached_by_links_from_the_first_one():
    reached, waiting = set(), [ROOT / "README.md"]
    while waiting:
        path = waiting.pop()
        if path not in reached and path.suffix == ".md":
            reached.add(path)
            targets = {link.text.partition("#")[0] for link in Page(path).links() if "://" not in link.text}
            waiting += [(path.parent / target).resolve() for target in targets if target]
    complain([str(page) for page in pages() if page.path not in reached])


def test_links_lead_somewhere():
    anchors = cache(Page.anchors)
    found = []
    for page in [*pages(), Page(ROOT / "CHANGELOG.md")]:
        for link in page.links():
            if link.text.startswith("https://"):
                continue
            path, _, anchor = link.text.partition("#")
            target = (page.path.parent / path).resolve() if path else page.path
            if not target.exists() or (anchor and anchor not in anchors(Page(target))):
                found.append(f"{link.place}: {link.text}")
    complain(found)


def test_every_page_is_in_the_navigation():
    listed = re.findall(r"^\s+- .*?([\w/.]+\.md)$", (ROOT / "mkdocs.yml").read_text("utf-8"), re.MULTILINE)
    made = {"index.md", "contributing.md", "security.md", "changelog.md"}
    written = {str(path.relative_to(ROOT / "docs")) for path in ROOT.glob("docs/**/*.md")}
    assert sorted(listed) == sorted(written | made)


def test_the_map_of_the_repository_has_every_folder():
    listed = set(re.findall(r"^\| `(\w+)/` \|", (ROOT / "CONTRIBUTING.md").read_text("utf-8"), re.MULTILINE))
    assert listed == {*FOLDERS, "docs"}


def test_tables_are_no_wider_than_a_page():
    found = []
    for page in pages():
        for number, line in enumerate(page.prose.splitlines(), 1):
            if re.fullmatch(r"\|[\s:|-]+\|", line) and line.count("|") > 14:
                found.append(f"{page}:{number}: {line.count('|') - 1} columns, expected 13 at most")
    complain(found)


def test_no_placeholder_was_left():
    complain([f"{page}: {mark}" for page in pages() for mark in re.findall(r"@[A-Z]{3,}@|\bTODO\b|\bTBD\b", page.text)])


# --- names in pages, docstrings, comments and messages --------------------------------------------------------------


@cache
def words_of_the_project() -> list[Piece]:
    """Everything that is said about the code, anywhere."""
    spoken = [piece for page in pages() for piece in page.spans()]
    spoken += [block for page in pages() for block in page.blocks() if block.language in ("mermaid", "text")]
    return [*spoken, *docstrings(), *comments(), *messages()]


def test_paths_are_there():
    found = []
    names = {path.name for folder in FOLDERS for path in (ROOT / folder).rglob("*")}
    names |= {path.name for path in ROOT.glob("docs/**/*.md")} | {path.name for path in ROOT.iterdir()}
    for piece in words_of_the_project():
        for path in _PATH.findall(piece.text):
            if not (any(ROOT.glob(path)) if "*" in path else (ROOT / path).exists()) and "://" not in piece.text:
                found.append(f"{piece.place}: {path}")
        found += [f"{piece.place}: {name}" for name in _FILE.findall(piece.text) if name not in names]
    complain(found)


def test_modules_are_there():
    found = []
    for piece in words_of_the_project():
        for dotted in _DOTTED.findall(piece.text):
            setting = any(tree.field_at(dotted) for tree in (RUN, DEPLOY))
            if not (
                setting
                or dotted in _ENTRY_POINTS
                or resolves(dotted)
                or dotted.endswith((".md", ".log", ".json", ".X"))
            ):
                found.append(f"{piece.place}: {dotted}")
    complain(found)


def resolves(dotted: str) -> bool:
    """Whether a dotted name is a module, or something that a module defines or imports."""
    parts = dotted.split(".")
    for cut in range(len(parts), 0, -1):
        module = ".".join(parts[:cut])
        if module in modules():
            return not parts[cut:] or parts[cut] in defined(module)
    return False


@cache
def defined(module: str) -> frozenset[str]:
    """Names that a module defines at its top level, imports, or has as submodules."""
    names = {name.removeprefix(f"{module}.").split(".")[0] for name in modules() if name.startswith(f"{module}.")}
    for node in modules()[module].body:
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            names.add(node.name)
        elif isinstance(node, ast.Import | ast.ImportFrom):
            names |= {(alias.asname or alias.name).split(".")[0] for alias in node.names}
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names |= {target.id for target in targets if isinstance(target, ast.Name)}
    return frozenset(names)


def test_settings_are_there():
    found = []
    for piece in words_of_the_project():
        for path in _SETTING.findall(piece.text):
            if not any(tree.field_at(path) for tree in (RUN, DEPLOY)) and not path.endswith((".log", ".json")):
                found.append(f"{piece.place}: {path}")
        for section, field in _VARIABLE.findall(piece.text):
            path = f"{section}.{field}".lower()
            if not any(tree.field_at(path) for tree in (RUN, DEPLOY)):
                found.append(f"{piece.place}: {path}")
    complain(found)


def test_settings_take_the_values_that_pages_give_them():
    found = []
    for span in [span for page in pages() for span in page.spans()]:
        match = re.fullmatch(rf"({_SETTING.pattern})(?:=| = |: )(\S+)", span.text)
        if match:
            tree = RUN if RUN.field_at(match[1]) else DEPLOY
            given = Piece(span.place, f"{match[1]}={match[2].strip(chr(34))}")
            found += refused([given], partial(check_setting, tree))
    complain(found)


def test_commands_in_messages_are_there():
    pieces = [Piece(piece.place, text) for piece in docstrings() for text in re.findall(r"`(hd-[^`]+)`", piece.text)]
    for piece in messages():
        named = re.findall(r"hd-(?:learner|eval|deploy) [a-z][a-z-]+", piece.text)
        pieces += [Piece(piece.place, text) for text in named]
    complain(refused(pieces, check_lines))


def test_options_in_messages_are_there():
    # These name options of other programs, or make them up from names of fields.
    elsewhere = (
        "actors/maps/public_sets.py",
        "benchmarks/",
        "common/system/code_state.py",
        "deploy/recording/storage.py",
        "deploy/robot/trial.py",
        "deploy/ros_arguments.py",
        "learner/watch/writers.py",
    )
    known = all_options()
    found = []
    for piece in [*docstrings(), *messages()]:
        for option in re.findall(r"(?<![\w-])--[a-z][a-z-]+", piece.text):
            if option not in known and not piece.place.startswith(elsewhere):
                found.append(f"{piece.place}: {option}")
    complain(found)


def test_metrics_are_there():
    spoken = [piece.text for piece in messages() if piece.place.startswith("learner/")]
    written = {text for text in spoken if _METRIC.fullmatch(text)}
    groups = {name.partition("/")[0] for name in written} | set(_GROUPS)
    page = next(page for page in pages() if page.path.name == "metrics.md")
    leaves = {span.text for span in page.spans()}
    explained = {name for name in leaves if _METRIC.fullmatch(name) and name.partition("/")[0] in groups}
    for name in sorted(explained):
        group, _, leaf = name.partition("/")
        assert name in written or (group in _GROUPS and leaf in leaves) or f"{group}/X" in written, name
    for name in sorted(written - {"steps/s"}):
        assert name in explained, f"{name} is not in docs/metrics.md"


def test_code_leads_to_no_document_that_is_not_here():
    strange = re.compile(r"\bDESIGN\b|\bRECIPES\b|\bBUS\.md\b|\bINTERFACES\b|\bBENCHMARKS\.md\b")
    complain([f"{piece.place}: {piece.text[:80]!r}" for piece in words_of_the_project() if strange.search(piece.text)])


# --- docstrings ----------------------------------------------------------------------------------------------------


def test_documented_arguments_are_taken():
    found = []
    for name, tree in modules().items():
        for node in definitions(tree):
            if isinstance(node, ast.FunctionDef):
                found += [f"{path_of(name)}:{node.lineno}: {word}" for word in section(node, "Args") - taken(node)]
            elif isinstance(node, ast.ClassDef):
                made = next((one for one in node.body if getattr(one, "name", "") == "__init__"), None)
                if made is not None:
                    found += [f"{path_of(name)}:{node.lineno}: {word}" for word in section(node, "Args") - taken(made)]
                if is_dataclass(node):
                    fields = {one.target.id for one in node.body if isinstance(one, ast.AnnAssign)}
                    methods = {one.name for one in node.body if isinstance(one, ast.FunctionDef)}
                    missing = section(node, "Attributes") - fields - methods
                    if not node.bases:
                        found += [f"{path_of(name)}:{node.lineno}: {word}" for word in missing]
    complain(found)


def section(node: ast.AST, title: str) -> set[str]:
    """Names that a docstring lists in a section."""
    text = ast.get_docstring(node) or ""
    match = re.search(rf"^{title}:\n((?:    .*\n?|\n)+)", text, re.MULTILINE)
    return set(re.findall(r"^    \*{0,2}(\w+):", match[1], re.MULTILINE)) if match else set()


def taken(function: ast.FunctionDef) -> set[str]:
    """Names of a function's parameters."""
    every = function.args
    extra = [one for one in (every.vararg, every.kwarg) if one is not None]
    return {one.arg for one in [*every.posonlyargs, *every.args, *every.kwonlyargs, *extra]}


def is_dataclass(node: ast.ClassDef) -> bool:
    return any("dataclass" in ast.dump(decorator) for decorator in node.decorator_list)


def test_the_figures_of_scale_are_those_that_the_program_computes() -> None:
    from benchmarks.scale import page

    assert page() in (ROOT / "docs" / "scale.md").read_text("utf-8")
