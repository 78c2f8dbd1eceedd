"""Directive `command-reference`: every command with its arguments and options, as the command line itself has them."""

from __future__ import annotations

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective
from typer.main import get_command

from emclutch.cli.main import app as command_line


def command_pages() -> str:
    """Markdown: a section a command."""
    lines: list[str] = []
    for name, command in sorted(get_command(command_line).commands.items()):
        arguments = [shown(one) for one in command.params if one.param_type_name == "argument"]
        call = " ".join(["emclutch", name, *arguments, "[OPTIONS]"])
        lines += [f"## {name}", "", command.help or "", "", f"`{call}`", "", "| | |", "|---|---|"]
        lines += [f"| `{shown(one)}` | {(one.help or '').replace('|', chr(92) + '|')} |" for one in command.params]
        lines.append("")
    return "\n".join(lines)


def shown(parameter) -> str:
    """An argument or option as one types it."""
    if parameter.param_type_name == "argument":
        return parameter.metavar
    value = "" if parameter.is_flag else f" {parameter.metavar or 'VALUE'}"
    return f"{parameter.opts[-1]}{value}"


class CommandReference(SphinxDirective):
    def run(self) -> list[nodes.Node]:
        return self.parse_text_to_nodes(command_pages(), allow_section_headings=True)


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_directive("command-reference", CommandReference)
    return {"parallel_read_safe": True}
