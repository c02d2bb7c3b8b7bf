//! `lookout init`: writes a commented configuration from a few options.

use crate::command::calibrate::picture_size;
use crate::command::console::say;
use crate::command::error::CommandError;
use crate::command::number::{number, whole};
use clap::Args;
use config::keys::{self, Key};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::{ErrorKind, Write as _};
use std::path::{Path, PathBuf};
use toml::Value;

/// Text below the options of `--help`.
pub const HELP: &str = "Examples:
  lookout init --left /dev/video0 --right /dev/video2 --board rpi5 --rig rig.toml
  lookout init --left /dev/video0 --side-by-side --size 1280x720 --fps 30 -o front.toml
  lookout init --recording drive -o drive.toml

Every option stands in the file with its meaning, and so do the keys that are changed most, as comments
with their defaults. `lookout check-config --reference` lists all keys. Paths are relative to the file.";

#[derive(Args, Debug)]
pub struct Init {
    /// Left camera: a device (preferably by its name in /dev/v4l/by-path)
    #[arg(long, value_name = "DEVICE")]
    pub left: Option<PathBuf>,
    /// Right camera
    #[arg(long, value_name = "DEVICE", conflicts_with_all = ["side_by_side", "recording"])]
    pub right: Option<PathBuf>,
    /// The left camera delivers both images in one frame, side by side
    #[arg(long, requires = "left")]
    pub side_by_side: bool,
    /// A folder of pictures or an MCAP file, instead of cameras
    #[arg(long, value_name = "PATH", conflicts_with = "left")]
    pub recording: Option<PathBuf>,
    /// Size of one image
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = picture_size, conflicts_with = "recording")]
    pub size: Option<(usize, usize)>,
    /// Frames a second of the cameras, or of the recording; the profile of the board may take fewer of a camera's
    #[arg(long, value_name = "N", value_parser = fps)]
    pub fps: Option<f64>,
    /// Profile of the board
    #[arg(long, value_name = "NAME", default_value = "replay", value_parser = config::profile_names().collect::<Vec<_>>())]
    pub board: String,
    /// Rig file of the cameras; lookout calibrate writes it
    #[arg(long, value_name = "FILE")]
    pub rig: Option<PathBuf>,
    /// Name of the daemon instance
    #[arg(long, value_name = "NAME")]
    pub name: Option<String>,
    /// Disparities to search: nearer obstacles and longer focal lengths need more
    #[arg(long, value_name = "N", value_parser = whole::<u32>(2, 255))]
    pub disparities: Option<u32>,
    /// File to write
    #[arg(short, long, value_name = "FILE", default_value = "lookout.toml")]
    pub out: PathBuf,
    /// Overwrite the file
    #[arg(long)]
    pub force: bool,
}

fn fps(text: &str) -> Result<f64, String> {
    number(text, 0.5, 500.0)
}

/// Keys that the file shows as comments unless an option sets them.
const SHOWN: [&str; 21] = [
    "instance.name",
    "source.kind",
    "source.path",
    "source.rig",
    "source.rectify",
    "source.fps",
    "camera.left",
    "camera.right",
    "camera.side_by_side",
    "camera.width",
    "camera.height",
    "camera.fps",
    "camera.skew_ms",
    "vehicle.width_m",
    "vehicle.front_m",
    "stereo.disparities",
    "road.camera_height_min_m",
    "road.camera_height_max_m",
    "alarm.distance_m",
    "alarm.ttc_alarm_s",
    "alarm.path_width_m",
];

