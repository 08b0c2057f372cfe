"""A camera process, and the other end of its topics."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from hsslam_node.sources.options.synth import SynthOptions
from hsslam_services.run.camera_progress import CameraProgress
from hsslam_services.run.run_info import RunInfo
from tests.services.processes.other_end import OtherEnd

_ROOM = SynthOptions(width_px=64, height_px=48)


@pytest.fixture
def other_end(make_run: Callable[..., RunInfo]) -> Iterator[Callable[..., OtherEnd]]:
    """Start a camera process with these options, and the client that it talks to."""
    started: list[OtherEnd] = []

    def start(progress: CameraProgress | None = None, **options) -> OtherEnd:
        """`progress`: that of a camera that was there before and died."""
        run = make_run(synth=_ROOM, **options)
        if progress is not None:
            progress.write(Path(run.arena_dir))
        started.append(OtherEnd(run))
        return started[-1]

    yield start
    for end in started:
        end.camera.kill()
        end.bus.close()
