"""OpenGL's axes; alone, as meshes and cameras of several formats use them."""

import numpy as np

OPENGL_FROM_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])
"""[4, 4], from x right, y down, z forward to x right, y up, z back; its own inverse."""
