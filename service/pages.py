"""The pages: the studio at /, live at /live, its picture alone at /live/view, operations at /ops, the API at /docs, the
studio's guide at /docs/shot, shared projects at /shared/..."""

from __future__ import annotations

import pathlib
from typing import Annotated

from fastapi import Path
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import FileResponse, HTMLResponse, PlainTextResponse, RedirectResponse, Response

from service import bundle
from service.middleware import LIVE_PERMISSIONS
from service.prefix import with_prefix
from service.routing import Router

HERE = pathlib.Path(__file__).parent
router = Router(include_in_schema=False)


@router.get("/")
def index(request: Request) -> Response:
    return _page(request, "index.html")


@router.get("/shared/{token}")
def shared(token: Annotated[str, Path(max_length=1000, pattern=r"^[A-Za-z0-9._~-]+$")]) -> Response:
    """The studio's page, which shows a shared link."""
    return RedirectResponse(f"/#/shared/{token}", 307)


@router.get("/live")
def live(request: Request) -> Response:
    page = _page(request, "live.html")
    page.headers["Permissions-Policy"] = LIVE_PERMISSIONS
    return page


@router.get("/live/view")
def live_view(request: Request) -> Response:
    return _page(request, "live-view.html")


@router.get("/ops")
def ops(request: Request) -> Response:
    return _page(request, "ops.html")


def _page(request: Request, name: str) -> Response:
    """A built page, or 503 with the remedy in a checkout whose pages were not built."""
    if not bundle.is_built():
        return PlainTextResponse(f"The pages of this checkout are not built. {bundle.REMEDY}\n", status_code=503)
    return _file(request, bundle.DIST / name)


def _file(request: Request, path: pathlib.Path) -> Response:
    prefix = request.scope.get("prefix", "")
    return HTMLResponse(with_prefix(path.read_text("utf-8"), prefix)) if prefix else FileResponse(path)


@router.get("/docs")
def docs(request: Request) -> Response:
    return _file(request, HERE / "docs" / "index.html")


@router.get("/docs/shot")
def guide(request: Request) -> Response:
    return _file(request, HERE / "docs" / "shot.html")


@router.get("/docs/{name}")
def docs_part(name: str) -> FileResponse:
    if name not in ("docs.js", "docs.css"):
        raise HTTPException(404)
    return FileResponse(HERE / "docs" / name)
