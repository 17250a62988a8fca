"""The pages: the studio at /, live at /live, operations at /ops, and the API's description at /docs."""

from __future__ import annotations

from pathlib import Path

from fastapi import APIRouter
from starlette.exceptions import HTTPException
from starlette.responses import FileResponse

HERE = Path(__file__).parent
router = APIRouter(include_in_schema=False)


@router.get("/")
def index() -> FileResponse:
    return FileResponse(HERE / "web" / "index.html")


@router.get("/live")
def live() -> FileResponse:
    return FileResponse(HERE / "web" / "live.html")


@router.get("/ops")
def ops() -> FileResponse:
    return FileResponse(HERE / "web" / "ops.html")


@router.get("/docs")
def docs() -> FileResponse:
    return FileResponse(HERE / "docs" / "index.html")


@router.get("/docs/{name}")
def docs_part(name: str) -> FileResponse:
    if name not in ("docs.js", "docs.css"):
        raise HTTPException(404)
    return FileResponse(HERE / "docs" / name)
