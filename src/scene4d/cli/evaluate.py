"""``scene4d evaluate``: the paper's experiments and our own."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from scene4d.cli.arguments import command_line, parse_image_size, reflowed
from scene4d.cli.command import Answer, Job, command, output_folder

if TYPE_CHECKING:
    from collections.abc import Callable

    from scene4d.core.progress import Progress
    from scene4d.evaluation.trials.activities import ActivityEvaluation
    from scene4d.evaluation.trials.outcomes import Evaluation
    from scene4d.evaluation.trials.sites import SiteEvaluation

evaluate = typer.Typer(
    name="evaluate",
    no_args_is_help=True,
    rich_markup_mode="rich",
    help="Measure calibrations and searches against recordings with ground truth.",
)

_Data = Annotated[Path, typer.Option("--data", metavar="DIR", help="Folder of the data set.")]
_Out = Annotated[
    Path | None,
    typer.Option(
        "--out",
        metavar="DIR",
        help="Folder for evaluation.html, figures/ and evaluation.json. Without it, no file is "
        "written.",
    ),
]


@command("evaluate pets")
def pets(job: Job, *, data: _Data, out: _Out = None) -> Answer:
    """PETS 2009 S2.L1, View 1, against its published Tsai calibration.

    DIR holds View_001.xml (camera) and PETS2009-S2L1.xml (hand-drawn boxes); the video and
    frcnn_det.txt (Faster R-CNN boxes) are used if present.

    [bold]Examples[/bold]

      scene4d evaluate pets --data data/pets2009
      scene4d evaluate pets --data data/pets2009 --out pets --json
    """
    from scene4d.evaluation import EvaluateOptions, evaluate_pets

    return _evaluated(job, lambda step: evaluate_pets(data, EvaluateOptions(), step), out)


@command("evaluate towncentre")
def towncentre(job: Job, *, data: _Data, out: _Out = None) -> Answer:
    """TownCentre, the paper's first experiment.

    DIR holds TownCentre-calibration.ci and TownCentreGTHalfRes.csv; tracker_boxes.txt, the folder
    frames and the original video (1000 frames of it, as in the paper) are used if present. The
    boxes in the CSV file were made with the reference calibration: rows that use them are marked as
    circular.

    [bold]Examples[/bold]

      scene4d evaluate towncentre --data data/towncentre
      scene4d evaluate towncentre --data data/towncentre --out towncentre
    """
    from scene4d.evaluation import EvaluateOptions, evaluate_towncentre

    return _evaluated(job, lambda step: evaluate_towncentre(data, EvaluateOptions(), step), out)


@command("evaluate virat")
def virat(
    job: Job,
    *,
    data: _Data,
    clip: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Clip, as VIRAT_S_000001. Default: the first one."),
    ] = None,
    image_size: Annotated[
        str | None,
        typer.Option(metavar="WxH", help="Size of the footage, if the video is not in DIR."),
    ] = None,
    out: _Out = None,
) -> Answer:
    """VIRAT, the paper's second experiment, on the official files.

    DIR holds *_homography_img2world.txt and *.viratdata.objects.txt, and the videos if present.
    The ground truth is only the ground homography: the true orientation follows from it for square
    pixels and a principal point at the image centre.

    [bold]Examples[/bold]

      scene4d evaluate virat --data VIRAT --clip VIRAT_S_000001
      scene4d evaluate virat --data VIRAT --image-size 1920x1080 --out virat
    """
    from scene4d.evaluation import EvaluateOptions, evaluate_virat

    size = None if image_size is None else parse_image_size(image_size)
    options = EvaluateOptions(clip=clip, image_size=size)
    return _evaluated(job, lambda step: evaluate_virat(data, options, step), out)


@command("evaluate custom")
def custom(
    job: Job,
    *,
    camera: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="The calibration: camera.json or any known camera format."
        ),
    ] = None,
    footage: Annotated[
        str | None,
        typer.Option(
            metavar="SOURCE",
            help="Footage to calibrate from, in every way there is, instead of --camera.",
        ),
    ] = None,
    reference: Annotated[
        Path,
        typer.Option(
            metavar="FILE",
            help="The ground truth: a camera file, or a 3x3 homography from pixels to metres.",
        ),
    ],
    points: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Pixels on the ground: lines of u,v; people.parquet; or an annotation file, for "
            "the feet in it. Default: a grid of pixels.",
        ),
    ] = None,
    image_size: Annotated[
        str | None,
        typer.Option(metavar="WxH", help="Size of the footage, for formats that do not store it."),
    ] = None,
    out: _Out = None,
) -> Answer:
    """Compare any calibration, or what your footage gives, with any reference.

    Both describe the same footage, as decoded. Their headings and origins may differ: the two maps
    are aligned by a rigid motion, as in the paper. With --footage it is calibrated by every method,
    with and without the true lens, at the feet of the people seen in it.

    [bold]Examples[/bold]

      scene4d evaluate custom --camera out/camera.json --reference surveyed.krtd
      scene4d evaluate custom --camera out/camera.json --reference img2world.txt \\
          --points out/people.parquet --out score
      scene4d evaluate custom --footage yard.mp4 --reference surveyed.json \\
          --out score
    """
    from scene4d.evaluation import EvaluateOptions, evaluate_custom, evaluate_footage

    size = None if image_size is None else parse_image_size(image_size)
    options = EvaluateOptions(points=points, image_size=size)
    if (camera is None) == (footage is None):
        raise typer.BadParameter("give either a camera or footage", param_hint="--camera")
    if camera is None:
        return _evaluated(
            job, lambda step: evaluate_footage(str(footage), reference, options, step), out
        )
    return _evaluated(job, lambda _: evaluate_custom(camera, reference, options), out)


@command("evaluate meva")
def meva(
    job: Job,
    *,
    data: _Data,
    camera: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="Camera to report instead of G328 and G506. Repeatable.",
        ),
    ] = None,
    out: _Out = None,
) -> Answer:
    """Search for labelled activities on MEVA.

    DIR holds cameras/*.krtd and the annotations, as annotations.tar.xz or unpacked in annotations/.
    Every catalogue activity that MEVA labels is searched for in the annotated tracks of two
    cameras, G328 and G506. The constants were chosen on G341 and G424, which must be present too.
    Four baselines are scored as well: the same activities in the image, in pixels and in box sizes;
    the probability of being near alone; and the ends of tracks, which the annotation gives away.
    Average precision is by NIST's rule and by overlap in time, with intervals, for each camera and
    for the right participants; stated probabilities are held against what came true.

    [bold]Examples[/bold]

      scene4d evaluate meva --data data/meva
      scene4d evaluate meva --data data/meva --out meva --json
    """
    from scene4d.evaluation import EvaluateOptions, evaluate_meva

    options = EvaluateOptions(cameras=tuple(camera)) if camera else EvaluateOptions()
    return _evaluated(job, lambda step: evaluate_meva(data, options, step), out)


@command("evaluate site")
def site(
    job: Job,
    *,
    data: _Data,
    site: Annotated[
        Path | None,
        typer.Option(
            "--site",
            metavar="SITE",
            help="Folder written by align. Default: the site, the scenes or the videos in DIR.",
        ),
    ] = None,
    out: _Out = None,
) -> Answer:
    """Compare a site with the true poses of its cameras.

    DIR holds the true cameras, in any known format, each named as its camera or with the same
    number at the end (0.json for cam0). Without --site a site in DIR is taken; else the scenes
    there are aligned; else the videos there are calibrated, tracked and aligned, told nothing.
    offsets.json in DIR gives the seconds to add to each clock; without it the footage is taken as
    synchronised.

    [bold]Examples[/bold]

      scene4d evaluate site --data lab --site site
      scene4d evaluate site --data lab --out score --json
    """
    from scene4d.evaluation import evaluate_site

    return _evaluated(job, lambda step: evaluate_site(data, site, step), out)


def _evaluated(
    job: Job,
    work: "Callable[[Progress], Evaluation | ActivityEvaluation | SiteEvaluation]",
    out: Path | None,
) -> Answer:
    """Evaluate, and write the page if ``out`` is given."""
    from scene4d.cli.scores import show
    from scene4d.evaluation.pages.page import write_evaluation

    with output_folder(out), job.progress() as progress:
        found = work(progress)
        if out is not None:
            write_evaluation(found, out, command=command_line(), progress=progress)
    where = {} if out is None else {"out": str(out)}
    return Answer(found.to_dict() | where, lambda: show(found, out))


for _command in (pets, towncentre, virat, meva, custom, site):
    evaluate.command(help=reflowed(_command.__doc__))(_command)
