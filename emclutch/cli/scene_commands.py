"""The commands that help before there is a scene: new, schema, doctor."""

from __future__ import annotations

import json

import typer

from emclutch.cli import options as opt
from emclutch.cli.errors import BAD_INPUT, FAILED, explained, stop
from emclutch.cli.output import show


def new(
    file: opt.NewScene, kind: opt.SceneKind = None, model: opt.FemmFile = None, powder: opt.PowderMaterial = None
) -> None:
    """Write a scene of a kind, or from a model of FEMM, with every key and its unit; nothing is overwritten."""
    with explained():
        from emclutch.cli.new import new_scene, new_scene_from

        if model is None and powder is not None:
            stop("--powder names a material of a model: give the model by --from", BAD_INPUT)
        if model is not None and kind is not None:
            stop("--kind and --from exclude each other: a model of FEMM is of kind cad", BAD_INPUT)
        for written in new_scene(file, kind or "drum") if model is None else new_scene_from(file, model, powder):
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
