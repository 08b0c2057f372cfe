"""Table of all commands and their dataclasses of options, for completion and docs/cli.md."""

import importlib
from collections.abc import Mapping
from types import MappingProxyType

from hsslam_node.presets import PRESETS
from hsslam_services.commands.options.option_table import Option, option_table

_ROOM = "hsslam_services.commands"
_BATCH = "hsslam_batch.options"
_TABLE = "hsslam_bench.tables.options:TableOptions"
_RESULTS = "hsslam_bench.options"
OPTIONS: Mapping[str, str] = MappingProxyType(  # command: module:class, "" without options
    {
        "hsslam": "",
        "hsslam completion": f"{_ROOM}.completion.options:CompletionOptions",
        "hsslam-serve": "hsslam_services.run.options:ServeOptions",
        "hsslam-serve warm-up": "",
        "hsslam-serve rescue": "",
        "hsslam-ctl": f"{_ROOM}.ctl_options:CtlOptions",
        "hsslam-doctor": f"{_ROOM}.doctor:DoctorOptions",
        "hsslam-log": "",
        "hsslam-log info": f"{_ROOM}.log.options:InfoOptions",
        "hsslam-log recover": f"{_ROOM}.log.options:RecoverOptions",
        "hsslam-log trim": f"{_ROOM}.log.options:TrimOptions",
        "hsslam-log export": f"{_ROOM}.log.options:ExportOptions",
        "hsslam-replay": f"{_ROOM}.log.replay:ReplayOptions",
        "hsslam-map": "",
        "hsslam-map query": f"{_ROOM}.maps.query:QueryOptions",
        "hsslam-map grid": f"{_ROOM}.maps.grid:GridOptions",
        "hsslam-map esdf": f"{_ROOM}.maps.esdf:EsdfOptions",
        "hsslam-map export": f"{_ROOM}.maps.export:ExportOptions",
        "hsslam-map merge": f"{_ROOM}.maps.merge:MergeOptions",
        "hsslam-mesh": f"{_ROOM}.maps.mesh:MeshOptions",
        "hsslam-render": f"{_ROOM}.maps.render:RenderOptions",
        "hsslam-eval": f"{_ROOM}.evaluate.options:EvalOptions",
        "hsslam-certs": f"{_ROOM}.certs:CertsOptions",
        "hsslam-batch": "",
        "hsslam-batch plan": f"{_BATCH}:PlanOptions",
        "hsslam-batch run": f"{_BATCH}:RunOptions",
        "hsslam-batch work": f"{_BATCH}:WorkOptions",
        "hsslam-batch report": f"{_BATCH}:ReportOptions",
        "hsslam-batch status": f"{_BATCH}:StatusOptions",
        "hsslam-bench": f"{_RESULTS}:BenchOptions",
        "hsslam-bench compare": f"{_RESULTS}:CompareOptions",
        "hsslam-bench plots": f"{_RESULTS}:PlotsOptions",
        "hsslam-bench keep": f"{_RESULTS}:KeepOptions",
        "hsslam-bench peers": "hsslam_bench.peers.options:PeersOptions",
        "hsslam-bench ablation": _TABLE,
        "hsslam-bench replica": _TABLE,
        "hsslam-bench tum": _TABLE,
        "hsslam-bench scannet": _TABLE,
    }
)


def options_class(command: str) -> type | None:
    """The dataclass of this command (`hsslam-log info`); None if it has no options of its own."""
    module, _, name = OPTIONS[command].partition(":")
    return getattr(importlib.import_module(module), name) if module else None


def options_of(command: str) -> list[Option]:
    """The options of this command, with the defaults of a run without options: those of preset realtime."""
    cls = options_class(command)
    if cls is None:
        return []
    return option_table(cls, cls(slam=PRESETS["realtime"]) if command == "hsslam-serve" else None)


def subcommands(command: str) -> list[str]:
    """The subcommands of a command: info, recover, ... for hsslam-log."""
    start = f"{command} "
    found = [name.removeprefix(start) for name in OPTIONS if name.startswith(start)]
    if command == "hsslam":
        found += [name.removeprefix("hsslam-") for name in OPTIONS if name.count(" ") == 0][1:]
    return found
