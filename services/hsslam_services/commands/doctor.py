"""`hsslam-doctor`: checks a source before a run and reports its faults in plain words."""

import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import ClassVar, Literal

from rich.console import Console
from rich.table import Table
from rich.text import Text

from hsslam_node.doctor.examine import examine
from hsslam_node.doctor.finding import Finding
from hsslam_node.doctor.sample import Sample, take_sample
from hsslam_node.doctor.stamps import recorded_stamps
from hsslam_node.errors import UserError
from hsslam_node.kernels.cache_folder import writable_kernel_cache
from hsslam_node.sources.options.camera import CameraOptions, RealsenseOptions
from hsslam_node.sources.options.source import RecordOptions, SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_node.sources.options.topics import BagOptions, Ros2Options
from hsslam_services.camera.open_source import open_any_source
from hsslam_services.commands.cli import exit_code, parse_options
from hsslam_services.commands.output_files import expect_json_file, write_json_file
from hsslam_services.run.options import ServeOptions
from hsslam_services.run.source_table import ALL_SOURCES

_PROG = "hsslam-doctor"
_STYLES = {"ok": "green", "note": "yellow", "fault": "bold red"}


@dataclass(frozen=True)
class DoctorOptions:
    """Checks a camera or a recording before a run: time stamps, association of colour and depth, depth,
    intrinsics, registration, motion.

    Examples:
      hsslam-doctor tum:my_recording --json findings.json
      hsslam-doctor realsense

    Sources are those of hsslam-serve, except zenoh:. The command reads a few frames in runs of three, spread
    over the sequence (the first frames of a live camera), and all time stamps of a TUM folder or a log. It
    does not use ground truth.

    Exit codes: 0 if there is no fault, 1 if there are faults, 2 if the input is bad.

    Raises:
        UserError: an option has a value that cannot be used.
    """

    POSITIONALS: ClassVar = ("source",)
    BASIC: ClassVar = (
        *("source", "sample_frames", "json", "noise", "camera", "record", "ros2.color"),
        *("ros2.depth", "ros2.info", "ros2.domain", "ros2.connect", "realsense.serial"),
    )
    VALUES: ClassVar = {
        name: value for name, value in ServeOptions.VALUES.items() if "." in name
    } | {"source": "SOURCE"}

    source: str = ""
    """What to check, as in hsslam-serve --source: tum:FOLDER, record:FOLDER, mcap:FILE, ..."""
    sample_frames: int = 60
    """Check at most N frames."""
    json: Path | None = None
    """Output file of all findings, JSON."""
    noise: Literal["none", "kinect"] = "none"
    """Depth noise added to a source without noise."""
    synth: SynthOptions = field(default_factory=SynthOptions)
    camera: CameraOptions = field(default_factory=CameraOptions)
    record: RecordOptions = field(default_factory=RecordOptions)
    ros2: Ros2Options = field(default_factory=Ros2Options)
    bag: BagOptions = field(default_factory=BagOptions)
    realsense: RealsenseOptions = field(default_factory=RealsenseOptions)

    def __post_init__(self) -> None:
        if not 6 <= self.sample_frames <= 3000:
            raise UserError(f"--sample-frames {self.sample_frames}: expected 6 to 3000")


def main(args: Sequence[str] | None = None) -> None:
    """Run the command; exit code 0, 1 or 2, see `DoctorOptions`."""
    given = sys.argv[1:] if args is None else args
    sys.exit(exit_code(lambda: 1 if _check(_options(given)) else 0))


def _options(args: Sequence[str]) -> DoctorOptions:
    options = parse_options(DoctorOptions, _PROG, args)
    if not options.source:
        raise UserError("SOURCE: missing: expected what to check, as tum:FOLDER")
    return options


def _check(options: DoctorOptions) -> int:
    """Check the source and print the findings; returns the number of faults."""
    if options.json is not None:
        expect_json_file(options.json)
    writable_kernel_cache()
    wanted = SourceOptions.among(options)
    # a download shows its own progress bar
    stamps = recorded_stamps(options.source, ALL_SOURCES)
    with Console(stderr=True, markup=False).status(f"checking {options.source}"):
        sample = take_sample(options.source, wanted, options.sample_frames, open_any_source)
        findings = list(examine(sample, stamps))
    if options.json is not None:
        _write_json(options.json, sample, findings)
    console = Console(emoji=False, highlight=False, markup=False)
    console.print(_table(sample, findings))
    for finding in findings:
        if finding.severity == "fault":
            console.print(_remedy(finding), soft_wrap=True)
    faults = sum(finding.severity == "fault" for finding in findings)
    notes = sum(finding.severity == "note" for finding in findings)
    console.print(f"{_counted(faults, 'fault')}, {_counted(notes, 'note')}")
    return faults


def _counted(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def _table(sample: Sample, findings: Sequence[Finding]) -> Table:
    of = "" if sample.frame_count is None else f" of {sample.frame_count}"
    checked = len(sample.frames) + len(sample.bad)
    table = Table(
        title=f"{sample.name}: {checked}{of} frames checked", title_justify="left", expand=False
    )
    for name in ("check", "", "seen", "expected"):
        table.add_column(name, no_wrap=name in ("check", ""))
    for finding in findings:
        severity = Text(finding.severity, style=_STYLES[finding.severity])
        seen = finding.seen
        if finding.severity == "note" and finding.advice:
            seen = f"{seen}. {finding.advice[0].upper()}{finding.advice[1:]}"
        table.add_row(finding.name, severity, seen, finding.expected)
    return table


def _remedy(finding: Finding) -> Text:
    """A fault and its remedy in one line."""
    text = Text(f"{finding.name}: ", style=_STYLES["fault"])
    return text.append(f"{finding.seen}. To fix it: {finding.advice}.", style="not bold default")


def _write_json(path: Path, sample: Sample, findings: Sequence[Finding]) -> None:
    document = {
        "source": sample.name,
        "frames": sample.frame_count,
        "frames_looked_at": len(sample.frames) + len(sample.bad),
        "faults": sum(finding.severity == "fault" for finding in findings),
        "findings": [asdict(finding) for finding in findings],
    }
    write_json_file(path, document)


if __name__ == "__main__":
    main()