pub fn run(args: &Init) -> Result<(), CommandError> {
    let text = text(&args.board, &settings(args)?)?;
    // What is written has to be right: the values are checked like those of any file.
    let checked = config::parse(&text, &args.out)?;
    write(&args.out, &text, args.force)?;
    let (out, rig) = (args.out.display(), args.rig.is_none());
    say(format_args!("wrote {out}"))?;
    // No errors: the file may be for another machine, or come before what it names.
    let named = [("--recording", args.recording.as_deref()), ("--rig", args.rig.as_deref())];
    for (option, path) in named.into_iter().filter_map(|(option, path)| Some((option, path?))) {
        let beside = args.out.parent().unwrap_or(Path::new("")).join(path);
        if !path.exists() && !beside.exists() {
            eprintln!(
                "lookout: note: {option}: there is no {} now, neither here nor beside {out}: lookout run needs it",
                path.display()
            );
        }
    }
    let has_cameras = checked.source.kind == "camera";
    let (taken, delivered) = (checked.source.fps, checked.camera.fps);
    if has_cameras && args.fps.is_some() && taken > 0.0 && taken < delivered {
        eprintln!(
            "lookout: note: the cameras deliver {delivered} frames/s, {taken} are processed: source.fps of the profile {}; \
             {out} can set another",
            args.board
        );
    }
    if rig && has_cameras {
        say(format_args!(
            "next: calibrate the cameras: lookout calibrate --live camera -c {out} --board COLSxROWS --square-mm S -o rig.toml,\n\
             then set source.rig = \"rig.toml\" in {out}"
        ))?;
    }
    say(format_args!("next: lookout check-config {out}, then lookout run -c {out}"))
}

/// The values that the options set, by key.
fn settings(args: &Init) -> Result<BTreeMap<&'static str, Value>, CommandError> {
    let path = |path: &Path| Value::String(path.to_string_lossy().into_owned());
    let whole = |n: usize| Value::Integer(i64::try_from(n).unwrap_or(i64::MAX));
    let mut values = BTreeMap::new();
    match &args.recording {
        None if args.left.is_none() => {
            return Err(CommandError::Other(
                "no cameras and no recording: give --left and --right, --left and --side-by-side, or --recording (lookout \
                 init --help has examples)"
                    .into(),
            ));
        }
        Some(recording) => {
            let is_file = tools::evaluation::compare::is_recording(recording);
            values.insert("source.kind", if is_file { "recording" } else { "folder" }.into());
            values.insert("source.path", path(recording));
            args.fps.map(|fps| values.insert("source.fps", fps.into()));
        }
        None => {
            values.insert("source.kind", "camera".into());
            args.fps.map(|fps| values.insert("camera.fps", fps.into()));
        }
    }
    if let Some(left) = &args.left {
        values.insert("camera.left", path(left));
        match &args.right {
            Some(right) if sources::check_two_files(left, right).is_err() => {
                return Err(CommandError::Other(format!(
                    "--left {} and --right {} are one device: name the device of each camera, or give --side-by-side \
                     instead of --right if one device delivers both images",
                    left.display(),
                    right.display()
                )));
            }
            Some(right) => values.insert("camera.right", path(right)),
            None if args.side_by_side => values.insert("camera.side_by_side", true.into()),
            None => {
                return Err(CommandError::Other(
                    "--left names one camera: name the other with --right, or give --side-by-side if one device delivers \
                     both images"
                        .into(),
                ));
            }
        };
    }
    if let Some((width, height)) = args.size {
        values.insert("camera.width", whole(width));
        values.insert("camera.height", whole(height));
    }
    args.rig.as_ref().map(|rig| values.insert("source.rig", path(rig)));
    args.name.as_ref().map(|name| values.insert("instance.name", name.as_str().into()));
    args.disparities.map(|n| values.insert("stereo.disparities", i64::from(n).into()));
    Ok(values)
}

/// The text of the file.
fn text(board: &str, values: &BTreeMap<&'static str, Value>) -> Result<String, CommandError> {
    // What holds where the file says nothing: the values of the board's profile.
    let profile = config::load(Some(Path::new(board)))?;
    let profile = toml::Table::try_from(&profile).map_err(|error| CommandError::Other(error.to_string()))?;
    let mut out = format!(
        "# Configuration of lookout, written by lookout init. Keys that are left out come from the profile; a key after\n\
         # \"# \" shows its value in the profile: remove the \"# \" to change it. All keys: lookout check-config --reference.\n\n\
         profile = \"{board}\"\n"
    );
    for table in keys::tables() {
        let is_shown = |key: &&Key| {
            let path = key.path();
            SHOWN.contains(&&path[..]) || values.contains_key(&path[..])
        };
        let mut keys = table.keys.iter().filter(is_shown).peekable();
        if keys.peek().is_none() {
            continue;
        }
        // Writing to a string cannot fail.
        let _ = write!(out, "\n[{}]\n", table.name);
        for key in keys {
            let unit = if key.unit.is_empty() { String::new() } else { format!(" Unit: {}.", key.unit) };
            for line in wrapped(&format!("{}{unit}", key.text)) {
                let _ = writeln!(out, "# {line}");
            }
            let _ = match values.get(&key.path()[..]) {
                Some(value) => writeln!(out, "{} = {value}", key.name),
                None => {
                    let value = profile.get(table.name).and_then(|table| table.get(&key.name));
                    writeln!(out, "# {} = {}", key.name, value.unwrap_or(&key.default))
                }
            };
        }
    }
    Ok(out)
}

