"""skinrender schema: the scene's JSON Schema."""

from __future__ import annotations

import json

import click

from skinrender.cli.console import Console
from skinrender.cli.options import reporting


@click.command()
@reporting
def schema(console: Console) -> None:
    """Print the JSON Schema of scene files, for editors that complete and check YAML.

    \b
    Example:
      skinrender schema > scene.schema.json
    and as the first line of a scene:  # yaml-language-server: $schema=scene.schema.json
    """
    from skinrender.scene import json_schema

    click.echo(json.dumps(json_schema(), indent=2, ensure_ascii=False))
