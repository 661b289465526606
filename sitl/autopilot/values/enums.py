"""The MAVLink numbers that the autopilot works with; a test holds them against the dialect."""

from enum import IntEnum, IntFlag


class Command(IntEnum):
    """MAV_CMD: commands and mission items that the vehicle knows."""

    NAV_WAYPOINT = 16
    NAV_LOITER_UNLIM = 17
    NAV_LOITER_TIME = 19
    NAV_RETURN_TO_LAUNCH = 20
    NAV_LAND = 21
    NAV_TAKEOFF = 22
    NAV_DELAY = 93
    CONDITION_DELAY = 112
    CONDITION_YAW = 115
    DO_SET_MODE = 176
    DO_ORBIT = 34
    DO_JUMP = 177
    DO_CHANGE_SPEED = 178
    DO_SET_HOME = 179
    DO_FLIGHTTERMINATION = 185
    DO_CHANGE_ALTITUDE = 186
    DO_REPOSITION = 192
    DO_PAUSE_CONTINUE = 193
    DO_SET_ROI_LOCATION = 195
    DO_SET_ROI_NONE = 197
    DO_SET_ROI = 201
    DO_FENCE_ENABLE = 207
    DO_SET_MISSION_CURRENT = 224
    PREFLIGHT_STORAGE = 245
    PREFLIGHT_REBOOT_SHUTDOWN = 246
    MISSION_START = 300
    COMPONENT_ARM_DISARM = 400
    GET_HOME_POSITION = 410
    INJECT_FAILURE = 420
    GET_MESSAGE_INTERVAL = 510
    SET_MESSAGE_INTERVAL = 511
    REQUEST_MESSAGE = 512
    REQUEST_AUTOPILOT_CAPABILITIES = 520
    NAV_FENCE_RETURN_POINT = 5000
    NAV_FENCE_POLYGON_VERTEX_INCLUSION = 5001
    NAV_FENCE_POLYGON_VERTEX_EXCLUSION = 5002
    NAV_FENCE_CIRCLE_INCLUSION = 5003
    NAV_FENCE_CIRCLE_EXCLUSION = 5004
    NAV_RALLY_POINT = 5100


class Result(IntEnum):
    """MAV_RESULT: the answer to a command."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4
    IN_PROGRESS = 5


class MissionResult(IntEnum):
    """MAV_MISSION_RESULT: the end of a mission transfer."""

    ACCEPTED = 0
    ERROR = 1
    UNSUPPORTED_FRAME = 2
    UNSUPPORTED = 3
    NO_SPACE = 4
    INVALID = 5
    INVALID_PARAM1 = 6
    INVALID_PARAM2 = 7
    INVALID_PARAM3 = 8
    INVALID_PARAM4 = 9
    INVALID_PARAM5_X = 10
    INVALID_PARAM6_Y = 11
    INVALID_PARAM7 = 12
    INVALID_SEQUENCE = 13
    DENIED = 14
    OPERATION_CANCELLED = 15


class MissionType(IntEnum):
    """MAV_MISSION_TYPE: which of the vehicle's lists a transfer is about."""

    MISSION = 0
    FENCE = 1
    RALLY = 2
    ALL = 255


class MissionState(IntEnum):
    """MISSION_STATE."""

    UNKNOWN = 0
    NO_MISSION = 1
    NOT_STARTED = 2
    ACTIVE = 3
    PAUSED = 4
    COMPLETE = 5


class Frame(IntEnum):
    """MAV_FRAME: what the coordinates of an item mean."""

    GLOBAL = 0
    LOCAL_NED = 1
    MISSION = 2
    GLOBAL_RELATIVE_ALT = 3
    GLOBAL_INT = 5
    GLOBAL_RELATIVE_ALT_INT = 6
    BODY_NED = 8


ABSOLUTE_FRAMES = frozenset({Frame.GLOBAL, Frame.GLOBAL_INT})
RELATIVE_FRAMES = frozenset({Frame.GLOBAL_RELATIVE_ALT, Frame.GLOBAL_RELATIVE_ALT_INT})
GLOBAL_FRAMES = ABSOLUTE_FRAMES | RELATIVE_FRAMES


