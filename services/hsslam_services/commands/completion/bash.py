"""The completion script for bash (3.2 or later)."""

from collections.abc import Iterator, Sequence

from hsslam_services.commands.completion.values import PATH_KINDS, Completed, Values

_SCRIPT = r"""# Completion of the hsslam commands in bash, by: hsslam completion bash

_hsslam_options() {
  case "$1" in
%(options)s
  esac
}

# one|many none|file|folder WORD...: the values of an option (or of the positionals, without one)
_hsslam_values() {
  case "$1 $2" in
%(values)s
  esac
}

_hsslam() {
  local line=${COMP_LINE:0:COMP_POINT} IFS=$' \t\n'
  local -a words
  read -r -a words <<< "$line"
  [[ $line == *[[:space:]] ]] && words+=("")
  local last=$((${#words[@]} - 1)) first=1 i
  local cur=${words[last]} command=${words[0]##*/}
  if [[ $command == hsslam ]] && ((last > 1)) && [[ ${words[1]} != completion ]]; then
    command=hsslam-${words[1]#hsslam-}
    first=2
  fi
  if ((last > first)) && [[ -n $(_hsslam_options "$command ${words[first]}") ]]; then
    command="$command ${words[first]}"
    first=$((first + 1))
  fi
  COMPREPLY=()
  if [[ $cur == -* ]]; then
    COMPREPLY=($(compgen -W "$(_hsslam_options "$command")" -- "$cur"))
    return
  fi
  local values="" found
  for ((i = last - 1; i >= first; i--)); do
    if [[ ${words[i]} == -* ]]; then
      found=$(_hsslam_values "$command" "${words[i]}")
      [[ $found == many\ * || ($found == one\ * && $i -eq $((last - 1))) ]] && values=$found
      break
    fi
  done
  [[ -z $values ]] && values=$(_hsslam_values "$command" "")
  [[ -z $values ]] && return
  local rest=${values#* }
  local paths=${rest%%%% *} prefix="" path=$cur
  [[ $rest == *\ * ]] && COMPREPLY=($(compgen -W "${rest#* }" -- "$cur"))
  if [[ $rest == *\ tum:* && $cur =~ ^(%(kinds)s): ]]; then
    prefix=${cur%%%%:*}: path=${cur#*:} paths=file
  fi
  IFS=$'\n'
  [[ $paths == file ]] && COMPREPLY+=($(compgen -P "$prefix" -f -- "$path"))
  [[ $paths == folder ]] && COMPREPLY+=($(compgen -d -- "$path"))
  [[ $paths != none ]] && compopt -o filenames 2>/dev/null
  [[ ${COMPREPLY[0]} == *: ]] && compopt -o nospace 2>/dev/null
  if [[ $cur == *:* && $COMP_WORDBREAKS == *:* ]]; then
    prefix=${cur%%"${cur##*:}"}
    for i in "${!COMPREPLY[@]}"; do COMPREPLY[i]=${COMPREPLY[i]#"$prefix"}; done
  fi
}

complete -F _hsslam %(names)s
"""


def bash_script(commands: Sequence[Completed]) -> str:
    """The whole script."""
    flags = {c.command: " ".join(f for o in c.options for f in o.flags) for c in commands}
    return _SCRIPT % {
        "options": "\n".join(
            f"    '{command}') echo '{text}' ;;" for command, text in flags.items()
        ),
        "values": "\n".join(line for command in commands for line in _value_lines(command)),
        "kinds": "|".join(PATH_KINDS),
        "names": " ".join(c.command for c in commands if " " not in c.command),
    }


def _value_lines(command: Completed) -> Iterator[str]:
    name = command.command
    for option in command.options:
        if option.values is not None:
            patterns = " | ".join(f"'{name} {flag}'" for flag in option.flags)
            yield f"    {patterns}) echo '{_text(option.values)}' ;;"
    positional = command.positional or Values("none", (), False)
    words = (*command.subcommands, *positional.words)
    if words or command.positional:
        yield f"    '{name} ') echo '{_text(Values(positional.paths, words, False))}' ;;"


def _text(values: Values) -> str:
    return " ".join(("many" if values.is_list else "one", values.paths, *values.words))
