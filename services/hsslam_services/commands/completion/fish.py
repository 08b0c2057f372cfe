"""The completion script for fish."""

from collections.abc import Iterator, Sequence

from hsslam_services.commands.completion.values import (
    PATH_KINDS,
    Completed,
    CompletedOption,
    Values,
)

_HEAD = r"""# Completion of the hsslam commands in fish, by: hsslam completion fish

# a path after the kind of a source: tum:FOLDER
function __hsslam_source_paths
    set -l token (commandline -ct)
    if string match -qr '^(%s):' -- $token
        set -l kind (string split -m 1 : -- $token)[1]
        for path in (__fish_complete_path (string split -m 1 : -- $token)[2])
            echo $kind:$path
        end
    end
end

# whether the last option is this one, which takes several values
function __hsslam_after
    set -l options (string match -r -- '^-.*' (commandline -opc))
    test (count $options) -gt 0; and test "$options[-1]" = "$argv[1]"
end
"""


def fish_script(commands: Sequence[Completed]) -> str:
    """The whole script."""
    lines = [_HEAD % "|".join(PATH_KINDS)]
    for command in commands:
        lines += _lines(command, commands)
    return "\n".join(lines) + "\n"


def _lines(command: Completed, commands: Sequence[Completed]) -> Iterator[str]:
    """The lines of a command, as hsslam-log and as `hsslam log`."""
    program, _, sub = command.command.partition(" ")
    used = f"__fish_seen_subcommand_from {sub}" if sub else ""
    if not sub and command.subcommands:
        used = f"not __fish_seen_subcommand_from {' '.join(command.subcommands)}"
    yield from _complete(program, used, command)
    if program != "hsslam":
        name = program.removeprefix("hsslam-")
        through = f"__fish_seen_subcommand_from {name}"
        yield from _complete("hsslam", f"{through}; and {used}" if used else through, command)


def _complete(program: str, condition: str, command: Completed) -> Iterator[str]:
    start = f"complete -c {program}" + (f" -n '{condition}'" if condition else "")
    yield f"{start} -f"
    if command.subcommands:
        yield f"{start} -a {_quoted(' '.join(command.subcommands))}"
    if command.positional:
        yield f"{start}{_values(command.positional)}"
    for option in command.options:
        yield f"{start}{_names(option)} -d {_quoted(option.help)}{_taken(option)}"
        if option.values is not None and option.values.is_list:
            after = f"__hsslam_after {option.flags[-1]}"
            both = f"{condition}; and {after}" if condition else after
            yield f"complete -c {program} -n '{both}'{_values(option.values)}"


def _names(option: CompletedOption) -> str:
    return "".join(
        f" -l {flag[2:]}" if flag.startswith("--") else f" -s {flag[1:]}" for flag in option.flags
    )


def _taken(option: CompletedOption) -> str:
    return "" if option.values is None else f" -r{_values(option.values)}"


def _values(values: Values) -> str:
    proposed = [*values.words]
    if values.paths == "folder":
        proposed.append("(__fish_complete_directories)")
    if "tum:" in values.words:
        proposed.append("(__hsslam_source_paths)")
    words = f" -a {_quoted(' '.join(proposed))}" if proposed else ""
    return f"{' -F' if values.paths == 'file' else ' -f'}{words}"


def _quoted(text: str) -> str:
    return "'" + text.replace("\\", "\\\\").replace("'", "\\'") + "'"
