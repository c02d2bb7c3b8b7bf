//! Values to frames.

use super::checksum::{COUNTER_VALUES, checksum};
use super::layout::{Content, HEAD, Identifiers, Message, OWN, PATH, STATUS, messages};
use super::signal::Signal;
use super::values::{Cycle, Object};

/// A frame to be sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OutFrame {
    /// Its identifier.
    pub id: u32,
    /// Whether the identifier has 29 bits.
    pub is_extended: bool,
    /// Its data.
    pub data: [u8; 8],
    /// Its data id for the checksum, which is not sent.
    pub data_id: u16,
}

/// Makes the frames of each cycle.
#[derive(Clone, Debug)]
pub struct Encoder {
    identifiers: Identifiers,
    messages: Vec<Message>,
    counter: u8,
}

impl Encoder {
    /// An encoder whose alive counter begins at 0.
    pub fn new(identifiers: Identifiers) -> Self {
        Self { identifiers, messages: messages(identifiers.objects), counter: 0 }
    }

    /// Replaces `frames` by those of the next cycle.
    pub fn encode(&mut self, cycle: &Cycle, frames: &mut Vec<OutFrame>) {
        frames.clear();
        for message in &self.messages {
            let mut data = content(message.content, cycle);
            data[1] |= self.counter << (HEAD[1].start % 8);
            data[0] = checksum(&data, message.data_id());
            let Identifiers { base, is_extended, .. } = self.identifiers;
            frames.push(OutFrame {
                id: base + message.offset,
                is_extended,
                data,
                data_id: message.data_id(),
            });
        }
        self.counter = (self.counter + 1) % COUNTER_VALUES;
    }
}

/// The data of a message, without checksum and counter.
fn content(content: Content, cycle: &Cycle) -> [u8; 8] {
    match content {
        Content::Status => encoded(STATUS, Some(&cycle.status)),
        Content::Path => encoded(PATH, cycle.path.as_ref()),
        Content::Own => encoded(OWN, cycle.own.as_ref()),
        Content::Nearest(table) => encoded(table, cycle.nearest.as_ref()),
        Content::Object(place, table) => {
            let objects = cycle.objects.as_deref();
            let none = Object::default();
            encoded(table, objects.map(|objects| objects.get(place).unwrap_or(&none)))
        }
    }
}

fn encoded<T>(table: &[Signal<T>], of: Option<&T>) -> [u8; 8] {
    let mut data = [0; 8];
    for signal in table {
        signal.encode(of, &mut data);
    }
    data
}

#[cfg(test)]
mod tests {
    use super::super::checksum::is_intact;
    use super::super::layout::{DEFAULT_BASE_ID, MAX_OBJECTS};
    use super::super::values::{Existence, ResultValues, Values};
    use super::super::{DaemonState, Own, PathAhead};
    use super::*;

    const IDENTIFIERS: Identifiers =
        Identifiers { base: DEFAULT_BASE_ID, is_extended: false, objects: MAX_OBJECTS };

    fn object() -> Object {
        Object {
            existence: Existence::Predicted,
            track: 65_536 + 42,
            distance_m: Some(12.34),
            distance_sigma_m: Some(0.31),
            lateral_m: Some(-1.52),
            closing_m_s: Some(8.21),
            across_m_s: Some(-0.39),
            time_to_collision_s: Some(1.49),
            width_m: Some(1.81),
            height_m: Some(1.44),
            class: Some(1),
            in_path: Some(true),
            moving: Some(2),
        }
    }

    fn result() -> ResultValues {
        ResultValues {
            sequence: 300,
            capture_ns: 1_000_000_000,
            level: 3,
            rule: 2,
            is_road_seen: true,
            path: PathAhead {
                is_known: true,
                free_m: Some(10.64),
                curvature_per_m: Some(-0.0123),
                curvature_sigma_per_m: Some(0.0021),
                half_width_m: Some(0.9),
                objects: 2,
                objects_in_path: 1,
            },
            own: Own {
                is_known: true,
                is_standing: false,
                disagrees: true,
                speed_m_s: Some(13.91),
                speed_sigma_m_s: Some(0.12),
                yaw_rate_rad_s: Some(-0.1236),
                yaw_rate_sigma_rad_s: Some(0.0041),
            },
            nearest: Some(object()),
            objects: vec![Object { distance_m: Some(1e9), lateral_m: Some(-1e9), ..object() }, object()],
            ..ResultValues::default()
        }
    }

    /// Frames of three cycles: a fresh result, a stale one, and no daemon.
    fn frames() -> Vec<Vec<OutFrame>> {
        let mut encoder = Encoder::new(IDENTIFIERS);
        let fresh = Values {
            daemon: Some(DaemonState::Degraded),
            source: Some(1),
            result: Some(result()),
            withdrawn: 0,
        };
        let absent = Values { daemon: Some(DaemonState::NotRunning), ..Values::default() };
        [(&fresh, 1_123_400_000), (&fresh, 1_600_000_000), (&absent, 0)]
            .map(|(values, now_ns)| {
                let mut frames = Vec::new();
                encoder.encode(&values.cycle(now_ns, 500_000_000), &mut frames);
                frames
            })
            .into()
    }

