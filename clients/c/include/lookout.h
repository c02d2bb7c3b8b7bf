/* Generated from the Rust declarations by: cargo run -p lookout-client-c --example generate
 *
 * Reads the results of a running lookout daemon from its shared memory.
 *
 *     lookout_options options = LOOKOUT_OPTIONS;
 *     lookout_client *client = lookout_open(&options, NULL, 0);
 *     lookout_frame frame;
 *     while (lookout_next(client, 1000, &frame) >= 0)
 *         ...
 *     lookout_close(client);
 *
 * Camera axes: x to the right, y down, z forward along the optical axis of the left camera. Speeds are positive
 * forwards, yaw and curvature to the left (counter-clockwise from above), lateral positions to the right. Names end in
 * their units. Client and daemon must be of one release. docs/clients.md says more.
 */
#ifndef LOOKOUT_H
#define LOOKOUT_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Layout of the structures: that of the daemon's messages. */
#define LOOKOUT_LAYOUT 12

/* Limits. */
#define LOOKOUT_MAX_OBSTACLES 128 /* Maximum number of obstacles of a frame. */
#define LOOKOUT_MAX_SECTORS 128 /* Maximum number of sectors of the free space. */
#define LOOKOUT_MAX_BOUNDARIES 8 /* Maximum number of boundaries. */
#define LOOKOUT_MAX_POINTS 24 /* Maximum number of points of a boundary. */
#define LOOKOUT_MAX_SIDE 8192 /* Maximum width and height of a picture, in pixels. */

/* Level of the alarm. */
#define LOOKOUT_LEVEL_OFF 0 /* off. */
#define LOOKOUT_LEVEL_CLEAR 1 /* clear. */
#define LOOKOUT_LEVEL_WARNING 2 /* warning. */
#define LOOKOUT_LEVEL_ALARM 3 /* alarm. */

/* The rule that raised the level. */
#define LOOKOUT_RULE_NONE 0 /* none. */
#define LOOKOUT_RULE_DISTANCE 1 /* distance. */
#define LOOKOUT_RULE_TIME_TO_COLLISION 2 /* time_to_collision. */
#define LOOKOUT_RULE_DECELERATION 3 /* deceleration. */

/* Self-checks that failed, as bits. */
#define LOOKOUT_FAULT_NO_ROAD 1 /* No road was detected. */
#define LOOKOUT_FAULT_DARK 2 /* An image is too dark. */
#define LOOKOUT_FAULT_BRIGHT 4 /* An image is too bright. */
#define LOOKOUT_FAULT_BLOCKED 8 /* An image has no contrast: the camera is covered, fogged or out of focus. */
#define LOOKOUT_FAULT_UNLIKE 16 /* The contrast of the left and the right image differs too much. */
#define LOOKOUT_FAULT_CALIBRATION 32 /* The rows of both images differ so much that matching suffers, after any correction. */
#define LOOKOUT_FAULT_SPARSE 64 /* The road has too little texture to be matched. */
#define LOOKOUT_FAULT_OLD 128 /* The frame is older than alarm.frame_age_max_ms. */
#define LOOKOUT_FAULT_STAGE 256 /* A stage is not running. */
#define LOOKOUT_FAULT_STALE 512 /* There has been no result for longer than pacing.stale_ms. */
#define LOOKOUT_FAULT_TIME 1024 /* The time of the source stands still or jumps too often. */
#define LOOKOUT_FAULT_PAIRING 2048 /* The images are no pair: swapped, the same, or with rows far apart. */
#define LOOKOUT_FAULT_FROZEN 4096 /* A camera shows the same picture again while the vehicle moves. */

/* Whether an obstacle moves over ground. */
#define LOOKOUT_MOVING_UNKNOWN 0 /* unknown. */
#define LOOKOUT_MOVING_STANDING 1 /* standing. */
#define LOOKOUT_MOVING_MOVING 2 /* moving. */

/* Why free space ends. */
#define LOOKOUT_END_UNKNOWN 0 /* unknown. */
#define LOOKOUT_END_OBSTACLE 1 /* obstacle. */
#define LOOKOUT_END_BOUNDARY 2 /* boundary. */
#define LOOKOUT_END_EDGE 3 /* edge. */

/* Where a boundary stands. */
#define LOOKOUT_SIDE_LEFT 0 /* left. */
#define LOOKOUT_SIDE_RIGHT 1 /* right. */
#define LOOKOUT_SIDE_ACROSS 2 /* across. */

