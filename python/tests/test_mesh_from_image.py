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
