"""The report in words and tables, the same for every format: sections of paragraphs, with tables beside the figures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinholify.report.boards import BoardEntry
from pinholify.report.contents import Report
from pinholify.report.maps import Coverage, round_down
from pinholify.report.numerals import angle, decimals, number, percent, px, scientific, with_std
from pinholify.report.overview import Length

STRUCTURED = 0.01  # p-value
MORE_THAN_NOISE = 1.5  # times
DRAWN_RESIDUAL = 0.03  # of the image's width: how long a typical residual is drawn on photographs

FULL_NAMES = {"f": "f, focal length", "uc": "uc, principal point across", "vc": "vc, principal point down"}


@dataclass(frozen=True, slots=True)
class Table:
    """Cells as text; the first column names the row, ``numeric`` says whether the others are numbers."""

    caption: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    numeric: bool = True


@dataclass(frozen=True, slots=True)
class Section:
    """A section of the report. ``key`` names it and its figure, which ``caption`` explains."""

    key: str
    title: str
    paragraphs: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    caption: str = ""


def title(report: Report) -> str:
    """What the report is called."""
    return f"Calibration of {report.provenance.file}"


def subtitle(report: Report) -> str:
    """Of what, how and when."""
    (width, height), count, day = report.image_size, len(report.boards), report.provenance.created[:10]
    return (
        f"{report.overview.method.capitalize()} method, {count} photograph{'s' * (count != 1)} "
        f"of {width} × {height} px, board {report.board}{f', calibrated on {day}' if day else ''}"
    )


def facts(report: Report) -> tuple[tuple[str, str, str], ...]:
    """The few numbers to know: label, value, and what it means."""
    overview = report.overview
    heldout = (
        ("Held-out error", px(overview.heldout_px), f"on photographs left out; noise alone: {px(overview.floor_px)}")
        if overview.heldout_px is not None
        else ("Residual", px(overview.insample_px), "in sample: on the photographs it was made from")
    )
    wrong = (f"{overview.wrong_corners} of {overview.corners}", "left out of every number")
    boards, known = f"{overview.boards_used} of {overview.boards_found}", np.isfinite(overview.f_share)
    return (
        heldout,
        ("Focal length", f"± {percent(overview.f_share)}" if known else "unknown", "one standard deviation"),
        ("Coverage", percent(overview.coverage), "of the image is covered by corners"),
        ("Boards that count", boards, f"found in {overview.images} photograph{'s' * (overview.images != 1)}"),
        *([("Wrong corners", *wrong)] if overview.wrong_corners else []),
    )


def sections(report: Report) -> tuple[Section, ...]:
    """The whole report after its overview, in the order of reading."""
    return (
        *([_straightened(report)] if report.frames else []),
        _intrinsics(report),
        _errors(report),
        _photographs(report),
        _coverage(report),
        _certainty(report),
        _residuals(report),
        _straightness(report),
        _scene(report),
        _comparison(report),
        _model(report),
        _usage(report),
        _provenance(report),
    )


def _straightened(report: Report) -> Section:
    caption = (
        "The same photograph as the camera took it, and as a perfect pinhole camera would have: straight things must "
        "look straight. The thin lines are drawn with a ruler between the end corners of the board's outer rows and "
        "columns; once straightened, the board's own lines must follow them."
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
        "The camera behaves as an ideal pinhole with these three numbers, in squares of the board: "
        f"its image is the plane of the board in {k.reference}, f is how far that stands from the camera's centre, and "
        "(uc, vc) is where the axis meets it, counted along the board's rows and columns from its first corner. There "
        "is no distortion left to describe. The true value lies in the interval in 95 of 100 calibrations like this "
        "one, if the corners' errors are independent; a narrow interval is good, f within 0.5 % is good enough for "
        "most work."
    )
    view = (
        f"As a picture: 'pinholify undistort' makes images of {width} × {height} px with focal length "
        f"fx = fy = {number(k.view_focal, 2)} px and principal point ({number(cx, 2)}, {number(cy, 2)}) px. The lens "
        f"sees about {angle(horizontal)} across, {angle(vertical)} down and {angle(diagonal)} on the diagonal."
    )
    apart = (
        f"Its boards disagree {number(k.disagreement, 1)} times as much as their corners' noise explains: they bent, "
        "moved or were blurred in ways of their own. The standard deviations here, and those of every ray, count that.",
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
    return " and boards' motion" if report.model.motion_px is not None else ""


def _errors(report: Report) -> Section:
    alone = f"noise in finding corners{_and_motion(report)} alone would leave ({px(report.overview.floor_px)})"
    caption = (
        "How far the corners of each photograph lie from where the camera puts them, once its board's pose is fitted: "
        f"the bar is the root mean square over its corners, the dot its worst corner, the thin line what {alone}. "
        "Good are bars about that long and all alike; one that stands out is a blurred, moved or wrongly found board: "
        "look at its photograph."
        f"{' Wrong corners are in none of them.' if report.overview.wrong_corners else ''}"
    )
    return Section("errors", "Error of each photograph", caption=caption)


def _photographs(report: Report) -> Section:
    crosses = ", crosses are wrong corners and count nowhere" if report.overview.wrong_corners else ""
    caption = (
        f"Corners as they were found: dots count, rings do not (they lie outside of the camera's domain){crosses}. "
        f"The lines from dots are the residuals, {residual_scale(report):g} times as long as they are. Good are short "
        "lines in all directions; a common direction or a pattern is bad."
    )
    header = ("photograph", "state", "corners", "RMS, px", "worst, px", "CE ×1e-4", "distance, squares", "tilt")
    rows = tuple(_board_row(entry) for entry in report.boards)
    table = Table("All photographs", header, rows, numeric=False)
    return Section("photographs", "Every photograph", report.overview.wrong_corners_said, (table,), caption)


def residual_scale(report: Report) -> float:
    """How many times too long residuals are drawn on photographs."""
    shown, rms = DRAWN_RESIDUAL * report.image_size[0], report.residuals.rms_px
    return round_down(shown / rms) if rms > 0 else 1.0


def state(entry: BoardEntry) -> str:
    """Whether a photograph counts, and why not."""
    if not entry.included:
        return f"left out: {entry.reason}"
    return "included, the reference" if entry.is_reference else "included"


def _board_row(entry: BoardEntry) -> tuple[str, ...]:
    suspicion = "" if entry.ratio is None else f"; looks wrong, {entry.ratio:.1f} times the noise"
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
        f"The corners that the camera was made from cover {percent(coverage.share)} of the image, its domain: measures "
        f"count the corners there. {_shown(coverage)}"
    )
    advised = report.overview.advice is not None
    advice = (f"To gain most, photograph the board {report.overview.advice}.",) * advised
    caption = (
        "Each board's area, the stronger the more often it was seen; the solid outline is the domain"
        f"{', the dashed one where the next board would help most' if advised else ''}. Good is an outline "
        "that reaches into all four corners of the image."
    )
    return Section("coverage", "Where boards were seen", (text, *advice), caption=caption)


def _shown(coverage: Coverage) -> str:
    """Of what straightened pictures show, which may be more."""
    if not np.isfinite(coverage.limit_px):
        return "'pinholify undistort' shows that much, and black for the rest."
    return (
        "Farther out the map is extrapolated, and the less known the farther. 'pinholify undistort' shows where it is "
        f"still known to {px(coverage.limit_px)}, {percent(coverage.shown)} of the image, and black for the rest."
    )


def _certainty(report: Report) -> Section:
    certainty = report.certainty
    text = (
        "How far a pixel's ray may be off by chance, one standard deviation, whole turns of the camera left out: "
        f"{px(certainty.inside_px)} in the camera's domain, {px(certainty.image_px)} over the whole image "
        "(medians)."
    )
    caption = (
        "The stronger the colour, the less is known. Good is a pale image, well below the error you can live with; "
        "it grows where no board was."
    )
    return Section("certainty", "How well the map is known", (text,), caption=caption)


def _residuals(report: Report) -> Section:
    field = report.residuals
    finding = (
        "They hang together over the image: the camera leaves something unexplained that several boards see alike."
        if field.p_value < STRUCTURED
        else "No structure is seen in them over the image."
    )
    text = (
        f"{finding} The residuals of neighbours on different boards correlate by {number(field.correlation, 3)} "
        f"(p = {_p_value(field.p_value)}; 0 is none)."
    )
    floor = report.overview.floor_px
    more = (
        f" That is {field.rms_px / floor:.1f} times as much: not all of it is noise."
        if field.rms_px > MORE_THAN_NOISE * floor
        else ""
    )
    alone = f"noise{_and_motion(report)} alone would leave {px(floor)}"
    numbers = f"They are {px(field.rms_px)} RMS a point, where {alone}.{more}"
    caption = (
        f"The arrows are residuals averaged over cells of the image, {field.magnification:g} times as long as they "
        "are; the cloud is all of them at once, with circles at 1, 2 and 3 standard deviations of the noise. Good are "
        "short arrows without a pattern and a round cloud."
    )
    board = (
        f"Of that, {px(field.board_error_px)} is the same at each corner of the board wherever it is held "
        f"(p = {_p_value(field.board_error_p_value)}): is the board flat, and printed true?",
    ) * (field.board_error_p_value < STRUCTURED)
    return Section("residuals", "What is left over", (text, numbers, *board), caption=caption)


def _p_value(p: float) -> str:
    return "below 0.0001" if p < 1e-4 else f"{p:.2g}"


def _straightness(report: Report) -> Section:
    lines = report.straightness
    times = f", {lines.image_ce / lines.ce:.0f} times less" if lines.ce > 0 else ""
    reference = (
        f" Without the reference: {scientific(lines.ce_without_reference)}."
        if np.isfinite(lines.ce_without_reference)
        else ""
    )
    text = (
        "Rows and columns of a board are straight, so a pinhole camera must see them straight. Their collinearity "
        f"error (RMS distance from a line ÷ its length) is {scientific(lines.image_ce)} in the photographs and "
        f"{scientific(lines.ce)} in the virtual plane{times}.{reference}"
    )
    drawn = "to scale" if lines.magnification == 1 else f"{lines.magnification:g} times as large as they are"
    caption = (
        f"The board in {lines.example}, its bends {drawn}: left as "
        "photographed, right in the virtual plane, which must look ruled."
    )
    return Section("straightness", "Are straight lines straight?", (text,), caption=caption)


def _scene(report: Report) -> Section:
    scene = report.scene
    text = "Every board where it stood before the camera."
    caption = "Good are boards at several distances, tilted in all directions."
    if scene.pinholeness is None:
        return Section("scene", "Boards and lines of sight", (text,), caption=caption)
    lines = (
        f"The lines are the sight of {len(scene.lines)} pixels, each fitted to where it hits the boards: of a perfect "
        "pinhole camera all pass through one point. On average they miss the camera's centre by "
        f"{100 * scene.pinholeness:.2g} % of f."
    )
    caption += " Small, at the side: where the lines pass the camera's centre (+). Good is below 1 % of f."
    return Section("scene", "Boards and lines of sight", (text, lines), caption=caption)


def _comparison(report: Report) -> Section:
    compared = report.comparison
    text = (
        "The same corners given to OpenCV's lens models. The held-out error is on photographs that were left out of "
        "the fit, with only their boards' poses fitted: it is the one to compare. The in-sample error flatters every "
        f"model, the more the more numbers it has. Noise alone would leave {px(report.overview.floor_px)}."
    )
    ours = (number(v, 3) for v in (compared.heldout_px, compared.insample_px, compared.re_percent))
    rows = [(f"pinholify, {compared.method}", *ours)]
    rows += [
        (model_name(name), *(number(v, 3) for v in (s.heldout_px, s.insample_px, s.re_percent)))
        for name, s in compared.models.items()
    ]
    header = ("model", "held out, px", "in sample, px", "in sample, % of a square")
    table = Table("Errors, root mean square a point", header, tuple((a, b, c, d) for a, b, c, d in rows))
    shapes = (
        "This camera is scored with the board's shape that it found in the same solve, OpenCV's models with a flat "
        "board, as they know no other: a part of the difference may be the board's.",
    ) * bool(compared.models and _board_shape(report))
    none = (f"There is no held-out error: {compared.heldout_reason}.",) if compared.heldout_px is None else ()
    folds = (f"Over five folds: {px(compared.kfold_px)}.",) if compared.kfold_px is not None else ()
    caption = (
        "Bars: held out; dots: in sample; the thin line: what noise alone would leave. Good is the shortest bar, close "
        "to that line."
    )
    shown = caption if compared.heldout_px is not None and compared.models else ""
    return Section("comparison", "Beside OpenCV's models", (text, *shapes, *none, *folds), (table,), shown)


def model_name(name: str) -> str:
    """What people call one of OpenCV's models."""
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
        ("corners' noise", f"{px(model.noise_px)} per axis"),
    ]
    for process in model.processes:
        scales = ", ".join(number(scale, 0) for scale in process.length_scales_px)
        rows.append((f"process, {process.of}", f"std {number(process.std, 3)} {process.unit}, length {scales} px"))
    if not model.processes:
        rows.append(("process", "switched off by the evidence: the trend says it all"))
    rows += _board_shape(report)
    if model.singular_values:
        rows.append(("singular values", ", ".join(f"{value:.3g}" for value in model.singular_values)))
    text = "Hyperparameters are those of the highest evidence (marginal likelihood). Candidates are listed best first."
    tables = [Table("What was chosen", ("", "value"), tuple(rows), numeric=False)]
    if model.candidates:
        candidates = tuple((name, number(behind, 1)) for name, behind in model.candidates)
        tables.append(Table("Candidates", ("trend", "log evidence below the best"), candidates))
    return Section("model", "What the calibration chose", (text,), tuple(tables))


