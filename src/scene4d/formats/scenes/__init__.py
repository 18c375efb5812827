"""Scenes out: people and vehicles through time, in formats that other programs read."""

from scene4d.formats.scenes._contract import SceneFormat, SceneTable
from scene4d.formats.scenes._geo import GeoAnchor
from scene4d.formats.scenes._registry import scene_formats, write_scene

__all__ = ["GeoAnchor", "SceneFormat", "SceneTable", "scene_formats", "write_scene"]
