"""/v1/styles: paintings that every user may choose as a style."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from fastapi import Path, Query, Response

from service.access.admission import Cost, costs
from service.assets.adopt import check_quota
from service.context.depends import Context, Reader, Submitter
from service.routing import Router
from service.schemas import Listing, Responses
from service.styles.library import StyleOut
from workers.contract.record import Asset
from workers.errors import NotFound

router = Router(prefix="/v1/styles", tags=["styles"])

StyleId = Annotated[str, Path(pattern=r"^[a-z0-9-]{1,60}$", description="A painting's id, as `GET /v1/styles` has it.")]
JPEG: Responses = {200: {"description": "The painting", "content": {"image/jpeg": {}}}}


@dataclass(frozen=True)
class StyleAssets:
    """A painting as assets of the caller."""

    painting: Asset
    source: Asset | None
    """The picture that it was painted from."""


@router.get("")
def list_styles(context: Context, _caller: Reader) -> Listing[StyleOut]:
    """Every painting: Impasto's own, then those of the operator's folder."""
    return Listing(context.styles.listing(), None)


@router.get("/{style_id}/picture", response_class=Response, responses=JPEG)
@costs(Cost.FRAMES)
def get_style_picture(
    style_id: StyleId,
    context: Context,
    _caller: Reader,
    max_side_px: Annotated[int, Query(ge=16, le=2048, description="Its longer side at most; never enlarged.")] = 320,
) -> Response:
    """The painting, scaled. Impasto's own are painted at the first request."""
    jpeg = context.styles.picture(style_id, max_side_px)
    return Response(jpeg, media_type="image/jpeg", headers={"Cache-Control": "private, max-age=3600"})


@router.post("/{style_id}/assets")
@costs(Cost.HEAVY)
def use_style(style_id: StyleId, context: Context, caller: Submitter) -> StyleAssets:
    """Copy the painting to your assets, for use in jobs and projects."""
    library = context.styles
    shared = library.painting(style_id)
    try:
        context.farm.assets.get(shared.id, caller.owner)
    except NotFound:
        check_quota(context, caller, shared.size_bytes)
    return StyleAssets(library.painting(style_id, caller.owner), library.source(style_id, caller.owner))
