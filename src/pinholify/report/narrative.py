"""The text and tables of a report, the same in every format."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinholify.evaluation.verdict import STRUCTURED
from pinholify.report.board_shape import BoardShape
from pinholify.report.boards import BoardEntry
from pinholify.report.contents import Report
from pinholify.report.maps import Coverage
from pinholify.report.numerals import angle, decimals, number, percent, px, round_down, scientific, with_std
from pinholify.report.overview import Length

MORE_THAN_NOISE = 1.5  # times
DRAWN_RESIDUAL = 0.03  # length of a typical residual as drawn on photographs, as a fraction of the image's width

FULL_NAMES = {"f": "f, focal length", "uc": "uc, principal point x", "vc": "vc, principal point y"}


@dataclass(frozen=True, slots=True)
class Table:
    """Cells as text; the first column names the row, and ``numeric`` tells whether the others are numbers."""

    caption: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    numeric: bool = True


@dataclass(frozen=True, slots=True)
class Section:
    """A section of the report; ``key`` identifies it and its figure, which ``caption`` explains."""

    key: str
    title: str
    paragraphs: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    caption: str = ""


def title(report: Report) -> str:
    """The title of the report."""
    return f"Calibration of {report.provenance.file}"


def subtitle(report: Report) -> str:
    """One line on the method, the photographs and the date of the calibration."""
    (width, height), count, day = report.image_size, len(report.boards), report.provenance.created[:10]
    return (
        f"{report.overview.method.capitalize()} method, {count} photograph{'s' * (count != 1)} "
        f"of {width} × {height} px, board {report.board}{f', calibrated on {day}' if day else ''}"
    )


def facts(report: Report) -> tuple[tuple[str, str, str], ...]:
    """The main numbers: label, value and meaning of each."""
    overview = report.overview
    alone = f"RMS per point; noise{_and_motion(report)} alone would leave {px(overview.floor_px)}"
    heldout = (
        ("Held-out error", px(overview.heldout_px), alone)
        if overview.heldout_px is not None
        else ("In-sample error", px(overview.insample_px), "RMS per point, on the photographs of the calibration")
    )
    wrong = (f"{overview.wrong_corners} of {overview.corners}", "left out of every number")
    boards, known = f"{overview.boards_used} of {overview.boards_found}", np.isfinite(overview.f_share)
    return (
        heldout,
        ("Focal length", f"± {percent(overview.f_share)}" if known else "unknown", "one standard deviation"),
        ("Coverage", percent(overview.coverage), "of the image is covered by corners"),
        ("Boards used", boards, f"found in {overview.images} photograph{'s' * (overview.images != 1)}"),
        *([("Wrong corners", *wrong)] if overview.wrong_corners else []),
    )


def sections(report: Report) -> tuple[Section, ...]:
    """All sections after the overview, in reading order."""
    return (
        *([_straightened()] if report.frames else []),
        _intrinsics(report),
        _errors(report),
        _photographs(report),
        _coverage(report),
        _certainty(report),
        _residuals(report),
        _straightness(report),
        _scene(report),
        *([] if report.board_shape is None else [_board_shape(report.board_shape)]),
        _comparison(report),
        _model(report),
        _usage(report),
        _provenance(report),
    )


def _straightened() -> Section:
    caption = (
        "The photograph as taken, and as a perfect pinhole camera would have taken it: straight edges must look "
        "straight. The thin lines are ruled between the end corners of the board's outer rows and columns; after "
        "straightening, the board's own lines must follow them."
    )
    return Section("frames", "Before and after", caption=caption)


def _intrinsics(report: Report) -> Section:
    k = report.intrinsics
    millimetres = k.square_mm is not None
    header = ("", "value ± std, squares", "95 % interval, squares", *(["mm"] if millimetres else []))
    rows = tuple(_length_row(length, k.square_mm) for length in k.lengths)
    horizontal, vertical, diagonal = k.field_of_view
    (width, height), (cx, cy) = k.view_size, k.view_centre
    text = (
        "The calibrated camera is an ideal pinhole camera without distortion, described by three numbers in squares of "
        f"the board. Its image plane is the plane of the board in {k.reference}: f is the distance of that plane from "
        "the camera's centre, and (uc, vc) is where the optical axis meets it, measured along the board's rows and "
        "columns from its first corner. The 95 % intervals assume independent corner errors. A standard deviation of f "
        "below 0.5 % is good enough for most work."
    )
    view = (
        f"In pixels: 'pinholify undistort' makes images of {width} × {height} px with focal length "
        f"fx = fy = {number(k.view_focal, 2)} px and principal point ({number(cx, 2)}, {number(cy, 2)}) px. The field "
        f"of view is about {angle(horizontal)} horizontally, {angle(vertical)} vertically and {angle(diagonal)} "
        "diagonally."
    )
    apart = (
        f"The boards disagree {number(k.disagreement, 1)} times as much as corner noise explains: they were bent, "
        "blurred or moving. The standard deviations here, and those of every ray, include this.",
    ) * (k.disagreement > 1.0)
    mirrored = ("The camera looks into a mirror; the straightened view shows the scene unreversed.",) * k.mirrored
    table = Table("K, the intrinsics", header, rows)
    return Section("intrinsics", "The camera in three numbers", (text, *apart, view, *mirrored), (table,))


def _length_row(length: Length, square_mm: float | None) -> tuple[str, ...]:
    low, high = length.interval
    digits = decimals(length.std, 2) if length.std > 0 else 4
    interval = f"{number(low, digits)} to {number(high, digits)}" if np.isfinite(low) else "unknown"
    millimetres = () if square_mm is None else (with_std(length.value * square_mm, length.std * square_mm),)
    return (FULL_NAMES[length.name], with_std(length.value, length.std), interval, *millimetres)


def _and_motion(report: Report) -> str:
    return " and board motion" if report.model.motion_px is not None else ""


def _errors(report: Report) -> Section:
    caption = (
        "Reprojection error of each photograph with the pose of its board fitted. Bar: RMS over its corners; dot: its "
        f"worst corner; thin line: the {px(report.overview.floor_px)} that corner noise{_and_motion(report)} alone "
        "would leave. In a good calibration all bars are about as long as that. A bar that stands out points to a "
        "board that was blurred, moving or wrongly detected: check its photograph."
        f"{' Wrong corners are not included.' if report.overview.wrong_corners else ''}"
    )
    return Section("errors", "Error by photograph", caption=caption)


def _photographs(report: Report) -> Section:
    crosses = "; crosses: wrong corners, which are in no number" if report.overview.wrong_corners else ""
    caption = (
        f"Detected corners. Dots: corners that count; rings: corners outside the camera's domain{crosses}. The lines "
        f"are residuals, drawn {residual_scale(report):g} times as long. In a good calibration they are short and "
        "point in all directions; a common direction or a pattern indicates a fault."
    )
    header = ("photograph", "state", "corners", "RMS, px", "worst, px", "CE ×1e-4", "distance, squares", "tilt")
    rows = tuple(_board_row(entry) for entry in report.boards)
    table = Table("All photographs", header, rows, numeric=False)
    return Section("photographs", "Photographs", report.overview.wrong_corners_said, (table,), caption)


def residual_scale(report: Report) -> float:
    """The factor by which residuals are magnified on photographs."""
    shown, rms = DRAWN_RESIDUAL * report.image_size[0], report.residuals.rms_px
    return round_down(shown / rms) if rms > 0 else 1.0


def state(entry: BoardEntry) -> str:
    """Whether a photograph is included, or why not."""
    if not entry.included:
        return f"left out: {entry.reason}"
    return "included, the reference" if entry.is_reference else "included"


def _board_row(entry: BoardEntry) -> tuple[str, ...]:
    suspicion = "" if entry.ratio is None else f"; suspicious, {entry.ratio:.1f} times the others' error"
    suspicion += "; too many wrong corners" if entry.crowded else ""
    note = f"; {entry.note}" if entry.note else ""
    dropped = f" ({entry.dropped} wrong, left out)" if entry.dropped else ""
    return (
        entry.name,
        state(entry) + suspicion + note,
        f"{len(entry.corners)}{dropped}",
        number(entry.rms_px, 3),
        number(entry.worst_px, 2),
        number(None if entry.ce is None else entry.ce * 1e4, 2),
        number(entry.distance, 1),
        angle(entry.tilt_degrees),
    )


def _coverage(report: Report) -> Section:
    coverage = report.coverage
    text = (
        f"The corners of the calibration cover {percent(coverage.share)} of the image, the camera's domain. All "
        f"measures count the corners inside it. {_shown(coverage)}"
    )
    advised = report.overview.advice is not None
    advice = (f"One more photograph would help most with the board {report.overview.advice}.",) * advised
    caption = (
        "Areas of the boards, in stronger colour where more boards were seen. Solid outline: the domain"
        f"{'; dashed outline: where the next board would help most' if advised else ''}. With good coverage the domain "
        "reaches into all four corners of the image."
    )
    return Section("coverage", "Coverage", (text, *advice), caption=caption)


def _shown(coverage: Coverage) -> str:
    """The part of the image that straightened pictures show, which may exceed the domain."""
    if not np.isfinite(coverage.limit_px):
        return "'pinholify undistort' shows the domain and leaves the rest black."
    return (
        "Outside it the map is extrapolated with growing uncertainty. 'pinholify undistort' shows the "
        f"{percent(coverage.shown)} of the image where the map is known to {px(coverage.limit_px)} and leaves the rest "
        "black."
    )


def _certainty(report: Report) -> Section:
    certainty = report.certainty
    text = (
        "The standard deviation of a pixel's ray, apart from a rotation of the whole camera, has a median of "
        f"{px(certainty.inside_px)} in the camera's domain and {px(certainty.image_px)} over the whole image."
    )
    caption = (
        "The stronger the colour, the larger the standard deviation. It grows where no board was seen, and should stay "
        "well below the error that your application tolerates."
    )
    return Section("certainty", "Uncertainty of the map", (text,), caption=caption)


def _residuals(report: Report) -> Section:
    field = report.residuals
    finding = (
        "The residuals are spatially correlated: several boards agree on an error that the camera does not model."
        if field.p_value < STRUCTURED
        else "The residuals show no spatial correlation."
    )
    text = (
        f"{finding} The correlation between neighbouring corners on different boards is {number(field.correlation, 3)} "
        f"({_p_value(field.p_value)})."
    )
    floor = report.overview.floor_px
    more = (
        f", {field.rms_px / floor:.1f} times less: not all of them are noise"
        if field.rms_px > MORE_THAN_NOISE * floor
        else ""
    )
    alone = f"corner noise{_and_motion(report)} alone would leave {px(floor)}"
    numbers = f"Their RMS is {px(field.rms_px)} per point; {alone}{more}."
    caption = (
        f"Arrows: residuals averaged over cells of the image, drawn {field.magnification:g} times as long. Cloud: all "
        "residuals, with circles at 1, 2 and 3 standard deviations of the noise. In a good calibration the arrows are "
        "short and without a pattern, and the cloud is round."
    )
    board = (
        f"Of this, {px(field.board_error_px)} is the same at each corner of the board in all photographs "
        f"({_p_value(field.board_error_p_value)}): is the board flat and accurately printed?",
    ) * (field.board_error_p_value < STRUCTURED)
    return Section("residuals", "Residuals", (text, numbers, *board), caption=caption)


def _p_value(p: float) -> str:
    return "p < 0.0001" if p < 1e-4 else f"p = {p:.2g}"


def _straightness(report: Report) -> Section:
    lines = report.straightness
    times = f", {lines.image_ce / lines.ce:.0f} times less" if lines.ce > 0 else ""
    reference = (
        f" Without the reference: {scientific(lines.ce_without_reference)}."
        if np.isfinite(lines.ce_without_reference)
        else ""
    )
    text = (
        "A pinhole camera maps the straight rows and columns of a board to straight lines. Their collinearity error "
        f"(RMS distance from a line ÷ its length) is {scientific(lines.image_ce)} in the photographs and "
        f"{scientific(lines.ce)} in the virtual plane{times}.{reference}"
    )
    drawn = "to scale" if lines.magnification == 1 else f"magnified {lines.magnification:g} times"
    caption = (
        f"The board in {lines.example} with deviations from straight lines {drawn}. Left: in the photograph; right: in "
        "the virtual plane, where the lines must look ruled."
    )
    return Section("straightness", "Straightness", (text,), caption=caption)


def _scene(report: Report) -> Section:
    scene = report.scene
    text = "The boards in their poses in front of the camera."
    caption = "Good boards stand at several distances, tilted in all directions."
    if scene.pinholeness is None:
        return Section("scene", "Boards and lines of sight", (text,), caption=caption)
    lines = (
        f"Also drawn are the lines of sight of {len(scene.lines)} pixels, each fitted to the pixel's points on all "
        "boards. In a perfect pinhole camera all of them pass through one point; here they miss the camera's centre by "
        f"{100 * scene.pinholeness:.2g} % of f on average. Below 1 % is good."
    )
    caption += " Small drawing: where the lines pass the camera's centre (+)."
    return Section("scene", "Boards and lines of sight", (text, lines), caption=caption)


def _comparison(report: Report) -> Section:
    compared = report.comparison
    text = (
        "OpenCV's lens models fitted to the same corners. Compare the held-out errors, those on photographs that were "
        "left out of the fit, with only the poses of their boards fitted. The in-sample error flatters every model, "
        f"the more so the more parameters it has. Corner noise{_and_motion(report)} alone would leave "
        f"{px(report.overview.floor_px)}."
    )
    ours = (number(v, 3) for v in (compared.heldout_px, compared.insample_px, compared.re_percent))
    rows = [(f"pinholify, {compared.method}", *ours)]
    rows += [
        (model_name(name), *(number(v, 3) for v in (s.heldout_px, s.insample_px, s.re_percent)))
        for name, s in compared.models.items()
    ]
    header = ("model", "held out, px", "in sample, px", "in sample, % of a square")
    table = Table("RMS errors per point", header, tuple((a, b, c, d) for a, b, c, d in rows))
    shapes = (
        "This camera is scored with the board's shape that it found in the same solve, OpenCV's models with a flat "
        "board, the only one they support: part of the difference may be due to the board.",
    ) * bool(compared.models and _shape_rows(report))
    none = (f"There is no held-out error: {compared.heldout_reason}.",) if compared.heldout_px is None else ()
    folds = (
        (f"The held-out error over five folds is {px(compared.kfold_px)}.",) if compared.kfold_px is not None else ()
    )
    caption = (
        "Bars: held-out errors; dots: in-sample errors; thin line: what corner "
        f"noise{_and_motion(report)} alone would leave."
    )
    shown = caption if compared.heldout_px is not None and compared.models else ""
    return Section("comparison", "Comparison with OpenCV", (text, *shapes, *none, *folds), (table,), shown)


def model_name(name: str) -> str:
    """The display name of one of OpenCV's models."""
    return OPENCV_MODELS.get(name, name)


