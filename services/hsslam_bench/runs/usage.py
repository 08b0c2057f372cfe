"""Samples core time, memory and shared memory of the processes of a running service."""

import os
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import psutil

from hsslam_node.errors import UserError
from hsslam_services.run.run_info import RunInfo

_CPU_EVERY_S, _TREE_EVERY_S = 0.5, 1.0
_MEMORY_EVERY_S = 5.0  # seldom, as reading PSS keeps a core busy
_SUPERVISOR, _VIEWER, _UNKNOWN = "supervisor", "viewer", "other"
_VIEWER_PROGRAM = "rerun"
_PACKAGE = "hsslam_services."
_BLOCK_BYTES = 512


@dataclass(frozen=True)
class Sample:
    """One sample of a run. `pss_bytes` is empty if memory was not due."""

    time_ns: int  # wall clock
    cpu_s: dict[str, float]  # user and system time since the start, by process
    pss_bytes: dict[str, int]  # proportional set size: shared pages are divided among their users
    shared_bytes: int  # of the arena in /dev/shm


@dataclass
class Usage:
    """Samples the processes below `root` when `poll` is called, every 0.2 s or so.

    A process has the name of its log file in the run folder, or of its module.
    """

    root: psutil.Process
    run_folder: Path
    samples: list[Sample] = field(default_factory=list)
    _names: dict[int, str] = field(default_factory=dict)
    _cpu_s: dict[int, float] = field(default_factory=dict)
    _tree: list[psutil.Process] = field(default_factory=list)
    _sampled_s: dict[str, float] = field(default_factory=dict)

    def poll(self) -> None:
        """Take a sample, if one is due."""
        if not self._is_due("cpu", _CPU_EVERY_S):
            return
        if self._is_due("tree", _TREE_EVERY_S):
            self._tree = [self.root, *_below(self.root)]
        with_memory = self._is_due("memory", _MEMORY_EVERY_S)
        pss: dict[str, int] = {}
        for process in self._tree:
            name = self._name(process)
            try:
                times = process.cpu_times()
                if with_memory:
                    pss[name] = pss.get(name, 0) + _pss_bytes(process.pid)
            except (psutil.Error, OSError):
                continue  # just ended
            self._cpu_s[process.pid] = times.user + times.system
        cpu_s: dict[str, float] = {}
        for pid, seconds in self._cpu_s.items():
            cpu_s[self._names[pid]] = cpu_s.get(self._names[pid], 0.0) + seconds
        self.samples.append(Sample(time.time_ns(), cpu_s, pss, self._shared_bytes()))

    def _is_due(self, what: str, every_s: float) -> bool:
        now = time.monotonic()
        if now - self._sampled_s.get(what, -1e9) < every_s:
            return False
        self._sampled_s[what] = now
        return True

    def _name(self, process: psutil.Process) -> str:
        found = self._found_name(process)  # each time, as a forked process opens its log later
        if found != _UNKNOWN or process.pid not in self._names:
            self._names[process.pid] = found
        return self._names[process.pid]

    def _found_name(self, process: psutil.Process) -> str:
        if process.pid == self.root.pid:
            return _SUPERVISOR
        try:
            output = Path(f"/proc/{process.pid}/fd/1").readlink()
            if output.parent == self.run_folder / "logs":
                return output.stem
            if process.name() == _VIEWER_PROGRAM:
                return _VIEWER
            modules = (w for w in " ".join(process.cmdline()).split() if w.startswith(_PACKAGE))
            return next((module.rpartition(".")[2] for module in modules), _UNKNOWN)
        except (psutil.Error, OSError):
            return _UNKNOWN

    def _shared_bytes(self) -> int:
        try:
            arena = RunInfo.read(self.run_folder).arena_dir
            with os.scandir(arena) as files:
                return sum(entry.stat().st_blocks * _BLOCK_BYTES for entry in files)
        except (OSError, UserError):
            return 0  # before the start or after the end


def core_ms_per_frame(
    samples: Sequence[Sample], window_ns: tuple[int, int], frames: int
) -> dict[str, float]:
    """Core time of each process between two times, ms a frame; interpolated between samples."""
    times = np.array([sample.time_ns for sample in samples], float)
    names = {name: None for sample in samples for name in sample.cpu_s}
    used_ms = {}
    for name in names:
        seconds = np.array([sample.cpu_s.get(name, 0.0) for sample in samples])
        begin, end = np.interp(np.array(window_ns, float), times, seconds)
        used_ms[name] = 1e3 * float(end - begin) / max(frames, 1)
    return {name: ms for name, ms in used_ms.items() if ms > 0}


def memory_at(samples: Sequence[Sample], time_ns: int) -> dict[str, int]:
    """Memory of each process in the last sample before a time, bytes."""
    seen = [
        sample.pss_bytes for sample in samples if sample.pss_bytes and sample.time_ns <= time_ns
    ]
    return seen[-1] if seen else {}


def peak_memory(samples: Sequence[Sample]) -> dict[str, int]:
    """Memory of each process in the sample with the largest sum, bytes."""
    return max((sample.pss_bytes for sample in samples), key=lambda p: sum(p.values()), default={})


def _below(root: psutil.Process) -> list[psutil.Process]:
    try:
        return root.children(recursive=True)
    except psutil.Error:
        return []


def _pss_bytes(pid: int) -> int:
    for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines():
        if line.startswith("Pss:"):
            return 1024 * int(line.split()[1])
    return 0
