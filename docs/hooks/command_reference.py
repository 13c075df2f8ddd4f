"""The help of every command, as the terminal shows it."""

from __future__ import annotations

import click

from skinrender.cli import main


def command_reference() -> str:
    """A section for each command with its ``--help``."""
    parent = click.Context(main, info_name="skinrender", **main.context_settings)
    sections = []
    for name in main.list_commands(parent):
        command = main.commands[name]
        with click.Context(command, info_name=name, parent=parent, terminal_width=96) as context:
            sections.append(f"## {name} {{ #{name} }}\n\n```text\n{command.get_help(context)}\n```")
    return "\n\n".join(sections) + "\n"
