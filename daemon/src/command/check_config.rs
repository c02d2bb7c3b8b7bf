//! `lookout check-config`.

use crate::command::console::say;
use crate::command::error::CommandError;
use crate::input::InputError;
use crate::stages::recognition::detectors::detectors;
use crate::stages::whole_number::whole;
use crate::{can_out, input};
use clap::Args;
use config::Config;
use perception::rig::Rig;
use sources::video::VideoFiles;
use sources::{PairSource, SourceError, calibration_file};
use std::path::PathBuf;

/// Text below the options of `--help`.
pub const HELP: &str = "Examples:
  lookout check-config car.toml
  lookout check-config rpi5
  lookout check-config --reference > docs/configuration.md";

#[derive(Args, Debug)]
pub struct CheckConfig {
    /// Configuration file or profile
    #[arg(required_unless_present = "reference")]
    pub file: Option<PathBuf>,
    /// Print the reference of all keys instead
    #[arg(long, conflicts_with = "file")]
    pub reference: bool,
}

pub fn run(args: &CheckConfig) -> Result<(), CommandError> {
    if args.reference {
        return say(config::reference().trim_end());
    }
    let config = config::load(args.file.as_deref())?;
    // What is doubtful of files that can be used.
    crate::logging::start("check-config", "warn");
    let place = |key: &str| config::place(args.file.as_deref(), key);
    // Files that the configuration names have to exist and be valid, too: all that are not are told at once.
    let (rig, wrong) = wrong(&config);
    let wrong: Vec<String> = wrong
        .into_iter()
        .map(|(key, text)| match place(key) {
            // The other camera is that of the profile or the default.
            none if none.is_empty() && key == "camera.right" => place("camera.left") + &text,
            place => place + &text,
        })
        .collect();
    if !wrong.is_empty() {
        return Err(CommandError::Lines(wrong.join("\n")));
    }
    let text = toml::to_string(&config).map_err(|e| CommandError::Other(e.to_string()))?;
    let lacks_rig = if has_rig(&config) { "" } else { " lookout run needs a rig, too: see the last note." };
    say(format_args!("# The effective configuration. No errors.{lacks_rig}\n{}", text.trim_end()))?;
    // Notes come last: the configuration is longer than a screen.
    for (key, path) in absent_cameras(&config) {
        // No error: the file may be for another machine.
        eprintln!("lookout: note: {}{key}: there is no {} on this machine now", place(key), path.display());
    }
    if !has_rig(&config) {
        eprintln!("lookout: note: {}", InputError::NoRigOfCameras);
    }
    if let Some(note) = rig.and_then(|rig| nearest_distance(&rig, config.stereo.disparities)) {
        eprintln!("lookout: note: {}stereo.disparities: {note}", place("stereo.disparities"));
    }
    Ok(())
}

