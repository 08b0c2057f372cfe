"""One kind of source as a row of a table, and look-ups in such a table: find, guess, suggest."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from hsslam_node.errors import UserError, did_you_mean
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.user_path import user_path


@dataclass(frozen=True)
class SourceRow:
    """One kind of source. Import paths are `module:name`; they are imported when a source is opened.

    `name` is the text after the colon.
    """

    kind: str
    """The text before the colon."""
    examples: tuple[str, ...]
    """What a user types; shown in errors."""
    brief: str
    """What it is, in a few words; shown by `hsslam-serve --help`."""
    about: str
    """What it is, in one line of markdown; shown in docs/cameras.md."""
    opener: str | None
    """Import path of `(name, options) -> Source`, of a live camera `(name, options, should_stop)`. None:
    frames come over the bus, there is nothing to open."""
    only_examples: bool = False
    """True: only the examples exist; False: any name after the colon."""
    is_live: bool = False
    """True: frames come on the camera's own clock, and a frame that is not read is lost."""
    needs_port: bool = False
    """True: programs outside the run send the frames, so its router listens on a port."""
    only_forwards: bool = False
    """True: its frames cannot be played backwards or held. Those of live cameras never can."""
    reads_to_count: bool = False
    """True: opening it reads the recording up to the last frame of `--frames`, which may take minutes."""
    camera_options: tuple[str, ...] | None = None
    """Fields of `CameraOptions` that it reads; others are refused. None: all, or a plugin checks them."""
    check: str | None = None
    """Import path of `(name, options)`; raises UserError if a live camera is missing. Opens nothing."""
    looks_like: Callable[[Path], bool] = lambda path: False
    """Whether a file or folder is of this kind, to suggest it in errors."""
    beside: tuple[str, ...] = ()
    """Files beside a recording that its source or the ground truth may read; `{name}` is the name of the
    recording, `{stem}` the name without suffix."""
    ground_truth: str | None = None
    """Import path of `(name, options) -> Truth | None`, read by the evaluator alone."""
    stamps: str | None = None
    """Import path of `(name) -> (colour, depth or None)`: all stamps in the order of the recording, [N]
    int64 ns, for the doctor."""
    package: str = ""
    """The installed package that it comes from; empty: this one."""
    fault: str = ""
    """Why its sources cannot be opened; empty: they can."""

    def matches(self, spec: str) -> bool:
        """Whether `spec` is a source of this kind."""
        kind, _, name = spec.partition(":")
        if self.fault:
            return kind == self.kind
        if self.only_examples:
            return spec in self.examples
        # `orbbec` alone is an example, too: the first camera found
        return kind == self.kind and (bool(name) or spec in self.examples)


def refuse_unread_options(row: SourceRow, spec: str, options: SourceOptions) -> None:
    """Raises UserError if an option is set that sources of this kind do not read."""
    if options.reorders and (row.only_forwards or row.is_live):
        raise UserError(
            f"--to-and-fro, --hold-frames: source {spec} plays forwards only: expected image files or synth:"
        )
    reads = row.camera_options
    if reads is None:
        return
    for name, value in options.camera.given().items():
        if name not in reads:
            number = " ".join(map(str, value)) if isinstance(value, list) else value
            others = ", ".join(f"--camera.{read.replace('_', '-')}" for read in reads)
            expected = f"only {others}" if others else "no --camera option"
            raise UserError(
                f"--camera.{name.replace('_', '-')} {number}: source {spec} has its own camera: "
                f"expected {expected}"
            )


def find_row(spec: str, rows: Sequence[SourceRow]) -> SourceRow | None:
    """The row of the source that `spec` names; None if there is none."""
    return next((row for row in rows if row.matches(spec)), None)


def source_name(spec: str) -> str:
    """The text after the colon."""
    return spec.partition(":")[2]


def imported(path: str) -> Callable[..., Any]:
    """The object of an import path `module:name` of a row."""
    module, _, name = path.partition(":")
    return getattr(import_module(module), name)


def guess_source(place: str, rows: Sequence[SourceRow]) -> str:
    """The source that would open this file or folder, as `tum:PLACE`; empty if nothing fits."""
    path = user_path(place)
    try:
        if place and path.exists():
            for row in rows:
                if row.looks_like(path):
                    return f"{row.kind}:{place}"
    except OSError:  # no permission, or too long for a file name
        return ""
    return ""


def source_examples(rows: Sequence[SourceRow]) -> tuple[str, ...]:
    """The examples of all kinds."""
    return tuple(example for row in rows for example in row.examples)


def unknown_source(spec: str, rows: Sequence[SourceRow]) -> UserError:
    """The error for a spec that names no source, with the nearest one that exists."""
    examples = source_examples(rows)
    found = guess_source(spec, rows)
    hint = f"; did you mean {found}?" if found else did_you_mean(spec, examples, cutoff=0.4)
    return UserError(f"source {spec!r}: expected one of {', '.join(examples)}{hint}")


def has_names(*choices: tuple[str, ...]) -> Callable[[Path], bool]:
    """For `looks_like`: a folder that holds all names of one of the choices."""
    return lambda path: any(all((path / name).exists() for name in names) for names in choices)


def has_files(*patterns: str) -> Callable[[Path], bool]:
    """For `looks_like`: a folder with a file for each of the patterns."""
    return lambda path: path.is_dir() and all(any(path.glob(each)) for each in patterns)


def has_suffix(suffix: str) -> Callable[[Path], bool]:
    """For `looks_like`: a file with this suffix."""
    return lambda path: path.is_file() and path.suffix == suffix


def either(*signs: Callable[[Path], bool]) -> Callable[[Path], bool]:
    """For `looks_like`: one of these holds."""
    return lambda path: any(sign(path) for sign in signs)
