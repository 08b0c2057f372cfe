"""A source for HS-SLAM in a separate package: `--source npz:FOLDER`."""
