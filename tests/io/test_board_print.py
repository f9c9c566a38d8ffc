import base64
import re
import zlib
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from reportlab.pdfbase.pdfmetrics import stringWidth

from pinholify.board import BOARD_KINDS, AprilGrid, Checkerboard, lattice, outline, parse_board
from pinholify.detection import detect_board
from pinholify.errors import BoardError, InputError, OutputError
from pinholify.io.board_print import ARTWORKS, FOOTER, FORMATS, MARGIN, PAGES, Disc, lay_out, write_board

SVG = "{http://www.w3.org/2000/svg}"


def svg_rectangles(path):
    """Page size and rectangles (x, y, width, height) in mm."""
    root = ElementTree.parse(path).getroot()
    page = tuple(float(root.attrib[side].removesuffix("mm")) for side in ("width", "height"))
    assert root.attrib["viewBox"] == f"0 0 {page[0]:g} {page[1]:g}"
    group = root.find(f"{SVG}g[@fill='black']")
    return page, np.array([[float(r.attrib[k]) for k in ("x", "y", "width", "height")] for r in group])


def pdf_rectangles(path):
    """Page size and rectangles (x, y, width, height) in mm from the top left, out of the content stream."""
    data = path.read_bytes()
    stream = re.search(rb"stream\r?\n(.*?~>)\s*endstream", data, re.S)[1]
    content = zlib.decompress(base64.a85decode(b"<~" + stream, adobe=True)).decode()
    box = [float(x) for x in re.search(rb"/MediaBox \[([^\]]*)\]", data)[1].split()]
    scales = [float(m) for m in re.findall(r"([\d.]+) 0 0 [\d.]+ 0 0 cm", content)]
    mm = np.prod(scales) * 25.4 / 72
    rectangles = np.array(re.findall(r"([-\d.]+) ([-\d.]+) ([-\d.]+) ([-\d.]+) re", content), float) * mm
    page = box[2] * 25.4 / 72, box[3] * 25.4 / 72
    rectangles[:, 1] = page[1] - rectangles[:, 1] - rectangles[:, 3]
    return page, rectangles


READERS = {".svg": svg_rectangles, ".pdf": pdf_rectangles}


