"""Parameters of TV-L1."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field


class TvL1(BaseModel):
    """Parameters of TV-L1, see zach2007duality; brightness is in 0..255."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    attachment: float = Field(0.45, gt=0, le=10, description="lambda: weight of the data term, per gray level")
    tightness: float = Field(0.3, gt=0, le=10, description="theta: largest difference of u and v, in effect")
    time_step: float = Field(0.25, gt=0, le=0.25, description="tau: step of the dual iteration")
    warps: int = Field(5, ge=1, le=50, description="linearisations of the data term per level")
    iterations: int = Field(20, ge=1, le=1000, description="primal-dual iterations per warp")
    texture_share: float = Field(0.95, ge=0, le=1, description="fraction of the denoised picture that is subtracted")
    texture_iterations: int = Field(20, ge=0, le=500, description="iterations of the denoising; 0 = no decomposition")
    median: bool = Field(True, description="5 x 5 median of the flow after each warp")


DEFAULTS = TvL1()
