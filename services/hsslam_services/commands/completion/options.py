"""The options of `hsslam completion`; alone, as the table of all options imports them."""

from dataclasses import dataclass
from typing import ClassVar, Literal

Shell = Literal["bash", "zsh", "fish"]


@dataclass(frozen=True)
class CompletionOptions:
    """Prints a script that completes commands, options and their values in your shell.

    Examples:
      hsslam completion bash > ~/.hsslam-completion.bash     and in ~/.bashrc: . ~/.hsslam-completion.bash
      hsslam completion zsh > ~/.hsslam-completion.zsh       and in ~/.zshrc, after compinit:
                                                             . ~/.hsslam-completion.zsh
      hsslam completion fish > ~/.config/fish/conf.d/hsslam.fish

    Exit codes: 0 if the script is printed, 2 if the input is bad.
    """

    POSITIONALS: ClassVar = ("shell",)

    shell: Shell = "bash"
    """The shell that reads the script."""
