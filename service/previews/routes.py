"""POST /v1/previews: one stylised frame as PNG, for thumbnails that follow the sliders."""

from __future__ import annotations

from fastapi import Response

from service.access.admission import Cost, costs
from service.context.depends import Context, Submitter
from service.jobs.lookup import check_inputs, find_job
from service.jobs.schemas import PreviewIn
from service.routing import Router
from service.schemas import Responses, binary

router = Router(prefix="/v1/previews", tags=["previews"])

PNG: Responses = {200: binary("image/png", "The frame")[200]}


@router.post("", response_class=Response, responses=PNG)
@costs(Cost.PREVIEWS)
def preview(body: PreviewIn, context: Context, caller: Submitter) -> Response:
    """Stylise one frame. 503 with Retry-After while the maximum number of previews are being made."""
    check_inputs(context, caller, body)
    earlier = body.artefacts_of
    if earlier is not None:
        find_job(context, caller, earlier)
    png = context.farm.jobs.preview(
        body.request(), caller.reach, body.frame, body.max_side_px, body.documents, earlier, caller.owner
    )
    return Response(png, media_type="image/png", headers={"Cache-Control": "no-store"})
