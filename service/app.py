"""`create_app`: routers, middleware and background work assembled into one FastAPI application."""

from __future__ import annotations

import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from fastapi import FastAPI
from prometheus_client import CollectorRegistry
from starlette.staticfiles import StaticFiles

from service import bundle, errors
from service.access.depends import ServiceContext, Streams
from service.access.gate import Gate
from service.access.rates import Rates
from service.artefacts.routes import router as artefacts
from service.assets.routes import router as assets
from service.background import background
from service.bodies import JsonBodies
from service.edge import Edge
from service.jobs.events import router as events
from service.jobs.files import router as files
from service.jobs.routes import router as jobs
from service.jobs.tasks import router as tasks
from service.live.routes import router as live
from service.live.sessions import Sessions
from service.methods.routes import router as methods
from service.ops.fleet import router as fleet
from service.ops.keys import router as keys
from service.ops.machine import add_machine
from service.ops.metrics import FarmMetrics, HttpMetrics, LiveMetrics
from service.ops.routes import router as ops
from service.pages import router as pages
from service.previews.routes import router as previews
from service.projects.archive import router as project_archives
from service.projects.estimates import router as estimates
from service.projects.jobs import router as project_jobs
from service.projects.previews import router as project_previews
from service.projects.routes import router as projects
from service.projects.sharing import router as sharing
from service.projects.versions import router as project_versions
from service.settings import Settings
from service.uploads.routes import router as uploads
from service.webhooks.routes import router as webhooks
from service.webhooks.secrets import WebhookSecrets
from workers.farm import Farm
from workers.model import Json

ROUTERS = (
    methods,
    assets,
    uploads,
    jobs,
    tasks,
    events,
    files,
    webhooks,
    previews,
    artefacts,
    project_archives,
    projects,
    project_versions,
    project_jobs,
    project_previews,
    estimates,
    sharing,
    live,
    keys,
    ops,
    fleet,
    pages,
)


def create_app(settings: Settings, farm: Farm) -> FastAPI:
    """The HTTP service over `farm`, which the caller starts and stops."""
    service = _context(settings, farm)
    app = FastAPI(
        title="Impasto",
        version="1",
        summary="Turn video into paintings and cartoons that hold still where they should.",
        docs_url=None,
        redoc_url=None,
        generate_unique_id_function=lambda route: route.name,
        lifespan=_lifespan,
    )
    app.state.service = service
    app.state.live = _sessions(service)
    errors.install(app)
    for router in ROUTERS:
        app.include_router(router, responses=errors.PROBLEM_RESPONSES)
    app.mount("/static", StaticFiles(directory=bundle.DIST, check_dir=False), name="static")
    _add_middleware(app, service)
    _describe(app)
    return app


@asynccontextmanager
async def _lifespan(app: FastAPI) -> AsyncIterator[None]:
    async with background(app.state.service, app.state.live):
        try:
            yield
        finally:
            await app.state.live.close()


def _sessions(service: ServiceContext) -> Sessions:
    farm_live = service.farm.live
    metrics = LiveMetrics(service.registry, lambda: farm_live.sessions)
    return Sessions(farm_live, metrics, service.settings.live_resume_s)


def _context(settings: Settings, farm: Farm) -> ServiceContext:
    service = ServiceContext(
        settings=settings,
        farm=farm,
        streams=Streams(settings.max_streams),
        previews=threading.BoundedSemaphore(settings.preview_slots),
        frames=threading.BoundedSemaphore(settings.frame_slots),
        webhook_secrets=_secrets(settings),
        registry=CollectorRegistry(),
    )
    service.registry.register(FarmMetrics(farm))
    add_machine(service.registry, settings)
    return service


def _secrets(settings: Settings) -> WebhookSecrets:
    given = settings.webhook_secret
    return WebhookSecrets(settings.home / "webhook_secret", given.get_secret_value() if given else "")


def _add_middleware(app: FastAPI, service: ServiceContext) -> None:
    """The last one added is the outermost."""
    settings = service.settings
    app.add_middleware(
        JsonBodies,
        max_bytes=settings.max_json_bytes,
        max_project_bytes=settings.max_project_bytes,
        idle_s=settings.idle_s,
    )
    app.add_middleware(Gate, settings=settings, keys=service.farm.keys, rates=Rates())
    app.add_middleware(Edge, metrics=HttpMetrics(service.registry, service.streams.count))


def _describe(app: FastAPI) -> None:
    """Add the problem's schema, which every route refers to, to the OpenAPI document."""
    plain = app.openapi

    def openapi() -> Json:
        document = plain()
        schemas = document.setdefault("components", {}).setdefault("schemas", {})
        schemas["Problem"] = errors.Problem.model_json_schema()
        return document

    app.openapi = openapi  # type: ignore[method-assign]
