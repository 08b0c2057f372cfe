"""The command `hsslam completion bash|zsh|fish`; each command has a file of its own."""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType

from hsslam_services.commands.all_options import OPTIONS
from hsslam_services.commands.cli import parse_options
from hsslam_services.commands.completion.bash import bash_script
from hsslam_services.commands.completion.fish import fish_script
from hsslam_services.commands.completion.options import CompletionOptions, Shell
from hsslam_services.commands.completion.values import Completed, completed
from hsslam_services.commands.completion.zsh import zsh_script

_SCRIPTS: Mapping[Shell, Callable[[Sequence[Completed]], str]] = MappingProxyType(
    {"bash": bash_script, "zsh": zsh_script, "fish": fish_script}
)


def completion_command(args: Sequence[str]) -> None:
    """Print the script.

    Raises:
        UserError: the shell is not known.
    """
    options = parse_options(CompletionOptions, "hsslam completion", args)
    print(_SCRIPTS[options.shell]([completed(command) for command in OPTIONS]), end="")
