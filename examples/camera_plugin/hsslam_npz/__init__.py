"""A source of HS-SLAM in a package of its own: `--source npz:FOLDER`."""
