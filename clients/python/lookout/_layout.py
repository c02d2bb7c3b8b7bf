# Generated from the Rust declarations by: cargo run -p lookout-client-c --example generate
"""Layout of the library's structures. docs/client-records.md describes the fields."""

import ctypes

import numpy

__all__ = [
    "LAYOUT",
    "MAX_OBSTACLES",
    "MAX_SECTORS",
    "MAX_BOUNDARIES",
    "MAX_POINTS",
    "MAX_SIDE",
    "LEVEL_OFF",
    "LEVEL_CLEAR",
    "LEVEL_WARNING",
    "LEVEL_ALARM",
    "RULE_NONE",
    "RULE_DISTANCE",
    "RULE_TIME_TO_COLLISION",
    "RULE_DECELERATION",
    "FAULT_NO_ROAD",
    "FAULT_DARK",
    "FAULT_BRIGHT",
    "FAULT_BLOCKED",
    "FAULT_UNLIKE",
    "FAULT_CALIBRATION",
    "FAULT_SPARSE",
    "FAULT_OLD",
    "FAULT_STAGE",
    "FAULT_STALE",
    "FAULT_TIME",
    "FAULT_PAIRING",
    "FAULT_FROZEN",
    "MOVING_UNKNOWN",
    "MOVING_STANDING",
    "MOVING_MOVING",
    "END_UNKNOWN",
    "END_OBSTACLE",
    "END_BOUNDARY",
    "END_EDGE",
    "SIDE_LEFT",
    "SIDE_RIGHT",
    "SIDE_ACROSS",
    "HEALTH_KNOWN",
    "HEALTH_ODOMETRY",
    "HEALTH_BUS_SPEED",
    "HEALTH_BUS_YAW_RATE",
    "HEALTH_DISAGREE",
    "HEALTH_STANDSTILL",
    "PRESENT_SPEED",
    "PRESENT_YAW_RATE",
    "PRESENT_STEERING_ANGLE",
    "PRESENT_BRAKE",
    "PRESENT_TURN_INDICATOR",
    "PRESENT_GEAR",
    "VEHICLE_FAULT_NO_BUS",
    "VEHICLE_FAULT_MISSING",
    "VEHICLE_FAULT_STALE",
    "VEHICLE_FAULT_OUT_OF_RANGE",
    "MODE_RECOGNITION_OFF",
    "SECTOR",
    "BOUNDARY_POINT",
    "BOUNDARY",
    "SPACE",
    "ALARM",
    "OBSTACLE",
    "MOTION",
    "VEHICLE",
    "RIG",
]

LAYOUT = 12

# Limits.
MAX_OBSTACLES = 128
MAX_SECTORS = 128
MAX_BOUNDARIES = 8
MAX_POINTS = 24
MAX_SIDE = 8192

# Level of the alarm.
LEVEL_OFF = 0
LEVEL_CLEAR = 1
LEVEL_WARNING = 2
LEVEL_ALARM = 3

# The rule that raised the level.
RULE_NONE = 0
RULE_DISTANCE = 1
RULE_TIME_TO_COLLISION = 2
RULE_DECELERATION = 3

# Self-checks that failed, as bits.
FAULT_NO_ROAD = 1
FAULT_DARK = 2
FAULT_BRIGHT = 4
FAULT_BLOCKED = 8
FAULT_UNLIKE = 16
FAULT_CALIBRATION = 32
FAULT_SPARSE = 64
FAULT_OLD = 128
FAULT_STAGE = 256
FAULT_STALE = 512
FAULT_TIME = 1024
FAULT_PAIRING = 2048
FAULT_FROZEN = 4096

# Whether an obstacle moves over ground.
MOVING_UNKNOWN = 0
MOVING_STANDING = 1
MOVING_MOVING = 2

# Why free space ends.
END_UNKNOWN = 0
END_OBSTACLE = 1
END_BOUNDARY = 2
END_EDGE = 3

# Where a boundary stands.
SIDE_LEFT = 0
SIDE_RIGHT = 1
SIDE_ACROSS = 2

# What the own motion is known from, as bits.
HEALTH_KNOWN = 1
HEALTH_ODOMETRY = 2
HEALTH_BUS_SPEED = 4
HEALTH_BUS_YAW_RATE = 8
HEALTH_DISAGREE = 16
HEALTH_STANDSTILL = 32

# Which values of the bus there are, as bits.
PRESENT_SPEED = 1
PRESENT_YAW_RATE = 2
PRESENT_STEERING_ANGLE = 4
PRESENT_BRAKE = 8
PRESENT_TURN_INDICATOR = 16
PRESENT_GEAR = 32

# What is wrong with the bus, as bits.
VEHICLE_FAULT_NO_BUS = 1
VEHICLE_FAULT_MISSING = 2
VEHICLE_FAULT_STALE = 4
VEHICLE_FAULT_OUT_OF_RANGE = 8

# How stages treat a frame, as bits.
MODE_RECOGNITION_OFF = 1

SECTOR = numpy.dtype([
    ("near_m", "=f4"),
    ("far_m", "=f4"),
    ("end", "=u4"),
])

BOUNDARY_POINT = numpy.dtype([
    ("lateral_m", "=f4"),
    ("distance_m", "=f4"),
    ("height_m", "=f4"),
    ("sigma_m", "=f4"),
])

