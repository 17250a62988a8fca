"""`python -m impasto`: the command, without the script."""

from impasto.cli.app import main

main()