/* What the own motion is known from, as bits. */
#define LOOKOUT_HEALTH_KNOWN 1 /* The motion is known. Without it, all other fields mean nothing. */
#define LOOKOUT_HEALTH_ODOMETRY 2 /* Visual odometry measured the motion since the last frame. */
#define LOOKOUT_HEALTH_BUS_SPEED 4 /* The speed of the vehicle's bus was used. */
#define LOOKOUT_HEALTH_BUS_YAW_RATE 8 /* The yaw rate of the vehicle's bus was used. */
#define LOOKOUT_HEALTH_DISAGREE 16 /* Odometry and bus disagree. */
#define LOOKOUT_HEALTH_STANDSTILL 32 /* The vehicle stands still. */

/* Which values of the bus there are, as bits. */
#define LOOKOUT_PRESENT_SPEED 1 /* speed_m_s and speed_age_s. */
#define LOOKOUT_PRESENT_YAW_RATE 2 /* yaw_rate_rad_s and yaw_rate_age_s. */
#define LOOKOUT_PRESENT_STEERING_ANGLE 4 /* steering_angle_rad. */
#define LOOKOUT_PRESENT_BRAKE 8 /* is_braking. */
#define LOOKOUT_PRESENT_TURN_INDICATOR 16 /* turn_indicator. */
#define LOOKOUT_PRESENT_GEAR 32 /* gear. */

/* What is wrong with the bus, as bits. */
#define LOOKOUT_VEHICLE_FAULT_NO_BUS 1 /* The bus cannot be opened, or nothing comes from it. */
#define LOOKOUT_VEHICLE_FAULT_MISSING 2 /* A configured signal has never been received. */
#define LOOKOUT_VEHICLE_FAULT_STALE 4 /* A configured signal has not been received for too long. */
#define LOOKOUT_VEHICLE_FAULT_OUT_OF_RANGE 8 /* A value was out of its range. */

/* How stages treat a frame, as bits. */
#define LOOKOUT_MODE_RECOGNITION_OFF 1 /* Regions are tracked, but not classified, because the board is too hot. */

/* Free ground in one direction. */
typedef struct lookout_sector {
    /* Distance along z from which the ground is known to be free, in metres. What is nearer is not seen. Range: 0
     * to 10000. */
    float near_m;
    /* Distance along z up to which it is known to be free, in metres; 0 if nothing is. Range: 0 to 10000. */
    float far_m;
    /* Why it ends there: an index into LOOKOUT_END_…. Range: 0 to 3. */
    uint32_t end;
} lookout_sector;

/* A point at the foot of a boundary. */
typedef struct lookout_boundary_point {
    /* Lateral position in metres; positive to the right of the camera's axis. Range: -10000 to 10000. */
    float lateral_m;
    /* Distance along z, in metres. Range: 0 to 10000. */
    float distance_m;
    /* Height above the road, in metres; at most the largest height of an obstacle. Range: 0 to 10000. */
    float height_m;
    /* Standard deviation of the position across the boundary, in metres. Range: 0 to 10000. */
    float sigma_m;
} lookout_boundary_point;

/* A boundary: a wall, a hedge, a fence, a guard rail, the fronts of houses. */
typedef struct lookout_boundary {
    /* Number that it keeps as long as it is seen. */
    uint32_t id;
    /* Where it stands: an index into LOOKOUT_SIDE_…. Range: 0 to 2. */
    uint32_t side;
    /* Number of points that are used, 0 to LOOKOUT_MAX_POINTS. Range: 0 to 24. */
    uint32_t count;
    /* Padding; 0. Range: 0. */
    uint32_t padding;
    /* The points, from left to right as the camera sees them; 0 beyond the last one. */
    lookout_boundary_point points[LOOKOUT_MAX_POINTS];
} lookout_boundary;

/* Free space and boundaries. Sector i lies between the directions left_slope + i · slope_step and the next one,
 * in metres to the right a metre ahead. */