def _board_shape(report: Report) -> list[tuple[str, str]]:
    model = report.model
    rows = []
    if model.bow is not None:
        rows.append(("board's bow", f"{_length(model.bow, model.square_mm)}: not quite flat, and allowed for"))
    if model.stretch is not None:
        lean = "" if model.shear is None else f", its columns leaning by {model.shear:+.3%}"
        rows.append(("board's print", f"{model.stretch:+.3%} longer along y than along x{lean}: allowed for"))
    if model.warp is not None:
        rows.append(("its corners", f"{_length(model.warp, model.square_mm)} off beyond that, rms: allowed for"))
    if model.motion_px is not None:
        rows.append(("motion", f"{number(model.motion_px, 3)} px, rms, while the shutter rolled: allowed for"))
    return rows


def _length(squares: float, square_mm: float | None) -> str:
    return f"{number(squares, 4)} squares" + ("" if square_mm is None else f" ({number(squares * square_mm, 2)} mm)")


def _usage(report: Report) -> Section:
    text = f"Lines to copy, for this very file; run them where {report.provenance.file} is."
    return Section("usage", "How to use it", (text,))


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
    return Section("provenance", "Where it comes from", (), (Table("Provenance", ("", "value"), rows, numeric=False),))


def _squares(square_mm: float | None) -> str:
    return "size of a square not given" if square_mm is None else f"squares of {square_mm:g} mm"