    /// Signals of these frames as cantools 45.1 decodes them with config/can/lookout.dbc; `None`: not available.
    /// Written by tests/can/decode_values.py.
    type Expected = (usize, u32, [u8; 8], &'static [(&'static str, Option<f64>)]);
    const EXPECTED: &[Expected] = &include!("cantools_values.in");

    #[test]
    fn frames_decode_with_cantools_to_the_values_that_were_encoded() {
        let all = frames();
        for (cycle, id, data, signals) in EXPECTED {
            let frame = all[*cycle].iter().find(|f| f.id == *id).unwrap();
            assert_eq!(frame.data, *data, "cycle {cycle}, {id:#x}: run tests/can/decode_values.py");
            assert!(!signals.is_empty());
        }
        assert_eq!(EXPECTED.len(), 3 * 21);
        let decoded = |cycle: usize, name: &str| {
            let signals = EXPECTED.iter().filter(|e| e.0 == cycle).flat_map(|e| e.3);
            let found: Vec<_> = signals.filter(|(n, _)| *n == name).collect();
            assert_eq!(found.len(), 1, "{name}");
            found[0].1
        };
        for (name, value, step) in [
            ("Status_AlarmLevel", 3.0, 0.0),
            ("Status_AlarmRule", 2.0, 0.0),
            ("Status_DaemonState", 2.0, 0.0),
            ("Status_FaultStale", 0.0, 0.0),
            ("Status_Source", 1.0, 0.0),
            ("Status_Age", 123.4, 1.0),
            ("Status_FrameNumber", 44.0, 0.0),
            ("Path_FreeDistance", 10.64, 0.05),
            ("Path_Curvature", -0.0123, 0.0005),
            ("Path_HalfWidth", 0.9, 0.02),
            ("Path_Objects", 2.0, 0.0),
            ("Own_Speed", 13.91, 0.05),
            ("Own_YawRate", -0.1236, 0.001),
            ("Own_Disagree", 1.0, 0.0),
            ("Nearest_Distance", 12.34, 0.05),
            ("Nearest_Lateral", -1.52, 0.05),
            ("Nearest_ClosingSpeed", 8.21, 0.1),
            ("Nearest_TimeToCollision", 1.49, 0.05),
            ("Nearest_LateralSpeed", -0.39, 0.2),
            ("NearestShape_Track", 42.0, 0.0),
            ("NearestShape_Width", 1.81, 0.05),
            ("NearestShape_Class", 1.0, 0.0),
            ("NearestShape_Existence", 3.0, 0.0),
            ("NearestShape_InPath", 1.0, 0.0),
            ("Object1_Distance", 12.34, 0.05),
            // Beyond the range: its ends.
            ("Object2_Distance", 204.7, 1e-6),
            ("Object2_Lateral", -51.15, 1e-6),
            ("Object3Shape_Existence", 0.0, 0.0),
        ] {
            let got = decoded(0, name).unwrap();
            assert!((got - value).abs() <= step / 2.0 + 1e-9, "{name}: {got}, not {value}");
        }
        assert_eq!(decoded(0, "Object3_Distance"), None);
        for cycle in [1, 2] {
            for name in ["Nearest_Distance", "Path_FreeDistance", "Own_Known", "Object1Shape_Existence"] {
                assert_eq!(decoded(cycle, name), None, "{name}");
            }
            assert_eq!(decoded(cycle, "Status_AlarmLevel"), Some(0.0));
        }
        assert_eq!((decoded(1, "Status_Age"), decoded(2, "Status_Age")), (Some(600.0), None));
        assert_eq!(
            (decoded(1, "Status_FaultStale"), decoded(2, "Status_FaultStage")),
            (Some(1.0), Some(1.0))
        );
        assert_eq!(decoded(2, "Status_DaemonState"), Some(4.0));
    }

    #[test]
    fn print_the_frames_for_decode_values_py() {
        for (cycle, frames) in frames().iter().enumerate() {
            for frame in frames {
                let data: String = frame.data.iter().map(|byte| format!("{byte:02x}")).collect();
                println!("frame {cycle} {:x} {data}", frame.id);
            }
        }
    }

    #[test]
    fn all_frames_of_a_cycle_have_one_counter_and_their_own_checksum() {
        let mut encoder = Encoder::new(Identifiers { base: 0x1abc_de00, is_extended: true, objects: 3 });
        let cycle = Values::default().cycle(0, 1);
        let mut frames = Vec::new();
        for expected in (0..15).chain(0..15).chain(0..2) {
            encoder.encode(&cycle, &mut frames);
            assert_eq!(frames.len(), 5 + 2 * 3);
            for frame in &frames {
                assert_eq!(frame.data[1] & 0xf, expected);
                assert!(is_intact(&frame.data, frame.data_id) && frame.is_extended);
            }
        }
        assert_eq!((frames[0].id, frames[10].id), (0x1abc_de00, 0x1abc_de0d));
    }
}