typedef struct lookout_space {
    /* Number of sectors that are used, 0 to LOOKOUT_MAX_SECTORS. Range: 0 to 128. */
    uint32_t sectors;
    /* Number of boundaries that are used, 0 to LOOKOUT_MAX_BOUNDARIES. Range: 0 to 8. */
    uint32_t boundaries;
    /* Left side of the first sector, in metres to the right a metre ahead. Range: -20000 to 20000. */
    float left_slope;
    /* Width of a sector, in metres a metre ahead. Range: 0 to 20000. */
    float slope_step;
    /* The sectors, from left to right. */
    lookout_sector free[LOOKOUT_MAX_SECTORS];
    /* The boundaries, nearest first. */
    lookout_boundary lines[LOOKOUT_MAX_BOUNDARIES];
} lookout_space;

/* Alarm and road model of a frame. */
typedef struct lookout_alarm {
    /* Level of the alarm: 0 = off (a self-check failed), 1 = clear, 2 = warning, 3 = alarm (LOOKOUT_LEVEL_…).
     * Range: 0 to 3. */
    uint32_t level;
    /* The rule that raised it: an index into LOOKOUT_RULE_…; 0 = none. Range: 0 to 3. */
    uint32_t rule;
    /* The track that caused it, from 1; 0 = none. */
    uint32_t track;
    /* Self-checks that failed: bits of LOOKOUT_FAULT_…; not 0 while the level is off. Range: 0 to 8191. */
    uint32_t faults;
    /* 1 if the level differs from that of the previous frame, else 0. Range: 0 to 1. */
    uint32_t changed;
    /* The track that the state is about, from 1: the one that raised the level, or else the nearest in the path;
     * 0 = none. */
    uint32_t object;
    /* 1 if the level is only held: what raised it does not call for it in this frame. Range: 0 to 1. */
    uint32_t held;
    /* 1 if the path follows from the vehicle's motion: the strip that its body sweeps. 0: the motion is unknown,
     * the path is the straight strip of the configuration, and of the fields path_… only its half width and the
     * body are set. Range: 0 to 1. */
    uint32_t path_known;
    /* Distance of the nearest obstacle in the path, in metres; infinite if there is none. Range: 0 to 10000, or
     * infinite. */
    double nearest_m;
    /* Time to collision of track, in seconds; infinite if its distance does not decrease, or it is lost. Range: 0
     * to 1e9, or infinite. */
    double time_to_collision_s;
    /* Deceleration that stops the vehicle before track, in m/s², positive; 0 if none is required. Range: 0 to
     * 5000000. */
    double required_deceleration_m_s2;
    /* Gap between object and the path when the vehicle arrives, in metres; negative if they overlap: by so much
     * it would have to be farther aside. Infinite if there is none, or it is lost. Range: -10000 to 10000, or
     * infinite. */
    double clearance_m;
    /* Class of object, padded with zeros; empty if there is none, or it is lost. */
    char class_name[16];
    /* 1 if a road was detected, else 0. The fields of the road below are then 0. Range: 0 to 1. */
    uint32_t road_seen;
    /* Number of obstacles that follow, 0 to LOOKOUT_MAX_OBSTACLES. Range: 0 to 128. */
    uint32_t obstacles;
    /* Slope of the road in v-disparity, px of disparity per row. Range: -1000 to 1000. */
    double slope;
    /* Row of the horizon in the left image, in px; may lie outside the image. Range: -200000 to 200000. */
    double horizon_px;
    /* Share of rows whose disparities support the road, 0 to 1. Range: 0 to 1. */
    double confidence;
    /* Height of the camera above the road, in metres. Range: 0 to 100. */
    double camera_height_m;
    /* Curvature of the path of the rear axle's centre, in 1/m, to the left positive. Range: -1 to 1. */
    double path_curvature_per_m;
    /* Its standard deviation, in 1/m. Range: 0 to 1. */
    double path_curvature_sigma_per_m;
    /* Half the width of the body, in metres; the front's overhang adds to it on the outer side of a bend. Range:
     * 0 to 50. */
    double path_half_width_m;
    /* Arc length from the rear axle from which the path follows the road's edges, in metres; 0 if it does not.
     * Range: 0 to 10000. */
    double path_edges_from_m;
    /* Curvature from there on, in 1/m, to the left positive. Range: -1 to 1. */
    double path_edges_curvature_per_m;
    /* Position of the camera to the right of the vehicle's centre line, in metres. Range: -50 to 50. */
    double path_camera_right_m;
    /* Distance from the camera back to the rear axle, in metres. Range: -50 to 50. */
    double path_rear_axle_m;
    /* Distance from the camera forward to the front of the body, in metres. Range: -50 to 50. */
    double path_front_m;
    /* Yaw of the camera in the vehicle, in rad, to the left positive. Range: -0.1 to 0.1. */
    double path_camera_yaw_rad;
    /* Free space and boundaries. */
    lookout_space space;
} lookout_alarm;

