//! `lookout rig`: shows a calibration, or writes it in another format.

use crate::command::calibrate::{CropArgs, picture_size};
use crate::command::console::say;
use crate::command::error::CommandError;
use clap::{Args, ValueEnum};
use sources::calibration_file::{self, Calibration, plain_toml};
use sources::rig_file::{Format, export, import};
use std::path::PathBuf;

/// Text below the options of `--help`.
pub const HELP: &str = "Examples:
  lookout rig rig.toml
  lookout rig rig.toml --format ros -o left.yaml       writes left.yaml and right.yaml
  lookout rig extr.yml intr.yml --size 640x480 --format toml -o rig.toml";

#[derive(Args, Debug)]
pub struct RigCommand {
    /// Calibration: rig TOML, OpenCV YAML, Kalibr camchain, KITTI calib.txt; two files for ROS
    /// camera_info, left first
    #[arg(required = true, value_name = "FILE", num_args = 1..=2)]
    pub files: Vec<PathBuf>,
    /// Output file, in the format of --format
    #[arg(short, long, value_name = "FILE", requires = "format")]
    pub out: Option<PathBuf>,
    /// Output format
    #[arg(long, value_enum, requires = "out")]
    pub format: Option<FormatChoice>,
    /// Image size, for files that do not contain it
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = picture_size)]
    pub size: Option<(usize, usize)>,
    #[command(flatten)]
    pub crop: CropArgs,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum FormatChoice {
    Toml,
    Opencv,
    Ros,
    Kalibr,
    Kitti,
}

impl From<FormatChoice> for Format {
    fn from(choice: FormatChoice) -> Self {
        match choice {
            FormatChoice::Toml => Self::Toml,
            FormatChoice::Opencv => Self::Opencv,
            FormatChoice::Ros => Self::Ros,
            FormatChoice::Kalibr => Self::Kalibr,
            FormatChoice::Kitti => Self::Kitti,
        }
    }
}

/// Where a rig TOML of four numbers is shown, its text: it holds no cameras.
fn four_numbers(args: &RigCommand) -> Result<Option<String>, CommandError> {
    if let [first, second, ..] = &args.files[..]
        && let Some(toml) =
            [first, second].into_iter().find(|file| file.extension().is_some_and(|end| end == "toml"))
    {
        let text = "a rig file holds both cameras: give it alone, or the two files of the cameras";
        return Err(CommandError::Other(format!("{}: {text}", toml.display())));
    }
    let [file] = &args.files[..] else { return Ok(None) };
    if args.out.is_some() || file.extension().is_none_or(|ending| ending != "toml") {
        return Ok(None);
    }
    let found = match args.size {
        Some(size) => calibration_file::open_for(file, false, size)?,
        None => calibration_file::open(file, false)?,
    };
    Ok(match found {
        Calibration::Rectified { rig, size } => Some(plain_toml(&rig, size.or(args.size))),
        Calibration::Cameras(_) => None,
    })
}

pub fn run(args: &RigCommand) -> Result<(), CommandError> {
    if let Some(text) = four_numbers(args)? {
        return say(format_args!("# a pair that is rectified already\n{}", text.trim_end()));
    }
    let rig = import(&args.files, args.size, args.crop.into())?;
    if let (Some(out), Some(format)) = (&args.out, args.format) {
        for path in export(&rig, format.into(), out)? {
            say(path.display())?;
        }
        return Ok(());
    }
    say(rig.to_toml().map_err(CommandError::Other)?.trim_end())
}
