"""SimulatedRig: an honest model of the paper's rig that looks at a scene as it is at the time of the visit."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from configs import CaptureError, InputError
from pipelines import Frames, Instant, PatternSet, parse_instant
from pipelines.scenes import SCENES, Ground, Scene

from .exposure import Light, Profiles, expose, profiles
from .faults import MOVED_MM, faults_of, harm, light_of, raise_fault
from .optics_model import Optics, paper_optics, small_motion
from .ray_march import look
from .stages.simulated import SimulatedStage

__all__ = ["SimulatedRig", "sample_motion"]

FULL_LIGHT_MS = 4.0
"""Exposure at which a white surface that faces the projector just saturates 8 bits."""

HALF_FIELD_MM = 6.2
DRIFT_MM = 0.004
HOURS = np.timedelta64(3600 * 10**9, "ns")


class SimulatedRig:
    """Takes frames of a scene, with all that the optics, the light and the sensor do to them, and nothing else.

    Modelled: perspective and distortion of both lenses, the angle between them, occlusion and shadow, Lambertian
    shading, defocus and the lenses' own blur, the projector's pixels and black leak, flicker of its light from frame to
    frame, drifting room light, shot and read noise, black level, saturation, 8 bits, and a sample that never stands
    exactly where it stood. Not modelled: light scattered between walls or within the soil, gloss, rolling shutter.

    Parameters
    ----------
    scene : str
        Name in `pipelines.scenes.SCENES`.
    scene_options : mapping, optional
        Keywords of that scene.
    camera : (int, int)
        Columns, rows of the camera.
    started : str, optional
        ISO time at which the scene's age is 0; without it, the first capture. Give it where a campaign must go on after
        a restart.
    pace : float
        Scene hours per real hour: above 1 the scene ages in time-lapse.
    exposure_ms : float
    flicker, room_light : float
        Standard deviation of the light from frame to frame (a share); grey values of the room's light on white.
    drift_mm : float
        Standard deviation of where the sample lies at each visit, sideways; half of it in height.
    seed : int
        The same seed and time give the same frames.
    faults : mapping of int to str or list of str, optional
        By number of the visit, from 0, since the rig was made: ``dropped`` (a frame is missing, CaptureError),
        ``unplugged`` in the middle of the capture (DeviceUnavailable), and what only the frames can tell: ``repeated``,
        ``slipped``, ``late``, ``swapped``, ``dark``, ``saturated``, ``moved``. Those of a list come together.

    Raises
    ------
    InputError
        An option has no such value.
    """

    def __init__(
        self,
        *,
        scene: str = "soil",
        scene_options: Mapping[str, Any] | None = None,
        camera: Sequence[int] = (960, 720),
        started: str | None = None,
        pace: float = 1.0,
        exposure_ms: float = 6.5,
        flicker: float = 0.008,
        room_light: float = 9.0,
        drift_mm: float = DRIFT_MM,
        seed: int = 1,
        faults: Mapping[int, str | Sequence[str]] | None = None,
    ) -> None:
        if scene not in SCENES:
            raise InputError(f"rig option scene: no scene {scene!r}; there are {', '.join(SCENES)}")
        try:
            self._scene: Scene = SCENES[scene](**(scene_options or {}))
        except TypeError as error:
            raise InputError(f"rig option scene_options: {error}") from None
        if len(camera) != 2 or not all(isinstance(n, int) and 64 <= n <= 8192 for n in camera):
            raise InputError(f"rig option camera: must be two numbers of 64 to 8192 (columns, rows), not {camera}")
        for name, value in (("pace", pace), ("exposure_ms", exposure_ms)):
            if not (np.isfinite(value) and value > 0):
                raise InputError(f"rig option {name}: must be above 0, not {value}")
        for name, value in (("flicker", flicker), ("room_light", room_light), ("drift_mm", drift_mm)):
            if not (np.isfinite(value) and value >= 0):
                raise InputError(f"rig option {name}: must not be below 0, not {value}")
        try:
            self._faults = {visit: faults_of(given) for visit, given in (faults or {}).items()}
        except ValueError as error:
            raise InputError(f"rig option faults: {error}") from None
        try:
            self._started = None if started is None else parse_instant(str(started), "UTC")
        except ValueError as error:
            raise InputError(f"rig option started: {error}") from None
        self._camera_size = (int(camera[0]), int(camera[1]))
        self._pace = pace
        self._exposure_ms = exposure_ms
        self._flicker = flicker
        self._room_light = room_light
        self._drift_mm = drift_mm
        self._seed = seed
        self._visits = 0
        self._scenery: _Scenery | None = None
        self._stage: SimulatedStage | None = None
        self._lines: tuple[PatternSet, Profiles] | None = None
        self.make_stack: Callable[..., npt.NDArray[Any]] = np.empty

    def open(self) -> None:
        """Lay the scene under the optics; what does not change from visit to visit is computed here."""
        if self._scenery is None:
            self._scenery = _Scenery(self._scene, paper_optics(self._camera_size), self._seed)

    def capture(self, patterns: PatternSet, at: Instant) -> Frames:
        """Show the scene as it is at that time; the frames bear that time.

        Raises
        ------
        CaptureError, DeviceUnavailable
            As asked for by `faults`; CaptureError too if the rig is not open.
        """
        if self._scenery is None:
            raise CaptureError("simulated rig: not open; call open() before capture()")
        if self._stage is not None:
            self._scenery.carry(self._scene, self._stage.sample_mm)
        suffers = self._faults.get(self._visits, ())
        self._visits += 1
        raise_fault(suffers)
        if self._started is None:
            self._started = at
        elapsed_h = float((at - self._started) / HOURS) * self._pace
        chance = _chance(self._seed, at)
        lies = _lying(chance, self._drift_mm)
        stack = self._frames(patterns, elapsed_h, lies, chance, light_of(suffers))
        if "moved" in suffers:
            pushed = lies.copy()
            pushed[:, 3] += MOVED_MM * np.array([0.8, 0.6, 0.0])
            half = len(stack) // 2
            stack[half:] = self._frames(patterns, elapsed_h, pushed, chance, light_of(suffers))[half:]
        return Frames(harm(stack, suffers, chance), at, patterns, self._exposure_ms)

    def capture_posed(
        self,
        patterns: PatternSet,
        at: Instant,
        tilt_deg: tuple[float, float, float],
        shift_mm: tuple[float, float, float],
    ) -> Frames:
        """Capture as `capture` does, of a scene that somebody tilted and shifted: how a board is shown in poses."""
        if self._scenery is None:
            raise CaptureError("simulated rig: not open; call open() before capture_posed()")
        chance = _chance(self._seed, at)
        lies = small_motion(tilt_deg, shift_mm)
        return Frames(self._frames(patterns, 0.0, lies, chance), at, patterns, self._exposure_ms)

    def carried_by(self, stage: SimulatedStage) -> None:
        """Let a stage carry the sample: the rig looks at what lies before it at each capture."""
        self._stage = stage

    def set_exposure(self, exposure_ms: float) -> None:
        """Expose the next captures so long."""
        self._exposure_ms = exposure_ms

    def close(self) -> None:
        """Let go of the arrays; the rig may be opened again."""
        self._scenery = None

    def _frames(
        self,
        patterns: PatternSet,
        elapsed_h: float,
        lies: npt.NDArray[np.float64],
        chance: np.random.Generator,
        power: float = 1.0,
    ) -> npt.NDArray[np.uint8]:
        scenery = self._scenery
        assert scenery is not None
        here = Optics(scenery.optics.camera.moved(lies), scenery.optics.projector.moved(lies))
        if patterns.size != here.projector.lens.size:
            columns, rows = here.projector.lens.size
            raise CaptureError(
                f"simulated rig: patterns are {patterns.size[0]}x{patterns.size[1]}, "
                f"the projector is {columns}x{rows}: set size: [{columns}, {rows}]"
            )
        if self._lines is None or self._lines[0] != patterns:
            self._lines = (patterns, profiles(patterns, here))
        view = look(
            scenery.ground.height(elapsed_h).astype(np.float32),
            scenery.ground.albedo(elapsed_h).astype(np.float32),
            scenery.origin_mm,
            scenery.pitch_mm,
            scenery.rays,
            here,
        )
        count = len(patterns.roles)
        strength = 255 * power * self._exposure_ms / FULL_LIGHT_MS * (1 + chance.normal(0, self._flicker, count))
        room = self._room_light * (1 + 0.15 * np.sin(np.linspace(0, 2.5, count) + chance.uniform(0, 6.28)))
        light = Light(strength.astype(np.float32), room.astype(np.float32))
        frames = self.make_stack((count, *view.lit.shape), np.uint8)
        expose(view, here, self._lines[1], light, scenery.noise, int(chance.integers(len(scenery.noise))), frames)
        return frames


def sample_motion(at: Instant, *, seed: int = 1, drift_mm: float = DRIFT_MM) -> npt.NDArray[np.float64]:
    """How the sample lies at a visit, 3x4: x_world = motion x_scene. To judge results; no frame tells it."""
    return _lying(_chance(seed, at), drift_mm)


def _chance(seed: int, at: Instant) -> np.random.Generator:
    return np.random.default_rng([seed, int(at.astype(np.int64)) % 2**63])


def _lying(chance: np.random.Generator, drift_mm: float) -> npt.NDArray[np.float64]:
    tilt = chance.normal(0, 0.5 * np.rad2deg(drift_mm / 10), 3)
    x, y = chance.normal(0, drift_mm, 2)
    return small_motion((tilt[0], tilt[1], tilt[2]), (x, y, chance.normal(0, drift_mm / 2)))


class _Scenery:
    """What stays from visit to visit: the optics, the ground on a raster, the camera's rays, a stretch of noise."""

    optics: Optics
    ground: Ground

    def __init__(self, scene: Scene, optics: Optics, seed: int) -> None:
        columns, rows = optics.camera.lens.size
        self.optics = optics
        self.rays = optics.camera.rays()
        pixel_mm = optics.camera.focus_mm / optics.camera.lens.K[1, 1]
        self.pitch_mm = float(np.clip(0.75 * pixel_mm, 0.008, 0.02))
        half_y = HALF_FIELD_MM
        half_x = min(HALF_FIELD_MM * columns / rows, 8.6)  # beyond, the projector does not reach
        self._x = np.arange(-half_x, half_x, self.pitch_mm)
        self._y = np.arange(-half_y, half_y, self.pitch_mm)
        self.origin_mm = (float(self._x[0]), float(self._y[0]))
        self._carried_mm = (0.0, 0.0)
        self.ground = scene.at(self._x[None, :], self._y[:, None])
        self.noise = np.random.default_rng([seed, 8]).standard_normal(1 << 18).astype(np.float32)

    def carry(self, scene: Scene, to_mm: tuple[float, float]) -> None:
        """Shift the sample: another part of it lies in the field of view."""
        if to_mm != self._carried_mm:
            self._carried_mm = to_mm
            self.ground = scene.at((self._x - to_mm[0])[None, :], (self._y - to_mm[1])[:, None])
