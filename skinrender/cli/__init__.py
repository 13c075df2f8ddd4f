"""The command line: one small module a command, each a thin shell over the library.

Importing this package imports click and nothing heavy; each command imports what it needs when it runs.
"""

from __future__ import annotations

from importlib import import_module

import click

from skinrender.cli.failures import FailureGroup

COMMANDS = (
    "plan", "build", "trace", "merge", "estimate", "render", "spectrum", "report", "compare", "check", "export", "info", "schema"
)  # fmt: skip


class OrderedGroup(FailureGroup):
    """Lists the commands in the order of their use."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self.commands)


def _print_versions(ctx: click.Context, _option: click.Parameter, wanted: bool) -> None:
    if not wanted or ctx.resilient_parsing:
        return
    from skinrender.cli.versions import version_lines

    click.echo("\n".join(version_lines()))
    ctx.exit()


@click.group(cls=OrderedGroup, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.option(
    "--version", is_flag=True, is_eager=True, expose_value=False, callback=_print_versions,
    help="Show the versions of skinrender, numba and numpy, and the CPU.",
)  # fmt: skip
def main() -> None:
    """Render human skin from its inside: voxel volume, spectral photons, photon map, picture.

    \b
    Example:
      skinrender render configs/smoke_beam.yaml
    writes out/smoke_beam/beam.exr and beam.png. The same in steps:
      skinrender build configs/smoke_beam.yaml
      skinrender trace configs/smoke_beam.yaml
      skinrender estimate configs/smoke_beam.yaml

    Exit codes: 0 done, 1 the run failed, 2 bad use or bad input, 130 interrupted (what was finished is kept).
    """


for _name in COMMANDS:
    main.add_command(getattr(import_module(f"skinrender.cli.{_name}"), _name))