BOUNDARY = numpy.dtype([
    ("id", "=u4"),
    ("side", "=u4"),
    ("count", "=u4"),
    ("padding", "=u4"),
    ("points", BOUNDARY_POINT, (24,)),
])

SPACE = numpy.dtype([
    ("sectors", "=u4"),
    ("boundaries", "=u4"),
    ("left_slope", "=f4"),
    ("slope_step", "=f4"),
    ("free", SECTOR, (128,)),
    ("lines", BOUNDARY, (8,)),
])

ALARM = numpy.dtype([
    ("level", "=u4"),
    ("rule", "=u4"),
    ("track", "=u4"),
    ("faults", "=u4"),
    ("changed", "=u4"),
    ("object", "=u4"),
    ("held", "=u4"),
    ("path_known", "=u4"),
    ("nearest_m", "=f8"),
    ("time_to_collision_s", "=f8"),
    ("required_deceleration_m_s2", "=f8"),
    ("clearance_m", "=f8"),
    ("class", "S16"),
    ("road_seen", "=u4"),
    ("obstacles", "=u4"),
    ("slope", "=f8"),
    ("horizon_px", "=f8"),
    ("confidence", "=f8"),
    ("camera_height_m", "=f8"),
    ("path_curvature_per_m", "=f8"),
    ("path_curvature_sigma_per_m", "=f8"),
    ("path_half_width_m", "=f8"),
    ("path_edges_from_m", "=f8"),
    ("path_edges_curvature_per_m", "=f8"),
    ("path_camera_right_m", "=f8"),
    ("path_rear_axle_m", "=f8"),
    ("path_front_m", "=f8"),
    ("path_camera_yaw_rad", "=f8"),
    ("space", SPACE),
])

OBSTACLE = numpy.dtype([
    ("track", "=u4"),
    ("confirmed", "=u4"),
    ("seen", "=u4"),
    ("missed", "=u4"),
    ("bounds", "=u4", (4,)),
    ("probability", "=f8"),
    ("distance_m", "=f8"),
    ("distance_sigma_m", "=f8"),
    ("lateral_m", "=f8"),
    ("width_m", "=f8"),
    ("height_m", "=f8"),
    ("clearance_m", "=f8"),
    ("across_m_s", "=f8"),
    ("along_m_s", "=f8"),
    ("closing_m_s", "=f8"),
    ("closing_sigma_m_s", "=f8"),
    ("time_to_collision_s", "=f8"),
    ("time_to_collision_sigma_s", "=f8"),
    ("in_path", "=u4"),
    ("moving", "=u4"),
    ("score", "=f8"),
    ("class", "S16"),
])

MOTION = numpy.dtype([
    ("speed_m_s", "=f8"),
    ("speed_sigma_m_s", "=f8"),
    ("acceleration_m_s2", "=f8"),
    ("acceleration_sigma_m_s2", "=f8"),
    ("yaw_rate_rad_s", "=f8"),
    ("yaw_rate_sigma_rad_s", "=f8"),
    ("yaw_acceleration_rad_s2", "=f8"),
    ("camera_yaw_rad", "=f8"),
    ("position_m", "=f8", (3,)),
    ("orientation", "=f8", (4,)),
    ("health", "=u4"),
    ("inliers", "=u4"),
    ("resets", "=u4"),
    ("reserved", "=u4"),
])

VEHICLE = numpy.dtype([
    ("speed_m_s", "=f8"),
    ("speed_age_s", "=f8"),
    ("yaw_rate_rad_s", "=f8"),
    ("yaw_rate_age_s", "=f8"),
    ("steering_angle_rad", "=f8"),
    ("present", "=u4"),
    ("faults", "=u4"),
    ("is_braking", "=u4"),
    ("turn_indicator", "=u4"),
    ("gear", "=u4"),
    ("reserved", "=u4"),
])

RIG = numpy.dtype([
    ("width", "=u4"),
    ("height", "=u4"),
    ("disparities", "=u4"),
    ("lockstep", "=u4"),
    ("focal_px", "=f8"),
    ("baseline_m", "=f8"),
    ("cx_px", "=f8"),
    ("cy_px", "=f8"),
    ("period_ns", "=u8"),
])


class Options(ctypes.Structure):
    _fields_ = [
        ("layout", ctypes.c_uint32),
        ("pictures", ctypes.c_uint32),
        ("instance", ctypes.c_char_p),
        ("directory", ctypes.c_char_p),
    ]


class Frame(ctypes.Structure):
    _fields_ = [
        ("sequence", ctypes.c_uint64),
        ("source_ns", ctypes.c_uint64),
        ("capture_ns", ctypes.c_uint64),
        ("result_ns", ctypes.c_uint64),
        ("run", ctypes.c_char_p),
        ("reason", ctypes.c_char_p),
        ("alarm", ctypes.c_void_p),
        ("obstacles", ctypes.c_void_p),
        ("motion", ctypes.c_void_p),
        ("vehicle", ctypes.c_void_p),
        ("rig", ctypes.c_void_p),
        ("disparity", ctypes.c_void_p),
        ("confidence", ctypes.c_void_p),
        ("left", ctypes.c_void_p),
        ("right", ctypes.c_void_p),
        ("obstacle_count", ctypes.c_uint32),
        ("withdrawn", ctypes.c_uint32),
        ("width", ctypes.c_uint32),
        ("height", ctypes.c_uint32),
        ("modes", ctypes.c_uint32),
        ("reserved", ctypes.c_uint32),
    ]
