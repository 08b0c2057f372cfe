"""Starts the commands that are no service; imports little, so that an early Ctrl-C ends them in one line."""

import importlib
import os
import signal
from typing import NoReturn


def certs() -> int | None:
    """Run `hsslam-certs`."""
    return _run("certs")


def ctl() -> int | None:
    """Run `hsslam-ctl`."""
    return _run("ctl")


def doctor() -> int | None:
    """Run `hsslam-doctor`."""
    return _run("doctor")


def evaluate() -> int | None:
    """Run `hsslam-eval`."""
    return _run("evaluate.command")


def log() -> int | None:
    """Run `hsslam-log`."""
    return _run("log.command")


def maps() -> int | None:
    """Run `hsslam-map`."""
    return _run("maps.command")


def mesh() -> int | None:
    """Run `hsslam-mesh`."""
    return _run("maps.mesh")


def render() -> int | None:
    """Run `hsslam-render`."""
    return _run("maps.render")


def replay() -> int | None:
    """Run `hsslam-replay`."""
    return _run("log.replay")


def _run(module: str) -> int | None:
    """Import the module of a command and run it; SIGINT ends the import at once with exit code 1.

    It raises no KeyboardInterrupt meanwhile: the import of a compiled module may catch it and go on.
    """
    before = signal.getsignal(signal.SIGINT)
    if before is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end)
    main = importlib.import_module(f"hsslam_services.commands.{module}").main
    signal.signal(signal.SIGINT, before)
    return main()


def _end(*_: object) -> NoReturn:
    os.write(2, b"interrupted\n")
    os._exit(1)
