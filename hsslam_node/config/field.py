"""The scene model."""

from dataclasses import dataclass
from typing import Literal

from hsslam_node.config.checks import (
    expect_in_range,
    expect_one_of,
    expect_positive,
)
from hsslam_node.errors import UserError


@dataclass(frozen=True)
class FieldConfig:
    """Scene model (paper, section III-A)."""

    plane_channels: Literal[0, 16, 32, 64] = 32
    """Features per plane vertex; 0 turns the planes off."""
    coarse_cell_m: float = 0.24
    """Cell size of the coarse geometry and appearance planes, m."""
    geometry_fine_cell_m: float = 0.06
    """Cell size of the fine geometry planes, m."""
    appearance_fine_cell_m: float = 0.03
    """Cell size of the fine appearance planes, m."""
    hash_levels: int = 16
    """Levels of the hash grid; 0 turns it off."""
    hash_features: Literal[2, 4] = 2
    """Features per vertex of a hash level; 4 uses two tables of 2."""
    hash_table_log2: int = 16
    """log2 of the table entries per level; a level that fits is a dense grid."""
    hash_base_resolution: int = 16
    """Cells along the longest side of the coarsest level."""
    hash_finest_cell_m: float = 0.02
    """Cell size of the finest level, m."""
    oneblob_bins: Literal[0, 16] = 16
    """Bins per axis of the one-blob encoding; 0 turns it off."""
    hidden_width: Literal[32] = 32
    """Hidden units of both decoders."""
    geometry_feature_width: Literal[15] = 15
    """Width of the feature from the geometry decoder to the colour decoder."""
    truncation_m: float = 0.06
    """Truncation distance T of the SDF, m; the decoder's SDF is in units of T."""
    beta_init: float = 10.0
    """Initial sharpness (beta) of the SDF-to-density conversion."""

    def __post_init__(self) -> None:
        expect_positive(
            self, "field", "coarse_cell_m", "geometry_fine_cell_m", "appearance_fine_cell_m"
        )
        expect_positive(self, "field", "hash_base_resolution", "hash_finest_cell_m")
        expect_in_range(self, "field", "hash_levels", 0, 32)
        expect_positive(self, "field", "truncation_m", "beta_init")
        expect_in_range(self, "field", "hash_table_log2", 8, 24)
        expect_one_of(self, "field", "plane_channels", 0, 16, 32, 64)
        expect_one_of(self, "field", "hash_features", 2, 4)
        expect_one_of(self, "field", "oneblob_bins", 0, 16)
        expect_one_of(self, "field", "hidden_width", 32)
        expect_one_of(self, "field", "geometry_feature_width", 15)
        if self.plane_channels == 0 and self.hash_levels == 0:
            raise UserError("field.hash_levels = 0: expected 1 or more if there are no planes")
        for name in ("geometry_fine_cell_m", "appearance_fine_cell_m"):
            ratio = self.coarse_cell_m / getattr(self, name)
            if abs(ratio - round(ratio)) > 1e-6:
                raise UserError(
                    f"field.{name} = {getattr(self, name)}: expected a whole fraction of "
                    f"field.coarse_cell_m = {self.coarse_cell_m}"
                )

    @property
    def hash_width(self) -> int:
        return self.hash_levels * self.hash_features

    @property
    def hash_tables(self) -> int:
        """Tables of two features; those of one level follow each other."""
        return self.hash_width // 2

    @property
    def oneblob_width(self) -> int:
        return 3 * self.oneblob_bins

    @property
    def geometry_input_width(self) -> int:
        """Rows of the geometry decoder: hash, coarse + fine planes, one-blob, in this order."""
        return self.hash_width + 2 * self.plane_channels + self.oneblob_width

    @property
    def color_input_width(self) -> int:
        """Rows of the colour decoder: coarse + fine planes, one-blob, geometry feature, in this order."""
        return 2 * self.plane_channels + self.oneblob_width + self.geometry_feature_width
