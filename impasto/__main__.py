"""Entry point of the `impasto` command, also as `python -m impasto`."""

from __future__ import annotations

import sys


def main() -> None:
    """Run the command line. For `impasto render`, the decoder server starts beside the imports of this process, which
    take about as long as its own."""
    if sys.argv[1:2] == ["render"] and not {"-h", "--help"} & set(sys.argv):
        from pipeline.video.guard.decoder_server import start_decoder_server

        start_decoder_server()
    from impasto.cli.app import main as run

    run()


if __name__ == "__main__":
    main()
