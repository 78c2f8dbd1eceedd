"""What the documentation says is so: its shell lines, scenes and Python run, its commands and links exist.

Lines of the tutorial and of the how-to guides that take seconds are executed, in the order of the page and in a folder
that has `cases` as a new user's has; the run of the tutorial at toy size. All others are parsed by the command line
itself: options and files exist, and the scene is right with the values that they set.
"""

from __future__ import annotations

import copy
import fnmatch
import importlib.util
import os
import re
import shlex
import textwrap
import tomllib
from dataclasses import dataclass
from pathlib import Path

import pytest
from step_file import write_polygons
from typer.main import get_command
from typer.testing import CliRunner

from emclutch.cli.input import load
from emclutch.cli.main import app
from emclutch.scene.case import case_from, load_case, read_toml
from emclutch.scene.study import read_study

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
READMES = [ROOT / "README.md", ROOT / "geometry" / "kernels" / "README.md", ROOT / "tests" / "hard" / "README.md"]
PAGES = [*READMES, *(page for page in sorted(DOCS.rglob("*.md")) if "_build" not in page.parts)]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
PROJECT_FOLDERS = ("geometry", "field", "particles", "coupling", "emclutch", "tests", "cases", "docs")
COMMANDS = get_command(app).commands
IN_ORDER = ["tutorial/first_torque.md", "tutorial/reading_results.md", "tutorial/own_device.md"]
IN_ORDER += [f"how_to/{page.name}" for page in sorted((DOCS / "how_to").glob("*.md"))]

# executed for real, with what makes them quick; the run in the tutorial's first page alone
COARSE = ["--set", "field.size_factor=4"]
QUICK = {
    "check": [], "plot": [], "report": [], "materials": [], "doctor": [], "schema": [], "mesh": COARSE,
    "field": [*COARSE, "--set", "field.order=1", "--set", "output.pictures=false", "--set", "output.formats=[]"],
}  # fmt: skip
TOY_RUN = {
    "time.end": "0.02 ms", "time.until": "none", "accuracy.replicas": 1, "output.snapshots": 1,
    "output.pictures": "false",
}  # fmt: skip
FENCE = re.compile(r"^( *)(`{3,}|:{3,})([^\n]*)\n(.*?)^\1\2[ ]*$", re.M | re.S)


@dataclass(frozen=True)
class Block:
    """A fenced block of a page: its language, its caption (the name of a file) and its text."""

    language: str
    caption: str
    text: str


def blocks(page: Path) -> list[Block]:
    found = []
    for indent, _, language, text in FENCE.findall(page.read_text(encoding="utf-8")):
        text, caption = textwrap.dedent(text) if indent else text, ""
        if language.startswith("{code-block}"):
            options, _, text = text.partition("\n\n")
            caption = options.removeprefix(":caption:").strip()
        found.append(Block(language.split()[-1] if language else "", caption, text))
    return found


def lines(block: Block) -> list[list[str]]:
    """The words of each shell line; a line that continues behind a backslash is one."""
    joined = re.sub(r"\\\n\s*", " ", block.text)
    return [words for line in joined.splitlines() if (words := shlex.split(line, comments=True))]


def without_blocks(page: Path) -> str:
    return FENCE.sub("", page.read_text(encoding="utf-8"))


def name_of(page: Path) -> str:
    return page.relative_to(DOCS if DOCS in page.parents else ROOT).as_posix()


def prose(page: Path) -> list[str]:
    """What stands between single backticks."""
    return re.findall(r"(?<!`)`([^`\n]+)`(?!`)", without_blocks(page))


# ---------------------------------------------------------------- links and the table of contents


def anchors(page: Path) -> set[str]:
    heads = re.findall(r"^#+ (.*)$", without_blocks(page), re.M)
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_link_leads_somewhere(page):
    for target in re.findall(r"\]\(([^)\s]+)\)", without_blocks(page)):
        if "://" in target:
            continue
        path, _, anchor = target.partition("#")
        there = (page.parent / path).resolve() if path else page
        assert there.exists(), f"{page.name}: {target} leads nowhere"
        if anchor:
            assert anchor in anchors(there), f"{page.name}: {target}: no heading {anchor}"


def test_every_page_is_in_the_table_of_contents():
    listed: set[str] = set()
    for page in PAGES:
        for block in blocks(page):
            if block.language == "{toctree}":
                entries = [line for line in block.text.splitlines() if line and not line.startswith(":")]
                listed |= {name_of(page.parent / entry) for entry in entries}
    pages = {name_of(page).removesuffix(".md") for page in PAGES if DOCS in page.parents} - {"index"}
    left_out = {page for page in pages if not any(fnmatch.fnmatch(page, entry) for entry in listed)}
    assert not left_out, f"in no table of contents: {sorted(left_out)}"


WRITTEN_BY_RUNS = {"paraview.py"}


