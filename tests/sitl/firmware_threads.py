"""Stand-ins for firmwares that run by themselves, in threads."""

import threading
from contextlib import suppress

from firmware_stand_ins import ArduPilotStandIn, Px4StandIn

IDLE, CLIMB = 1000, 1700  # pulses


class ArduPilot(threading.Thread):
    """Asks for tick after tick with the same pulse, until told to end; holds on while `held`."""

    def __init__(self, port: int, pulse: int = IDLE) -> None:
        super().__init__(daemon=True)
        self._stand_in, self.pulse = ArduPilotStandIn(port), pulse
        self.seconds = 0.0  # of the newest answer
        self._on, self._ended = threading.Event(), False
        self._on.set()
        self.start()

    def run(self) -> None:
        count = 0
        while not self._ended:
            self._on.wait()
            with suppress(OSError):
                self._stand_in.ask(count, (self.pulse,) * 4)
                self.seconds = self._stand_in.answer()["timestamp"]
                count += 1
        self._stand_in.close()

    def hold(self) -> None:
        self._on.clear()

    def go_on(self) -> None:
        self._on.set()

    def end(self) -> None:
        self._ended = True
        self._on.set()
        self.join()


class Px4(threading.Thread):
    """Answers each HIL_SENSOR, disarmed, until told to end."""

    def __init__(self, port: int) -> None:
        super().__init__(daemon=True)
        self._stand_in, self._ended = Px4StandIn(port), False
        self.start()

    def run(self) -> None:
        with suppress(OSError):
            while not self._ended:
                for message in self._stand_in.hear(at_once=True):
                    if message.get_type() == "HIL_SENSOR":
                        self._stand_in.control(message.time_usec)
        self._stand_in.close()

    def end(self) -> None:
        self._ended = True
        self.join()
