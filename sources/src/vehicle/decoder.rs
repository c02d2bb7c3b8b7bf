//! The configured signals, and how frames become values.

use super::dbc::Dbc;
use super::error::VehicleError;
use super::frame::{Frame, FrameId};
use super::quantity::Quantity;
use super::signal::Signal;
use super::state::{BusState, Purpose, gear_number};
use perception::excerpt::{VALUE_CHARS, excerpt};
use perception::motion::vehicle::Gear;
use std::path::PathBuf;

/// Values in one list: more than any gear lever or stalk has.
const MAX_VALUES: usize = 64;

/// The signals as they are configured. A signal is `Message.Signal` of the DBC file, or
/// `id:start|length@order sign (factor,offset) [min|max] unit`; empty where there is none.
#[derive(Clone, Debug, PartialEq)]
pub struct BusSettings {
    /// The DBC file; may be empty.
    pub dbc: PathBuf,
    /// Speed.
    pub speed_signal: String,
    /// Yaw rate.
    pub yaw_rate_signal: String,
    /// Angle of the steering wheel.
    pub steering_angle_signal: String,
    /// Brake. On where it is not 0, or one of the values after `=`.
    pub brake_signal: String,
    /// Left indicator, likewise.
    pub turn_left_signal: String,
    /// Right indicator, likewise.
    pub turn_right_signal: String,
    /// Gear.
    pub gear_signal: String,
    /// Values of `gear_signal` for park, separated by commas.
    pub gear_park: String,
    /// Values for reverse.
    pub gear_reverse: String,
    /// Values for neutral. All other values are forward gears.
    pub gear_neutral: String,
    /// What the speed is multiplied by.
    pub speed_factor: f64,
    /// Whether the yaw rate of the bus is positive to the right.
    pub yaw_rate_is_right: bool,
    /// Whether the steering angle of the bus is positive to the right.
    pub steering_is_right: bool,
}

impl Default for BusSettings {
    fn default() -> Self {
        Self {
            dbc: PathBuf::new(),
            speed_signal: String::new(),
            yaw_rate_signal: String::new(),
            steering_angle_signal: String::new(),
            brake_signal: String::new(),
            turn_left_signal: String::new(),
            turn_right_signal: String::new(),
            gear_signal: String::new(),
            gear_park: String::new(),
            gear_reverse: String::new(),
            gear_neutral: String::new(),
            speed_factor: 1.0,
            yaw_rate_is_right: false,
            steering_is_right: false,
        }
    }
}

/// What is made of a decoded value.
#[derive(Clone, Debug, PartialEq)]
enum Meaning {
    /// A quantity: multiplied by `scale`, at most `max`.
    Number { scale: f64, max: f64 },
    /// Whether it is one of these; if there are none, whether it is not 0.
    OneOf(Vec<f64>),
    /// A gear: values of park, reverse and neutral.
    Gear([Vec<f64>; 3]),
}

/// A configured signal.
#[derive(Clone, Debug, PartialEq)]
struct Input {
    key: &'static str,
    purpose: Purpose,
    signal: Signal,
    meaning: Meaning,
}

/// Turns frames into values.
#[derive(Clone, Debug, PartialEq)]
pub struct Decoder {
    inputs: Vec<Input>,
}

/// A value that was out of range, or a frame too short for it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Refused {
    /// Configuration key of the signal, without its table.
    pub key: &'static str,
    /// The value as the bus gave it, in the signal's unit; `None` if the frame was too short.
    pub value: Option<f64>,
}

