"""HS-SLAM: dense RGB-D SLAM on a neural signed distance field (the library; no process, no socket)."""

__version__ = "0.1.0"
