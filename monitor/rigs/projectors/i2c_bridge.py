"""I2C of TI's evaluation modules, through the USB bridge on their board (CY7C65215), with its arbitration."""

from __future__ import annotations

import contextlib
import sys
import time
from typing import Any

from configs import DeviceUnavailable

from ...extras import load_extra

__all__ = ["I2CBridge"]

CYPRESS = 0x04B4
ADDRESS = 0x1B
CLOCK_HZ = 100_000
ASK_FOR_BUS, BUS_IS_OURS, WE_TALK = 5, 6, 9
"""Lines of the bridge by which it shares the bus with the board's own processor."""
WAIT_S, ROUND_S = 2.0, 0.02


class I2CBridge:
    """The controller's I2C bus; open while this lives as a context."""

    def __init__(self) -> None:
        self._held = contextlib.ExitStack()
        self._bridge: Any = None

    def __enter__(self) -> I2CBridge:
        """Find the bridge and get the bus.

        Raises
        ------
        DeviceUnavailable
            There is no bridge, or the board does not give the bus away.
        """
        cy = load_extra("cy_serial_bridge", "dlpc3478", "a DLP3010EVM-LC")
        usb = load_extra("usb1", "dlpc3478", "a DLP3010EVM-LC")
        self._errors = (cy.CySerialBridgeError, usb.USBError)
        try:
            context = cy.CyScbContext()
            # its own way to open a bridge may write another mode into its flash: never do that to TI's board
            bridges = context.list_devices(vid_pids=None)
            found = [each for each in bridges if each.vid == CYPRESS and each.curr_cytype == cy.CyType.I2C]
            if not found:
                raise DeviceUnavailable(
                    "no DLP3010EVM-LC answers: look at its power and USB cable, and whether this user may use it by "
                    "udev's rules"
                )
            with contextlib.redirect_stdout(sys.stderr):  # the library greets
                self._bridge = self._held.enter_context(cy.CyI2CControllerBridge(context, found[0], found[0].scb))
            self._bridge.set_i2c_configuration(cy.driver.CyI2CConfig(frequency=CLOCK_HZ))
            self._get_bus()
        except self._errors as error:
            self._held.close()
            raise DeviceUnavailable(
                "the DLP3010EVM-LC cannot be opened: look at its power and USB cable, and whether this user may use it "
                f"({error})"
            ) from None
        except BaseException:
            self._held.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        """Give the bus back and let the bridge go."""
        with contextlib.suppress(*self._errors):  # it may be gone
            self._bridge.set_gpio(ASK_FOR_BUS, False)
            self._bridge.set_gpio(WE_TALK, False)
        with contextlib.suppress(*self._errors):
            self._held.close()

    def write(self, command: bytes) -> None:
        """Send a command. Raises DeviceUnavailable where the controller does not take it."""
        try:
            self._bridge.i2c_write(ADDRESS, command)
        except self._errors as error:
            raise DeviceUnavailable(f"the DLP3010EVM-LC does not take command {command[0]:02X}: {error}") from None

    def read(self, command: bytes, length: int) -> bytes:
        """Send a command and give its answer."""
        self.write(command)
        try:
            return bytes(self._bridge.i2c_read(ADDRESS, length))
        except self._errors as error:
            raise DeviceUnavailable(f"the DLP3010EVM-LC does not answer command {command[0]:02X}: {error}") from None

    def _get_bus(self) -> None:
        self._bridge.set_gpio(ASK_FOR_BUS, True)
        until = time.monotonic() + WAIT_S
        while not self._bridge.get_gpio(BUS_IS_OURS):
            if time.monotonic() > until:
                raise DeviceUnavailable(f"the DLP3010EVM-LC does not give its I2C bus away within {WAIT_S:g} s")
            time.sleep(ROUND_S)
        self._bridge.set_gpio(WE_TALK, True)
