"""The completion script for zsh."""

from collections.abc import Iterator, Sequence

from hsslam_services.commands.completion.values import (
    PATH_KINDS,
    Completed,
    CompletedOption,
    Values,
)

_SCRIPT = r"""#compdef %(names)s
# Completion of the hsslam commands in zsh, by: hsslam completion zsh

_hsslam_options() {
  case "$1" in
%(options)s
    (*) return 1 ;;
  esac
}

# one|many none|file|folder WORD...: the values of an option (or of the positionals, without one)
_hsslam_values() {
  case "$1 $2" in
%(values)s
    (*) reply=() ;;
  esac
}

_hsslam() {
  local command=${words[1]:t} first=2 i cur=${words[CURRENT]}
  local -a reply values
  if [[ $command == hsslam && $CURRENT -gt 2 && ${words[2]} != completion ]]; then
    command=hsslam-${words[2]#hsslam-}
    first=3
  fi
  if ((CURRENT > first)) && _hsslam_options "$command ${words[first]}"; then
    command="$command ${words[first]}"
    ((first++))
  fi
  if [[ $cur == -* ]]; then
    _hsslam_options "$command" && _describe -o option reply
    return
  fi
  for ((i = CURRENT - 1; i >= first; i--)); do
    if [[ ${words[i]} == -* ]]; then
      _hsslam_values "$command" "${words[i]}"
      [[ ${reply[1]} == many || (${reply[1]} == one && $i -eq $((CURRENT - 1))) ]] && values=($reply)
      break
    fi
  done
  if (($#values == 0)); then
    _hsslam_values "$command" ""
    values=($reply)
  fi
  (($#values)) || return 1
  if [[ $cur == (%(kinds)s):* && " $values " == *' tum: '* ]]; then
    compset -P '*:'
    _files
    return
  fi
  local -a plain open
  plain=(${values[3,-1]:#*:})
  open=(${(M)values[3,-1]:#*:})
  compadd -a plain
  compadd -S '' -a open
  [[ ${values[2]} == file ]] && _files
  [[ ${values[2]} == folder ]] && _files -/
  return 0
}

compdef _hsslam %(names)s
"""


def zsh_script(commands: Sequence[Completed]) -> str:
    """The whole script."""
    return _SCRIPT % {
        "options": "\n".join(_options(command) for command in commands),
        "values": "\n".join(line for command in commands for line in _value_lines(command)),
        "kinds": "|".join(PATH_KINDS),
        "names": " ".join(c.command for c in commands if " " not in c.command),
    }


def _options(command: Completed) -> str:
    rows = [row for option in command.options for row in _described(option)]
    return f"    ('{command.command}') reply=({' '.join(rows)}) ;;"


def _described(option: CompletedOption) -> Iterator[str]:
    for flag in option.flags:
        yield _quoted(f"{flag}:{option.help}")


def _value_lines(command: Completed) -> Iterator[str]:
    name = command.command
    for option in command.options:
        if option.values is not None:
            patterns = " | ".join(f"'{name} {flag}'" for flag in option.flags)
            yield f"    ({patterns}) reply=({_words(option.values)}) ;;"
    positional = command.positional or Values("none", (), False)
    words = (*command.subcommands, *positional.words)
    if words or command.positional:
        yield f"    ('{name} ') reply=({_words(Values(positional.paths, words, False))}) ;;"


def _words(values: Values) -> str:
    kept = ("many" if values.is_list else "one", values.paths, *values.words)
    return " ".join(map(_quoted, kept))


def _quoted(text: str) -> str:
    return "'" + text.replace("'", "'\\''") + "'"