/// The rig, if there is one, and the key and the error of each file that is missing, not valid, or does not fit.
pub fn wrong(config: &Config) -> (Option<Rig>, Vec<(&'static str, String)>) {
    let mut wrong = wrong_files(config);
    let (rig, wrong_source) = source_and_rig(config);
    wrong.extend(wrong_source);
    (rig, wrong)
}

/// Whether there is a rig for cameras, if the source is cameras; recordings may have their own.
pub fn has_rig(config: &Config) -> bool {
    config.source.kind != "camera" || !config.source.rig.as_os_str().is_empty()
}

/// The key and the error of each file beside the source and its rig that is missing or not valid.
fn wrong_files(config: &Config) -> Vec<(&'static str, String)> {
    let mut wrong = wrong_detectors(config);
    if let Err(error) = input::vehicle::decoder(config) {
        let text = error.to_string();
        let key = match text.split([':', ' ']).next() {
            Some("vehicle.bus") => "vehicle.bus",
            _ => "vehicle.dbc",
        };
        wrong.push((key, text));
    }
    if let Err(error) = can_out::identifiers(config) {
        wrong.push(("can_out.base_id", error.to_string()));
    }
    for (key, path, what) in [
        ("bridge.tls_ca", &config.bridge.tls_ca, "the certificates of the authority"),
        ("bridge.tls_certificate", &config.bridge.tls_certificate, "the certificate of this vehicle"),
        ("bridge.tls_key", &config.bridge.tls_key, "the key of its certificate"),
    ] {
        if !path.as_os_str().is_empty() && !path.is_file() {
            let path = path.display();
            wrong.push((
                key,
                format!("{key}: {path}: there is no such file: give {what} (PEM), or \"\" for none"),
            ));
        }
    }
    if let Some(path) = input::vehicle::named_motion(config).filter(|path| !path.exists()) {
        let path = path.display();
        let text = format!(
            "vehicle.motion: {path}: there is no such file: give motion.csv, poses or OXTS, or \"none\""
        );
        wrong.push(("vehicle.motion", text));
    }
    wrong
}

/// The same for the detectors, each alone.
fn wrong_detectors(config: &Config) -> Vec<(&'static str, String)> {
    let mut alone = config.clone();
    let others = std::mem::take(&mut alone.recognition.detectors);
    let mut wrong = Vec::new();
    let mut check = |config: &Config| {
        if let Err(error) = detectors(config, 8, 8) {
            wrong.push((error.key(), error.to_string()));
        }
    };
    let cascade = std::mem::take(&mut alone.recognition.cascade);
    check(&alone);
    alone.recognition.network = PathBuf::new();
    alone.recognition.cascade = cascade;
    check(&alone);
    alone.recognition.cascade = PathBuf::new();
    for detector in others {
        alone.recognition.detectors = vec![detector];
        check(&alone);
    }
    wrong
}

/// The rig, if there is one, and what is wrong with the source and the rig, and whether they fit.
fn source_and_rig(config: &Config) -> (Option<Rig>, Vec<(&'static str, String)>) {
    let mut wrong = Vec::new();
    let opened: Result<Box<dyn PairSource>, _> = if config.source.kind == "camera" {
        // The cameras themselves may be those of another machine.
        wrong.extend(input::check_two_cameras(config).err().map(|error| ("camera.right", error.to_string())));
        let (width, height) = (config.camera.width, config.camera.height);
        Ok(Box::new(AbsentCameras { size: (whole(width), whole(height)) }))
    } else {
        open(config)
    };
    let rig = match opened {
        Ok(opened) => rig_of(config, opened),
        Err(error) => {
            wrong.extend(unreadable_rig(config));
            wrong.push(error);
            return (None, wrong);
        }
    };
    match rig {
        Ok(rig) => (Some(rig), wrong),
        Err(error) => {
            wrong.extend(wrong_rig(config, &error));
            (None, wrong)
        }
    }
}

/// From where on obstacles should be matched, in metres: nearer ones are beside the bonnet.
const NEAREST_M: f64 = 3.0;

/// Largest value of `stereo.disparities`.
const MAX_DISPARITIES: f64 = 255.0;

/// What a rig with these disparities does not see near by: the wider its baseline and the longer its focal length, the more.
fn nearest_distance(rig: &Rig, disparities: i64) -> Option<String> {
    let nearest_m = rig.distance_m(disparities as f64);
    // What is printed as 3.0 m is near enough.
    if nearest_m < NEAREST_M + 0.05 {
        return None;
    }
    let needed = rig.disparity_px(NEAREST_M).ceil();
    let remedy = if needed > MAX_DISPARITIES {
        "smaller pictures (camera.width, camera.height) see nearer".to_owned()
    } else {
        let needed = (16.0 * (needed / 16.0).ceil()).min(MAX_DISPARITIES);
        format!("{needed} see from {NEAREST_M} m on, and take longer")
    };
    Some(format!(
        "nothing nearer than {nearest_m:.1} m is matched with {disparities} disparities and this rig: {remedy}"
    ))
}

/// The rig of the pictures of a source.
fn rig_of(config: &Config, source: Box<dyn PairSource>) -> Result<Rig, InputError> {
    input::rectified(config, source).and_then(|opened| input::rig(config, opened.as_ref()))
}

/// What `run` would refuse of the rig for the pictures of a source.
fn wrong_rig(config: &Config, error: &InputError) -> Option<(&'static str, String)> {
    let key = match error {
        // Told as a note: it can be named later.
        InputError::NoRigOfCameras => return None,
        InputError::Source(error) if !config.source.rig.as_os_str().is_empty() => {
            return Some(("source.rig", format!("source.rig: {error}")));
        }
        InputError::NoCameras | InputError::NoDistortion(_) | InputError::Distorted(_) => "source.rectify",
        _ => "source.rig",
    };
    Some((key, error.to_string()))
}

/// What is wrong with the named rig, whatever the size of the pictures, which is not known.
fn unreadable_rig(config: &Config) -> Option<(&'static str, String)> {
    /// For formats that do not always say the size.
    const ANY_SIZE: (usize, usize) = (640, 480);
    let rig = &config.source.rig;
    if rig.as_os_str().is_empty() || calibration_file::open_for(rig, true, ANY_SIZE).is_ok() {
        return None;
    }
    let error = calibration_file::open(rig, true).err()?;
    Some(("source.rig", format!("source.rig: {error}")))
}

/// Stands for cameras that are not asked for pictures.
struct AbsentCameras {
    size: (usize, usize),
}

impl PairSource for AbsentCameras {
    fn size(&self) -> (usize, usize) {
        self.size
    }

    fn rig(&self) -> Option<Rig> {
        None
    }

    fn count(&self) -> Option<u64> {
        None
    }

    fn period_ns(&self) -> u64 {
        1
    }

    fn read(&mut self, index: u64, _: &mut [u8], _: &mut [u8]) -> Result<(), SourceError> {
        Err(SourceError::End { index, count: 0 })
    }
}

/// Opens the source; if that fails, says with which key.
fn open(config: &Config) -> Result<Box<dyn PairSource>, (&'static str, String)> {
    let source = &config.source;
    let has_patterns = input::has_patterns(config);
    let is_named_by_pictures = has_patterns
        && (source.kind == "folder"
            || matches!(
                VideoFiles::named(&source.path, &source.left, &source.right),
                Some(VideoFiles::Two(..))
            ));
    if ["folder", "recording"].contains(&&source.kind[..])
        && !has_patterns
        && !source.path.as_os_str().is_empty()
        && !source.path.exists()
    {
        let path = source.path.display();
        let text = format!(
            "source.path = \"{path}\": there is no such file or folder: name the pictures or the recording"
        );
        return Err(("source.path", text));
    }
    input::open_raw(config).map(|(opened, _)| opened).map_err(|error| {
        let text = error.to_string();
        let names =
            |path: &PathBuf| !path.as_os_str().is_empty() && text.contains(&path.display().to_string());
        let key = match &error {
            InputError::NoPath => return ("source.path", text),
            InputError::OnePattern => return ("source.left", text),
            _ if is_named_by_pictures && names(&source.right) && !names(&source.left) => "source.right",
            _ if is_named_by_pictures => "source.left",
            _ => "source.path",
        };
        (key, format!("{key}: {text}"))
    })
}

/// Camera devices that the configuration names and that are not there.
fn absent_cameras(config: &Config) -> Vec<(&'static str, &PathBuf)> {
    let camera = &config.camera;
    let is_device = |path: &PathBuf| path.is_absolute() && !path.to_string_lossy().contains('!');
    let devices = [("camera.left", &camera.left), ("camera.right", &camera.right)];
    let used = if camera.side_by_side { 1 } else { 2 };
    let absent = devices.into_iter().take(used).filter(|(_, path)| is_device(path) && !path.exists());
    if config.source.kind == "camera" { absent.collect() } else { Vec::new() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rig_that_does_not_see_near_things_is_told() {
        let rig = |focal_px: f64| Rig { focal_px, baseline_m: 0.5, cx_px: 600.0, cy_px: 180.0 };
        let note = |focal_px: f64| nearest_distance(&rig(focal_px), 128);
        assert_eq!(note(700.0), None);
        assert_eq!(note(775.0), None, "3.03 m");
        let text = "nothing nearer than 4.1 m is matched with 128 disparities and this rig: 176 see from 3 m on, and take \
                    longer";
        assert_eq!(note(1056.0).as_deref(), Some(text));
        assert!(note(1500.0).is_some_and(|text| text.contains(": 255 see from 3 m on")));
        assert!(note(1540.0).is_some_and(|text| text.contains("smaller pictures")));
        assert_eq!(nearest_distance(&rig(1056.0), 176), None);
    }
}
