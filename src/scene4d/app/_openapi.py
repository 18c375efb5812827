"""The description of the HTTP interface, OpenAPI 3.1."""

from importlib.metadata import version
from typing import Any


def description() -> dict[str, Any]:
    """What ``/openapi.json`` answers."""
    run = {"name": "run", "in": "path", "required": True, "schema": {"type": "integer"}}
    piece = run | {"name": "piece"}
    since = {
        "name": "since_s",
        "in": "query",
        "description": "rows from this time on, seconds from the clip's start",
        "schema": {"type": "number"},
    }
    operations: tuple[tuple[str, str, str, str, list[dict[str, Any]]], ...] = (
        ("/", "get", "The page.", "text/html", []),
        ("/openapi.json", "get", "This description.", "application/json", []),
        ("/api/scene", "get", "Cameras and runs, without rows.", "application/json", []),
        ("/api/runs/{run}/rows", "get", "Rows, packed.", "application/json", [run, since]),
        ("/api/runs/{run}/video", "get", "Footage, with ranges.", "video/mp4", [run]),
        ("/api/runs/{run}/pieces", "get", "Where pieces begin.", "application/json", [run]),
        ("/api/runs/{run}/pieces/{piece}", "get", "One as MP4.", "video/mp4", [run, piece]),
        ("/api/runs/{run}/view", "get", "The empty view.", "image/jpeg", [run]),
        ("/api/runs/{run}/now", "get", "What it shows now, small.", "image/jpeg", [run]),
        ("/api/fused", "get", "A site's rows of everybody once.", "application/json", []),
        ("/api/search", "post", "Events that words ask for.", "application/json", []),
        ("/api/export", "post", "These events as json, csv or actev.", "text/plain", []),
        ("/api/places", "get", "Zones and lines.", "application/json", []),
        ("/api/places", "put", "Save zones and lines.", "application/json", []),
        ("/api/alerts", "get", "Searches that a watch makes too.", "application/json", []),
        ("/api/alerts", "put", "Keep one more.", "application/json", []),
        ("/api/alerts", "delete", "Keep one no longer.", "application/json", []),
        ("/api/runs/{run}/calibration", "post", "Calibrate again.", "application/json", [run]),
        ("/api/calibration", "get", "Where that stands, or its camera.", "application/json", []),
        ("/api/calibration", "delete", "Cancel it.", "application/json", []),
        ("/api/live", "get", "Runs that grow, and alerts.", "text/event-stream", []),
    )
    paths: dict[str, Any] = {}
    for path, method, summary, kind, parameters in operations:
        said: dict[str, Any] = {"summary": summary, "parameters": parameters}
        said["responses"] = {
            "200": {"description": summary, "content": {kind: {}}},
            "default": {"$ref": "#/components/responses/error"},
        }
        if (path, method) in _BODIES:
            content = {"application/json": {"schema": _BODIES[path, method]}}
            said["requestBody"] = {"required": True, "content": content}
        paths.setdefault(path, {})[method] = said
    return {
        "openapi": "3.1.0",
        "info": {"title": "scene4d serve", "version": version("scene4d")},
        "paths": paths,
        "components": {"responses": {"error": _ERROR}, "securitySchemes": _TOKEN},
        "security": [{}, {"token": []}],
    }


_POINTS = {
    "type": "array",
    "items": {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2},
}
_PLACE = {
    "type": "object",
    "required": ["points"],
    "properties": {"camera": {"type": "string"}, "points": _POINTS},
    "description": "points on the camera's ground, metres",
}
_NAMED = {"type": "object", "additionalProperties": _PLACE}
_SEARCH: dict[str, Any] = {
    "words": {"type": "string", "maxLength": 400},
    "min_score": {"type": "number", "minimum": 0, "maximum": 1},
    "min_probability": {"type": "number", "minimum": 0, "maximum": 1},
    "top": {"type": "integer", "minimum": 1},
}
_WORDS = {"words": _SEARCH["words"]}
_FORMAT = {"format": {"enum": ["json", "csv", "actev"]}}


def _object(properties: dict[str, Any], *required: str) -> dict[str, Any]:
    said = {"type": "object", "properties": properties, "additionalProperties": False}
    return said | ({"required": list(required)} if required else {})


_BODIES: dict[tuple[str, str], Any] = {
    ("/api/search", "post"): _object(_SEARCH, "words"),
    ("/api/export", "post"): _object(_SEARCH | _FORMAT, "words", "format"),
    ("/api/runs/{run}/calibration", "post"): _object(
        {"orientation": {"type": "object"}, "landmarks": {"type": "object"}}
    ),
    ("/api/alerts", "put"): _object(_WORDS, "words"),
    ("/api/alerts", "delete"): _object(_WORDS, "words"),
    ("/api/places", "put"): _object({"zones": _NAMED, "lines": _NAMED}),
}
_ERROR = {
    "description": "What is wrong, and what helps.",
    "content": {
        "application/json": {
            "schema": {
                "type": "object",
                "properties": {
                    "error": {
                        "type": "object",
                        "properties": {
                            name: {"type": ["string", "null"]}
                            for name in ("kind", "message", "remedy")
                        },
                    }
                },
            }
        }
    },
}
_TOKEN = {"token": {"type": "http", "scheme": "bearer"}}
