//! The camera source and its settings from the configuration.

use super::error::InputError;
use crate::stages::whole_number::whole;
use config::Config;
use sources::camera::connection::ConnectionParameters;
use sources::camera::exposure::ExposureParameters;
use sources::camera::{CameraSource, Exposure, ExposureMode, Opener, Settings};

/// The camera source. The cameras are opened by the first wait for a pair.
///
/// # Errors
/// If this build lacks the backend, or the configuration names no device.
pub fn source(config: &Config) -> Result<CameraSource, InputError> {
    check_two_cameras(config)?;
    let settings = settings(config);
    Ok(CameraSource::new(opener(config)?, settings, messages::clock::monotonic_ns))
}

/// Checks that the devices are named, and that left and right are not one, by whatever names.
///
/// # Errors
/// If they are not named, or are one.
pub fn check_two_cameras(config: &Config) -> Result<(), InputError> {
    let c = &config.camera;
    if c.left.as_os_str().is_empty() || (!c.side_by_side && c.right.as_os_str().is_empty()) {
        return Err(InputError::NoCamera);
    }
    // Two pipelines may have the same text.
    if c.side_by_side || c.backend != "v4l2" || sources::check_two_files(&c.left, &c.right).is_ok() {
        return Ok(());
    }
    Err(InputError::OneCamera { left: c.left.clone(), right: c.right.clone() })
}

fn settings(config: &Config) -> Settings {
    let c = &config.camera;
    let ns = |ms: i64| whole::<u64>(ms) * 1_000_000;
    let (time_us, gain) = (whole(c.exposure_us), whole(c.gain));
    Settings {
        size: (whole(c.width), whole(c.height)),
        period_ns: (1e9 / c.fps) as u64,
        side_by_side: c.side_by_side,
        skew_ns: (c.skew_ms * 1e6) as u64,
        connection: ConnectionParameters {
            silence_ns: ns(c.silence_ms),
            retry_initial_ns: ns(c.retry_first_ms),
            retry_max_ns: ns(c.retry_longest_ms),
        },
        exposure: match c.exposure.as_str() {
            "fixed" => ExposureMode::Once(Exposure::Fixed { time_us, gain }),
            "matched" => {
                ExposureMode::Matched(ExposureParameters { max_exposure_us: time_us, max_gain: gain })
            }
            _ => ExposureMode::Once(Exposure::Automatic),
        },
    }
}

/// The devices to open: left and right, or only the left if it delivers both images side by side.
#[cfg(any(feature = "v4l2", feature = "gstreamer"))]
fn devices(config: &Config) -> Vec<String> {
    let c = &config.camera;
    let both = [&c.left, &c.right].map(|path| path.display().to_string());
    both.into_iter().take(if c.side_by_side { 1 } else { 2 }).collect()
}

fn opener(config: &Config) -> Result<Box<dyn Opener>, InputError> {
    match config.camera.backend.as_str() {
        #[cfg(feature = "v4l2")]
        "v4l2" => Ok(Box::new(sources::camera::v4l2::V4l2Opener {
            devices: devices(config),
            rate_hz: config.camera.fps,
            format: config.camera.format.clone(),
            clock: messages::clock::monotonic_ns,
        })),
        #[cfg(feature = "gstreamer")]
        "gstreamer" => Ok(Box::new(sources::camera::gstreamer::GstOpener { pipelines: devices(config) })),
        other => Err(InputError::NoBackend(other.to_owned())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn settings_follow_the_configuration() {
        let text = "[source]\nkind = \"camera\"\n[camera]\nwidth = 320\nheight = 240\nfps = 20\nskew_ms = 2.5\n\
                    exposure = \"matched\"\nexposure_us = 4000\ngain = 8\n";
        let config = config::parse(text, Path::new("car.toml")).unwrap();
        let settings = settings(&config);
        assert_eq!(
            (settings.size, settings.period_ns, settings.skew_ns),
            ((320, 240), 50_000_000, 2_500_000)
        );
        let matched = ExposureParameters { max_exposure_us: 4000, max_gain: 8 };
        assert_eq!(settings.exposure, ExposureMode::Matched(matched));
        let wide = "[camera]\nskew_ms = 30\n";
        let error = config::parse(wide, Path::new("car.toml")).unwrap_err().to_string();
        assert!(error.contains("camera.skew_ms = 30 is too high"), "{error}");
        let none = config::parse("[camera]\nright = \"\"\n", Path::new("car.toml")).unwrap();
        assert!(matches!(source(&none), Err(InputError::NoCamera)));
        let one = Config::default();
        let mut one =
            Config { camera: config::Camera { right: one.camera.left.clone(), ..one.camera }, ..one };
        assert!(matches!(source(&one), Err(InputError::OneCamera { .. })));
        one.camera.side_by_side = true;
        assert!(!matches!(source(&one), Err(InputError::OneCamera { .. })));
        let elsewhere = config::parse("[camera]\nbackend = \"gstreamer\"\n", Path::new("car.toml")).unwrap();
        let error = source(&elsewhere).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(cfg!(feature = "gstreamer") || error.contains("--features gstreamer"), "{error}");
    }
}
