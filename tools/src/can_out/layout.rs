//! The messages and their signals, declared once: frames, the DBC file and the documentation follow from these tables.
//!
//! Every frame has 8 bytes, of which the first 12 bits are checksum and alive counter. `Values::cycle` says what is absent;
//! what is absent is sent as "not available".

use super::signal::{Coding, Signal};
use super::values::{Object, Own, PathAhead, Status};

/// Version of this layout, in each status frame: increased with every change of a table below.
pub const VERSION: u32 = 1;

/// First identifier where the configuration names no other.
pub const DEFAULT_BASE_ID: u32 = 0x640;

/// Number of identifiers from the first one that are reserved.
pub const ID_COUNT: u32 = 32;

/// Maximum number of obstacles.
pub const MAX_OBJECTS: usize = 8;

/// Data id of the first message for the checksum; that of the others follows their identifiers. It does not depend on
/// the configured identifiers.
pub const FIRST_DATA_ID: u16 = 0x4c00;

/// Prefix of all names of messages: they inform, and ask nothing of the vehicle.
pub const MESSAGE_PREFIX: &str = "LookoutInfo_";

/// Offset of the identifier of the first obstacle's first message.
const FIRST_OBJECT: u32 = 8;

/// Levels of the alarm, by number.
pub const LEVELS: &[&str] = &["off", "clear", "warning", "alarm"];

/// Rules that raise the alarm, by number.
pub const RULES: &[&str] = &["none", "distance", "time_to_collision", "deceleration"];

/// States of the daemon, by number ([`super::DaemonState`]).
pub const DAEMON_STATES: &[&str] = &["starting", "running", "degraded", "stopping", "not running"];

/// Where the frames come from, by number.
pub const SOURCES: &[&str] = &["cameras", "recording", "scene"];

/// How an obstacle is known, by number ([`super::Existence`]).
pub const EXISTENCE: &[&str] = &["none", "tentative", "measured", "predicted"];

/// Classes of obstacles, by number: not recognised, recognised as a vehicle, a pedestrian, as a class that this layout does
/// not name, or as a rider.
pub const CLASSES: &[&str] = &["obstacle", "vehicle", "pedestrian", OTHER, "rider"];

/// A class that has no number of its own.
pub const OTHER: &str = "other";

/// Whether an obstacle moves over ground, by number.
pub const MOVING: &[&str] = &["unknown", "standing", "moving"];

/// Self-checks that switch the alarm off, in the order of their bits in the daemon's messages.
pub const FAULTS: &[&str] = &[
    "NoRoad",
    "Dark",
    "Bright",
    "Blocked",
    "Unlike",
    "Calibration",
    "Sparse",
    "Old",
    "Stage",
    "Stale",
    "SourceTime",
    "Pairing",
];

/// States of what is true or not.
const YES_NO: Coding = Coding::State(&["no", "yes"]);

/// A physical value.
const fn number(factor: f64, offset: f64, unit: &'static str) -> Coding {
    Coding::Number { factor, offset, unit }
}

/// The value of a state that is true or not.
fn yes(is_true: bool) -> Option<f64> {
    Some(f64::from(u8::from(is_true)))
}

/// The bit of a failed self-check.
fn fault(status: &Status, bit: u32) -> Option<f64> {
    yes(status.faults >> bit & 1 == 1)
}