@pytest.mark.parametrize("ending", READERS)
@pytest.mark.parametrize(
    ("spec", "square", "page"), [("15x9", 25, "A2"), ("8x6", 17.3, "Letter"), ("4x5", 12.5, "90x120mm")]
)
def test_squares_are_where_they_belong(tmp_path, ending, spec, square, page):
    board = parse_board(spec)
    sheet = write_board(board, tmp_path / f"b{ending}", square_mm=square, page=page)
    size, rectangles = READERS[ending](tmp_path / f"b{ending}")
    np.testing.assert_allclose(size, (sheet.width, sheet.height), atol=1e-3)
    laid_out = [(r.x, r.y, r.width, r.height) for r in sheet.black]
    np.testing.assert_allclose(rectangles, laid_out, atol=1e-3)
    squares = rectangles[np.isclose(rectangles[:, 2], rectangles[:, 3])]
    assert len(squares) == -(-(board.columns + 1) * (board.rows + 1) // 2)
    np.testing.assert_allclose(squares[:, 2:], square, atol=1e-3)
    lattice = (squares[:, :2] - squares[:, :2].min(axis=0)) / square
    np.testing.assert_allclose(lattice, lattice.round(), atol=1e-3)
    assert (lattice.round().sum(axis=1) % 2 == 0).all()
    assert len(np.unique(lattice.round(), axis=0)) == len(squares)
    np.testing.assert_array_equal(lattice.round().max(axis=0), [board.columns, board.rows])
    centre = squares[:, 0].min() + (board.columns + 1) * square / 2
    assert centre == pytest.approx(sheet.width / 2, abs=1e-3)


@pytest.mark.parametrize("ending", READERS)
def test_the_ruler_is_100_mm_between_its_outer_ends(tmp_path, ending):
    write_board(Checkerboard(5, 4), tmp_path / f"b{ending}", square_mm=20)
    _, r = READERS[ending](tmp_path / f"b{ending}")
    thin = r[np.isclose(r[:, 2], 0.2, atol=1e-3)]
    assert len(thin) == 11
    assert (thin[:, 0] + thin[:, 2]).max() - thin[:, 0].min() == pytest.approx(100, abs=1e-3)
    line = r[np.isclose(r[:, 3], 0.2, atol=1e-3)]
    np.testing.assert_allclose(line[:, 2], 100, atol=1e-3)


@pytest.mark.parametrize(
    ("spec", "square", "page"), [("15x9", 17, "A4"), ("8x6", 23.7, "A4"), ("7x10", 30, "A3")]
)
def test_a_png_is_true_to_scale_for_opencv(tmp_path, spec, square, page):
    board = parse_board(spec)
    write_board(board, tmp_path / "b.png", square_mm=square, page=page)
    with Image.open(tmp_path / "b.png") as picture:
        dpi, image = np.array(picture.info["dpi"]), np.array(picture)
    small = cv2.resize(image, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
    found, corners = cv2.findChessboardCorners(small, (board.columns, board.rows))
    assert found
    corners = (corners + 0.5) * 4 - 0.5
    term = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-4)
    corners = cv2.cornerSubPix(image, corners.astype(np.float32), (15, 15), (-1, -1), term)
    mm = corners.reshape(board.rows, board.columns, 2) / dpi * 25.4
    for axis in (0, 1):
        spacing = np.linalg.norm(np.diff(mm, axis=axis), axis=-1)
        np.testing.assert_allclose(spacing, square, atol=0.05)
    diagonal = np.linalg.norm(mm[-1, -1] - mm[0, 0])
    assert diagonal == pytest.approx(square * np.hypot(board.columns - 1, board.rows - 1), abs=0.05)


def test_a_png_has_equal_squares_to_the_pixel(tmp_path):
    write_board(Checkerboard(6, 5), tmp_path / "b.png", square_mm=19.3)
    with Image.open(tmp_path / "b.png") as picture:
        image = np.array(picture)
    row = image[np.flatnonzero((image == 0).sum(axis=1) > image.shape[1] // 4)[10]]
    assert len(set(np.diff(np.flatnonzero(np.diff(row.astype(int)))))) == 1


def test_page_and_pixels_agree_in_a_png(tmp_path):
    sheet = write_board(Checkerboard(8, 6), tmp_path / "b.png", square_mm=20)
    with Image.open(tmp_path / "b.png") as picture:
        mm = np.array(picture.size) / picture.info["dpi"] * 25.4
    np.testing.assert_allclose(mm, (sheet.width, sheet.height), atol=0.1)


@given(
    st.builds(Checkerboard, st.integers(3, 20), st.integers(3, 20)),
    st.floats(2, 60),
    st.sampled_from(sorted(PAGES)) | st.builds("{}x{}mm".format, st.integers(30, 900), st.integers(30, 900)),
)
def test_a_board_is_laid_out_inside_the_page_or_refused(board, square, page):
    try:
        sheet = lay_out(board, square_mm=square, page=page)
    except BoardError as error:
        largest = float(re.search(r"that fits has squares of ([\d.]+) mm", str(error))[1])
        assert largest < square
        with pytest.raises(BoardError):
            lay_out(board, square_mm=largest + 0.11, page=page)
        if largest == 0:
            return
        square, sheet = largest, lay_out(board, square_mm=largest, page=page)
    left, top = np.min([(r.x, r.y) for r in sheet.black if r.width == r.height], axis=0)
    right, bottom = left + (board.columns + 1) * square, top + (board.rows + 1) * square
    footer = sheet.height - MARGIN - FOOTER
    gaps = np.array([left, top, sheet.width - right, footer - bottom])
    assert (gaps >= MARGIN - 1e-6).all()
    roomy = sheet.width >= right - left + 2 * square and footer >= bottom - top + 2 * square
    assert not roomy or (gaps >= square - 1e-6).all()
    for label in sheet.labels:
        assert label.y - label.size >= footer - 1e-6
        assert label.x + stringWidth(label.text, "Helvetica", label.size) <= sheet.width - MARGIN + 1e-6
    ruler = [r for r in sheet.black if r.width != r.height]
    assert all(r.y >= footer and r.x + r.width <= sheet.width - MARGIN + 1e-9 for r in ruler)


def test_named_pages_turn_and_given_sizes_do_not():
    assert lay_out(Checkerboard(15, 9), square_mm=15, page="A4").width == 297
    assert lay_out(Checkerboard(9, 15), square_mm=15, page="a4").width == 210
    assert lay_out(Checkerboard(9, 15), square_mm=5, page="297 x 210 mm").width == 297


def test_what_was_printed_stands_on_the_sheet(tmp_path):
    write_board(Checkerboard(8, 6), tmp_path / "b.svg", square_mm=22.5)
    text = ElementTree.parse(tmp_path / "b.svg").find(f".//{SVG}text").text
    assert re.search(r"8x6 .* 22\.5 mm, pinholify \d+\.\d+\.\d+.* 100 mm", text)


def test_a_pdf_asks_the_viewer_not_to_scale(tmp_path):
    write_board(Checkerboard(8, 6), tmp_path / "b.pdf", square_mm=20)
    assert b"/PrintScaling /None" in (tmp_path / "b.pdf").read_bytes()


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"square_mm": 25}, BoardError, "covers 400 x 250 mm and .* on A4; the largest .* squares of 17.9 mm"),
        ({"square_mm": 0}, BoardError, "a square of 0 mm"),
        ({"square_mm": float("nan")}, BoardError, "a square of nan mm"),
        ({"square_mm": 10, "page": "A9"}, InputError, "unknown page 'A9': choose one of A0, .*Letter"),
        ({"square_mm": 10, "page": "600x400"}, InputError, "unknown page '600x400'"),
        ({"square_mm": 10, "page": "10x10mm"}, InputError, "between 30 and 5000 mm"),
    ],
)
def test_what_cannot_be_printed_is_refused_and_nothing_is_written(tmp_path, options, error, words):
    with pytest.raises(error, match=words):
        write_board(Checkerboard(15, 9), tmp_path / "b.pdf", **options)
    assert list(tmp_path.iterdir()) == []


