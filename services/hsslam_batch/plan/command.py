"""`hsslam-batch plan`: finds logs, checks the options of their runs, writes manifest and configuration."""

import os
import shlex
from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from rich.progress import BarColumn, MofNCompleteColumn, TextColumn

from hsslam_batch.options import PlanOptions
from hsslam_batch.plan.batch import folder_of, planned_batch, write_batch
from hsslam_batch.plan.find_logs import find_logs, is_utf8, with_frames
from hsslam_batch.plan.listing import Listing, list_folder
from hsslam_batch.plan.lock import alone
from hsslam_batch.plan.log import write_manifest
from hsslam_batch.plan.remote_listing import is_url, list_url
from hsslam_batch.plan.unplanned_results import unplanned_results
from hsslam_node.errors import UserError
from hsslam_node.user_path import user_path
from hsslam_services.commands.cli import QUESTIONS, parse_options, terminal_progress
from hsslam_services.commands.options.parser import parsed
from hsslam_services.commands.serve_command_line import parse_command_line
from hsslam_services.run.config_file import config_text
from hsslam_services.run.maps_folder import find_map
from hsslam_services.run.options import ServeOptions

_PROG = "hsslam-batch plan"
_OUT = "--out"
_SET_BY_BATCH = ("source", "out", "zenoh_port", "bind", "security", "metrics_port", "ros2_out")


def plan_command(args: Sequence[str]) -> None:
    """Write manifest and configuration; print counts and the next command.

    Raises:
        UserError: no logs, an option of hsslam-serve that is wrong or that the batch sets itself, a folder
            that is not writable, or a run of the batch is running.
    """
    own, serve_args = _split(args)
    options = parse_options(PlanOptions, _PROG, own)
    if not options.logs or not options.out:
        raise UserError(f"plan {' '.join(args)}: expected LOGS --out OUT")
    serve = run_options(serve_args)
    out, url = folder_of(options.out)
    place = url or str(out)
    for name in (options.logs, place):
        if not is_utf8(name):
            raise UserError(f"{name!r}: is not UTF-8: expected a path in UTF-8")
    for line in config_text(serve).splitlines():
        if not is_utf8(line):
            raise UserError(f"{line!r}: is not UTF-8: expected a value in UTF-8")
    found = find_logs(_listing(options.logs, place))
    columns = (TextColumn("counting frames"), BarColumn(), MofNCompleteColumn())
    with terminal_progress(*columns) as progress:
        counting = with_frames(found, serve.source_options)
        logs = list(progress.track(counting, total=len(found)))
    batch, text = planned_batch(out, serve, options.logs, url)
    try:
        out.mkdir(parents=True, exist_ok=True)
        with alone(out, place):
            write_manifest(out, logs)
            write_batch(batch, text)
            unplanned = unplanned_results(batch, logs)
    except OSError as error:
        reason = error.strerror or str(error)
        raise UserError(f"--out {place}: {reason}: expected a folder that can be written") from None
    nbytes, frames = sum(log.nbytes for log in logs), sum(log.frames for log in logs)
    print(f"{len(logs)} logs, {nbytes / 1e9:.2f} GB, {frames} frames")
    if unknown := sum(not log.frames for log in logs):
        print(f"{unknown} of them: number of frames not known before the run")
    if unplanned.count:
        print(unplanned.line())
    about = batch.about
    print(f"configuration {about.configuration}, code {about.code} ({about.digest})")
    print(f"next: hsslam-batch run {shlex.quote(options.out)}")


def run_options(serve_args: Sequence[str]) -> ServeOptions:
    """The options of every run, from the options of hsslam-serve on the command line.

    Options that the batch sets itself are ignored in a configuration file, which may come from one run.

    Raises:
        UserError: an option is wrong, or the command line has one that the batch sets itself.
    """
    given = parse_command_line(serve_args)
    named = parsed(ServeOptions, _PROG, serve_args)
    for name in _SET_BY_BATCH:
        if name in named:
            flag = f"--{name.replace('_', '-')}"
            raise UserError(f"{flag} {named[name]}: expected no such option: the batch "
                            "sets sources and folders, and opens no ports")  # fmt: skip
    if named.get("pace") == "realtime":
        raise UserError("--pace realtime: expected lockstep, which uses every frame")
    if (viewer := named.get("viewer", "none")) not in ("auto", "none"):
        raise UserError(f"--viewer {viewer}: expected none: a batch starts no viewer")
    saved = str(find_map(given.maps, given.map)) if given.map else ""
    mask = str(user_path(given.mask).absolute()) if given.mask else ""
    if mask and not Path(mask).exists():
        raise UserError(f"--mask {given.mask}: no such file or folder: expected a mask of each run")
    usual: dict[str, Any] = {
        field.name: field.default for field in fields(given) if field.name in _SET_BY_BATCH
    }
    return replace(given, **usual, pace="lockstep", viewer="none", map=saved, mask=mask)


def _listing(logs: str, place: str) -> Listing:
    """All files below LOGS, except those of the batch.

    Raises:
        UserError: the next plan would take the results of the batch for logs.
    """
    folder, url = folder_of(logs)
    below, own = (p if is_url(p) else os.path.realpath(p) for p in (url or str(folder), place))
    if below == own or f"{below}/".startswith(f"{own}/runs/"):
        raise UserError(
            f"--out {place}: its results would be among the logs of {logs}: expected another folder"
        )
    return list_url(url, without=place) if url else list_folder(folder, without=place)


def _split(args: Sequence[str]) -> tuple[list[str], list[str]]:
    """The arguments of `plan` (those before the first option, --out, --help, ...), and of hsslam-serve."""
    own: list[str] = []
    rest = list(args)
    while rest and not rest[0].startswith("-"):
        own.append(rest.pop(0))
    serve_args: list[str] = []
    while rest:
        word = rest.pop(0)
        if word == _OUT:
            own += [word, *rest[:1]]
            rest = rest[1:]
        elif word.startswith(f"{_OUT}=") or word in QUESTIONS:
            own.append(word)
        else:
            serve_args.append(word)
    return own, serve_args
