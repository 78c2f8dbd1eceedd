"""The commands that help before there is a scene: new, schema, doctor."""

from __future__ import annotations

import json

import typer

from emclutch.cli import options as opt
from emclutch.cli.errors import FAILED, explained, stop
from emclutch.cli.output import show


def new(file: opt.NewScene, kind: opt.SceneKind = "drum") -> None:
    """Write a scene of a kind, with every key, its unit and what it is for; nothing is overwritten."""
    with explained():
        from emclutch.cli.new import new_scene

        for written in new_scene(file, kind):
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
