"""The sample video: people in front of a fixed camera whose true calibration is published.

It is PETS 2009 S2.L1 View_001 (795 frames, 768x576, 10 fps, University of Reading), distributed
with OpenCV as ``vtest.avi``.
"""

from pathlib import Path

from scene4d.core.fetching import DebianPackage, Download, WebFile, fetched

SAMPLE = Download(
    name="sample video",
    file="vtest.avi",
    sha256="45cddc9490be69345cbdab64ca583be65987e864ca408038e648db99e10516cf",
    size_bytes=8_131_690,
    licence="© University of Reading, for research with acknowledgement (PETS 2009)",
    sources=(
        DebianPackage("opencv-doc"),
        WebFile("https://github.com/opencv/opencv/raw/4.10.0/samples/data/vtest.avi"),
    ),
)


def sample_video(folder: Path) -> Path:
    """The sample video in ``folder``, downloaded on first use; raises as :func:`.fetched`."""
    return fetched(SAMPLE, folder)


def first_seconds(video: Path, out: Path, seconds: float) -> Path:
    """Copy the beginning of a video without re-encoding, and return ``out``.

    An existing ``out`` is kept.
    """
    import av

    if out.exists():
        return out
    part = out.with_name(f".scene4d-{out.name}")
    with av.open(str(video)) as source, av.open(str(part), "w") as target:
        footage = source.streams.video[0]
        copy = target.add_stream_from_template(footage)
        for packet in source.demux(footage):
            if packet.dts is None or packet.dts * packet.time_base >= seconds:
                break
            packet.stream = copy
            target.mux(packet)
    return part.replace(out)
