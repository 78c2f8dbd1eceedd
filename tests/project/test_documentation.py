"""What the documentation says is so: its links, files, commands, options and scenes exist; its Python runs.

Lines of the first two pages of the tutorial are executed, the run at toy size, and the design search of the third,
which must reach its target. All others are parsed by the command line itself, and the scenes that they name are loaded
with the values that they set.
"""

from __future__ import annotations

import copy
import importlib.util
import re
import shlex
import sys
import textwrap
import tomllib
from pathlib import Path
from types import SimpleNamespace

import pytest
from step_file import write_polygons
from typer.main import get_command
from typer.testing import CliRunner

from emclutch.cli.input import load
from emclutch.cli.main import app
from emclutch.scene.case import case_from, load_case, read_toml
from emclutch.scene.study import read_study

ROOT = Path(__file__).resolve().parents[2]
DOCS, CASES = ROOT / "docs", ROOT / "cases"
PAGES = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "geometry/kernels/README.md", "tests/hard/README.md")]
PAGES += [page for page in sorted(DOCS.rglob("*.md")) if "_build" not in page.parts]
TUTORIAL = [DOCS / "tutorial" / f"{name}.md" for name in ("first_torque", "reading_results", "own_device")]
IN_ORDER = [*TUTORIAL, *sorted((DOCS / "how_to").glob("*.md"))]  # in a folder that has `cases` as a new user's has
FOLDERS = ("geometry", "field", "particles", "coupling", "emclutch", "tests", "cases", "docs")
RULES = (ROOT / "Makefile").read_text(encoding="utf-8")
COMMANDS = get_command(app).commands
RUN = {"field.size_factor": 4, "output.pictures": "false", "particles.solid_fraction": 0.05, "accuracy.replicas": 1,
       "time.end": "0.02 ms", "time.until": "none"}  # fmt: skip
COARSE = {"field.size_factor": 4}
EXECUTED = {"doctor": {}, "report": {}, "plot": {}, "run": RUN, "design": COARSE}  # with these settings
ELSEWHERE = {"sensitivity"}  # its Python needs a finished study: tests/studies/test_sensitivity_how_to.py
FENCE = re.compile(r"^( *)(`{3,}|:{3,})([^\n]*)\n(.*?)^\1\2[ ]*$", re.M | re.S)


def blocks(page: Path):
    """(language, caption, text) of the fenced blocks; a caption is the name of a file."""
    for indent, _, language, text in FENCE.findall(page.read_text(encoding="utf-8")):
        text, caption = textwrap.dedent(text) if indent else text, ""
        if language.startswith("{code-block}"):
            options, _, text = text.partition("\n\n")
            caption = options.removeprefix(":caption:").strip()
        yield language.split()[-1] if language else "", caption, text


def shell_lines(text: str) -> list[list[str]]:
    joined = re.sub(r"\\\n\s*", " ", text)
    return [words for line in joined.splitlines() if (words := shlex.split(line, comments=True))]


def prose(page: Path) -> str:
    return FENCE.sub("", page.read_text(encoding="utf-8"))


def quoted(page: Path) -> list[str]:
    """What stands between single backticks."""
    return re.findall(r"(?<!`)`([^`\n]+)`(?!`)", prose(page))


def headings(page: Path) -> set[str]:
    heads = re.findall(r"^#+ (.*)$", prose(page), re.M)
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


def test_links_lead_somewhere_and_files_that_the_text_names_are_in_the_tree():
    wrong = []
    for page in PAGES:
        for target in re.findall(r"\]\(([^)\s]+)\)", prose(page)):
            path, _, anchor = target.partition("#")
            there = (page.parent / path).resolve() if path else page
            if "://" not in target and not (there.exists() and (not anchor or anchor in headings(there))):
                wrong.append(f"{page.name}: link to {target}")
        for path in {word.rstrip(".,;:") for code in quoted(page) for word in code.split()} - {"paraview.py"}:
            inside = re.fullmatch(r"([\w.*-]+)(/[\w.*-]+)*/?", path)
            if inside and "/" in path and inside[1] in {*FOLDERS, *(one.name for one in CASES.iterdir())}:
                found = [*ROOT.glob(path), *CASES.glob(path), *CASES.glob(f"{path}.toml")]
            elif inside and path.endswith(".py"):
                found = [file for folder in FOLDERS for file in (ROOT / folder).rglob(path)]
            else:
                continue
            if not found:
                wrong.append(f"{page.name}: `{path}`")
    assert wrong == []


def test_formulas_are_of_letters_that_the_converter_to_mathml_knows():
    """It stops the build of the pages at a degree sign, for instance."""
    formulas = re.compile(r"\$\$.*?\$\$|\$[^$\n]+\$", re.S)
    found = {page.name: [one for one in formulas.findall(prose(page)) if not one.isascii()] for page in PAGES}
    assert {name: wrong for name, wrong in found.items() if wrong} == {}


