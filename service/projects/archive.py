"""A project as one zip file: exported with every asset that it names, imported on any server."""

from __future__ import annotations

import tempfile
from pathlib import Path

from fastapi import Request, Response
from starlette.background import BackgroundTask
from starlette.concurrency import run_in_threadpool
from starlette.responses import FileResponse

from service.access.admission import Cost
from service.access.keys import Principal
from service.assets.adopt import check_free_space, check_quota, disk_faults, upload_folder
from service.bodies import chunks
from service.context.depends import Context, Reader, ServiceContext, Submitter
from service.errors import UnsupportedMediaType
from service.projects.lookup import document_quota, etag, find_project
from service.projects.schemas import ProjectId, ProjectOut, project_out
from service.routing import Router
from service.schemas import binary
from service.serving import disposition

router = Router(prefix="/v1/projects", tags=["projects"])

ZIP = "application/zip"
_BODY = {"requestBody": {"required": True, "content": {ZIP: {"schema": {"type": "string", "format": "binary"}}}}}
_MOST_TIMES = 4
"""Maximum size of an unpacked archive, in multiples of the largest asset."""


@router.get("/{project_id}/export", response_class=Response, responses={200: binary(ZIP, "The project")[200]})
async def export_project(project_id: ProjectId, context: Context, caller: Reader) -> Response:
    """The newest version and its assets in one zip file."""
    async with context.admission.one(Cost.READING, caller):
        return await run_in_threadpool(_export, context, caller, project_id)


def _export(context: ServiceContext, caller: Principal, project_id: str) -> Response:
    project = find_project(context, caller, project_id)
    folder = tempfile.TemporaryDirectory(dir=upload_folder(context))
    path = Path(folder.name) / "project.zip"
    try:
        with disk_faults():
            context.farm.projects.export(project_id, path)
    except BaseException:
        folder.cleanup()
        raise
    headers = {"Content-Disposition": disposition(f"{project.name}.zip", True), "Cache-Control": "no-store"}
    return FileResponse(path, headers=headers, media_type=ZIP, background=BackgroundTask(folder.cleanup))


@router.post("/import", status_code=201, openapi_extra=_BODY)
async def import_project(request: Request, response: Response, context: Context, caller: Submitter) -> ProjectOut:
    """A new project from an exported zip file. Its assets become yours."""
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind != ZIP:
        raise UnsupportedMediaType(
            "A project is imported from a zip file.", field="Content-Type", value=kind, remedy=f"Send it as {ZIP}."
        )
    with tempfile.TemporaryDirectory(dir=await run_in_threadpool(upload_folder, context)) as folder:
        path = Path(folder) / "project.zip"
        await _receive(request, context, path)
        async with context.admission.one(Cost.READING, caller):
            found = await run_in_threadpool(_load, context, caller, path)
    response.headers["Location"] = f"/v1/projects/{found.id}"
    response.headers["ETag"] = etag(found.version)
    return found


async def _receive(request: Request, context: ServiceContext, path: Path) -> None:
    limit = _MOST_TIMES * context.settings.max_asset_bytes
    with disk_faults(), path.open("wb") as file:
        async for chunk in chunks(request, limit, context.settings.idle_s):
            await run_in_threadpool(file.write, chunk)


def _load(context: ServiceContext, caller: Principal, path: Path) -> ProjectOut:
    def admit(size_bytes: int) -> None:
        check_quota(context, caller, size_bytes)
        check_free_space(context, size_bytes)

    with disk_faults():
        limits = (_MOST_TIMES * context.settings.max_asset_bytes, admit, document_quota(context, caller, caller.owner))
        project = context.farm.projects.load(path, caller.owner, *limits)
    _, document = context.farm.projects.document(project.id)
    return project_out(project, document)
