"""What a vehicle without payload answers to those who ask for one.

Commands are answered UNSUPPORTED by the command protocol. Here is the rest: what MAVLink has an
answer for is answered, and what it has none for is said once in a status text.
"""

from pymavlink.dialects.v20 import common as mav

from sitl.autopilot.codec.orders import Handlers, Outbox, Peer
from sitl.autopilot.reporter import Reporter

_NO_SHELL = b"There is no shell on this vehicle.\n"
_SHELL_BYTES = 70  # of one SERIAL_CONTROL
_NO_GIMBAL = "Gimbal order dropped: there is no gimbal"
_DROPPED: dict[type[mav.MAVLink_message], str] = {
    mav.MAVLink_gimbal_manager_set_attitude_message: _NO_GIMBAL,
    mav.MAVLink_gimbal_manager_set_pitchyaw_message: _NO_GIMBAL,
    mav.MAVLink_gimbal_manager_set_manual_control_message: _NO_GIMBAL,
    mav.MAVLink_gps_rtcm_data_message: "RTCM data dropped: the receiver takes no corrections",
    mav.MAVLink_play_tune_message: "Tune dropped: there is no speaker",
}


class NoPayload:
    """Answers for cameras, gimbals, shells and speakers, which are not there."""

    def __init__(self, outbox: Outbox, reporter: Reporter) -> None:
        self._outbox = outbox
        self._report = reporter
        self._said: set[str] = set()

    def handlers(self) -> Handlers:
        """The handler of each message class that is taken."""
        return dict.fromkeys(_DROPPED, self._drop) | {
            mav.MAVLink_serial_control_message: self._shell,
            mav.MAVLink_param_ext_set_message: self._refuse_parameter,
        }

    def _drop(self, _peer: Peer, msg: mav.MAVLink_message, _now: float) -> None:
        text = _DROPPED[type(msg)]
        if text not in self._said:
            self._said.add(text)
            self._report.say(text, mav.MAV_SEVERITY_NOTICE)

    def _shell(self, _peer: Peer, msg: mav.MAVLink_serial_control_message, _now: float) -> None:
        if msg.flags & mav.SERIAL_CONTROL_FLAG_RESPOND and msg.count > 0:
            data = list(_NO_SHELL.ljust(_SHELL_BYTES, b"\0"))
            reply = mav.SERIAL_CONTROL_FLAG_REPLY
            self._outbox.append(
                mav.MAVLink_serial_control_message(msg.device, reply, 0, 0, len(_NO_SHELL), data)
            )

    def _refuse_parameter(
        self, _peer: Peer, msg: mav.MAVLink_param_ext_set_message, _now: float
    ) -> None:
        kind, failed = mav.MAV_PARAM_EXT_TYPE_CUSTOM, mav.PARAM_ACK_FAILED
        name = msg.param_id.encode()
        self._outbox.append(mav.MAVLink_param_ext_ack_message(name, b"", kind, failed))