impl Decoder {
    /// Finds the configured signals.
    ///
    /// # Errors
    /// Names the key, the DBC file with its line, and the remedy.
    pub fn new(settings: &BusSettings) -> Result<Self, VehicleError> {
        let s = settings;
        let dbc = if s.dbc.as_os_str().is_empty() { None } else { Some(Dbc::read(&s.dbc)?) };
        let mut inputs = Vec::new();
        let sign = |is_right: bool| if is_right { -1.0 } else { 1.0 };
        for (key, text, purpose, quantity, factor) in [
            ("speed_signal", &s.speed_signal, Purpose::Speed, Quantity::Speed, s.speed_factor),
            (
                "yaw_rate_signal",
                &s.yaw_rate_signal,
                Purpose::YawRate,
                Quantity::YawRate,
                sign(s.yaw_rate_is_right),
            ),
            (
                "steering_angle_signal",
                &s.steering_angle_signal,
                Purpose::SteeringAngle,
                Quantity::Angle,
                sign(s.steering_is_right),
            ),
        ] {
            let Some(signal) = find(key, text, dbc.as_ref())? else { continue };
            let scale = quantity.scale(&signal.unit).ok_or_else(|| {
                let unit = excerpt(&signal.unit, VALUE_CHARS);
                let reason = format!(
                    "its unit is \"{unit}\", known are {}: correct the DBC file, or give the signal as \
                     id:start|length@order sign (factor,offset) unit",
                    quantity.names()
                );
                fault(key, text, reason)
            })?;
            let meaning = Meaning::Number { scale: scale * factor, max: quantity.max() };
            inputs.push(Input { key, purpose, signal, meaning });
        }
        for (key, text, purpose) in [
            ("brake_signal", &s.brake_signal, Purpose::Brake),
            ("turn_left_signal", &s.turn_left_signal, Purpose::TurnLeft),
            ("turn_right_signal", &s.turn_right_signal, Purpose::TurnRight),
        ] {
            let (name, list) = text.rsplit_once('=').unwrap_or((text, ""));
            let Some(signal) = find(key, name, dbc.as_ref())? else { continue };
            if text.contains('=') && list.trim().is_empty() {
                return Err(fault(key, text, "no values after =: give for example =1,2".into()));
            }
            let meaning = Meaning::OneOf(values(list).map_err(|reason| fault(key, text, reason))?);
            inputs.push(Input { key, purpose, signal, meaning });
        }
        if let Some(signal) = find("gear_signal", &s.gear_signal, dbc.as_ref())? {
            let list = |key, text: &String| values(text).map_err(|reason| fault(key, text, reason));
            let gears = [
                list("gear_park", &s.gear_park)?,
                list("gear_reverse", &s.gear_reverse)?,
                list("gear_neutral", &s.gear_neutral)?,
            ];
            inputs.push(Input {
                key: "gear_signal",
                purpose: Purpose::Gear,
                signal,
                meaning: Meaning::Gear(gears),
            });
        }
        Ok(Self { inputs })
    }

    /// Whether no signal is configured.
    pub fn is_empty(&self) -> bool {
        self.inputs.is_empty()
    }

    /// Identifiers of the frames that it needs, each once.
    pub fn ids(&self) -> Vec<FrameId> {
        let mut ids: Vec<FrameId> = self.inputs.iter().map(|input| input.signal.id).collect();
        ids.sort_unstable();
        ids.dedup();
        ids
    }

    /// The state of its signals before the first frame; the bus is not open.
    pub fn state(&self) -> BusState {
        let of = |purpose: Purpose| self.inputs.iter().find(|input| input.purpose == purpose);
        BusState::new(
            |purpose| of(purpose).is_some(),
            of(Purpose::Speed).is_some_and(|speed| speed.signal.is_unsigned()),
        )
    }

    /// Takes the values of a frame that was received at `time_ns`. Returns the first that was out of range.
    pub fn decode(&self, frame: &Frame, time_ns: u64, state: &mut BusState) -> Option<Refused> {
        let mut refused = None;
        for input in self.inputs.iter().filter(|input| input.signal.id == frame.id) {
            let decoded = input.signal.decode(frame.data());
            let value = decoded
                .filter(|&value| input.signal.is_valid(value))
                .and_then(|value| input.meaning.of(value));
            state.set(input.purpose, value, time_ns);
            if value.is_none() {
                refused = refused.or(Some(Refused { key: input.key, value: decoded }));
            }
        }
        refused
    }
}

