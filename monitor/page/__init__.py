"""The status page: how campaigns stand, for browsers without WebGL and for Prometheus; it reads stores only."""

from .app import make_app
from .reviews import Reviews
from .server import PageServer, serve_pages
from .sites import Sites, SiteSource

__all__ = ["PageServer", "Reviews", "SiteSource", "Sites", "make_app", "serve_pages"]
