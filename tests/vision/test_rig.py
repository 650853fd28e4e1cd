"""rig.json: written and read without loss; every refusal names the key."""

import json

import numpy as np
import pytest
from rendering import turned

from geoerr.errors import InputFileError
from geoerr.vision.rig import Rig, RightFromLeft, read_rig, write_rig
from geoerr.vision.rotation import angle_between_rad, rotation_from_vector


def rig(covariance=True):
    matrix = np.array([[2319.0, 0.0, 1230.0], [0.0, 2321.0, 1019.0], [0.0, 0.0, 1.0]])
    lens = np.array([-0.1, 0.1, 1e-4, -1e-4, 0.0])
    pose = RightFromLeft(turned(0.2, -16.0, 0.1), np.array([-240.0, 0.5, 36.0]))
    made = Rig(matrix, lens, matrix + np.diag([3.0, 2.0, 0.0]), lens, pose, (2448, 2048))
    if not covariance:
        return made
    root = np.random.default_rng(0).normal(size=(24, 24)) * 1e-3
    square = root @ root.T
    return Rig(matrix, lens, made.K_right, lens, pose, (2448, 2048), 0.5 * (square + square.T))


@pytest.mark.parametrize("covariance", [True, False])
def test_round_trip_keeps_every_bit(tmp_path, covariance):
    first, second = tmp_path / "a.json", tmp_path / "b.json"
    write_rig(first, rig(covariance))
    write_rig(second, read_rig(first))
    assert first.read_bytes() == second.read_bytes()


def test_names_follow_the_covariance():
    names = rig().parameter_names
    assert len(names) == 24
    assert names[0] == "left_fx_px"
    assert names[17] == "right_k3"
    assert names[-6:] == ("rotation_x_rad", "rotation_y_rad", "rotation_z_rad", "t_x_mm", "t_y_mm", "t_z_mm")
    assert set(rig().standard_uncertainties()) == set(names)
    assert rig(False).standard_uncertainties() is None


def test_a_changed_parameter_is_the_one_named():
    for index, name in enumerate(rig().parameter_names):
        change = np.zeros(24)
        change[index] = 1e-3
        changed = rig().changed_by(change)
        camera = "left" if index < 9 else "right"
        if "rotation" in name:
            turn = rotation_from_vector(change[18:21])
            assert np.allclose(changed.right_from_left.R, turn @ rig().right_from_left.R, atol=1e-15)
        elif name.startswith("t_"):
            assert changed.right_from_left.t_mm["xyz".index(name[2])] - rig().right_from_left.t_mm[
                "xyz".index(name[2])
            ] == pytest.approx(1e-3)
        elif name.endswith("fx_px"):
            key = f"K_{camera}"
            assert getattr(changed, key)[0, 0] - getattr(rig(), key)[0, 0] == pytest.approx(1e-3)
        elif name.endswith("k2"):
            key = f"dist_{camera}"
            assert getattr(changed, key)[1] - getattr(rig(), key)[1] == pytest.approx(1e-3)


@pytest.mark.parametrize(
    ("change", "column"),
    [
        (lambda d: d.pop("K_left"), "K_left"),
        (lambda d: d["K_right"][0].__setitem__(0, -5.0), "K_right"),
        (lambda d: d["K_right"].pop(), "K_right"),
        (lambda d: d["K_left"][0].__setitem__(0, "wide"), "K_left"),
        (lambda d: d["dist_left"].append(0.1), "dist_left"),
        (lambda d: d["dist_right"].__setitem__(0, float("inf")), "dist_right"),
        (lambda d: d.pop("right_from_left"), "right_from_left"),
        (lambda d: d["right_from_left"]["R"][0].__setitem__(0, 0.5), "right_from_left.R"),
        (lambda d: d["right_from_left"].__setitem__("t_mm", [0.0, 0.0, 0.0]), "right_from_left.t_mm"),
        (lambda d: d.__setitem__("image_size", [2448]), "image_size"),
        (lambda d: d.__setitem__("image_size", [2448.5, 2048]), "image_size"),
        (lambda d: d["covariance"]["parameters"].reverse(), "covariance.parameters"),
        (lambda d: d["covariance"]["matrix"][0].__setitem__(1, 1.0), "covariance.matrix"),
        (lambda d: d["covariance"]["matrix"][0].__setitem__(0, -1.0), "covariance.matrix"),
    ],
)
def test_refusals_name_file_and_key(tmp_path, change, column):
    document = rig().to_document()
    change(document)
    path = tmp_path / "rig.json"
    path.write_text(json.dumps(document))
    with pytest.raises(InputFileError) as caught:
        read_rig(path)
    assert caught.value.column == column
    assert caught.value.path == str(path)


