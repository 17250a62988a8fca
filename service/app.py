"""`create_app`: routers, middleware and background work assembled into one FastAPI application."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from anyio import CapacityLimiter
from fastapi import FastAPI
from prometheus_client import CollectorRegistry
from starlette.staticfiles import StaticFiles

from service import bundle, errors, openapi
from service.access.admission import Admission, classes
from service.access.audit import AuditTrail
from service.access.gate import Gate
from service.access.provider import Provider
from service.access.rates import Rates
from service.artefacts.routes import router as artefacts
from service.assets.routes import router as assets
from service.assets.styles import router as styles
from service.background import background
from service.bodies import JsonBodies
from service.context.depends import ServiceContext, Streams
from service.jobs.deliveries import router as webhooks
from service.jobs.events import router as events
from service.jobs.exports import router as exports
from service.jobs.files import router as files
from service.jobs.film_frames import router as film_frames
from service.jobs.queue import router as queue
from service.jobs.routes import router as jobs
from service.jobs.tasks import router as tasks
from service.live.routes import router as live
from service.live.sessions import Sessions
from service.live.webrtc.routes import router as webrtc
from service.methods.routes import router as methods
from service.middleware import Edge
from service.ops.fleet import router as fleet
from service.ops.load import router as load
from service.ops.machine import add_machine
from service.ops.metrics import FarmMetrics, HttpMetrics, LiveMetrics
from service.ops.owners import router as owners
from service.ops.queued_jobs import router as queued_jobs
from service.ops.records import router as records
from service.ops.routes import router as ops
from service.pages import router as pages
from service.prefix import InsidePrefix, OutsidePrefix
from service.previews.routes import router as previews
from service.projects.archive import router as project_archives
from service.projects.comments import router as project_comments
from service.projects.estimates import router as estimates
from service.projects.films import router as project_films
from service.projects.jobs import router as project_jobs
from service.projects.previews import router as project_previews
from service.projects.routes import router as projects
from service.projects.sharing import router as sharing
from service.projects.versions import router as project_versions
from service.scenes.routes import router as scenes
from service.settings import Settings
from service.styles.library import StyleLibrary
from service.uploads.routes import router as uploads
from service.users.keys import router as keys
from service.users.me import router as me
from service.users.sign_in import router as sign_in
from service.webhooks.secrets import WebhookSecrets
from workers.contract.request import Json
from workers.farm import Farm

ROUTERS = (
    methods,
    styles,
    scenes,
    assets,
    uploads,
    jobs,
    tasks,
    events,
    files,
    film_frames,
    queue,
    exports,
    webhooks,
    previews,
    artefacts,
    project_archives,
    projects,
    project_versions,
    project_films,
    project_comments,
    project_jobs,
    project_previews,
    estimates,
    sharing,
    live,
    webrtc,
    me,
    sign_in,
    keys,
    owners,
    records,
    ops,
    fleet,
    queued_jobs,
    load,
    pages,
)


def create_app(settings: Settings, farm: Farm) -> FastAPI:
    """The HTTP service over `farm`, which the caller starts and stops."""
    service = _context(settings, farm)
    app = _routes()
    app.state.service = service
    app.state.live = _sessions(service)
    errors.install(app)
    app.mount("/static", StaticFiles(directory=bundle.DIST, check_dir=False), name="static")
    _add_middleware(app, service)
    return app


def openapi_document() -> Json:
    """The OpenAPI document that the service answers with at /openapi.json; needs no farm."""
    return _routes().openapi()


def _routes() -> FastAPI:
    """An application with all routes and without a farm, which cannot answer yet."""
    app = FastAPI(
        title=openapi.TITLE,
        version="1",
        summary=openapi.SUMMARY,
        description=openapi.DESCRIPTION,
        docs_url=None,
        redoc_url=None,
        lifespan=_lifespan,
        routes=[route for router in ROUTERS for route in router.routes],
    )
    openapi.install(app)
    return app


@asynccontextmanager
async def _lifespan(app: FastAPI) -> AsyncIterator[None]:
    app.state.service.admission.start()
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
        preview_threads=CapacityLimiter(settings.preview_threads),
        admission=Admission(classes(settings)),
        webhook_secrets=_secrets(settings),
        styles=StyleLibrary(farm, settings.styles_dir),
        provider=_provider(settings),
        registry=CollectorRegistry(),
    )
    service.registry.register(FarmMetrics(farm))
    add_machine(service.registry, settings)
    return service


def _provider(settings: Settings) -> Provider | None:
    return Provider(settings, _secrets(settings).master()) if settings.oidc_issuer else None


def _secrets(settings: Settings) -> WebhookSecrets:
    given = settings.webhook_secret
    return WebhookSecrets(settings.home / "webhook_secret", given.get_secret_value() if given else "")


def _add_middleware(app: FastAPI, service: ServiceContext) -> None:
    """Add the middleware. The one added last is the outermost."""
    settings = service.settings
    app.add_middleware(AuditTrail, audit=service.farm.audit)
    app.add_middleware(InsidePrefix)
    app.add_middleware(
        JsonBodies,
        max_bytes=settings.max_json_bytes,
        max_project_bytes=settings.max_project_bytes,
        idle_s=settings.idle_s,
    )
    app.add_middleware(Gate, settings=settings, farm=service.farm, rates=Rates())
    app.add_middleware(Edge, metrics=HttpMetrics(service.registry, service.streams.count))
    app.add_middleware(OutsidePrefix)