impl Meaning {
    fn of(&self, value: f64) -> Option<f64> {
        let is_one = |list: &[f64]| list.contains(&value);
        match self {
            Self::Number { scale, max } => Some(value * scale).filter(|value| value.abs() <= *max),
            Self::OneOf(list) => {
                Some(f64::from(u8::from(if list.is_empty() { value != 0.0 } else { is_one(list) })))
            }
            Self::Gear([park, reverse, neutral]) => Some(gear_number(match value {
                _ if is_one(park) => Gear::Park,
                _ if is_one(reverse) => Gear::Reverse,
                _ if is_one(neutral) => Gear::Neutral,
                _ => Gear::Forward,
            })),
        }
    }
}

fn fault(key: &'static str, text: &str, reason: String) -> VehicleError {
    VehicleError::Signal { key, value: excerpt(text, VALUE_CHARS).into_owned(), reason }
}

/// The signal that a key names; `None` if it is empty.
fn find(key: &'static str, text: &str, dbc: Option<&Dbc>) -> Result<Option<Signal>, VehicleError> {
    if text.trim().is_empty() {
        return Ok(None);
    }
    let signal = if text.contains('|') {
        Signal::parse(text)
    } else {
        let value = excerpt(text, VALUE_CHARS).into_owned();
        dbc.ok_or(VehicleError::NoDbc { key, value })?.signal(text)
    };
    signal.map(Some).map_err(|reason| fault(key, text, reason))
}

