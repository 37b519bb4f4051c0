"""`examples/own-anatomy/mesh_from_image.py` on images as clinics send them: units of the header, four dimensions."""

import importlib.util
from pathlib import Path

import pytest

nibabel = pytest.importorskip("nibabel")
np = pytest.importorskip("numpy")

ROOT = Path(__file__).parents[2]
IMAGES = ROOT / "tests/fixtures/public-reports/24-nifti-units-and-4d"


@pytest.fixture(scope="module")
def script():
    spec = importlib.util.spec_from_file_location("mesh_from_image", ROOT / "examples/own-anatomy/mesh_from_image.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def cavity_of(values, affine):
    """Volume of the labelled voxels, mL."""
    return (values > 0).sum() * abs(np.linalg.det(affine[:3, :3])) * 1e-3


def made(folder, values, unit="mm", scale=1.0):
    image = nibabel.Nifti1Image(values, np.diag([scale, scale, scale, 1.0]))
    image.header.set_xyzt_units(unit)
    path = folder / "labels.nii.gz"
    nibabel.save(image, path)
    return path


SQUARES = np.arange(-30, 30) ** 2
BALL = (np.add.outer(np.add.outer(SQUARES, SQUARES), SQUARES) < 625).astype(np.int16)
# 4/3 π 25³ mm³
BALL_ML = 4 / 3 * np.pi * 25**3 * 1e-3


@pytest.mark.parametrize(("unit", "scale"), [("mm", 1.0), ("meter", 0.001), ("micron", 1000.0), ("unknown", 1.0)])
def test_the_unit_of_the_header_counts(script, tmp_path, unit, scale):
    values, affine = script.labels_in_mm(made(tmp_path, BALL, unit, scale))
    assert cavity_of(values, affine) == pytest.approx(BALL_ML, rel=0.02)


def test_one_frame_in_four_dimensions_is_read_and_of_several_one_is_chosen(script, tmp_path):
    values, _ = script.labels_in_mm(made(tmp_path, BALL[..., None]))
    assert values.shape == BALL.shape
    path = made(tmp_path, np.stack([BALL, 2 * BALL], axis=-1))
    with pytest.raises(SystemExit, match="2 frames; say which one with --frame, 1 to 2"):
        script.labels_in_mm(path)
    assert script.labels_in_mm(path, 2)[0].max() == 2
    with pytest.raises(SystemExit, match="no frame 3"):
        script.labels_in_mm(path, 3)


def test_the_images_of_the_reports_have_the_size_of_a_heart(script):
    for path in sorted(IMAGES.glob("*.nii.gz")):
        values, affine = script.labels_in_mm(path)
        assert values.ndim == 3
        assert 20 < cavity_of(values, affine) < 400, path


def test_each_refusal_is_a_sentence(script, tmp_path):
    path = tmp_path / "labels.nii.gz"
    path.write_bytes(b"no image")
    with pytest.raises(SystemExit, match="cannot be read as an image"):
        script.labels_in_mm(path)
    with pytest.raises(SystemExit, match="no whole numbers"):
        script.labels_in_mm(made(tmp_path, BALL.astype(np.float32) * 0.4))
    with pytest.raises(SystemExit, match="check the unit"):
        script.labels_in_mm(made(tmp_path, BALL, "mm", 0.001))


def test_a_small_file_that_claims_very_many_voxels_is_refused_before_it_is_unpacked(script, tmp_path):
    import gzip

    header = nibabel.Nifti1Header()
    header.set_data_shape((30_000, 30_000, 30_000))
    header.set_data_dtype(np.uint8)
    header.set_data_offset(352)
    path = tmp_path / "labels.nii.gz"
    path.write_bytes(gzip.compress(header.binaryblock + bytes(4) + bytes(1 << 20)))
    with pytest.raises(SystemExit, match="30000 x 30000 x 30000 voxels, expected at most 1000000000; save a part"):
        script.labels_in_mm(path)
    with pytest.raises(SystemExit, match=r"expected at most .*give a larger --voxel-mm"):
        script.surface_of_labels(made(tmp_path, BALL), [1], 0.001, 1.0)


def half_ball():
    """A ball without its upper half, in a box of its own on each side, so that every axis and direction shows."""
    values = BALL.copy()
    values[:, :, 38:] = 0
    return np.pad(values, ((1, 2), (3, 4), (5, 6)))


def stored(folder, values, affine, name="labels.nii.gz", image=None, **changes):
    """An image with an affine map to mm, in the header of either kind."""
    made_image = (image or nibabel.Nifti1Image)(values, affine)
    made_image.header.set_xyzt_units("mm")
    for key, value in changes.items():
        made_image.header[key] = value
    nibabel.save(made_image, folder / name)
    return folder / name


def turned(values, affine, order, flips):
    """The same image with its axes in another order, some of them backwards."""
    move = np.zeros((4, 4))
    move[3, 3] = 1
    for to, axis in enumerate(order):
        move[axis, to] = -1 if axis in flips else 1
        move[axis, 3] = values.shape[axis] - 1 if axis in flips else 0
    other = np.flip(values, flips).transpose(order)
    return np.ascontiguousarray(other), affine @ move


OBLIQUE = np.array([[1.2, 0.3, 0, -40], [-0.2, 0.9, 0.1, 12], [0.1, 0, 1.4, 250], [0, 0, 0, 1.0]])
TURNS = [((0, 1, 2), ()), ((1, 0, 2), ()), ((2, 0, 1), (1,)), ((2, 1, 0), (0, 1, 2)), ((0, 1, 2), (2,))]


@pytest.mark.parametrize(("order", "flips"), TURNS)
def test_the_order_and_direction_of_the_axes_change_no_surface(script, tmp_path, order, flips):
    """Programs store slices from either end and axes in any order; the affine map says which."""
    values = half_ball()
    usual, _ = script.surface_of_labels(stored(tmp_path, values, OBLIQUE), [1], 2.0, 0.5)
    path = stored(tmp_path, *turned(values, OBLIQUE, order, flips))
    points, _ = script.surface_of_labels(path, [1], 2.0, 0.5)
    for of in (np.min, np.max, np.mean):
        assert of(points, axis=0) == pytest.approx(of(usual, axis=0), abs=0.3)


def volume_ml(points, triangles):
    """Volume inside a closed surface, by the divergence theorem; its sign is that of the triangles' turn."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6e3


@pytest.mark.parametrize(("order", "flips"), TURNS)
def test_the_surface_encloses_the_volume_of_the_voxels(script, tmp_path, order, flips):
    values = half_ball()
    path = stored(tmp_path, *turned(values, OBLIQUE, order, flips))
    enclosed = abs(volume_ml(*script.surface_of_labels(path, [1], 2.0, 0.5)))
    assert enclosed == pytest.approx(cavity_of(values, OBLIQUE), rel=0.02)


def test_labels_that_the_header_scales_are_the_scaled_ones(script, tmp_path):
    """`scl_slope` of NIfTI-1, at byte 112, multiplies the stored numbers; 0 stands for none."""
    path = stored(tmp_path, BALL, np.eye(4), "labels.nii")
    for slope, wanted in [(2.0, {0, 2}), (0.0, {0, 1}), (1.0, {0, 1})]:
        content = bytearray(path.read_bytes())
        content[112:120] = np.array([slope, 0.0], "<f4").tobytes()
        path.write_bytes(content)
        assert set(np.unique(script.labels_in_mm(path)[0])) == wanted


@pytest.mark.parametrize("kind", [np.uint8, np.int32, np.float32, np.float64])
def test_the_type_of_the_numbers_changes_no_label(script, tmp_path, kind):
    values, _ = script.labels_in_mm(stored(tmp_path, (3 * BALL).astype(kind), np.eye(4)))
    assert set(np.unique(values)) == {0, 3}


@pytest.mark.parametrize("name", ["labels.nii", "labels.nii.gz", "labels.img"])
def test_files_of_every_kind_are_read(script, tmp_path, name):
    """One file, a packed one, and a pair of header and data."""
    kind = nibabel.Nifti1Pair if name.endswith(".img") else nibabel.Nifti2Image
    values, affine = script.labels_in_mm(stored(tmp_path, BALL, np.diag([1, 1, 2, 1.0]), name, kind))
    assert cavity_of(values, affine) == pytest.approx(2 * BALL_ML, rel=0.02)


def test_a_quaternion_counts_where_the_affine_map_has_no_code(script, tmp_path):
    image = nibabel.Nifti1Image(BALL, None)
    image.header.set_xyzt_units("mm")
    image.header.set_qform(np.diag([2.0, 2.0, 2.0, 1.0]), code=1)
    image.header.set_sform(None, code=0)
    nibabel.save(image, tmp_path / "labels.nii.gz")
    values, affine = script.labels_in_mm(tmp_path / "labels.nii.gz")
    assert cavity_of(values, affine) == pytest.approx(8 * BALL_ML, rel=0.02)


@pytest.mark.parametrize("share", [0.01, 0.3, 0.7, 0.99])
def test_a_file_cut_off_is_refused_by_its_name(script, tmp_path, share):
    path = made(tmp_path, BALL)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(SystemExit, match=r"labels\.nii\.gz: cannot be read as an image"):
        script.labels_in_mm(path)


def test_a_map_without_a_volume_is_refused(script, tmp_path):
    """Two axes along one direction, or a voxel without a thickness."""
    flat = np.array([[1, 1, 0, 0], [0, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
    image = nibabel.Nifti1Image(BALL, np.eye(4))
    image.header.set_xyzt_units("mm")
    image.header.set_sform(flat, code=1)
    image.header.set_qform(None, code=0)
    raw = nibabel.Nifti1Image(BALL, None, image.header)
    nibabel.save(raw, tmp_path / "labels.nii.gz")
    with pytest.raises(SystemExit, match="voxels without a volume"):
        script.labels_in_mm(tmp_path / "labels.nii.gz")


def test_no_number_is_no_label(script, tmp_path):
    values = BALL.astype(np.float32)
    values[0, 0, 0] = np.nan
    with pytest.raises(SystemExit, match="no whole numbers"):
        script.labels_in_mm(made(tmp_path, values))


def coded(folder, sform=None, qform=None):
    """An image with the two maps of a header, each with its code."""
    image = nibabel.Nifti1Image(BALL, None)
    image.header.set_xyzt_units("mm")
    image.header.set_qform(qform, code=0 if qform is None else 1)
    image.header.set_sform(sform, code=0 if sform is None else 1)
    nibabel.save(nibabel.Nifti1Image(BALL, None, image.header), folder / "labels.nii.gz")
    return folder / "labels.nii.gz"


def test_two_maps_of_other_sizes_are_refused_and_of_other_places_are_not(script, tmp_path):
    """Programs that resample an image leave one of the two maps as it was."""
    sides = np.diag([2.0, 2.0, 3.0, 1.0])
    for other in (np.diag([0.2, 0.2, 0.3, 1.0]), np.diag([2.0, 2.0, 8.0, 1.0])):
        with pytest.raises(SystemExit, match=r"by the header's sform and of 2 x 2 x 3 by its qform"):
            script.labels_in_mm(coded(tmp_path, sform=other, qform=sides))
    moved = sides.copy()
    moved[:3, 3] = [10, -20, 30]
    values, affine = script.labels_in_mm(coded(tmp_path, sform=moved, qform=sides))
    assert cavity_of(values, affine) == pytest.approx(12 * BALL_ML, rel=0.02)
    assert affine[:3, 3] == pytest.approx([10, -20, 30])


def test_headers_that_no_program_should_write_are_refused_in_a_sentence(script, tmp_path):
    path = stored(tmp_path, BALL, np.eye(4), "labels.nii", xyzt_units=7)
    with pytest.raises(SystemExit, match="lengths in the unknown unit 7, expected mm"):
        script.labels_in_mm(path)
    colours = np.zeros(BALL.shape, [("R", "u1"), ("G", "u1"), ("B", "u1")])
    with pytest.raises(SystemExit, match="colours or other values that are no numbers"):
        script.labels_in_mm(stored(tmp_path, colours, np.eye(4)))


def test_the_value_that_is_no_label_is_named(script, tmp_path):
    """A probability of a half among ones."""
    values = BALL.astype(np.float32)
    values[30, 30, 30] = 0.5
    with pytest.raises(SystemExit, match=r"such as 0\.5;"):
        script.labels_in_mm(made(tmp_path, values))
