"""The pages: the studio at /, live at /live, its picture alone at /live/view, operations at /ops, the API at /docs, the
studio's guide at /docs/shot, shared projects at /shared/..."""

from __future__ import annotations

import pathlib
from typing import Annotated

from fastapi import Path
from starlette.exceptions import HTTPException
from starlette.responses import FileResponse, PlainTextResponse, RedirectResponse, Response

from service import bundle
from service.routing import Router

HERE = pathlib.Path(__file__).parent
router = Router(include_in_schema=False)


@router.get("/")
def index() -> Response:
    return _page("index.html")


@router.get("/shared/{token}")
def shared(token: Annotated[str, Path(max_length=1000, pattern=r"^[A-Za-z0-9._~-]+$")]) -> Response:
    """The studio's page, which shows a shared link."""
    return RedirectResponse(f"/#/shared/{token}", 307)


@router.get("/live")
def live() -> Response:
    return _page("live.html")


@router.get("/live/view")
def live_view() -> Response:
    return _page("live-view.html")


@router.get("/ops")
def ops() -> Response:
    return _page("ops.html")


def _page(name: str) -> Response:
    """A built page, or 503 with the remedy in a checkout whose pages were not built."""
    if not bundle.is_built():
        return PlainTextResponse(f"The pages of this checkout are not built. {bundle.REMEDY}\n", status_code=503)
    return FileResponse(bundle.DIST / name)


@router.get("/docs")
def docs() -> FileResponse:
    return FileResponse(HERE / "docs" / "index.html")


@router.get("/docs/shot")
def guide() -> FileResponse:
    return FileResponse(HERE / "docs" / "shot.html")


@router.get("/docs/{name}")
def docs_part(name: str) -> FileResponse:
    if name not in ("docs.js", "docs.css"):
        raise HTTPException(404)
    return FileResponse(HERE / "docs" / name)
