"""`microrelief optics`: figures with units, missing inputs and conflicts, for people and as JSON."""

from __future__ import annotations

import json

import pytest

from monitor.cli import run_tokens


def run(words: str, capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    code = run_tokens(["optics", *words.split()])
    out, err = capsys.readouterr()
    return code, out, err


def test_feasibility_at_the_papers_angle(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run("--theta-deg 31 --working-distance-mm 100 --lens-radius-mm 20", capsys)
    assert code == 0
    lines = {line.split()[0]: line for line in out.splitlines()}
    assert "27.73 mm" in lines["largest_lens_radius"]
    assert "96.36 mm" in lines["height_over_object"]
    assert "needs --wavelength-nm, --na-camera" in lines["cut_off_period"]
    assert "conflict" not in out


def test_json_of_the_papers_setup(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run("--paper --wavelength-nm 550 --json", capsys)
    found = json.loads(out)
    assert code == 0
    assert found["inputs"]["camera"] == [2560, 1440]
    assert found["figures"]["camera_blur"]["value"] == pytest.approx(600)
    assert found["figures"]["camera_blur"]["unit"] == "um"
    assert found["figures"]["lens_gap"] == {
        "value": None,
        "unit": "mm",
        "about": "between the rims of the two lenses; below 0 they collide",
        "formula": "2 (l sin(theta/2) - r cos(theta/2))",
        "source": "trigonometry of straight rays",
        "missing": ["lens_radius_mm"],
    }
    assert len(found["conflicts"]) == 4


def test_na_and_magnification_of_both(capsys: pytest.CaptureFixture[str]) -> None:
    words = "--na 0.006 --na-camera 0.01 --depth-of-field-mm 6 --magnification 2 --chip DLP3000"
    figures = json.loads(run(f"{words} --json", capsys)[1])["figures"]
    assert figures["camera_blur"]["value"] == pytest.approx(60)
    assert figures["projector_blur"]["value"] == pytest.approx(36)
    assert figures["projected_width"]["value"] == pytest.approx(3.2859)


def test_nothing_given_says_what_to_give(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run("", capsys)
    assert code == 0
    assert "--paper takes the paper's figures" in out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--theta-deg 200", "--theta-deg: must be below 180, not 200.0"),
        ("--na 2", "--na-camera: must be below 1 in air, not 2.0"),
        ("--field-mm wide", "--field-mm wide: give one number, or across and along such as 10x8"),
        ("--camera 2560", "--camera 2560: give columns and rows, such as 2560x1440"),
        ("--lens-radius-mm 0", "--lens-radius-mm: must be above 0, not 0.0"),
        ("--chip DLP1", "--chip: no array 'DLP1'; there are DLP3000, DLP3010"),
    ],
)
def test_mistakes(words: str, message: str, capsys: pytest.CaptureFixture[str]) -> None:
    code, _, err = run(words, capsys)
    assert code == 2
    assert err.strip() == f"microrelief: {message}"