OPENCV_MODELS = {
    "opencv5": "OpenCV, 5 parameters",
    "opencv8": "OpenCV, 8 parameters (rational)",
    "fisheye": "OpenCV, fisheye",
}


def _model(report: Report) -> Section:
    model = report.model
    rows = [
        ("method", model.method),
        ("trend", model.trend),
        ("kernel", model.kernel),
        ("corner noise", f"{px(model.noise_px)} per axis"),
    ]
    for process in model.processes:
        scales = ", ".join(number(scale, 0) for scale in process.length_scales_px)
        rows.append((f"process, {process.of}", f"std {number(process.std, 3)} {process.unit}, length {scales} px"))
    if not model.processes:
        rows.append(("process", "switched off by the evidence: the trend suffices"))
    shape = _shape_rows(report)
    rows += shape
    if model.singular_values:
        rows.append(("singular values", ", ".join(f"{value:.3g}" for value in model.singular_values)))
    text = "The trend and the hyperparameters maximise the evidence (marginal likelihood)."
    text += " The board's shape and motion were estimated in the same solve." * bool(shape)
    tables = [Table("Chosen model", ("", "value"), tuple(rows), numeric=False)]
    if model.candidates:
        candidates = tuple((name, number(behind, 1)) for name, behind in model.candidates)
        tables.append(Table("Candidates", ("trend", "log evidence below the best"), candidates))
    return Section("model", "The model", (text,), tuple(tables))