/// Lines of at most so many characters, unless a word is longer.
fn wrapped(text: &str) -> Vec<String> {
    /// Width of a comment.
    const MAX_CHARS: usize = 96;
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if line.chars().count() + 1 + word.chars().count() <= MAX_CHARS => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

fn write(path: &Path, text: &str, force: bool) -> Result<(), CommandError> {
    let mut options = std::fs::OpenOptions::new();
    options.write(true);
    if force {
        options.create(true).truncate(true)
    } else {
        options.create_new(true)
    };
    let written = options.open(path).and_then(|mut file| file.write_all(text.as_bytes()));
    written.map_err(|error| {
        CommandError::Other(match error.kind() {
            ErrorKind::AlreadyExists => {
                format!(
                    "{}: is there already: give another name with -o, or --force to overwrite it",
                    path.display()
                )
            }
            _ => format!(
                "{}: {error}: give a file in a folder that this user may write with -o",
                path.display()
            ),
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_shown_key_exists_and_the_file_says_what_the_options_say() {
        for name in SHOWN {
            assert!(keys::all().any(|key| key.path() == name), "{name}");
        }
        let values = BTreeMap::from([
            ("source.kind", Value::from("camera")),
            ("camera.left", "/dev/v4l/by-path/a\"b".into()),
            ("camera.fps", 25.0.into()),
            ("source.rig", "rig.toml".into()),
        ]);
        let file = Path::new("x.toml");
        for board in config::profile_names() {
            let text = text(board, &values).unwrap();
            let found = config::parse(&text, file).unwrap();
            assert_eq!((&found.source.kind[..], found.camera.fps), ("camera", 25.0));
            assert_eq!(found.camera.left, Path::new("/dev/v4l/by-path/a\"b"));
            assert!(
                text.contains(&format!("profile = \"{board}\"")) && text.contains("# distance_m = "),
                "{text}"
            );
            assert!(text.lines().all(|line| line.chars().count() <= 120), "{text}");
            // With the comment signs removed it is valid, too, and has the defaults.
            let is_key =
                |line: &str| line.split_once(" = ").is_some_and(|(name, _)| !name[2..].contains(' '));
            let shown: String = text
                .lines()
                .map(|line| if line.starts_with("# ") && is_key(line) { &line[2..] } else { line })
                .fold(String::new(), |all, line| all + line + "\n");
            assert!(shown.contains("\ndistance_m = "), "{shown}");
            let shown = config::parse(&shown, file).unwrap();
            // They are those of the profile, so that nothing changes.
            let profile = config::load(Some(Path::new(board))).unwrap();
            assert_eq!(shown.stereo.disparities, profile.stereo.disparities, "{board}");
            assert_eq!(shown.camera.width, profile.camera.width, "{board}");
            assert_eq!(shown.vehicle, profile.vehicle, "{board}");
        }
    }

    #[test]
    fn the_values_shown_are_those_of_the_boards_profile() {
        let of = |board: &str| text(board, &BTreeMap::new()).unwrap();
        let differs = |board: &str| {
            let config = config::load(Some(Path::new(board))).unwrap();
            assert!(
                of(board).contains(&format!("\n# disparities = {}\n", config.stereo.disparities)),
                "{board}"
            );
            config.stereo.disparities
        };
        let disparities: Vec<_> = config::profile_names().map(differs).collect();
        assert!(disparities.iter().any(|&n| n != disparities[0]), "{disparities:?}: the test shows nothing");
    }
}