class Severity(IntEnum):
    """MAV_SEVERITY of a status text."""

    EMERGENCY = 0
    ALERT = 1
    CRITICAL = 2
    ERROR = 3
    WARNING = 4
    NOTICE = 5
    INFO = 6
    DEBUG = 7


class LandedState(IntEnum):
    """MAV_LANDED_STATE."""

    UNDEFINED = 0
    ON_GROUND = 1
    IN_AIR = 2
    TAKEOFF = 3
    LANDING = 4


class SystemState(IntEnum):
    """MAV_STATE."""

    UNINIT = 0
    BOOT = 1
    CALIBRATING = 2
    STANDBY = 3
    ACTIVE = 4
    CRITICAL = 5
    EMERGENCY = 6
    POWEROFF = 7
    FLIGHT_TERMINATION = 8


class Sensor(IntFlag):
    """MAV_SYS_STATUS_SENSOR: parts whose presence and health SYS_STATUS reports."""

    GYRO = 1
    ACCEL = 2
    MAG = 4
    BARO = 8
    GNSS = 32
    RATE_CONTROL = 1024
    ATTITUDE_CONTROL = 2048
    YAW_CONTROL = 4096
    ALTITUDE_CONTROL = 8192
    POSITION_CONTROL = 16384
    MOTORS = 32768
    GEOFENCE = 1048576
    AHRS = 2097152
    BATTERY = 33554432
    PREARM_CHECK = 268435456


class ParamType(IntEnum):
    """MAV_PARAM_TYPE; the vehicle has these two."""

    INT32 = 6
    REAL32 = 9


class ParamError(IntEnum):
    """MAV_PARAM_ERROR."""

    DOES_NOT_EXIST = 1
    VALUE_OUT_OF_RANGE = 2
    PERMISSION_DENIED = 3
    COMPONENT_NOT_FOUND = 4
    READ_ONLY = 5


class FailureUnit(IntEnum):
    """FAILURE_UNIT: what a failure is injected into."""

    GYRO = 0
    ACCEL = 1
    MAG = 2
    BARO = 3
    GNSS = 4
    BATTERY = 100
    MOTOR = 101


class FailureType(IntEnum):
    """FAILURE_TYPE: how the unit fails; OK ends the failure."""

    OK = 0
    OFF = 1
    STUCK = 2
    GARBAGE = 3
    WRONG = 4
    SLOW = 5
    DELAYED = 6
    INTERMITTENT = 7


class OrbitYaw(IntEnum):
    """ORBIT_YAW_BEHAVIOUR: where the nose points on an orbit."""

    FRONT_TO_CENTER = 0
    INITIAL_HEADING = 1
    UNCONTROLLED = 2
    TANGENT = 3
    RC_CONTROLLED = 4
    UNCHANGED = 5


class Message(IntEnum):
    """Message numbers that can be asked for or streamed."""

    HEARTBEAT = 0
    SYS_STATUS = 1
    SYSTEM_TIME = 2
    GPS_RAW_INT = 24
    SCALED_IMU = 26
    RAW_IMU = 27
    SCALED_PRESSURE = 29
    ATTITUDE = 30
    ATTITUDE_QUATERNION = 31
    LOCAL_POSITION_NED = 32
    GLOBAL_POSITION_INT = 33
    SERVO_OUTPUT_RAW = 36
    MISSION_CURRENT = 42
    GPS_GLOBAL_ORIGIN = 49
    VFR_HUD = 74
    ATTITUDE_TARGET = 83
    POSITION_TARGET_LOCAL_NED = 85
    POSITION_TARGET_GLOBAL_INT = 87
    HIGHRES_IMU = 105
    SIM_STATE = 108
    HIL_STATE_QUATERNION = 115
    ALTITUDE = 141
    BATTERY_STATUS = 147
    AUTOPILOT_VERSION = 148
    ESTIMATOR_STATUS = 230
    WIND_COV = 231
    VIBRATION = 241
    HOME_POSITION = 242
    EXTENDED_SYS_STATE = 245
    FLIGHT_INFORMATION = 264
    ODOMETRY = 331
    ORBIT_EXECUTION_STATUS = 360
    ACTUATOR_OUTPUT_STATUS = 375
