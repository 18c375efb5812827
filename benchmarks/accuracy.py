"""Measure accuracy on real recordings with known cameras.

    python -m benchmarks.accuracy [--data DIR] [--write]

DIR holds pets2009/, towncentre/ and footage/ (by default $SCENE4D_DATA or ../shared/data). With
--write the table replaces what stands between the markers in docs/accuracy.md, and its main rows
those in README.md.
"""

import tempfile
from collections.abc import Iterable
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path

import av
import numpy as np

from benchmarks import ROOT, options_of
from benchmarks.recordings import Recording, lab
from scene4d import calibrate
from scene4d.calibration import CalibrateOptions
from scene4d.calibration.watching import solved, watch
from scene4d.core.calibration import Calibration
from scene4d.core.orientation import Orientation
from scene4d.core.progress import Silent
from scene4d.evaluation import PUBLISHED, Reference, pets, towncentre
from scene4d.video.reader import open_source
from scene4d.video.undistort import Undistorter

BEGIN, END = "<!-- accuracy: begin -->", "<!-- accuracy: end -->"


@dataclass(frozen=True)
class Row:
    case: str
    given: str
    result: Calibration
    reference: Reference
    undistorted: bool = False

    def cells(self) -> list[str]:
        camera, true = self.result.camera, self.reference.camera
        if camera is None or not self.result:
            return [self.case, self.given, "refused", *[""] * 5]
        error = self.reference.score(camera, undistorted=self.undistorted)
        predicted = self.reference.predicted_m(self.result, undistorted=self.undistorted)
        near = self.reference.near(self.result, undistorted=self.undistorted).to_dict()
        shares = near["auc"], near["auc_within_two_tau"]
        auc = "" if None in shares else "{:.4f} ({:.3f})".format(*shares)
        return [
            self.case,
            self.given,
            f"**{error.mean_m:.2f} ± {error.sd_m:.2f} m**",
            f"{predicted:.2f} m",
            auc,
            f"{camera.focal_px:.0f} ({true.focal_px:.0f})",
            f"{np.degrees(camera.tilt_rad):.1f}° ({np.degrees(true.tilt_rad):.1f}°)",
            f"{camera.height_m:.2f} m ({true.height_m:.2f} m)",
        ]


def undistorted_video(reference: Reference, video: Path, out: Path) -> Path:
    """The footage through the true lens, losslessly coded, with the same clock."""
    straight = Undistorter(reference.camera.lens)
    with open_source(video) as source, av.open(str(out), "w") as container:
        stream = container.add_stream("ffv1", rate=Fraction(round(source.fps or 10), 1))
        stream.width, stream.height = source.image_size
        stream.pix_fmt = "bgr0"
        for frame in source.frames():
            picture = av.VideoFrame.from_ndarray(straight(frame.image_bgr), format="bgr24")
            container.mux(stream.encode(picture))
        container.mux(stream.encode(None))
    return out


def undistorted_pictures(reference: Reference, folder: Path, out: Path) -> Path:
    import cv2

    straight = Undistorter(reference.camera.lens)
    with open_source(folder) as source:
        for frame in source.frames():
            cv2.imwrite(str(out / f"{frame.index:04d}.png"), straight(frame.image_bgr))
    return out


def walked(room: Recording, found: Calibration) -> Reference:
    """A true camera whose people nobody annotated: the feet are those that were found."""
    feet = np.empty((0, 2)) if found.segments is None else found.segments.foot_uv
    return Reference(room.name, room.camera, feet)


def boxes_with_pictures(data: Path, park: Reference, street: Reference) -> list[Row]:
    """Boxes, and the orientation network for what they do not tell: by both methods."""
    folder, frames = data / "pets2009", data / "towncentre" / "frames"
    video = folder / "vtest.avi"
    tracker = CalibrateOptions(
        annotations=data / "towncentre" / "tracker_boxes.txt",
        person_height_m=1.7018,
        drop_invalid=True,
    )
    cases = (
        ("PETS 2009 video, its boxes", video, CalibrateOptions(), park),
        ("PETS 2009, Faster R-CNN boxes", video, boxes_in(folder / "frcnn_det.txt"), park),
        ("PETS 2009, hand-drawn boxes", video, boxes_in(folder / "PETS2009-S2L1.xml"), park),
        ("TownCentre, tracker boxes, 1.7018 m", frames, tracker, street),
    )
    found = []
    for case, source, joint, reference in cases:
        paper = replace(joint, method="paper", orientation="network")
        for said, asked in (("joint", joint), ("the paper's method", paper)):
            result = on_boxes(source, asked)
            found.append(Row(f"{case}, {said}", "nothing (network)", result, reference))
    return found


