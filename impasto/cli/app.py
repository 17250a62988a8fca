"""The `impasto` command: its subcommands, and the conversion of errors to messages and exit statuses."""

from __future__ import annotations

import errno
import gc
import logging
import os
import sys
import threading
from collections.abc import Sequence
from typing import Annotated, Any, NoReturn

import typer
from typer.exceptions import Abort, TyperException

from impasto.cli import (
    batch,
    doctor,
    formats,
    inspect,
    jobs,
    keys,
    live,
    methods,
    ops,
    owners,
    render,
    report,
    scene,
    serve,
    worker,
)
from impasto.cli.console import FAILED, INTERRUPTED, Interrupted, fail
from pipeline.errors import BadInput, ImpastoError
from workers.process.starting import WARM_UP_THREAD

app = typer.Typer(
    name="impasto",
    help="Turn video into paintings and cartoons that hold still where they should.",
    epilog="Start with `impasto render clip.mp4 -o cartoon.mp4`, or with `impasto serve` and a browser.",
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

HERE, REMOTE, INFORMATION = "On this machine", "At a service", "Information"


@app.callback()
def _global_options(
    version: Annotated[
        bool, typer.Option("--version", callback=doctor.print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Options before the command."""


app.command(epilog=render.EPILOG, rich_help_panel=HERE)(render.render)
app.command(epilog=batch.EPILOG, rich_help_panel=HERE)(batch.batch)
app.command(epilog=live.EPILOG, rich_help_panel=HERE)(live.live)
app.command(epilog=serve.EPILOG, rich_help_panel=HERE)(serve.serve)
app.command(epilog=worker.EPILOG, rich_help_panel=HERE)(worker.worker)
app.command(epilog=report.EPILOG, rich_help_panel=HERE)(report.report)
app.command(epilog=inspect.EPILOG, rich_help_panel=HERE)(inspect.inspect)
app.command(epilog=scene.EPILOG, rich_help_panel=HERE)(scene.scene)
app.add_typer(keys.app, name="keys", rich_help_panel=HERE)
app.command(epilog=jobs.SUBMIT_EPILOG, rich_help_panel=REMOTE)(jobs.submit)
for _command, _epilog in jobs.COMMANDS:
    app.command(epilog=_epilog, rich_help_panel=REMOTE)(_command)
app.add_typer(ops.app, name="ops", rich_help_panel=REMOTE)
app.add_typer(owners.app, name="owners", rich_help_panel=REMOTE)
app.command(epilog=methods.EPILOG, rich_help_panel=INFORMATION)(methods.methods)
app.command(rich_help_panel=INFORMATION)(formats.formats)
app.command(rich_help_panel=INFORMATION)(doctor.doctor)
app.command(rich_help_panel=INFORMATION)(doctor.version)


REMEDIES = {
    errno.ENOSPC: "Free some space, then run the same command again.",
    errno.EACCES: "Check the permissions, or name another path.",
    errno.EROFS: "Name a path that can be written to.",
    errno.EADDRINUSE: "Choose another port: --port 0 takes a free one.",
}
POSIX_MODULES = {"fcntl", "resource"}
"""Modules of Python that Windows lacks, and that farms and services need."""


def run(arguments: Sequence[str]) -> int:
    """Run one command line; return its exit status. Errors are printed, in one way, here only."""
    as_json = "--json" in arguments
    try:
        code: Any = app(args=list(arguments), prog_name="impasto", standalone_mode=False)
    except TyperException as error:
        return fail(_usage(error), as_json)
    except (Abort, KeyboardInterrupt):
        code = INTERRUPTED
    except ImpastoError as error:
        return fail(error, as_json)
    except ModuleNotFoundError as error:
        if error.name not in POSIX_MODULES:
            raise
        return fail(_without_posix(error), as_json)
    except BrokenPipeError:
        return FAILED
    except OSError as error:
        return fail(_system(error), as_json)
    if code == INTERRUPTED:
        return fail(Interrupted("Interrupted."), as_json)
    return code if isinstance(code, int) else 0


def _usage(error: TyperException) -> ImpastoError:
    return BadInput(error.format_message(), remedy="`impasto --help` and `impasto COMMAND --help` show how.")


def _without_posix(error: ModuleNotFoundError) -> ImpastoError:
    return BadInput(
        "This command needs Linux.", field="system", value=f"{sys.platform}, without {error.name}",
        remedy="Use a service on another computer (`impasto submit --server URL`), or `impasto.render` in Python.",
    )  # fmt: skip


def _system(error: OSError) -> ImpastoError:
    """An error of the operating system: a full disk, a missing permission, a port in use."""
    return ImpastoError(
        f"{error.strerror or type(error).__name__}.",
        field=str(error.filename or ""),
        remedy=REMEDIES.get(error.errno or 0, "Correct that, then run the same command again."),
    )


def main() -> None:
    """Entry point of the `impasto` command."""
    status = run(sys.argv[1:])
    if any(thread.name == WARM_UP_THREAD for thread in threading.enumerate()):
        _end_at_once(status)
    gc.freeze()  # without a search for cycles among all objects, the process ends 0.3 s sooner
    sys.exit(status)


def _end_at_once(status: int) -> NoReturn:
    """End the process while a thread still loads kernels, as after Ctrl-C in the first second.

    The interpreter would end that thread in the middle of C++ code, and the C++ library then aborts the process.
    """
    logging.shutdown()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)
