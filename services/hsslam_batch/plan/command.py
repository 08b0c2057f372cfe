"""`hsslam-batch plan`: finds logs, checks the options of their runs, writes both down."""

import os
from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path

from rich.progress import BarColumn, MofNCompleteColumn, TextColumn

from hsslam_batch.options import PlanOptions
from hsslam_batch.plan.batch import folder_of, write_batch
from hsslam_batch.plan.find_logs import find_logs, is_utf8, with_frames
from hsslam_batch.plan.listing import Listing, list_folder
from hsslam_batch.plan.lock import alone
from hsslam_batch.plan.log import write_manifest
from hsslam_batch.plan.remote_listing import is_url, list_url
from hsslam_node.errors import UserError
from hsslam_node.user_path import user_path
from hsslam_services.commands.cli import QUESTIONS, parse_options, terminal_progress
from hsslam_services.commands.options.parser import parsed
from hsslam_services.commands.serve_command_line import parse_command_line
from hsslam_services.run.maps_folder import find_map
from hsslam_services.run.options import ServeOptions

_PROG = "hsslam-batch plan"
_OUT = "--out"
_OF_EACH_RUN = ("source", "out", "zenoh_port", "bind", "security", "metrics_port", "ros2_out")


def plan_command(args: Sequence[str]) -> None:
    """Write manifest and configuration; print what was found.

    Raises:
        UserError: no logs, an option of hsslam-serve that is wrong or that each run decides, a folder that
            cannot be written, or a run of the batch that goes on.
    """
    own, of_serve = _split(args)
    options = parse_options(PlanOptions, _PROG, own)
    if not options.logs or not options.out:
        raise UserError(f"plan {' '.join(args)}: expected LOGS --out OUT")
    serve = run_options(of_serve)
    out, url = folder_of(options.out)
    place = url or str(out)
    for name in (options.logs, place):
        if not is_utf8(name):
            raise UserError(f"{name!r}: is not UTF-8: expected a path in UTF-8")
    found = find_logs(_listing(options.logs, place))
    columns = (TextColumn("counting frames"), BarColumn(), MofNCompleteColumn())
    with terminal_progress(*columns) as progress:
        counting = with_frames(found, serve.source_options)
        logs = list(progress.track(counting, total=len(found)))
    try:
        out.mkdir(parents=True, exist_ok=True)
        with alone(out, place):
            write_manifest(out, logs)
            batch = write_batch(out, serve, options.logs, url)
    except OSError as error:
        reason = error.strerror or str(error)
        raise UserError(f"--out {place}: {reason}: expected a folder that can be written") from None
    nbytes, frames = sum(log.nbytes for log in logs), sum(log.frames for log in logs)
    print(f"{len(logs)} logs, {nbytes / 1e9:.2f} GB, {frames} frames")
    if unknown := sum(not log.frames for log in logs):
        print(f"{unknown} of them have frames that only their run can count")
    about = batch.about
    print(f"configuration {about.configuration}, code {about.code} ({about.digest})")
    print(f"next: hsslam-batch run {options.out}")


def run_options(of_serve: Sequence[str]) -> ServeOptions:
    """The options of every run, from those of the command line.

    What each run decides is left out of files, as that of a run that is to be repeated on all logs.

    Raises:
        UserError: one that is wrong, or that the command line gives though each run decides it.
    """
    given = parse_command_line(of_serve)
    named = parsed(ServeOptions, _PROG, of_serve)
    for name in _OF_EACH_RUN:
        if name in named:
            flag = f"--{name.replace('_', '-')}"
            raise UserError(f"{flag} {named[name]}: expected no such option: runs of a "
                            "batch have their own sources and folders and no ports")  # fmt: skip
    if named.get("pace") == "realtime":
        raise UserError("--pace realtime: expected lockstep, which uses every frame")
    if (viewer := named.get("viewer", "none")) not in ("auto", "none"):
        raise UserError(f"--viewer {viewer}: expected none: a batch shows no run")
    saved = str(find_map(given.maps, given.map)) if given.map else ""
    mask = str(user_path(given.mask).absolute()) if given.mask else ""
    if mask and not Path(mask).exists():
        raise UserError(f"--mask {given.mask}: no such file or folder: expected a mask of each run")
    usual = {field.name: field.default for field in fields(given) if field.name in _OF_EACH_RUN}
    return replace(given, **usual, pace="lockstep", viewer="none", map=saved, mask=mask)


def _listing(logs: str, place: str) -> Listing:
    """All files below LOGS but those of the batch.

    Raises:
        UserError: the results of the batch would be logs of the next plan.
    """
    folder, url = folder_of(logs)
    below, own = (p if is_url(p) else os.path.realpath(p) for p in (url or str(folder), place))
    if below == own or f"{below}/".startswith(f"{own}/runs/"):
        raise UserError(
            f"--out {place}: its results would be among the logs of {logs}: expected another folder"
        )
    return list_url(url, without=place) if url else list_folder(folder, without=place)


def _split(args: Sequence[str]) -> tuple[list[str], list[str]]:
    """Our words (those before the first option, --out, questions), and those of hsslam-serve."""
    own: list[str] = []
    rest = list(args)
    while rest and not rest[0].startswith("-"):
        own.append(rest.pop(0))
    of_serve: list[str] = []
    while rest:
        word = rest.pop(0)
        if word == _OUT:
            own += [word, *rest[:1]]
            rest = rest[1:]
        elif word.startswith(f"{_OUT}=") or word in QUESTIONS:
            own.append(word)
        else:
            of_serve.append(word)
    return own, of_serve