def test_endings_places_and_sizes_that_do_not_work_are_refused(tmp_path):
    board = Checkerboard(8, 6)
    with pytest.raises(InputError, match=r"ends in '.jpg'; .*\.pdf, \.svg, \.png"):
        write_board(board, tmp_path / "b.jpg", square_mm=20)
    with pytest.raises(InputError, match="has no ending"):
        write_board(board, tmp_path / "b", square_mm=20)
    with pytest.raises(InputError, match="write a PDF or SVG instead"):
        write_board(board, tmp_path / "b.png", square_mm=20, page="5000x5000mm")
    with pytest.raises(OutputError, match="folder does not exist"):
        write_board(board, tmp_path / "none" / "b.pdf", square_mm=20)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("ending", FORMATS)
def test_endings_are_read_in_capitals_and_files_are_replaced_as_a_whole(tmp_path, ending):
    path = tmp_path / f"b{ending.upper()}"
    path.write_text("old")
    write_board(Checkerboard(3, 4), str(path), square_mm=10, page="A5")
    assert path.stat().st_size > 500
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ("aprilgrid:6x6:tag36h11:0.3", "tags of 50 mm covers 405 x 405 mm .* has tags of 24.6 mm"),
        ("circles:7x5", "circles 50 mm apart covers 325 x 225 mm .* has circles 41.3 mm apart"),
        ("circles:4x11:asymmetric", "rows 50 mm apart covers .* has rows 26 mm apart"),
        ("gray:1920x1080", "pinholify gray-code make"),
    ],
)
def test_what_does_not_fit_is_said_in_the_boards_own_lengths(spec, words):
    with pytest.raises(BoardError, match=words):
        lay_out(parse_board(spec), square_mm=50, page="A4")


def test_a_kind_of_board_that_has_no_drawing_is_refused():
    class Unknown:
        columns, rows, spec, orientable = 3, 3, "unknown:3x3", True

    with pytest.raises(BoardError, match="of the kind Unknown cannot be printed; these can: Checkerboard"):
        lay_out(Unknown(), square_mm=10, page="A4")


def test_every_kind_of_board_has_a_drawing():
    examples = {
        "checkerboard": "5x4",
        "charuco": "charuco:6x5:DICT_4X4_50:0.7",
        "aprilgrid": "aprilgrid:3x4:tag25h9:0.2",
        "circles": "circles:4x5:asymmetric:0.7",
    }
    assert {*examples, "gray"} == BOARD_KINDS.keys()  # a screen shows its patterns itself
    for spec in examples.values():
        board = parse_board(spec)
        artwork = ARTWORKS[type(board)](board)
        _, last = outline(board)
        assert (last + artwork.origin <= (artwork.columns, artwork.rows)).all()
        for shape in artwork.black:
            left, top, right, bottom = extent(shape)
            assert -1e-9 < left < right < artwork.columns + 1e-9
            assert -1e-9 < top < bottom < artwork.rows + 1e-9


def extent(shape):
    if isinstance(shape, Disc):
        return shape.x - shape.radius, shape.y - shape.radius, shape.x + shape.radius, shape.y + shape.radius
    return shape.x, shape.y, shape.x + shape.width, shape.y + shape.height


