"""The commands that help before there is a scene: new, schema, doctor."""

from __future__ import annotations

import json

import typer

from emclutch.cli import options as opt
from emclutch.cli.errors import FAILED, explained, stop
from emclutch.cli.output import show
from emclutch.scene.errors import Fault, SceneError


def new(file: opt.NewScene = None, kind: opt.SceneKind = "drum", drawing: opt.Drawing = None) -> None:
    """Write a scene of a kind, with every key, its unit and what it is for; nothing is overwritten."""
    with explained():
        from emclutch.cli.new import draw_kind, new_scene

        if file is None and drawing is None:
            message = "is missing; name the new scene (.toml), or a picture of the dimensions with --drawing"
            raise SceneError([Fault("FILE", "", message)], "command line")
        drawn = [] if drawing is None else [draw_kind(drawing, kind)]
        for written in [*drawn, *([] if file is None else new_scene(file, kind))]:
            typer.echo(str(written))


def schema(out: opt.NewFile = None, markdown: opt.AsMarkdown = False) -> None:
    """Write the JSON schema of a scene, with which editors complete and check."""
    from emclutch.scene.model import Scene
    from emclutch.scene.reference import scene_reference

    text = scene_reference() if markdown else json.dumps(Scene.model_json_schema(), indent=2)
    text = text.rstrip("\n")
    if out is None:
        typer.echo(text)
        return
    with explained():
        with open(out, "x", encoding="utf-8") as stream:
            stream.write(text + "\n")
        typer.echo(str(out))


def doctor() -> None:
    """Check whether this machine has what the program needs."""
    from emclutch.cli.doctor import examine

    report, good = examine()
    show(report)
    if not good:
        stop(
            "something is missing; run `make setup`: it installs it, and names the shared libraries that gmsh lacks",
            FAILED,
        )
