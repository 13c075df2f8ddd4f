"""``python -m skinrender.cli``: the command line where its script is not installed."""

from skinrender.cli import main

main(prog_name="skinrender")
