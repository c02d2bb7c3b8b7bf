//! Camera devices, their formats, and those that the configuration names.

use super::finding::{Finding, entries, text};
use config::Config;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

const AREA: &str = "cameras";

/// Sizes of a format that are told.
const MAX_TOLD_SIZES: usize = 8;

pub fn findings(root: &Path, config: &Config) -> Vec<Finding> {
    let devices = entries(root, "dev", "video");
    let is_wanted = config.source.kind == "camera";
    let mut all: Vec<Finding> =
        devices.iter().filter_map(|device| of_device(root, device, is_wanted)).collect();
    if devices.is_empty() {
        all.push(none(is_wanted));
    }
    if is_wanted && config.camera.backend == "v4l2" {
        all.extend(configured(config));
    }
    if cfg!(not(feature = "gstreamer")) {
        let remedy = "for CSI cameras build with --features gstreamer: docs/cameras.md";
        all.push(Finding::note(AREA, "this build reads USB cameras (V4L2), no GStreamer pipelines", remedy));
    }
    all
}

fn none(is_wanted: bool) -> Finding {
    let text = "there is no /dev/video*";
    let remedy =
        "plug in two USB cameras and look at dmesg; without cameras use lookout replay or lookout demo";
    if is_wanted { Finding::problem(AREA, text, remedy) } else { Finding::note(AREA, text, remedy) }
}

/// A device with its name that stays the same when the machine starts again.
fn of_device(root: &Path, device: &Path, is_wanted: bool) -> Option<Finding> {
    let file = device.file_name()?.to_string_lossy().into_owned();
    let name = text(root, &format!("sys/class/video4linux/{file}/name")).unwrap_or_else(|| "camera".into());
    let stable = stable_name(root, device).map_or_else(String::new, |path| format!(", {}", path.display()));
    let what = format!("{} ({name}{stable})", device.display());
    match formats(device) {
        // The second device of a camera, for its metadata.
        Ok(formats) if formats.is_empty() => None,
        Ok(formats) => Some(of_formats(&what, &formats)),
        Err(error) if error.kind() == ErrorKind::PermissionDenied => {
            let remedy =
                "add this user to the device's group, then log in again: sudo usermod -a -G video \"$USER\"";
            let text = format!("{what}: this user may not open it");
            Some(if is_wanted {
                Finding::problem(AREA, text, remedy)
            } else {
                Finding::note(AREA, text, remedy)
            })
        }
        Err(error) if error.kind() == ErrorKind::ResourceBusy => {
            let remedy = "another program has it: sudo fuser -v /dev/video* names it (a running daemon does)";
            Some(Finding::note(AREA, format!("{what}: in use"), remedy))
        }
        Err(error) if error.kind() == ErrorKind::Unsupported => {
            let remedy = "build with --features v4l2, or use a GStreamer pipeline: docs/cameras.md";
            Some(Finding::note(AREA, format!("{what}: {error}"), remedy))
        }
        Err(error) => {
            let remedy = "unplug it and plug it in again, and look at dmesg";
            Some(Finding::note(AREA, format!("{what}: {error}"), remedy))
        }
    }
}

/// A format of a device: its name, whether it can be read, its sizes.
type Format = (String, bool, Vec<String>);

#[cfg(feature = "v4l2")]
fn formats(device: &Path) -> std::io::Result<Vec<Format>> {
    let formats = sources::camera::device_formats::device_formats(device)?;
    Ok(formats.into_iter().map(|format| (format.name, format.is_supported, format.sizes)).collect())
}

#[cfg(not(feature = "v4l2"))]
fn formats(_: &Path) -> std::io::Result<Vec<Format>> {
    Err(std::io::Error::new(ErrorKind::Unsupported, "this build has no V4L2 (--features v4l2)"))
}

