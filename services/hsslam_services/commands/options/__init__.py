"""From a frozen dataclass of options to its command line: table, parser, help, files of options."""