def _board_shape(shape: BoardShape) -> Section:
    text = (
        "The solve estimated the board's own shape together with the camera. Its corners deviate from a lattice of "
        f"squares by {_length(shape.shift_rms, shape.square_mm)} RMS in its plane, and the range of their heights is "
        f"{_length(shape.height_range, shape.square_mm)}."
    )
    caption = (
        f"The board from the camera's side, its first corner at the upper left. Arrows: shifts in its plane, drawn "
        f"{shape.magnification:g} times as long. Discs: heights towards the camera (filled) and away from it (open), "
        f"proportional to their areas; the largest is {_length(float(np.abs(shape.heights).max()), shape.square_mm)}."
    )
    return Section("board-shape", "The board's shape", (text,), caption=caption)


def _shape_rows(report: Report) -> list[tuple[str, str]]:
    model = report.model
    rows = []
    if model.bow is not None:
        rows.append(("board, bow", f"{_length(model.bow, model.square_mm)} from flat"))
    if model.stretch is not None:
        lean = "" if model.shear is None else f", columns leaning by {100 * model.shear:+.3f} %"
        rows.append(("board, print", f"{100 * model.stretch:+.3f} % longer along y than along x{lean}"))
    if model.warp is not None:
        rows.append(("board, corners", f"{_length(model.warp, model.square_mm)} RMS beyond that"))
    if model.motion_px is not None:
        rows.append(("board, motion", f"{number(model.motion_px, 3)} px RMS per axis during the rolling shutter"))
    return rows


def _length(squares: float, square_mm: float | None) -> str:
    return f"{number(squares, 4)} squares" + ("" if square_mm is None else f" ({number(squares * square_mm, 3)} mm)")


def _usage(report: Report) -> Section:
    text = f"Code for this camera, to run in the folder of {report.provenance.file}."
    return Section("usage", "Using the camera", (text,))


def _provenance(report: Report) -> Section:
    source = report.provenance
    width, height = report.image_size
    rows = (
        ("camera file", source.file),
        ("SHA-256", source.sha256),
        ("written by", source.software or "unknown"),
        ("written", source.created or "unknown"),
        ("board", f"{report.board} ({_squares(report.intrinsics.square_mm)})"),
        ("images", f"{len(report.boards)} of {width} × {height} px"),
        ("reference", report.intrinsics.reference),
        ("mirrored", "yes" if report.intrinsics.mirrored else "no"),
        ("report by", report.software),
    )
    return Section("provenance", "Provenance", (), (Table("Provenance", ("", "value"), rows, numeric=False),))


def _squares(square_mm: float | None) -> str:
    return "size of squares not given" if square_mm is None else f"squares of {square_mm:g} mm"
