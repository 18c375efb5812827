"""See it, touch it: one page for a scene, from disk (``view``) or with a server (``serve``)."""

from scene4d.app.viewing import ViewOptions, view

__all__ = ["ViewOptions", "view"]