/* One tracked obstacle. The box is in pixels of the left image; z is the camera's axis. */
typedef struct lookout_obstacle {
    /* Number of its track, from 1. */
    uint32_t track;
    /* 1 if the track is confirmed: only then it can raise the alarm; else 0. Range: 0 to 1. */
    uint32_t confirmed;
    /* Number of frames in which it was detected. */
    uint32_t seen;
    /* Number of frames in a row, up to this one, in which it was not detected. Above 0, its box, place and size
     * are predictions. */
    uint32_t missed;
    /* The box: left, top, width, height, in px; within the image. Range: 0 to 8192. */
    uint32_t bounds[4];
    /* Probability that it exists, 0 to 1. Range: 0 to 1. */
    double probability;
    /* Filtered distance along z, in metres. Range: 0 to 10000. */
    double distance_m;
    /* Standard deviation of the distance, in metres. Range: 0 to 10000. */
    double distance_sigma_m;
    /* Lateral position of its centre, in metres; positive to the right of the camera's axis. Range: -10000 to
     * 10000. */
    double lateral_m;
    /* Width in metres. Range: 0 to 10000. */
    double width_m;
    /* Height in metres. Range: 0 to 10000. */
    double height_m;
    /* Gap between it and the vehicle's path when the vehicle arrives, in metres; negative if they overlap: by so
     * much it would have to be farther aside. Range: -10000 to 10000, or infinite. */
    double clearance_m;
    /* Lateral speed in m/s; positive to the right. Over ground where the alarm's path is known, else relative to
     * the camera. Range: -1000 to 1000. */
    double across_m_s;
    /* Speed over ground along z, in m/s; positive away from the camera. 0 where the alarm's path is unknown.
     * Range: -1000 to 1000. */
    double along_m_s;
    /* Closing speed in m/s; positive while the distance decreases. Range: -1000 to 1000. */
    double closing_m_s;
    /* Standard deviation of the closing speed, in m/s. Range: 0 to 1000. */
    double closing_sigma_m_s;
    /* Time to collision in seconds; infinite if the distance does not decrease. Range: 0 to 1e9, or infinite. */
    double time_to_collision_s;
    /* Standard deviation of the time to collision, in seconds; 0 if the distance does not decrease. Range: 0 to
     * 1e9. */
    double time_to_collision_sigma_s;
    /* 1 if it is in the path of the vehicle, else 0. Range: 0 to 1. */
    uint32_t in_path;
    /* Whether it moves over ground: an index into LOOKOUT_MOVING_…; 0 = unknown. Range: 0 to 2. */
    uint32_t moving;
    /* Probability of the recognised class; 0 if none was recognised. Range: 0 to 1. */
    double score;
    /* Name of the class, padded with zeros; obstacle if none was recognised. */
    char class_name[16];
} lookout_obstacle;

/* The vehicle's own motion at the time of a frame, from odometry and bus. All zeros where no stage has determined
 * it yet. */
typedef struct lookout_motion {
    /* Speed, in m/s, forwards positive. Range: -300 to 300. */
    double speed_m_s;
    /* Its standard deviation, in m/s. Range: 0 to 300. */
    double speed_sigma_m_s;
    /* Acceleration, in m/s², forwards positive. Range: -100 to 100. */
    double acceleration_m_s2;
    /* Its standard deviation, in m/s². Range: 0 to 100. */
    double acceleration_sigma_m_s2;
    /* Yaw rate, in rad/s, to the left positive. Range: -20 to 20. */
    double yaw_rate_rad_s;
    /* Its standard deviation, in rad/s. Range: 0 to 20. */
    double yaw_rate_sigma_rad_s;
    /* Yaw acceleration, in rad/s², to the left positive. Range: -40 to 40. */
    double yaw_acceleration_rad_s2;
    /* Yaw of the camera in the vehicle, in rad, to the left positive, as odometry has found it; 0 until then.
     * Range: -0.1 to 0.1. */
    double camera_yaw_rad;
    /* Position since the start of the run or the last reset, in metres: right, down, forward of the first camera.
     * Range: -1e9 to 1e9. */
    double position_m[3];
    /* Orientation since then as a unit quaternion: x, y, z, w; all zeros until it is determined. Range: -1.000001
     * to 1.000001. */
    double orientation[4];
    /* What it is known from: bits of LOOKOUT_HEALTH_…. Range: 0 to 63. */
    uint32_t health;
    /* Number of image points that odometry agrees with in this frame. */
    uint32_t inliers;
    /* Number of resets of position and orientation. */
    uint32_t resets;
    /* Padding; 0. Range: 0. */
    uint32_t reserved;
} lookout_motion;

