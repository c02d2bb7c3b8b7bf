//! What the vehicle reports of its motion: files beside a recording, and the settings of the bus.

use super::error::InputError;
use crate::stages::whole_number::whole;
use config::Config;
use sources::PairSource;
use sources::motion_file::{MOTION_CSV, MotionSource};
use sources::vehicle::{BusSettings, Decoder, VehicleError};
use std::path::{Path, PathBuf};

/// Value of `vehicle.motion` that leaves out what a recording has.
const NONE: &str = "none";

/// Time from a value to a frame up to which it is used, in seconds.
pub fn stale_s(config: &Config) -> f64 {
    config.vehicle.stale_ms as f64 * 1e-3
}

/// The same in nanoseconds.
pub fn stale_ns(config: &Config) -> u64 {
    whole::<u64>(config.vehicle.stale_ms) * 1_000_000
}

/// The source with the motion that the configuration names. `first_time_s` is the time of the first pair on the clock of
/// the file.
///
/// # Errors
/// If the file cannot be read.
pub fn with_motion(
    config: &Config,
    source: Box<dyn PairSource>,
    first_time_s: f64,
) -> Result<Box<dyn PairSource>, InputError> {
    let named = &config.vehicle.motion;
    if named.as_os_str() == NONE {
        return Ok(Box::new(MotionSource::silent(source)));
    }
    let Some(path) = motion_path(config) else { return Ok(source) };
    if config.source.kind == "camera" {
        return Err(InputError::MotionOfCameras(named.display().to_string()));
    }
    Ok(Box::new(MotionSource::new(source, &path, first_time_s, stale_s(config))?))
}

/// The file that is read: the named one, or the `motion.csv` of a folder.
fn motion_path(config: &Config) -> Option<PathBuf> {
    let (source, named) = (&config.source, &config.vehicle.motion);
    let folder = if source.path.is_dir() { Some(source.path.as_path()) } else { source.path.parent() };
    if named.as_os_str().is_empty() {
        return folder
            .filter(|_| source.kind == "folder")
            .map(|f| f.join(MOTION_CSV))
            .filter(|path| path.is_file());
    }
    // A path from the root replaces the folder.
    Some(folder.unwrap_or(Path::new("")).join(named))
}

/// The file of motion that the configuration names, if it names one.
pub fn named_motion(config: &Config) -> Option<PathBuf> {
    let named = config.vehicle.motion.as_os_str();
    if named.is_empty() || named == NONE { None } else { motion_path(config) }
}

/// The configured signals of the bus; `None` without `vehicle.bus`.
///
/// # Errors
/// Names the key, the DBC file with its line, and the remedy.
pub fn decoder(config: &Config) -> Result<Option<Decoder>, VehicleError> {
    let decoder = Decoder::new(&settings(config))?;
    let bus = &config.vehicle.bus;
    if bus.is_empty() {
        return Ok(None);
    }
    if decoder.is_empty() {
        return Err(VehicleError::NoSignals { bus: bus.clone() });
    }
    if cfg!(not(feature = "can")) {
        return Err(VehicleError::NoCan { bus: bus.clone() });
    }
    Ok(Some(decoder))
}

fn settings(config: &Config) -> BusSettings {
    let v = &config.vehicle;
    BusSettings {
        dbc: v.dbc.clone(),
        speed_signal: v.speed_signal.clone(),
        yaw_rate_signal: v.yaw_rate_signal.clone(),
        steering_angle_signal: v.steering_angle_signal.clone(),
        brake_signal: v.brake_signal.clone(),
        turn_left_signal: v.turn_left_signal.clone(),
        turn_right_signal: v.turn_right_signal.clone(),
        gear_signal: v.gear_signal.clone(),
        gear_park: v.gear_park.clone(),
        gear_reverse: v.gear_reverse.clone(),
        gear_neutral: v.gear_neutral.clone(),
        speed_factor: v.speed_factor,
        yaw_rate_is_right: v.yaw_rate_positive == "right",
        steering_is_right: v.steering_angle_positive == "right",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(text: &str) -> Config {
        config::parse(text, Path::new("car.toml")).unwrap()
    }

    #[test]
    fn only_what_the_vehicle_reported_is_used_unnamed() {
        let folder = tempfile::tempdir().unwrap();
        let path = |motion: &str| {
            let mut config = config("[source]\nkind = \"folder\"\n");
            config.source.path = folder.path().to_owned();
            config.vehicle.motion = motion.into();
            motion_path(&config)
        };
        for truth in ["poses.txt", "oxts.csv"] {
            std::fs::write(folder.path().join(truth), "").unwrap();
        }
        assert_eq!(path(""), None);
        assert_eq!(path("poses.txt"), Some(folder.path().join("poses.txt")));
        assert_eq!(path("/data/oxts.csv"), Some("/data/oxts.csv".into()));
        std::fs::write(folder.path().join("motion.csv"), "").unwrap();
        assert_eq!(path(""), Some(folder.path().join("motion.csv")));
    }

    #[test]
    fn the_bus_needs_signals_and_a_build_that_has_it() {
        assert_eq!(decoder(&config("")).unwrap(), None);
        // Signals without a bus are checked.
        let error = decoder(&config("[vehicle]\nspeed_signal = \"M.S\"\n")).unwrap_err().to_string();
        assert!(error.contains("vehicle.dbc is empty"), "{error}");
        let error = decoder(&config("[vehicle]\nbus = \"can0\"\n")).unwrap_err().to_string();
        assert!(error.contains("no signal is configured"), "{error}");
        let bus = "[vehicle]\nbus = \"can0\"\nspeed_signal = \"0x123:8|16@1+ (0.01,0) km/h\"\n";
        match decoder(&config(bus)) {
            Ok(decoder) => assert!(cfg!(feature = "can") && decoder.is_some()),
            Err(error) => assert!(error.to_string().contains("--features can"), "{error}"),
        }
    }
}
