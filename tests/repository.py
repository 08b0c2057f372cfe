"""Where the repository is; a module of its own because tests at any depth of the tree need it."""

from pathlib import Path

ROOT = Path(__file__).parents[1]