def files_named(page: Path) -> set[str]:
    """What a page's text has between backticks and looks like a file or folder of the tree; `*` stands for any."""
    words = {word.rstrip(".,;:") for code in prose(page) for word in code.split()}
    tops = {*PROJECT_FOLDERS, *(folder.name for folder in (ROOT / "cases").iterdir() if folder.is_dir())}
    paths = {word for word in words if re.fullmatch(r"[\w.*-]+(/[\w.*-]+)*/?", word)}
    return {path for path in paths if ("/" in path and path.split("/")[0] in tops) or path.endswith(".py")}


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_files_that_the_text_names_are_in_the_tree(page):
    """Beside those of links: `particles/laws/springs.py`, `thesis/centrifugal.toml` of `cases`, or a `module.py`."""
    for path in files_named(page) - WRITTEN_BY_RUNS:
        found = [*ROOT.glob(path), *(ROOT / "cases").glob(path)]
        if "/" not in path:
            found = [file for folder in PROJECT_FOLDERS for file in (ROOT / folder).rglob(path)]
        assert found or [*(ROOT / "cases").glob(f"{path}.toml")], f"{name_of(page)}: `{path}` is not in the tree"


def test_the_source_tree_that_is_drawn_is_there():
    """A line begins with its folder, which lies in the one above that is indented less, and names folders in it."""
    drawn = next(block for block in blocks(DOCS / "reference" / "source_tree.md") if not block.language)
    outer, drawn_folders = "", set()
    for line in drawn.text.splitlines():
        first, *inner = re.findall(r"(?<![\w/])(\w+)/", line)
        if line.startswith(" "):
            first = f"{outer}/{first}"
        else:
            outer = first
        drawn_folders |= {first, *(f"{first}/{name}" for name in inner)}
    assert {folder for folder in drawn_folders if not (ROOT / folder).is_dir()} == set()
    rooms = {f"emclutch/{path.name}" for path in (ROOT / "emclutch").iterdir() if path.is_dir()}
    assert {*PROJECT_FOLDERS, *rooms} - {"docs", "emclutch/__pycache__"} <= drawn_folders


SCENES = [*sorted((ROOT / "cases").glob("*.toml")), *sorted((ROOT / "cases" / "thesis").glob("*.toml"))]


@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.stem)
def test_a_scene_of_the_gallery_says_what_is_asked_and_expected(scene):
    """The gallery is made of the headers: a question, how to run it, what to expect and how long it takes."""
    header = re.match(r"(?:#.*\n)+", scene.read_text(encoding="utf-8"))
    assert header is not None
    question, _, rest = re.sub(r"^# *", "", header[0], flags=re.M).partition("\nRun:")
    assert "?" in question, f"{scene.name}: the first lines are to be a question"
    for part in ("Expect:", "Takes:"):
        assert f"\n{part} " in rest, f"{scene.name}: its header has no {part}"


# ---------------------------------------------------------------- the words of a shell line


def parsed(words: list[str]):
    """Parameters of a line `emclutch COMMAND ...`; fails as the command line itself does."""
    assert words[0] in COMMANDS, f"no command {words[0]}; there are {', '.join(sorted(COMMANDS))}"
    return COMMANDS[words[0]].make_context(words[0], list(words[1:])).params


def check_emclutch(words: list[str], folder: Path) -> None:
    if words[1] in ("--version", "--help"):
        return
    given = parsed(words[1:])
    if (study := given.get("study")) is not None:
        read_study(folder / study)
    case = given.get("case")
    if case is not None and not given.get("resume"):
        load(folder / case, given.get("sets"))


def check_make(words: list[str], folder: Path) -> None:
    rules = (ROOT / "Makefile").read_text(encoding="utf-8")
    for word in words[1:]:
        name, equals, value = word.partition("=")
        if equals:
            assert re.search(rf"^{name}\s*\?=", rules, re.M), f"the Makefile has no variable {name}"
            assert name != "CASE" or (ROOT / value).is_file(), f"no file {value}"
        else:
            assert re.search(rf"^{name}:", rules, re.M), f"the Makefile has no target {name}"


def check_python(words: list[str], folder: Path) -> None:
    script = words[1]
    assert script in ("-m", "-c") or (ROOT / script).is_file(), f"no script {script}"
    if script == "-c":
        compile(words[2], "shell line", "exec")


def check_pip(words: list[str], folder: Path) -> None:
    for version in re.findall(r"emclutch-([\d.]+)-", " ".join(words)):
        assert version == PROJECT["version"], f"a wheel of version {version}"
    for extras in re.findall(r"\[(.*?)\]", " ".join(words)):
        assert set(extras.split(",")) <= set(PROJECT["optional-dependencies"]), f"no such extras: {extras}"


