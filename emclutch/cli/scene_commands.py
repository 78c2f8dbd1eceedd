"""The commands that help before there is a scene: new, schema, doctor."""

from __future__ import annotations

import json

import typer

from emclutch.cli import options as opt
from emclutch.cli.errors import FAILED, explained, stop
from emclutch.cli.input import refuse_beside, refuse_without
from emclutch.cli.output import show
from emclutch.scene.errors import Fault, SceneError


def new(
    file: opt.NewScene = None,
    kind: opt.SceneKind = None,
    model: opt.FemmFile = None,
    powder: opt.PowderMaterial = None,
    drawing: opt.Drawing = None,
) -> None:
    """Write a new scene file with every key and its unit, for a kind of device or from a FEMM model."""
    with explained():
        from emclutch.cli.new import draw_dimensions_of, new_scene, new_scene_from

        if file is None and (drawing is None or model is not None):
            message = "is missing; name the new scene (.toml), or a picture of the dimensions with --drawing"
            raise SceneError([Fault("FILE", "", message)], "command line")
        if model is None:
            refuse_without("--from", {"--powder": powder is not None})
        else:
            refuse_beside("--from", {"--kind": kind is not None, "--drawing": drawing is not None})
        is_there = file is not None and drawing is not None and kind is None and file.is_file()
        written: list = []
        if drawing is not None:
            written.append(draw_dimensions_of(drawing, kind or "drum", file if is_there else None))
        if file is not None and model is not None:
            paths, notes = new_scene_from(file, model, powder)
            written += [*paths, *notes]
        elif file is not None and not is_there:
            written += new_scene(file, kind or "drum")
        for line in written:
            typer.echo(str(line))


def schema(out: opt.NewFile = None, markdown: opt.AsMarkdown = False) -> None:
    """Write the JSON schema of a scene, so that editors can complete and check keys."""
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
