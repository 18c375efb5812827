"""Annotation files in."""

from scene4d.formats.annotations._contract import AnnotationFormat
from scene4d.formats.annotations._registry import annotation_formats, read_annotations

__all__ = ["AnnotationFormat", "annotation_formats", "read_annotations"]
