"""PETS XML (CVML): frames from 0, boxes as centre and size in pixels, one id per track."""

import io
from pathlib import Path
from typing import Any
from xml.sax import SAXParseException
from xml.sax.handler import ContentHandler
from xml.sax.xmlreader import InputSource

import defusedxml.sax
import numpy as np
from defusedxml.common import DefusedXmlException

from scene4d.core.errors import InputError
from scene4d.core.people import Detections
from scene4d.core.text import quoted, read_text
from scene4d.formats.annotations.contract import AnnotationFormat, Rows

_BOX = ("xc", "yc", "w", "h")


class _Boxes(ContentHandler):
    """Collects (frame, id, box) with the line of each; a tree would not know its lines."""

    def __init__(self) -> None:
        super().__init__()
        self.frame: int | None = None
        self.track = -1
        self.rows: list[tuple[int, int, list[float]]] = []
        self.where: list[str] = []

    def _where(self) -> str:
        return f"line {self._locator.getLineNumber()}"  # type: ignore[attr-defined]

    def _number(self, name: str, attributes: Any, key: str, kind: type) -> Any:
        text = attributes.get(key)
        try:
            return np.int64(text) if kind is int else float(text)
        except (TypeError, ValueError, OverflowError) as error:
            raise InputError(
                f"{self._where()}: <{name}> needs a number {key}=, found {quoted(text)}"
            ) from error

    def startElement(self, name: str, attrs: Any) -> None:
        if name == "frame":
            self.frame = self._number(name, attrs, "number", int)
        elif name == "object":
            self.track = self._number(name, attrs, "id", int)
        elif name == "box":
            if self.frame is None:
                raise InputError(f"{self._where()}: <box> outside any <frame>")
            box = [self._number(name, attrs, key, float) for key in _BOX]
            self.rows.append((self.frame, self.track, box))
            self.where.append(self._where())


def _sniff(path: Path, head: str) -> bool:
    return "<frame" in head and "<objectlist" in head


def _read(path: Path, image_size: tuple[int, int]) -> Rows:
    handler = _Boxes()
    try:
        parser = defusedxml.sax.make_parser()
        parser.setContentHandler(handler)
        source = InputSource()  # of text, so that the encoding it declares is of no account
        source.setCharacterStream(io.StringIO(read_text(path)))
        parser.parse(source)
    except SAXParseException as error:
        raise InputError(
            f"line {error.getLineNumber()}: is not well-formed XML: {error.getMessage()}"
        ) from error
    except DefusedXmlException as error:
        raise InputError(f"XML with entities or external references is refused: {error}") from error
    box = np.array([row[2] for row in handler.rows], dtype=float).reshape(-1, 4)
    centre, half = box[:, :2], box[:, 2:] / 2
    found = Detections.from_boxes(
        image_size,
        np.array([row[0] for row in handler.rows], dtype=np.int64),
        np.hstack([centre - half, centre + half]),
        track=np.array([row[1] for row in handler.rows], dtype=np.int64),
    )
    return Rows(found, handler.where)


FORMAT = AnnotationFormat("pets", "PETS XML", _sniff, _read)