/// Numbers separated by commas.
fn values(text: &str) -> Result<Vec<f64>, String> {
    let words = || text.split(',').map(str::trim).filter(|word| !word.is_empty());
    if words().count() > MAX_VALUES {
        return Err(format!("more than {MAX_VALUES} values"));
    }
    words()
        .map(|word| {
            let value = word.parse().ok().filter(|v: &f64| v.is_finite());
            value.ok_or_else(|| {
                format!("\"{}\" is not a number: give values separated by commas", excerpt(word, VALUE_CHARS))
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use perception::motion::vehicle::TurnIndicator;

    const MS: u64 = 1_000_000;

    fn settings() -> BusSettings {
        BusSettings {
            speed_signal: "0x100:0|16@1+ (0.01,0) [0|400] km/h".into(),
            yaw_rate_signal: "0x101:7|16@0- (0.01,0) deg/s".into(),
            steering_angle_signal: "0x101:16|16@1- (0.1,0) deg".into(),
            brake_signal: "0x102:0|1@1+ (1,0)".into(),
            turn_left_signal: "0x102:8|2@1+ (1,0)=1,3".into(),
            turn_right_signal: "0x102:8|2@1+ (1,0)=2,3".into(),
            gear_signal: "0x102:16|4@1+ (1,0)".into(),
            gear_park: "1".into(),
            gear_reverse: "2".into(),
            gear_neutral: "3, 15".into(),
            ..BusSettings::default()
        }
    }

    fn near(value: Option<f64>, expected: f64) -> bool {
        value.is_some_and(|value| (value - expected).abs() < 1e-9)
    }

    #[test]
    fn frames_become_values() {
        let decoder = Decoder::new(&settings()).unwrap();
        assert_eq!(decoder.ids().iter().map(|id| id.number).collect::<Vec<_>>(), [0x100, 0x101, 0x102]);
        let mut state = decoder.state();
        let nothing = state.reading(0, 500 * MS);
        assert!(nothing.faults.no_bus && nothing.faults.missing && !nothing.faults.stale);
        state.opened();
        // 72 km/h; 18 °/s to the left; −90°.
        assert_eq!(
            decoder.decode(&Frame::new(0x100, false, &7200_u16.to_le_bytes()), 1000 * MS, &mut state),
            None
        );
        let [high, low] = 1800_i16.to_be_bytes();
        let [first, second] = (-900_i16).to_le_bytes();
        decoder.decode(&Frame::new(0x101, false, &[high, low, first, second]), 1010 * MS, &mut state);
        decoder.decode(&Frame::new(0x102, false, &[1, 3, 4]), 1020 * MS, &mut state);
        // The same number, extended, is another message.
        decoder.decode(&Frame::new(0x100, true, &[0, 0]), 1020 * MS, &mut state);
        let reading = state.reading(1040 * MS, 500 * MS);
        assert_eq!(reading.faults, Default::default());
        let sample = reading.sample;
        assert!(
            near(sample.speed_m_s.map(|v| v.value), 20.0) && near(sample.speed_m_s.map(|v| v.age_s), 0.04)
        );
        assert!(near(sample.yaw_rate_rad_s.map(|v| v.value), 0.1 * std::f64::consts::PI));
        assert!(near(sample.steering_angle_rad, -std::f64::consts::FRAC_PI_2));
        assert_eq!((sample.is_braking, sample.turn_indicator), (Some(true), Some(TurnIndicator::Both)));
        assert_eq!(sample.gear, Some(Gear::Forward));
        for (data, turn, gear, speed) in [
            ([0, 1, 2], TurnIndicator::Left, Gear::Reverse, -20.0),
            ([0, 2, 3], TurnIndicator::Right, Gear::Neutral, 20.0),
            ([0, 0, 1], TurnIndicator::Off, Gear::Park, 20.0),
            ([0, 0, 15], TurnIndicator::Off, Gear::Neutral, 20.0),
        ] {
            decoder.decode(&Frame::new(0x102, false, &data), 1020 * MS, &mut state);
            let sample = state.reading(1040 * MS, 500 * MS).sample;
            assert_eq!(
                (sample.is_braking, sample.turn_indicator, sample.gear),
                (Some(false), Some(turn), Some(gear))
            );
            assert!(near(sample.speed_m_s.map(|v| v.value), speed), "the gear gives the sign");
        }
        // An image that was exposed before the frame was received.
        let before = state.reading(990 * MS, 500 * MS).sample;
        assert!(near(before.speed_m_s.map(|v| v.age_s), -0.01));
    }

    #[test]
    fn stale_and_invalid_values_are_told() {
        let decoder = Decoder::new(&settings()).unwrap();
        let mut state = decoder.state();
        state.opened();
        for (id, data) in [(0x100, [0x20, 0x1c, 0, 0]), (0x101, [0; 4]), (0x102, [0; 4])] {
            decoder.decode(&Frame::new(id, false, &data), 1000 * MS, &mut state);
        }
        assert_eq!(state.reading(1500 * MS, 500 * MS).faults, Default::default());
        decoder.decode(&Frame::new(0x102, false, &[0; 3]), 1400 * MS, &mut state);
        let stale = state.reading(1501 * MS, 500 * MS);
        assert!(stale.faults.stale && !stale.faults.no_bus && stale.sample.speed_m_s.is_none());
        assert!(stale.sample.gear.is_some());
        assert!(state.reading(9000 * MS, 500 * MS).faults.no_bus, "nothing comes from the bus");
        // 0xffff is 655.35 km/h, beyond the range of the signal.
        let refused =
            decoder.decode(&Frame::new(0x100, false, &[0xff, 0xff]), 2000 * MS, &mut state).unwrap();
        assert!(refused.key == "speed_signal" && near(refused.value, 655.35));
        let reading = state.reading(2010 * MS, 500 * MS);
        assert!(reading.faults.out_of_range && reading.sample.speed_m_s.is_none());
        // Without a range in the notation the physical one holds: −327 °/s is not driven.
        let refused = decoder.decode(&Frame::new(0x101, false, &[0x80, 0, 0, 0]), 2000 * MS, &mut state);
        assert_eq!(refused.map(|r| r.key), Some("yaw_rate_signal"));
        let short = decoder.decode(&Frame::new(0x100, false, &[1]), 2000 * MS, &mut state).unwrap();
        assert_eq!(short.value, None, "a frame that is too short");
        state.closed();
        assert!(state.reading(2010 * MS, 500 * MS).faults.no_bus);
        let empty = Decoder::new(&BusSettings::default()).unwrap();
        assert!(empty.is_empty());
        assert_eq!(empty.state().reading(5, 1), Default::default(), "nothing is configured");
    }

    #[test]
    fn signs_and_factors_are_applied() {
        let turned = BusSettings {
            yaw_rate_is_right: true,
            steering_is_right: true,
            speed_factor: 1.02,
            speed_signal: "0x100:0|16@1- (0.01,0) m/s".into(),
            ..settings()
        };
        let decoder = Decoder::new(&turned).unwrap();
        let mut state = decoder.state();
        decoder.decode(&Frame::new(0x100, false, &(-300_i16).to_le_bytes()), 0, &mut state);
        decoder.decode(&Frame::new(0x101, false, &[0, 100, 10, 0]), 0, &mut state);
        decoder.decode(&Frame::new(0x102, false, &[0, 0, 2]), 0, &mut state);
        let sample = state.reading(0, 500 * MS).sample;
        // A signed speed keeps its sign in reverse.
        assert!(near(sample.speed_m_s.map(|v| v.value), -3.06));
        assert!(near(sample.yaw_rate_rad_s.map(|v| v.value), -1.0_f64.to_radians()));
        assert!(near(sample.steering_angle_rad, -1.0_f64.to_radians()));
    }

    #[test]
    fn faults_name_the_key() {
        let with = |change: fn(&mut BusSettings)| {
            let mut changed = settings();
            change(&mut changed);
            Decoder::new(&changed).unwrap_err().to_string()
        };
        for (error, expected) in [
            (
                with(|s| s.speed_signal = "Motion.Speed".into()),
                "vehicle.speed_signal = \"Motion.Speed\": names a signal of a DBC file, but vehicle.dbc is empty",
            ),
            (
                with(|s| s.speed_signal = "1:0|8@1+ (1,0) furlong".into()),
                "its unit is \"furlong\", known are m/s, km/h, mph",
            ),
            (
                with(|s| s.yaw_rate_signal = "1:0|8@1+ (1,0)".into()),
                "vehicle.yaw_rate_signal = \"1:0|8@1+ (1,0)\": its unit is \"\", known are rad/s, deg/s",
            ),
            (
                with(|s| s.brake_signal = "1:0|8@1+ (1,0)=on".into()),
                "vehicle.brake_signal = \"1:0|8@1+ (1,0)=on\": \"on\" is not a number",
            ),
            (with(|s| s.brake_signal = "1:0|8@1+ (1,0)=".into()), "no values after ="),
            (with(|s| s.gear_reverse = "R".into()), "vehicle.gear_reverse = \"R\": \"R\" is not a number"),
            (with(|s| s.dbc = "/nowhere/car.dbc".into()), "vehicle.dbc: /nowhere/car.dbc: "),
        ] {
            assert!(error.contains(expected), "{error}");
        }
    }

    #[test]
    fn random_frames_never_panic_and_stay_in_range() {
        let decoder = Decoder::new(&settings()).unwrap();
        let mut state = decoder.state();
        let mut random = fastrand::Rng::with_seed(4);
        for _ in 0..20_000 {
            let data: Vec<u8> = (0..random.usize(0..70)).map(|_| random.u8(..)).collect();
            decoder.decode(
                &Frame::new(random.u32(0x100..0x104), random.bool(), &data),
                random.u64(..),
                &mut state,
            );
            let sample = state.reading(random.u64(..), u64::MAX).sample;
            assert!(sample.speed_m_s.is_none_or(|v| v.value.abs() <= 120.0));
            assert!(sample.yaw_rate_rad_s.is_none_or(|v| v.value.abs() <= 4.0));
            assert!(sample.steering_angle_rad.is_none_or(|v| v.abs() <= 19.0));
        }
    }
}