/* What the vehicle itself reported at the time of a frame. A value that is not present means nothing. */
typedef struct lookout_vehicle {
    /* Speed, in m/s, forwards positive. Range: -300 to 300. */
    double speed_m_s;
    /* Time from the measurement of the speed to the frame, in seconds. Range: -60 to 60. */
    double speed_age_s;
    /* Yaw rate, in rad/s, to the left positive. Range: -20 to 20. */
    double yaw_rate_rad_s;
    /* Time from the measurement of the yaw rate to the frame, in seconds. Range: -60 to 60. */
    double yaw_rate_age_s;
    /* Angle of the steering wheel, in rad, to the left positive. Range: -26 to 26. */
    double steering_angle_rad;
    /* Which values are present: bits of LOOKOUT_PRESENT_…. Range: 0 to 63. */
    uint32_t present;
    /* What is wrong: bits of LOOKOUT_VEHICLE_FAULT_…. Range: 0 to 15. */
    uint32_t faults;
    /* 1 while the brake is pressed, else 0. Range: 0 to 1. */
    uint32_t is_braking;
    /* Turn indicators: 0 off, 1 left, 2 right, 3 both. Range: 0 to 3. */
    uint32_t turn_indicator;
    /* Gear: 0 park, 1 reverse, 2 neutral, 3 forward. Range: 0 to 3. */
    uint32_t gear;
    /* Padding; 0. Range: 0. */
    uint32_t reserved;
} lookout_vehicle;

/* Frame size and rectified rig. All zeros until they are known. */
typedef struct lookout_rig {
    /* Width of an image in pixels. Range: 0 to 8192. */
    uint32_t width;
    /* Height of an image in pixels. Range: 0 to 8192. */
    uint32_t height;
    /* Number of disparities that are searched, from 0 px. Range: 0 to 8192. */
    uint32_t disparities;
    /* 1 in lock-step, 0 at live rate. Range: 0 to 1. */
    uint32_t lockstep;
    /* Focal length of both cameras, in pixels. Range: 0 to 100000. */
    double focal_px;
    /* Distance between the camera centres, in metres. Range: 0 to 20. */
    double baseline_m;
    /* Column of the left principal point, in pixels. Range: -100000 to 100000. */
    double cx_px;
    /* Row of the principal point, in pixels. Range: -100000 to 100000. */
    double cy_px;
    /* Current target of the time between two pairs at live rate, in ns. Range: 0 to 1000000000000000000. */
    uint64_t period_ns;
} lookout_rig;

/* What to read. LOOKOUT_OPTIONS initialises it: the daemon lookout, without pictures. */
typedef struct lookout_options {
    /* LOOKOUT_LAYOUT: the layout that the program was compiled with. */
    uint32_t layout;
    /* 1: frames come with the disparity map and its pictures; 0: without. */
    uint32_t pictures;
    /* Name of the daemon, instance.name of its configuration; NULL: lookout. */
    const char *instance;
    /* Its folder, instance.directory. NULL or empty: $RUNTIME_DIRECTORY, /tmp/lookout-<user id>, or the folder of
     * the systemd service. */
    const char *directory;
} lookout_options;

/* The results of one frame. All pointers are valid until the next call of lookout_next or lookout_close with the
 * same client, and what they lead to must not be written. */
