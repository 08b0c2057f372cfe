"""The way through the apartment."""

import numpy as np

from hsslam_node.sources.synth.walk import walk_poses

_WAY_M = np.array(
    [
        *((4.9, 4.5), (2.4, 4.3), (1.6, 2.9), (2.3, 1.55), (4.4, 1.45), (6.6, 1.7)),  # living room
        *((7.8, 1.7), (8.9, 2.2), (9.2, 3.9), (10.6, 4.3), (11.8, 3.6), (11.9, 2.1)),  # kitchen
        *((12.8, 1.8), (14.0, 1.7), (16.3, 1.4), (17.1, 2.7), (15.9, 3.9), (14.8, 4.6)),  # study
        *(
            (15.3, 5.6),
            (15.4, 6.5),
            (15.5, 7.1),
            (16.0, 7.8),
            (15.0, 8.5),
            (14.0, 9.9),
            (14.0, 11.5),
        ),  # bedroom
        *((12.8, 11.8), (11.7, 11.8), (11.0, 10.1), (10.4, 8.9), (8.8, 8.7)),  # children's room
        *((8.1, 10.4), (7.0, 11.0), (5.7, 11.4), (3.7, 11.9), (1.8, 11.4), (1.5, 9.6)),  # dining
        *(
            (1.6, 8.4),
            (1.6, 7.5),
            (1.7, 6.8),
            (4.4, 6.65),
            (6.3, 6.65),
            (6.6, 5.8),
            (6.5, 5.0),
        ),  # hall
    ]
)


def apartment_poses(length: int | None, seed: int) -> np.ndarray:
    """Camera-to-world poses [n, 4, 4]; one round through all rooms unless a length is given."""
    return walk_poses(_WAY_M, length, seed)