macro_rules! signals {
    ($(#[doc = $doc:literal])* $table:ident of $type:ty {
        $($(#[doc = $text:literal])+ $name:ident: $start:literal | $length:literal, $coding:expr, $value:expr;)*
    }) => {
        $(#[doc = $doc])*
        pub const $table: &[Signal<$type>] = &[$(Signal {
            name: stringify!($name),
            start: $start,
            length: $length,
            coding: $coding,
            text: concat!($($text),+),
            value: $value,
        }),*];
    };
}

signals! {
    /// What each frame begins with. The encoder fills both; here they have no value.
    HEAD of () {
        /// Checksum: AUTOSAR E2E profile 1A, CRC-8 of SAE J1850's polynomial with start value and final XOR 0, over the
        /// data id (low byte, high byte) and bytes 1 to 7.
        Checksum: 0 | 8, Coding::LowBits, |_| None;
        /// Alive counter, 0 to 14: one more in each cycle, and the same in all frames of a cycle.
        AliveCounter: 8 | 4, number(1.0, 0.0, ""), |_| None;
    }
}

signals! {
    /// The alarm, why it is off, the daemon's health and the age of the data.
    STATUS of Status {
        /// Level of the alarm. Off: it cannot judge, for the reasons that the fault bits give; it does not mean that the
        /// road is clear.
        AlarmLevel: 12 | 3, Coding::State(LEVELS), |s| Some(s.level.into());
        /// The rule that raised the alarm.
        AlarmRule: 15 | 3, Coding::State(RULES), |s| Some(s.rule.into());
        /// State of the daemon; not available if it does not answer.
        DaemonState: 18 | 3, Coding::State(DAEMON_STATES), |s| s.daemon.map(f64::from);
        /// Whether the road was seen.
        RoadSeen: 21 | 2, YES_NO, |s| s.is_road_seen.and_then(yes);
        /// A self-check failed that has no bit of its own, such as a camera that shows the same picture again.
        FaultOther: 23 | 1, Coding::Bit, |s| yes(s.faults >> FAULTS.len() != 0);
        /// No road was detected.
        FaultNoRoad: 24 | 1, Coding::Bit, |s| fault(s, 0);
        /// An image is too dark.
        FaultDark: 25 | 1, Coding::Bit, |s| fault(s, 1);
        /// An image is too bright.
        FaultBright: 26 | 1, Coding::Bit, |s| fault(s, 2);
        /// An image has no contrast: a camera is covered, fogged or out of focus.
        FaultBlocked: 27 | 1, Coding::Bit, |s| fault(s, 3);
        /// The left and the right image differ too much.
        FaultUnlike: 28 | 1, Coding::Bit, |s| fault(s, 4);
        /// The rows of both images differ so much that matching suffers: the cameras have moved.
        FaultCalibration: 29 | 1, Coding::Bit, |s| fault(s, 5);
        /// The road has too little texture.
        FaultSparse: 30 | 1, Coding::Bit, |s| fault(s, 6);
        /// The frame was too old when it was processed.
        FaultOld: 31 | 1, Coding::Bit, |s| fault(s, 7);
        /// A stage, or the daemon, is not running.
        FaultStage: 32 | 1, Coding::Bit, |s| fault(s, 8);
        /// There has been no result for too long.
        FaultStale: 33 | 1, Coding::Bit, |s| fault(s, 9);
        /// The time of the source stands still or jumps.
        FaultSourceTime: 34 | 1, Coding::Bit, |s| fault(s, 10);
        /// The images are no pair: swapped, the same, or with rows far apart.
        FaultPairing: 35 | 1, Coding::Bit, |s| fault(s, 11);
        /// Version of the layout of all frames.
        LayoutVersion: 36 | 4, Coding::LowBits, |_| Some(VERSION.into());
        /// Age of the last result: time from the exposure of its images to this frame.
        Age: 40 | 14, number(1.0, 0.0, "ms"), |s| s.age_ms;
        /// Low bits of the number of the frame that the values come from.
        FrameNumber: 54 | 8, Coding::LowBits, |s| s.sequence.map(|n| (n & 0xff) as f64);
        /// Where the frames come from; not available without a daemon. Only those of cameras show the road now.
        Source: 62 | 2, Coding::State(SOURCES), |s| s.source.map(f64::from);
    }
}

signals! {
    /// The path ahead of the vehicle.
    PATH of PathAhead {
        /// Distance from the front of the body to the nearest obstacle in the path. The largest value: none is seen as far
        /// as the system sees, which does not mean that there is none. Not available while the alarm is off.
        FreeDistance: 12 | 12, number(0.05, 0.0, "m"), |p| p.free_m;
        /// Whether the path follows from the vehicle's motion; else it is the straight strip of the configuration.
        Known: 24 | 2, YES_NO, |p| yes(p.is_known);
        /// Curvature of the path, to the left positive.
        Curvature: 26 | 11, number(0.0005, -0.5, "1/m"), |p| p.curvature_per_m;
        /// Standard deviation of the curvature.
        CurvatureSigma: 37 | 10, number(0.0001, 0.0, "1/m"), |p| p.curvature_sigma_per_m;
        /// Half the width of the body that moves along the path.
        HalfWidth: 47 | 8, number(0.02, 0.0, "m"), |p| p.half_width_m;
        /// Number of obstacles that are tracked; the largest value means that many or more.
        Objects: 55 | 4, number(1.0, 0.0, ""), |p| Some(p.objects.into());
        /// Number of confirmed obstacles in the path; the largest value means that many or more.
        ObjectsInPath: 59 | 4, number(1.0, 0.0, ""), |p| Some(p.objects_in_path.into());
    }
}

signals! {
    /// The vehicle's own motion as the system estimates it.
    OWN of Own {
        /// Estimated speed, forwards positive.
        Speed: 12 | 12, number(0.05, -51.2, "m/s"), |o| o.speed_m_s;
        /// Estimated yaw rate, to the left positive.
        YawRate: 24 | 12, number(0.001, -2.047, "rad/s"), |o| o.yaw_rate_rad_s;
        /// Standard deviation of the speed.
        SpeedSigma: 36 | 10, number(0.02, 0.0, "m/s"), |o| o.speed_sigma_m_s;
        /// Standard deviation of the yaw rate.
        YawRateSigma: 46 | 10, number(0.0005, 0.0, "rad/s"), |o| o.yaw_rate_sigma_rad_s;
        /// Whether the own motion is known; without it the other values are not available.
        Known: 56 | 2, YES_NO, |o| yes(o.is_known);
        /// Whether the vehicle stands.
        Standstill: 58 | 2, YES_NO, |o| yes(o.is_standing);
        /// Whether the sources of the motion contradict each other.
        Disagree: 60 | 2, YES_NO, |o| yes(o.disagrees);
    }
}

signals! {
    /// Where an obstacle is and how it moves.
    OBJECT of Object {
        /// Distance of the near side from the left camera, along its axis. Not available: there is no obstacle in this
        /// place.
        Distance: 12 | 12, number(0.05, 0.0, "m"), |o| o.distance_m;
        /// Lateral position of its centre, to the right of the camera's axis positive.
        Lateral: 24 | 11, number(0.05, -51.15, "m"), |o| o.lateral_m;
        /// Closing speed, positive while the distance decreases.
        ClosingSpeed: 35 | 11, number(0.1, -102.3, "m/s"), |o| o.closing_m_s;
        /// Time to collision. The largest value: that or later, or never.
        TimeToCollision: 46 | 10, number(0.05, 0.0, "s"), |o| o.time_to_collision_s;
        /// Lateral speed, to the right positive; over ground where the path is known, else relative to the camera.
        LateralSpeed: 56 | 8, number(0.2, -25.4, "m/s"), |o| o.across_m_s;
    }
}

signals! {
    /// What an obstacle is.
    SHAPE of Object {
        /// Low bits of the number of its track; 0 where there is no obstacle.
        Track: 12 | 16, Coding::LowBits, |o| Some(o.track.into());
        /// Width.
        Width: 28 | 8, number(0.05, 0.0, "m"), |o| o.width_m;
        /// Height.
        Height: 36 | 8, number(0.05, 0.0, "m"), |o| o.height_m;
        /// Standard deviation of the distance.
        DistanceSigma: 44 | 8, number(0.05, 0.0, "m"), |o| o.distance_sigma_m;
        /// Whether there is an obstacle in this place, and how it is known.
        Existence: 52 | 3, Coding::State(EXISTENCE), |o| Some(f64::from(o.existence as u8));
        /// Its class; obstacle if none was recognised.
        Class: 55 | 4, Coding::State(CLASSES), |o| o.class.map(f64::from);
        /// Whether it is or will be in the vehicle's path.
        InPath: 59 | 2, YES_NO, |o| o.in_path.and_then(yes);
        /// Whether it moves over ground.
        Moving: 61 | 2, Coding::State(MOVING), |o| o.moving.map(f64::from);
    }
}

/// Where the values of a message come from.
#[derive(Clone, Copy, Debug)]
pub enum Content {
    /// The status.
    Status,
    /// The path.
    Path,
    /// The own motion.
    Own,
    /// The nearest obstacle in the path, with these signals.
    Nearest(&'static [Signal<Object>]),
    /// The obstacle of this place, the nearest at 0, with these signals.
    Object(usize, &'static [Signal<Object>]),
}

/// One message.
#[derive(Clone, Debug)]
pub struct Message {
    /// Its name, without [`MESSAGE_PREFIX`]; the prefix of its signals, too.
    pub name: String,
    /// Its identifier after the first one.
    pub offset: u32,
    /// Description, for the DBC file.
    pub text: String,
    /// Where its values come from.
    pub content: Content,
}

impl Message {
    /// Its data id for the checksum.
    pub fn data_id(&self) -> u16 {
        FIRST_DATA_ID + self.offset as u16
    }
}

/// The messages with `objects` obstacles, at most [`MAX_OBJECTS`], in the order in which they are sent.
pub fn messages(objects: usize) -> Vec<Message> {
    let message = |name: &str, offset, text: &str, content| Message {
        name: name.into(),
        offset,
        text: text.into(),
        content,
    };
    let mut messages = vec![
        message(
            "Status",
            0,
            "Alarm, its reasons, health and age of the data. If it does not come, nothing is known.",
            Content::Status,
        ),
        message(
            "Nearest",
            1,
            "Nearest obstacle in the path: place and motion. Not available while the alarm is off.",
            Content::Nearest(OBJECT),
        ),
        message("NearestShape", 2, "Nearest obstacle in the path: what it is.", Content::Nearest(SHAPE)),
        message("Path", 3, "Path ahead, as it is estimated. No request to follow it.", Content::Path),
        message("Own", 4, "The vehicle's own motion, as it is estimated. No request.", Content::Own),
    ];
    for place in 0..objects.min(MAX_OBJECTS) {
        let (number, offset) = (place + 1, FIRST_OBJECT + 2 * place as u32);
        messages.push(message(
            &format!("Object{number}"),
            offset,
            &format!("Obstacle {number}, the nearest first: place and motion."),
            Content::Object(place, OBJECT),
        ));
        messages.push(message(
            &format!("Object{number}Shape"),
            offset + 1,
            &format!("Obstacle {number}: what it is."),
            Content::Object(place, SHAPE),
        ));
    }
    messages
}

/// The identifiers of the messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Identifiers {
    /// The first one.
    pub base: u32,
    /// Whether they have 29 bits; else 11.
    pub is_extended: bool,
    /// Number of obstacles.
    pub objects: usize,
}

/// Whether one of [`ID_COUNT`] identifiers from `base` on belongs to diagnostics or is too large: 0x7df to 0x7ef, and
/// 0x18da0000 to 0x18dbffff (ISO 15765-4), whose receivers act on requests.
pub fn is_diagnostic(base: u32, is_extended: bool) -> bool {
    let last = base.saturating_add(ID_COUNT - 1);
    let (from, to, max) =
        if is_extended { (0x18da_0000, 0x18db_ffff, 0x1fff_ffff) } else { (0x7df, 0x7ef, 0x7ff) };
    last > max || (base <= to && last >= from)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Asserts that signals lie in a frame behind its head, one after the other, with names of their own.
    fn check<T>(table: &[Signal<T>]) {
        let mut end = HEAD[1].start + HEAD[1].length;
        for signal in table {
            let name = signal.name;
            assert!(signal.start >= end && (1..=16).contains(&signal.length), "{name}");
            end = signal.start + signal.length;
            if let Coding::State(names) = signal.coding {
                assert!((names.len() as u64) < 1 << signal.length, "{name}: no place for not available");
            }
            assert!(signal.text.ends_with('.') && signal.text.is_ascii(), "{name}");
            assert!(table.iter().filter(|other| other.name == name).count() == 1, "{name}");
        }
        assert!(end <= 64);
    }

    #[test]
    fn signals_do_not_overlap() {
        check(STATUS);
        check(PATH);
        check(OWN);
        check(OBJECT);
        check(SHAPE);
        assert_eq!(HEAD.iter().map(|s| (s.start, s.length)).collect::<Vec<_>>(), [(0, 8), (8, 4)]);
    }

    #[test]
    fn each_message_has_an_identifier_of_its_own() {
        let all = messages(MAX_OBJECTS);
        assert_eq!((all.len(), messages(0).len(), messages(99).len()), (21, 5, 21));
        for (i, message) in all.iter().enumerate() {
            assert!(message.offset < ID_COUNT);
            assert!(all[..i].iter().all(|m| m.offset < message.offset && m.name != message.name));
        }
    }

    #[test]
    fn nothing_is_named_like_a_request_to_the_vehicle() {
        let mut names: Vec<String> = messages(MAX_OBJECTS).into_iter().map(|m| m.name).collect();
        names.extend(STATUS.iter().map(|s| s.name.into()));
        names.extend(PATH.iter().map(|s| s.name.into()));
        names.extend(OWN.iter().map(|s| s.name.into()));
        names.extend(OBJECT.iter().chain(SHAPE).map(|s| s.name.into()));
        for word in ["brake", "decel", "accel", "torque", "steer", "request", "command", "target", "set"] {
            assert!(names.iter().all(|name| !name.to_lowercase().contains(word)), "{word}");
        }
        assert!(MESSAGE_PREFIX.contains("Info"));
    }

    #[test]
    fn each_bit_of_a_failed_self_check_has_its_signal() {
        for (bit, name) in FAULTS.iter().enumerate() {
            let status = Status { faults: 1 << bit, ..Status::default() };
            let set: Vec<&str> = STATUS
                .iter()
                .filter(|s| s.name.starts_with("Fault") && s.raw(Some(&status)) == 1)
                .map(|s| s.name)
                .collect();
            assert_eq!(set, [format!("Fault{name}")]);
        }
        let unknown = Status { faults: 1 << 31, ..Status::default() };
        let other = STATUS.iter().find(|s| s.name == "FaultOther").unwrap();
        assert_eq!(other.raw(Some(&unknown)), 1);
    }

    #[test]
    fn identifiers_of_diagnostics_are_recognised() {
        for (base, is_extended, expected) in [
            (DEFAULT_BASE_ID, false, false),
            (0x7bf, false, false),
            (0x7c0, false, true),
            (0x7ef, false, true),
            (0x7f0, false, true),
            (0x18da_0000 - ID_COUNT, true, false),
            (0x18da_0000 - 1, true, true),
            (0x18db_ffff, true, true),
            (0x18dc_0000, true, false),
            (0x1fff_ffe0, true, false),
            (0x1fff_ffe1, true, true),
            (u32::MAX, true, true),
        ] {
            assert_eq!(is_diagnostic(base, is_extended), expected, "{base:#x}");
        }
    }
}