def test_an_aprilgrid_is_kalibrs():
    """Kalibr prints a tag's code from its highest bit on, row by row from the top, 1 as white; tag 0 bottom left."""
    codes = {0: 0xD5D628584, 1: 0xD97F18B49, 2: 0xDD280910E, 3: 0xE479E9C98}
    board = parse_board("aprilgrid:2x2:tag36h11:0.3")
    drawn = np.zeros((29, 29), bool)  # ten cells a tag, three a gap
    for r in ARTWORKS[AprilGrid](board).black:
        x0, y0, x1, y1 = np.rint(10 * np.array(extent(r))).astype(int)
        assert not drawn[y0:y1, x0:x1].any()
        drawn[y0:y1, x0:x1] = True
    for number, code in codes.items():
        left, top = 3 + 13 * (number % 2), 3 + 13 * (1 - number // 2)
        white = np.array([code >> (35 - k) & 1 for k in range(36)], bool).reshape(6, 6)
        tag = drawn[top : top + 10, left : left + 10]
        assert np.array_equal(~tag[2:8, 2:8], white)
        border = np.pad(np.zeros((6, 6), bool), 2, constant_values=True)
        assert tag[border].all()
    gaps = drawn[[1, 14, 27]]
    squares = np.isin(np.arange(29), [0, 1, 2, 13, 14, 15, 26, 27, 28])
    assert (gaps == squares).all()


def svg_discs(path):
    root = ElementTree.parse(path).getroot()
    return np.array([[float(c.attrib[k]) for k in ("cx", "cy", "r")] for c in root.iter(f"{SVG}circle")])


@pytest.mark.parametrize("spec", ["circles:7x5", "circles:4x11:asymmetric:0.8"])
def test_circles_are_where_they_belong(tmp_path, spec):
    board = parse_board(spec)
    write_board(board, tmp_path / "b.svg", square_mm=12.5)
    discs = svg_discs(tmp_path / "b.svg")
    np.testing.assert_allclose(discs[:, 2], 12.5 * board.diameter / 2, atol=1e-6)
    np.testing.assert_allclose(discs[:, :2] - discs[0, :2], 12.5 * lattice(board), atol=1e-6)


@pytest.mark.parametrize("spec", ["circles:7x5", "circles:4x11:asymmetric"])
def test_printed_circles_are_a_grid_for_opencv(tmp_path, spec):
    """In the same order too: row by row, the odd rows of an asymmetric grid moved to the right."""
    board = parse_board(spec)
    write_board(board, tmp_path / "b.png", square_mm=17)
    with Image.open(tmp_path / "b.png") as picture:
        dpi = picture.info["dpi"][0]
    image = cv2.resize(cv2.imread(str(tmp_path / "b.png")), None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
    kind = cv2.CALIB_CB_ASYMMETRIC_GRID if board.asymmetric else cv2.CALIB_CB_SYMMETRIC_GRID
    found, centres = cv2.findCirclesGrid(image, (board.columns, board.rows), flags=kind)
    assert found
    centres = centres.reshape(-1, 2)
    mm = (centres - centres[0]) * 4 / dpi * 25.4
    np.testing.assert_allclose(mm, 17 * lattice(board), atol=0.1)


def test_a_pdf_holds_every_circle(tmp_path):
    write_board(parse_board("circles:7x5"), tmp_path / "b.pdf", square_mm=20)
    stream = re.search(rb"stream\r?\n(.*?~>)\s*endstream", (tmp_path / "b.pdf").read_bytes(), re.S)[1]
    content = zlib.decompress(base64.a85decode(b"<~" + stream, adobe=True)).decode()
    assert len(re.findall(r" c\s", content)) == 4 * 35  # four Bézier arcs each


@pytest.mark.parametrize("spec", ["charuco:6x5:DICT_4X4_50:0.75", "charuco:9x7:DICT_5X5_100:0.7"])
def test_a_charuco_board_is_opencvs(spec, tmp_path):
    """Drawn cell by cell it is the picture OpenCV makes, and the printed file is read by the detector."""
    board = parse_board(spec)
    scale = 240
    columns, rows = board.columns + 1, board.rows + 1
    drawn = np.full((rows * scale, columns * scale), 255, np.uint8)
    for r in ARTWORKS[type(board)](board).black:
        x0, y0, x1, y1 = (round(scale * v) for v in (r.x, r.y, r.x + r.width, r.y + r.height))
        drawn[y0:y1, x0:x1] = 0
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
    theirs = cv2.aruco.CharucoBoard((columns, rows), 1.0, board.marker, dictionary)
    theirs = theirs.generateImage((columns * scale, rows * scale), marginSize=0)
    assert (drawn != theirs).mean() < 0.02  # edges of cells fall between pixels
    path = tmp_path / "board.png"
    write_board(board, path, square_mm=20, page="A4")
    found = detect_board(cv2.resize(cv2.imread(str(path)), None, fx=0.4, fy=0.4, interpolation=cv2.INTER_AREA), board)
    assert list(found.ids) == list(range(board.columns * board.rows))
