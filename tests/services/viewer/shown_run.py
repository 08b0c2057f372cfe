"""A run that is shown to a viewer; alone, as tests of the file and of live viewers use it."""

import time

from hsslam_proto import messages, run_messages
from hsslam_services.viewer.view import RerunView
from tests.services.wire_samples import frame, keyframe, mesh, pose


def show_a_run(view: RerunView) -> None:
    view.show(keyframe(0))
    for index in range(100):
        if index % 10 == 0:
            view.show(frame(index, compressed=True))
            time.sleep(0.02)
        view.show(pose(index, status="lost" if index == 50 else "tracked"))
    view.show(keyframe(40))
    view.show(messages.MapVersion(version=1, iterations=10, loss=0.5, keyframes=2, mapping_ms=9.0))
    view.show(
        messages.Correction(
            pose_version=1,
            base_version=0,
            keyframes=[0],
            t=[(0.0, 0.1, 0.0)],
            q=[(0.0, 0.0, 0.0, 1.0)],
            loss_before=1.0,
            loss_after=0.5,
            loops=[(0, 40)],
        )
    )
    view.show(mesh(final=True))
    color = memoryview(bytes(36))
    view.show(messages.View(index=1, stamp_ns=1, width_px=4, height_px=3, color=color))
    view.show(run_messages.Health(process="mapper", pid=1, state="running", rss_bytes=10**8))
    view.show(run_messages.Event(process="mapper", level="warning", text="slow", stamp_ns=1))
    time.sleep(0.3)
