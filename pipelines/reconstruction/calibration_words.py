"""A calibration in words: residuals, boards measured, what is sure and what is not, and the verdict."""

from __future__ import annotations

from .pose_spread import covered_share
from .rig_model import BoardCheck, Calibration, Lens

__all__ = ["calibration_verdict", "describe_calibration", "rms_verdict"]

LOOSE = 0.5  # per cent: a scale of heights that is less sure is told
COVERED = 0.7  # of the field: less, and the verdict says so
WORSE = 3.0  # if it also makes heights this many times less sure
KEPT = 0.95  # of the corners: a calibration that leaves out more deserves a look at the board


def rms_verdict(stereo_px: float) -> str:
    """Say what a stereo rms means."""
    if stereo_px < 0.5:
        return "good (under 0.5 px)"
    if stereo_px < 1.0:
        return "usable, not good (0.5 to 1 px): take more poses, sharper and at other tilts"
    return "bad (over 1 px): check the board's size, the pattern file, and that nothing moved during a capture"


def calibration_verdict(calibration: Calibration) -> list[str]:
    """The verdict: the rms first, then everything that deserves a look, one line each."""
    rms = calibration.rms_px["stereo"]
    lines = [f"stereo rms {rms:.3f} px: {rms_verdict(rms)}"]
    lines += [f"bad pose {pose.name}, left out: {pose.advice}" for pose in calibration.poses if pose.advice]
    good = [pose for pose in calibration.poses if not pose.advice]
    kept, found = sum(pose.kept for pose in good), sum(pose.found for pose in good)
    if found and kept < KEPT * found:
        worst = min(good, key=lambda pose: pose.kept / max(pose.found, 1))
        lines.append(
            f"{found - kept} of {found} corners lie many standard deviations off and were left out, "
            f"most in {worst.name}: is the board flat, clean and free of glare?"
        )
    lines += calibration.notes
    scale = (calibration.sigma or {}).get("field", {}).get("height_scale_percent", 0.0)
    if scale > LOOSE:
        lines.append(f"the scale of heights is known to ±{_two(scale)} % only: tilt the board more, 10 to 25 degrees")
    lines += _coverage(calibration)
    if calibration.squares and not calibration.held_out:
        lines.append("no held-out check: it takes 4 poses, each measured by the others; take one or two more")
    return lines


def describe_calibration(calibration: Calibration) -> list[str]:
    """Residuals per pose, rejected corners, boards measured, mirrors, uncertainty and the verdict, as lines."""
    width = max(len("pose"), *(len(pose.name) for pose in calibration.poses))
    lines = [f"{'pose':{width}}  camera px  projector px  corners"]
    lines += [
        f"{pose.name:{width}}  {pose.camera_px:9.3f}  {pose.projector_px:12.3f}  {pose.kept} of {pose.found}"
        for pose in calibration.poses
    ]
    for pose in calibration.poses:
        if pose.rejected:
            places = ", ".join(f"({column:.0f}, {row:.0f})" for column, row in pose.rejected)
            lines.append(f"{pose.name}: corners left out at image column, row: {places}")
    checks = calibration.held_out or calibration.squares
    if checks:
        how = "by the calibration from all other poses" if calibration.held_out else "in its own pose"
        lines += ["", f"each board measured in 3D {how}:", f"{'pose':{width}}  flat to um  square mm  its sd um"]
        lines += [_check_line(check, width) for check in checks]
        lines.append("")
    affine = [who for who, lens in _lenses(calibration) if lens.parallel]
    if affine:
        lines.append(f"telecentric (affine): {' and '.join(affine)}; a pinhole explains the corners no better")
    if calibration.camera.mirrored or calibration.projector.mirrored:
        lines.append(_mirrors(calibration))
    if calibration.sigma:
        field = {name: _two(value) for name, value in calibration.sigma["field"].items() if name != "map_um"}
        lines += [f"{words} (no harm to heights beyond the next line)" for words in calibration.sigma["weak"]]
        lines.append(
            f"calibration's part in heights: scale ±{field['height_scale_percent']} %, bow "
            f"±{field['bow_um']} um where the board was (±{field['bow_image_um']} um over the whole image); "
            f"in lengths: ±{field['lateral_scale_percent']} %"
        )
    rms = calibration.rms_px
    lines.append(f"camera rms {rms['camera']:.3f} px, projector rms {rms['projector']:.3f} px")
    return lines + calibration_verdict(calibration)


def _coverage(calibration: Calibration) -> list[str]:
    """Say so where the boards left much of the field out, and heights there are less sure for it."""
    covered = covered_share(calibration)
    if calibration.sigma is None or covered is None or covered >= COVERED:
        return []
    field = calibration.sigma["field"]
    if field["bow_image_um"] < WORSE * field["bow_um"]:
        return []
    return [
        f"the boards cover only {covered:.0%} of the field: heights beyond them are extrapolated, ±"
        f"{_two(field['bow_image_um'])} um over the whole image against ±{_two(field['bow_um'])} um where they were "
        "(sigma says so): take poses with the board in every corner of the field, or a larger board"
    ]


def _lenses(calibration: Calibration) -> tuple[tuple[str, Lens], ...]:
    return ("camera", calibration.camera), ("projector", calibration.projector)


def _two(value: float) -> str:
    """Two significant digits, never with an exponent that a person must undo."""
    return f"{float(f'{value:.2g}'):g}"


def _check_line(check: BoardCheck, width: int) -> str:
    flat, spread = 1000 * check.flatness_mm, 1000 * check.square_sd_mm
    return f"{check.name:{width}}  {flat:10.3g}  {check.square_mm:9.5g}  {spread:9.3g}"


def _mirrors(calibration: Calibration) -> str:
    both = calibration.camera.mirrored and calibration.projector.mirrored
    which = "both" if both else "camera" if calibration.camera.mirrored else "projector"
    if (calibration.board or {}).get("kind") == "charuco":
        return f"the optics mirror: {which}, as the board's markers tell"
    if both:
        return "the optics mirror: both, as you said"
    return (
        f"the optics mirror: of camera and projector exactly one is mirrored, taken to be the {which} "
        "(if it is the other one, say so with --mirrored)"
    )