def check_parallel(words: list[str], folder: Path) -> None:
    """The line that GNU parallel makes of its first argument."""
    command, arguments = words[words.index("emclutch") : words.index(":::")], words[words.index(":::") + 1 :]
    check_line([word.replace("{}", arguments[0]) for word in command], folder)


def nothing(words: list[str], folder: Path) -> None:
    """Lines of the shell itself."""


PROGRAMS = {
    "emclutch": check_emclutch, "make": check_make, "python": check_python, "python3.11": check_python,
    "pip": check_pip, "parallel": check_parallel, ".": nothing, "cp": nothing, "cd": nothing, "export": nothing,
}  # fmt: skip


def check_line(words: list[str], folder: Path) -> None:
    program = words[0].removeprefix(".venv/bin/")
    assert program in PROGRAMS, f"what does {program} do? Say in this test how its line is checked: {words}"
    PROGRAMS[program](words, folder)


@pytest.mark.parametrize("page", [page for page in PAGES if name_of(page) not in IN_ORDER], ids=name_of)
def test_shell_lines_of_the_other_pages_are_right(page):
    for block in blocks(page):
        if block.language == "sh":
            for words in lines(block):
                check_line(words, ROOT)


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_commands_that_the_text_names_exist(page):
    """`emclutch run CASE --resume` in a sentence, and the rows of the table of commands."""
    for code in prose(page):
        words = re.sub(r"[\[\]']", " ", code).split()
        if words[:1] == ["emclutch"]:
            words = words[1:]
        elif not (len(words) > 1 and words[0] in COMMANDS and re.match("[A-Z]{3}", words[1])):
            continue
        if not words or words[0].startswith("-") or words[0].isupper():
            continue
        for name in words[0].split("|"):
            assert name in COMMANDS, f"{page.name}: `{code}`: no command {name}"
            known = {option for one in COMMANDS[name].params for option in one.opts}
            given = {word.split("=")[0] for word in words if word.startswith("--")}
            assert given <= known, f"{page.name}: `{code}`: {name} has no option {sorted(given - known)}"
    for code in prose(page):
        if code.startswith("make "):
            check_make(code.split(), ROOT)


# ---------------------------------------------------------------- pages that are executed


@pytest.fixture(scope="module")
def workplace(tmp_path_factory):
    """A new user's folder: the scenes that ship, and a device from a CAD program."""
    folder = tmp_path_factory.mktemp("documentation")
    (folder / "cases").symlink_to(ROOT / "cases")
    shape = load_case(ROOT / "cases" / "quickstart.toml").scene.shape()
    write_polygons(folder / "device.step", shape.section_polygons())
    return folder


def execute(words: list[str], folder: Path, page: str) -> None:
    """A line of a page in `folder`, which is the working directory."""
    check_line(words, folder)
    if words[0] != "emclutch":
        return
    command = words[1]
    if command in QUICK:
        words = words + QUICK[command]
    elif command == "run" and page == IN_ORDER[0]:
        words = words + [word for key, value in TOY_RUN.items() for word in ("--set", f"{key}={value}")]
    else:
        return
    done = CliRunner().invoke(app, words[1:])
    assert done.exit_code == 0, f"{shlex.join(words)}\n{done.output}"


def importable(code: str) -> bool:
    names = re.findall(r"^\s*(?:from|import) (\w+)", code, re.M)
    return all(importlib.util.find_spec(name) for name in names)


def fits_a_scene(fragment: str, folder: Path) -> None:
    """A part of a scene makes a right scene in place of what the quickstart (with slots: that scene) has there."""
    given = tomllib.loads(fragment)
    slotted = any("slots" in key for key in given.get("geometry", {}))
    data = read_toml(ROOT / "cases" / ("slotted_disc.toml" if slotted else "quickstart.toml"))
    if "sizes" in given.get("particles", {}):
        data["particles"].pop("diameter")
    case_from(merged(data, given), {}, folder / "fragment.toml")


def merged(data: dict, given: dict) -> dict:
    result = copy.deepcopy(data)
    for key, value in given.items():
        both = isinstance(value, dict) and isinstance(result.get(key), dict)
        result[key] = merged(result[key], value) if both else value
    return result


@pytest.mark.parametrize("name", IN_ORDER)
def test_a_page_does_what_it_says(name, workplace, monkeypatch):
    monkeypatch.chdir(workplace)
    names: dict[str, object] = {}
    for block in blocks(DOCS / name):
        if block.language == "sh":
            for words in lines(block):
                execute(words, workplace, name)
        elif block.language == "python":
            code = compile(block.text, f"{name}: {block.caption}", "exec")
            if importable(block.text):
                exec(code, names)
        elif block.language == "toml" and not block.caption.endswith(".toml"):
            fits_a_scene(block.text, workplace)
        elif "." in block.caption:
            assert not os.path.exists(block.caption), f"{name}: {block.caption} is written twice"
            (workplace / block.caption).write_text(block.text, encoding="utf-8")