def check_line(words: list[str], folder: Path) -> None:
    """A shell line: options and files exist, and a scene is right with the values that the line sets."""
    if "|" in words:
        check_line(words[words.index("|") + 1 :], folder)
        words = words[: words.index("|")]
    words = [word.replace("$SLURM_ARRAY_TASK_ID", "0") for word in words]
    program, line = words[0].removeprefix(".venv/bin/"), shlex.join(words)
    if program == "emclutch" and words[1] not in ("--version", "--help"):
        given = COMMANDS[words[1]].make_context(words[1], words[2:]).params
        if given.get("study") is not None:
            read_study(folder / given["study"])
        if given.get("case") is not None and not given.get("resume"):
            load(folder / given["case"], given.get("sets"))
    elif program == "make":
        for name, equals, value in (word.partition("=") for word in words[1:]):
            assert re.search(rf"^{name}" + (r"\s*\?=" if equals else ":"), RULES, re.M), line
            assert name != "CASE" or (ROOT / value).is_file(), line
    elif program.startswith("python"):
        assert words[1] in ("-m", "-c") or (ROOT / words[1]).is_file(), line


def test_shell_lines_are_right_and_commands_that_the_text_names_exist():
    """`emclutch run CASE --resume` in a sentence, and the rows of the table of commands."""
    for page in PAGES:
        for language, _, text in blocks(page):
            for words in shell_lines(text) if language == "sh" and page not in IN_ORDER else ():
                check_line(words, ROOT)
        for code in quoted(page):
            program, *words = re.sub(r"[\[\]']", " ", code).split() or [""]
            if program == "make":
                check_line([program, *words], ROOT)
            elif program in COMMANDS and words and re.match("[A-Z]{3}", words[0]):
                words = [program, *words]
            elif program != "emclutch" or not words or words[0].startswith("-") or words[0].isupper():
                continue
            for name in words[0].split("|") if program != "make" else ():
                known = {one for option in COMMANDS[name].params for one in option.opts} if name in COMMANDS else ()
                options = {word.split("=")[0] for word in words if word.startswith("--")}
                assert name in COMMANDS and options <= set(known), f"{page.name}: `{code}`"


@pytest.fixture(scope="module")
def workplace(tmp_path_factory):
    """A new user's folder: the scenes that ship, and a device from a CAD program."""
    folder = tmp_path_factory.mktemp("documentation")
    (folder / "cases").symlink_to(CASES)
    write_polygons(folder / "device.step", load_case(CASES / "quickstart.toml").scene.shape().section_polygons())
    return folder


def execute(words: list[str], page: Path, folder: Path) -> None:
    check_line(words, folder)
    if words[0] == "emclutch" and words[1] in EXECUTED and page in TUTORIAL[: 3 if words[1] == "design" else 2]:
        words = words + [word for key, value in EXECUTED[words[1]].items() for word in ("--set", f"{key}={value}")]
        done = CliRunner().invoke(app, words[1:])
        assert done.exit_code == 0, f"{shlex.join(words)}\n{done.output}"


def merged(data: dict, given: dict) -> dict:
    result = copy.deepcopy(data)
    for key, value in given.items():
        both = isinstance(value, dict) and isinstance(result.get(key), dict)
        result[key] = merged(result[key], value) if both else value
    return result


def fits_a_scene(fragment: str, folder: Path) -> None:
    """A part of a scene makes a right scene in place of what the quickstart (with slots: that scene) has there."""
    given = tomllib.loads(fragment)
    slotted = any("slots" in key for key in given.get("geometry", {}))
    data = read_toml(CASES / ("slotted_disc.toml" if slotted else "quickstart.toml"))
    if "sizes" in given.get("particles", {}):
        data["particles"].pop("diameter")
    case_from(merged(data, given), {}, folder / "fragment.toml")


@pytest.mark.parametrize("page", IN_ORDER, ids=lambda page: page.stem)
def test_a_page_does_what_it_says(page, workplace, monkeypatch):
    monkeypatch.chdir(workplace)
    names: dict[str, object] = {}
    for language, caption, text in blocks(page):
        if language == "sh":
            for words in shell_lines(text):
                execute(words, page, workplace)
        elif language == "python" and page.stem not in ELSEWHERE:
            packages = re.findall(r"^\s*(?:from|import) (\w+)", text, re.M)
            if all(importlib.util.find_spec(name) for name in packages):
                exec(compile(text, f"{page.name}: {caption}", "exec", dont_inherit=True), names)
            if caption.endswith(".py"):  # later blocks import it
                path = caption.removesuffix(".py").replace("/", ".")
                monkeypatch.setitem(sys.modules, path, SimpleNamespace(**names))
            for test in [name for name in names if name.startswith("test_")]:
                names.pop(test)()
        elif language == "toml" and not caption.endswith(".toml"):
            fits_a_scene(text, workplace)
        elif "." in caption:
            assert not (workplace / caption).exists(), f"{page.name}: {caption} is written twice"
            (workplace / caption).write_text(text, encoding="utf-8")