def correlated(pairs):
    """A rig's document, its first three parameters correlated as given, of variances as unlike as they are."""
    document = rig().to_document()
    matrix = np.diag([1e-4, 1e2, 1e-8, *np.full(21, 1e-6)])
    for first, second, correlation in pairs:
        matrix[first, second] = matrix[second, first] = correlation * np.sqrt(
            matrix[first, first] * matrix[second, second]
        )
    document["covariance"]["matrix"] = matrix.tolist()
    return document


@pytest.mark.parametrize(
    ("pairs", "why"),
    [
        ([(0, 1, 1e4)], "left_fx_px and left_fy_px are correlated by more than 1"),
        # Each pair could be; the three together could not: 1 - 2 * 0.9 is below 0.
        ([(0, 1, 0.9), (1, 2, 0.9), (0, 2, -0.9)], "negative eigenvalue"),
    ],
)
def test_a_matrix_that_no_errors_have_is_refused(tmp_path, pairs, why):
    path = tmp_path / "rig.json"
    path.write_text(json.dumps(correlated(pairs)))
    with pytest.raises(InputFileError, match=why) as caught:
        read_rig(path)
    assert caught.value.column == "covariance.matrix"


def test_a_parameter_known_exactly_has_no_covariance_with_another(tmp_path):
    document = correlated([])
    document["covariance"]["matrix"][2][2] = 0.0
    path = tmp_path / "rig.json"
    path.write_text(json.dumps(document))
    assert read_rig(path).covariance[2, 2] == 0.0
    document["covariance"]["matrix"][2][3] = document["covariance"]["matrix"][3][2] = 1e-12
    path.write_text(json.dumps(document))
    with pytest.raises(InputFileError, match="correlated by more than 1"):
        read_rig(path)


@pytest.mark.parametrize("correlation", [1.0, -1.0])
def test_parameters_that_move_as_one_are_a_covariance(tmp_path, correlation):
    path = tmp_path / "rig.json"
    path.write_text(json.dumps(correlated([(0, 1, correlation)])))
    assert read_rig(path).covariance is not None


@pytest.mark.parametrize(
    "content", ["[1, 2]", "", "[machine]\nname = 'mill'\n", "left,right,x,y,z\n", b"\x89PNG\xff"]
)
def test_not_a_rig(tmp_path, content):
    path = tmp_path / "rig.json"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputFileError) as caught:
        read_rig(path)
    assert "a rig is two cameras" in caught.value.remedy
    assert "geoerr calibrate SESSION -o rig.json" in caught.value.remedy


def test_a_folder_is_no_rig_and_a_missing_file_is_missing(tmp_path):
    with pytest.raises(InputFileError, match="is a folder") as caught:
        read_rig(tmp_path)
    assert "a rig is two cameras" in caught.value.remedy
    with pytest.raises(InputFileError, match="no such file") as caught:
        read_rig(tmp_path / "rig.json")
    assert caught.value.remedy == "check the name and the folder"


def test_a_rotation_typed_with_few_digits_is_made_whole(tmp_path):
    document = rig().to_document()
    document["right_from_left"]["R"] = np.round(document["right_from_left"]["R"], 7).tolist()
    path = tmp_path / "rig.json"
    path.write_text(json.dumps(document))
    rotation = read_rig(path).right_from_left.R
    assert np.abs(rotation @ rotation.T - np.eye(3)).max() < 1e-15
    assert angle_between_rad(rotation, rig().right_from_left.R) < 1e-6


def test_fourteen_coefficients_without_tilt_are_twelve(tmp_path):
    document = rig(False).to_document()
    document["dist_left"] = [0.1, *[0.0] * 13]
    path = tmp_path / "rig.json"
    path.write_text(json.dumps(document))
    assert len(read_rig(path).dist_left) == 12
