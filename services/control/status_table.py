"""The answer to `status` for people."""

from rich.console import Console
from rich.table import Table

from hsslam_node.proto.request_messages import Status


def print_status(status: Status) -> None:
    """Print it as a table, names to the left."""
    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    table.add_column(style="dim", no_wrap=True)
    table.add_column(overflow="fold")
    for name, value in _rows(status):
        table.add_row(name, value)
    Console(emoji=False, highlight=False, markup=False).print(table)


def _rows(status: Status) -> list[tuple[str, str]]:
    resets = f", thrown away {status.world} x" if status.world else ""
    processes = "  ".join(f"{name}:{state}" for name, state in status.processes.items())
    restarts = ", ".join(f"{name} {count} x" for name, count in status.restarts.items())
    return [
        ("state", f"{status.state}, {status.mode}"),
        ("run", f"{status.run_id}, {status.source}, preset {status.preset}, pace {status.pace}"),
        ("time", f"{status.seconds:.0f} s"),
        (
            "frames",
            f"{status.frames_sent} sent, {status.frames_tracked} tracked, "
            f"{status.frames_lost} lost, {status.frames_dropped} dropped",
        ),
        ("rate", f"{status.fps:.1f} FPS, {status.latency_ms:.0f} ms from sensor to pose"),
        ("tracking", f"{status.tracking}, quality {status.quality:.2f}"),
        (
            "map",
            f"version {status.map_version}, {status.keyframes} keyframes, "
            f"{status.ba_rounds} rounds of bundle adjustment{resets}",
        ),
        ("memory", f"{status.memory_mb} MB"),
        ("requests", f"{status.requests}, {status.requests_refused} refused"),
        ("messages", f"{status.messages_rejected} could not be read"),
        ("processes", processes),
        ("restarts", restarts or "none"),
    ]
