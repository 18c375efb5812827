"""See it, touch it: one page for a scene, from disk (``view``) or with a server (``serve``)."""

from scene4d.app.serving import ServeOptions, application, serve
from scene4d.app.viewing import ViewOptions, view

__all__ = ["ServeOptions", "ViewOptions", "application", "serve", "view"]
