"""All pages but the viewer's."""

from fastapi import APIRouter

from tidemap.services.context import Context
from tidemap_web.pages import anomaly_pages, location_pages, overview_pages, report_pages, session_pages

PAGES = (overview_pages, anomaly_pages, location_pages, report_pages, session_pages)


def router(ctx: Context) -> APIRouter:
    """The routes of each module of pages."""
    routes = APIRouter(include_in_schema=False)
    for module in PAGES:
        routes.include_router(module.router(ctx))
    return routes
