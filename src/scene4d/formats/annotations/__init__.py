"""Annotation files in."""

from scene4d.formats.annotations.contract import AnnotationFormat
from scene4d.formats.annotations.registry import annotation_formats, read_annotations

__all__ = ["AnnotationFormat", "annotation_formats", "read_annotations"]