def boxes_in(file: Path) -> CalibrateOptions:
    return CalibrateOptions(annotations=file)


def on_boxes(source: Path, options: CalibrateOptions) -> Calibration:
    """As ``calibrate``, from boxes alone where the detector gives keypoints."""
    with open_source(source) as footage:
        options = options.read(footage.image_size)
        seen = watch(footage, options, Silent(), {})
    return solved(replace(seen, detections=seen.detections.without_keypoints()), options)


def rows(data: Path, scratch: Path) -> list[Row]:
    park, street = pets(data / "pets2009"), towncentre(data / "towncentre")
    video, frames = data / "pets2009" / "vtest.avi", data / "towncentre" / "frames"
    straight_video = undistorted_video(park, video, scratch / "pets.mkv")
    (scratch / "street").mkdir()
    straight_frames = undistorted_pictures(street, frames, scratch / "street")
    found = [
        Row("PETS 2009 video", "nothing", calibrate(video), park),
        Row("PETS 2009 video, undistorted", "nothing", calibrate(straight_video), park, True),
        Row("TownCentre, 2 frames", "nothing", calibrate(frames), street),
        Row("TownCentre, 2 frames, undist.", "nothing", calibrate(straight_frames), street, True),
    ]
    found += boxes_with_pictures(data, park, street)
    clip = data / "footage" / "towncentre" / "tc_1080p_orig0-251.mp4"
    found.append(Row("TownCentre, 10 s video", "nothing", calibrate(clip), street))
    for number in (0, 2):
        room, _ = lab(number, data)
        result = calibrate(data / "footage" / "lab" / f"cam{number}.mp4")
        found.append(Row(f"laboratory, camera {number}", "nothing", result, walked(room, result)))
    boxes = data / "towncentre" / "tracker_boxes.txt"
    for name, title in (("frcnn_det.txt", "Faster R-CNN"), ("PETS2009-S2L1.xml", "hand-drawn")):
        result = calibrate(
            None,
            CalibrateOptions(
                annotations=data / "pets2009" / name,
                image_size=park.camera.image_size,
                lens=data / "pets2009" / "View_001.xml",
            ),
        )
        found.append(Row(f"PETS 2009, {title} boxes", "lens", result, park))
    camera = street.camera
    for height in (1.7018, 1.8288):
        result = calibrate(
            None,
            CalibrateOptions(
                annotations=boxes,
                image_size=camera.image_size,
                lens=data / "towncentre" / "TownCentre-calibration.ci",
                orientation=Orientation(camera.focal_px, camera.tilt_rad, camera.roll_rad),
                method="paper",
                person_height_m=height,
                drop_invalid=True,
            ),
        )
        case = f"TownCentre, tracker boxes, the paper's method, {height:g} m"
        found.append(Row(case, "lens, tilt, roll", result, street))
    return found


IN_README = (
    "PETS 2009 video",
    "TownCentre, 2 frames",
    "TownCentre, 10 s video",
    "laboratory, camera 0",
    "laboratory, camera 2",
    "PETS 2009, Faster R-CNN boxes",
    "PETS 2009, hand-drawn boxes",
)
"""Ours, beside the published row."""


def table(found: list[Row]) -> list[list[str]]:
    head = ["footage", "given", "error", "predicted", "AUC", "focal px", "tilt", "height"]
    p = PUBLISHED["towncentre"]
    paper = [
        f"*published: TownCentre, {p.frames} frames*",
        "*its network*",
        f"*{p.mean_m} ± {p.sd_m} m*",
        "",
        f"*{p.auc}*",
        *[""] * 3,
    ]
    return [head, ["---"] * len(head), paper, *(row.cells() for row in found)]


def markdown(lines: Iterable[list[str]]) -> str:
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)


def replace_table(page: Path, text: str) -> None:
    before, rest = page.read_text().split(BEGIN)
    page.write_text(f"{before}{BEGIN}\n{text}\n{END}{rest.split(END)[1]}")


def main() -> None:
    parser = options_of(__doc__)
    parser.add_argument("--write", action="store_true", help="put the tables into the pages")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        lines = table(rows(arguments.data, Path(scratch)))
    print(markdown(lines))
    if arguments.write:
        replace_table(ROOT / "docs" / "accuracy.md", markdown(lines))
        head, rule, published, *measured = (cells[:4] for cells in lines)
        ours = [cells for cells in measured if cells[0] in IN_README]
        replace_table(ROOT / "README.md", markdown([head, rule, *ours, published]))


if __name__ == "__main__":
    main()
