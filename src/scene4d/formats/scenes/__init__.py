"""Scenes out: people and vehicles through time, in formats that other programs read."""

from scene4d.formats.scenes.contract import SceneFormat, SceneTable
from scene4d.formats.scenes.geo import GeoAnchor
from scene4d.formats.scenes.registry import scene_formats, write_scene

__all__ = ["GeoAnchor", "SceneFormat", "SceneTable", "scene_formats", "write_scene"]
