"""Makes a command line of a frozen dataclass of options: table, parser, help, files of options."""