typedef struct lookout_frame {
    /* Number of the pair in its run, from 0, rising; a gap is a frame that a newer one has overtaken. */
    uint64_t sequence;
    /* Time of the source (recording, scene, camera), in ns. */
    uint64_t source_ns;
    /* When the pair was captured, in ns of CLOCK_MONOTONIC: the age of a result is that clock less this value. 0
     * where the daemon itself has ended. */
    uint64_t capture_ns;
    /* When the result was complete, in ns of CLOCK_MONOTONIC; 0 where it is withdrawn. */
    uint64_t result_ns;
    /* The run: 12 letters and digits, other ones at each start of the daemon. Run and sequence identify a frame. */
    const char *run;
    /* Why the alarm has its level, in words. */
    const char *reason;
    /* Alarm, road, path, and in space free space and boundaries. */
    const lookout_alarm *alarm;
    /* The obstacles, the oldest track first: obstacle_count of them. */
    const lookout_obstacle *obstacles;
    /* The vehicle's own motion; unknown unless its health has LOOKOUT_HEALTH_KNOWN. */
    const lookout_motion *motion;
    /* What the vehicle's bus reported; which values there are is in its field present. */
    const lookout_vehicle *vehicle;
    /* Frame size and rectified rig, to turn disparities into metres: z = focal_px × baseline_m ÷ disparity. All
     * zeros until the daemon has told it, within a second of the client's start. */
    const lookout_rig *rig;
    /* Disparity in 1/256 px, 0 = unknown: width × height values, row after row. NULL if pictures were not asked
     * for, or the frame is withdrawn; so are the other pictures then. */
    const uint16_t *disparity;
    /* Confidence of the disparity, 1 to 255; 0 where it is unknown. */
    const uint8_t *confidence;
    /* Left rectified picture, grey values. */
    const uint8_t *left;
    /* Right rectified picture as it was matched, grey values. */
    const uint8_t *right;
    /* Number of obstacles, 0 to LOOKOUT_MAX_OBSTACLES. */
    uint32_t obstacle_count;
    /* 1: the results of this frame and of all earlier ones no longer hold: a stage or the daemon has ended, or
     * results have stopped. The alarm is then off, and there are no obstacles. Else 0. */
    uint32_t withdrawn;
    /* Width of the frame's pictures, in pixels; 0 where the daemon itself has ended. */
    uint32_t width;
    /* Height of the frame's pictures, in pixels; 0 where the daemon itself has ended. */
    uint32_t height;
    /* How stages treated the frame: bits of LOOKOUT_MODE_…. */
    uint32_t modes;
    /* Padding; 0. */
    uint32_t reserved;
} lookout_frame;

/* Initial options: the daemon "lookout", without pictures. */
#define LOOKOUT_OPTIONS { LOOKOUT_LAYOUT, 0, NULL, NULL }

/* A client. Calls with the same client must not overlap. */
typedef struct lookout_client lookout_client;

/* Opens a client of a daemon, which need not run yet. Returns NULL if the options are wrong; error, if it is not
 * NULL, then gets the reason, cut to error_bytes with its terminating zero. */
lookout_client *lookout_open(const lookout_options *options, char *error, size_t error_bytes);

/* Gets the newest frame that was not given before; waits for it at most timeout_ms milliseconds. Returns 1 with a
 * frame, 0 if none came, -1 if there is a daemon that could not be read; lookout_error then says why. A later
 * call tries again, and goes on with the next run when the daemon was restarted. */
int lookout_next(lookout_client *client, uint32_t timeout_ms, lookout_frame *frame);

/* Why the last call of lookout_next gave no frame; empty if it gave one. Valid until the next call with the same
 * client. */
const char *lookout_error(const lookout_client *client);

/* Closes a client; NULL is allowed. The pointers of its last frame are no longer valid. */
void lookout_close(lookout_client *client);

/* The layout of the structures that the library was built with, to compare with LOOKOUT_LAYOUT. */
uint32_t lookout_layout(void);

/* Name of a level of the alarm: off, clear, warning, alarm. An unknown one counts as off. */
const char *lookout_level_name(uint32_t level);

#ifdef __cplusplus
}
#endif

/* That this compiler lays the structures out as the library does. */
#if defined(__STDC_VERSION__) && __STDC_VERSION__ >= 201112L
_Static_assert(sizeof(lookout_sector) == 12, "layout");
_Static_assert(sizeof(lookout_boundary_point) == 16, "layout");
_Static_assert(sizeof(lookout_boundary) == 400, "layout");
_Static_assert(sizeof(lookout_space) == 4752, "layout");
_Static_assert(sizeof(lookout_alarm) == 4944, "layout");
_Static_assert(sizeof(lookout_obstacle) == 168, "layout");
_Static_assert(sizeof(lookout_motion) == 136, "layout");
_Static_assert(sizeof(lookout_vehicle) == 64, "layout");
_Static_assert(sizeof(lookout_rig) == 56, "layout");
#endif

#endif
