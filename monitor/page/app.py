"""The page's addresses: the fleet, a site, its picture and state, its review, health and metrics."""

from __future__ import annotations

from importlib.resources import files
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, PlainTextResponse, RedirectResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp

from configs import MicroreliefError
from dashboards import page_style
from pipelines import Instant, format_instant

from ..forecast import format_bytes
from .guard import Guard, is_from_here
from .prometheus import exposition
from .reviews import Reviews
from .sites import Site, Sites

__all__ = ["make_app"]

REFRESH_S = 60
LAMPS = {"ok": "green", "empty": "", "warning": "amber", "degraded": "amber", "alarm": "red"}


def make_app(sites: Sites, reviews: Reviews, *, host: str = "127.0.0.1", token: str = "") -> ASGIApp:
    """Make the page.

    Parameters
    ----------
    sites : Sites
    reviews : Reviews
    host : str
        The address that it will listen on.
    token : str
        Asked of everybody, where it is not empty.
    """
    pages = Environment(loader=PackageLoader("monitor.page"), autoescape=True, undefined=StrictUndefined)
    pages.filters["told"] = _told
    pages.filters["bytes"] = format_bytes

    def page(request: Request, name: str, status: int = 200, **values: Any) -> HTMLResponse:
        up = "../" * (request.url.path.count("/") - 1)  # links without a root: a proxy may serve us under a path
        text = pages.get_template(name).render(up=up, refresh_s=REFRESH_S, lamps=LAMPS, **values)
        return HTMLResponse(text, status)

    def fleet(request: Request) -> Response:
        everyone = list(sites)
        if len(everyone) == 1:
            return RedirectResponse(f"site/{everyone[0].key}")
        return page(request, "fleet.html", sites=everyone)

    def site(request: Request, key: str) -> Response:
        seen = _known(sites, key)
        trouble, shown = seen.trouble, None
        if seen.standing is not None:
            try:
                shown = sites.glance(key)
            except (MicroreliefError, OSError, ValueError) as error:
                trouble = str(error)
        return page(
            request,
            "site.html",
            site=seen,
            trouble=trouble,
            glance=shown,
            fleet=len(sites) > 1,
            here=is_from_here(request),
        )

    def picture(_: Request, key: str) -> Response:
        _known(sites, key)
        png = sites.picture(key)
        if png is None:
            raise HTTPException(404, "no scan yet")
        return Response(png, media_type="image/png")

    def state(_: Request, key: str) -> Response:
        seen = _known(sites, key)
        if seen.standing is None:
            return JSONResponse({"state": "unknown", "why": seen.trouble}, 503)
        return JSONResponse(seen.standing.as_mapping())

    def review(_: Request, key: str) -> Response:
        seen = _known(sites, key)
        if seen.standing is None or not seen.standing.scans:
            raise HTTPException(409, "nothing to review yet")
        reviews.start(key, sites.source(key).store)
        return RedirectResponse("review", 303)

    def review_state(request: Request, key: str) -> Response:
        seen = _known(sites, key)
        how, link, trouble = reviews.state(key)
        return page(request, "review.html", site=seen, how=how, link=link, trouble=trouble)

    def ready(_: Request) -> Response:
        unread = [seen.key for seen in sites if seen.standing is None]
        return PlainTextResponse(f"not ready: {', '.join(unread)}\n" if unread else "ready\n", 503 if unread else 200)

    def wrong(request: Request, error: Exception) -> Response:
        assert isinstance(error, HTTPException)
        return page(request, "wrong.html", error.status_code, number=error.status_code, told=error.detail)

    keyed = {"/site/{key}": site, "/site/{key}/picture.png": picture, "/site/{key}/status.json": state}
    routes = [Route(path, _threaded(answer)) for path, answer in keyed.items()]
    routes += [
        Route("/", _threaded(fleet)),
        Route("/site/{key}/review", _threaded(review), methods=["POST"]),
        Route("/site/{key}/review", _threaded(review_state)),
        Route("/style.css", _threaded(lambda _: Response(_style(), media_type="text/css"))),
        Route("/healthz", _threaded(lambda _: PlainTextResponse("alive\n"))),
        Route("/livez", _threaded(lambda _: PlainTextResponse("alive\n"))),
        Route("/readyz", _threaded(ready)),
        Route("/metrics", _threaded(lambda _: Response(exposition(sites), media_type="text/plain; version=0.0.4"))),
    ]
    return Guard(Starlette(routes=routes, exception_handlers={HTTPException: wrong}), host, token)


def _threaded(answer: Any) -> Any:
    """Answer on a thread: reading a store must not stop the others' answers."""

    async def respond(request: Request) -> Response:
        found: Response = await run_in_threadpool(answer, request, **request.path_params)
        return found

    return respond


def _known(sites: Sites, key: str) -> Site:
    if key not in sites:
        raise HTTPException(404, "no such site")
    return sites[key]


def _style() -> str:
    return page_style() + files("monitor.page").joinpath("templates/page.css").read_text(encoding="utf-8")


def _told(moment: Instant | None) -> str:
    """Write a time as people read it, UTC."""
    if moment is None:
        return "–"
    return (
        format_instant(moment.astype("datetime64[s]").astype("datetime64[ns]")).replace("T", " ").replace("Z", " UTC")
    )