fn of_formats(what: &str, formats: &[Format]) -> Finding {
    let usable: Vec<String> = formats
        .iter()
        .filter(|(_, is_supported, _)| *is_supported)
        .map(|(name, _, sizes)| {
            let told: Vec<&str> = sizes.iter().take(MAX_TOLD_SIZES).map(String::as_str).collect();
            let more = if sizes.len() > told.len() { " …" } else { "" };
            format!("{name} {}{more}", told.join(" "))
        })
        .collect();
    if usable.is_empty() {
        let has: Vec<&str> = formats.iter().map(|(name, ..)| &name[..]).collect();
        let remedy =
            "it cannot be read directly: use a GStreamer pipeline that converts it (docs/cameras.md)";
        return Finding::note(AREA, format!("{what}: only {}", has.join(", ")), remedy);
    }
    Finding::good(AREA, format!("{what}: {}", usable.join("; ")))
}

/// The link in `/dev/v4l/by-path` that leads to a device.
fn stable_name(root: &Path, device: &Path) -> Option<PathBuf> {
    let target = device.file_name()?;
    let links = std::fs::read_dir(root.join("dev/v4l/by-path")).ok()?.flatten();
    let mut found: Vec<PathBuf> = links
        .map(|link| link.path())
        .filter(|link| std::fs::read_link(link).is_ok_and(|to| to.file_name() == Some(target)))
        .collect();
    found.sort();
    found.into_iter().next()
}

/// The devices that the configuration names.
fn configured(config: &Config) -> Vec<Finding> {
    let camera = &config.camera;
    let used = if camera.side_by_side { 1 } else { 2 };
    let named = [("camera.left", &camera.left), ("camera.right", &camera.right)];
    let absent = named.into_iter().take(used).filter(|(_, path)| !path.exists());
    let mut all: Vec<Finding> = absent
        .map(|(key, path)| {
            let text = format!("{key} = \"{}\" is not there", path.display());
            Finding::problem(AREA, text, "plug it in, or name a device that is listed above")
        })
        .collect();
    if used == 2 && camera.left == camera.right {
        let text = "camera.left and camera.right are the same device";
        let remedy = "name two; one device that delivers both images needs camera.side_by_side = true";
        all.push(Finding::problem(AREA, text, remedy));
    }
    all
}

#[cfg(test)]
mod tests {
    use super::super::finding::Level;
    use super::*;

    #[test]
    fn formats_that_cannot_be_read_are_named() {
        let usable = [("YUYV".to_owned(), true, vec!["640x480".to_owned()]), ("H264".into(), false, vec![])];
        let found = of_formats("/dev/video0 (a)", &usable);
        assert!(found.level == Level::Good && found.text.ends_with("YUYV 640x480"), "{found}");
        let found = of_formats("/dev/video0 (a)", &usable[1..]);
        assert!(found.level == Level::Note && found.text.contains("only H264"), "{found}");
    }

    #[test]
    fn missing_cameras_are_a_problem_only_where_they_are_configured() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("dev")).unwrap();
        let mut config = Config::default();
        let first = |config: &Config| findings(folder.path(), config).remove(0);
        assert_eq!(first(&config).level, Level::Note);
        config.source.kind = "camera".into();
        config.camera.left = folder.path().join("dev/video7");
        config.camera.right = config.camera.left.clone();
        let all = findings(folder.path(), &config);
        let problems: Vec<&str> =
            all.iter().filter(|f| f.level == Level::Problem).map(|f| &f.text[..]).collect();
        assert_eq!(problems.len(), 4, "{problems:?}");
        assert!(problems[1].contains("camera.left") && problems[3].contains("the same device"));
    }

    #[test]
    fn a_device_has_the_name_that_stays() {
        let folder = tempfile::tempdir().unwrap();
        let links = folder.path().join("dev/v4l/by-path");
        std::fs::create_dir_all(&links).unwrap();
        std::os::unix::fs::symlink("../../video2", links.join("usb-1-video-index0")).unwrap();
        let of = |device: &str| stable_name(folder.path(), &folder.path().join(device));
        assert_eq!(of("dev/video2"), Some(links.join("usb-1-video-index0")));
        assert_eq!(of("dev/video0"), None);
    }
}
