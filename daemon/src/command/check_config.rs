//! `lookout check-config`.

use crate::command::console::say;
use crate::command::error::CommandError;
use crate::stages::recognition::detectors::detectors;
use crate::{can_out, input};
use clap::Args;
use config::Config;
use sources::folder::FolderSource;
use sources::scene::Scene;
use sources::video::{VideoFiles, VideoSource};
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
    // Files that the configuration names have to exist and be valid, too: all that are not are told at once.
    let wrong: Vec<String> = wrong_files(&config)
        .into_iter()
        .map(|(key, text)| config::place(args.file.as_deref(), key) + &text)
        .collect();
    if !wrong.is_empty() {
        return Err(CommandError::Lines(wrong.join("\n")));
    }
    for (key, path) in absent_cameras(&config) {
        let place = config::place(args.file.as_deref(), key);
        // No error: the file may be for another machine.
        eprintln!("lookout: note: {place}{key}: there is no {} on this machine now", path.display());
    }
    let text = toml::to_string(&config).map_err(|e| CommandError::Other(e.to_string()))?;
    say(format_args!("# The effective configuration. No errors.\n{text}"))
}

/// The key and the error of each file that is missing or not valid.
fn wrong_files(config: &Config) -> Vec<(&'static str, String)> {
    let mut wrong = Vec::new();
    if let Err(error) = detectors(config, 8, 8) {
        wrong.push((error.key(), error.to_string()));
    }
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
    let source = &config.source;
    if !source.rig.as_os_str().is_empty()
        && let Err(error) = sources::calibration_file::read(&source.rig, true)
    {
        wrong.push(("source.rig", format!("source.rig: {error}")));
    }
    if let Some(path) = input::vehicle::named_motion(config).filter(|path| !path.exists()) {
        let path = path.display();
        let text = format!(
            "vehicle.motion: {path}: there is no such file: give motion.csv, poses or OXTS, or \"none\""
        );
        wrong.push(("vehicle.motion", text));
    }
    wrong.extend(wrong_source(config));
    wrong
}

/// The same for the source.
fn wrong_source(config: &Config) -> Vec<(&'static str, String)> {
    let source = &config.source;
    let is_recorded = ["folder", "recording"].contains(&&source.kind[..]);
    if is_recorded && let Some(videos) = VideoFiles::named(&source.path, &source.left, &source.right) {
        let key = if matches!(videos, VideoFiles::Two(..)) { "source.left" } else { "source.path" };
        return VideoSource::open(&videos).err().map(|e| (key, format!("{key}: {e}"))).into_iter().collect();
    }
    if is_recorded && input::has_patterns(config) {
        let opened = input::folder_options(config)
            .and_then(|options| Ok(FolderSource::open_with(&source.path, &options)?));
        return opened.err().into_iter().map(|error| pattern_error(config, &error.to_string())).collect();
    }
    if is_recorded && !source.path.exists() {
        let path = source.path.display();
        let text = format!(
            "source.path = \"{path}\": there is no such file or folder: name the pictures or the recording"
        );
        return vec![("source.path", text)];
    }
    if source.kind == "scene"
        && !source.path.as_os_str().is_empty()
        && let Err(error) = Scene::open(&source.path.to_string_lossy())
    {
        return vec![("source.path", format!("source.path: {error}"))];
    }
    Vec::new()
}

/// An error of pictures that are named by patterns, with the key of the pattern that it names.
fn pattern_error(config: &Config, text: &str) -> (&'static str, String) {
    let right = config.source.right.display().to_string();
    let key = if !right.is_empty() && text.contains(&right) { "source.right" } else { "source.left" };
    (key, format!("{key}: {text}"))
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
