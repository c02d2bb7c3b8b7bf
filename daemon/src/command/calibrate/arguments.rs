//! The arguments of `lookout calibrate`.

use crate::command::board::BoardArgs;
use crate::command::config_args::ConfigArgs;
use clap::{Args, ValueEnum};
use perception::calibration::rectification::MAX_FIELD_OF_VIEW_DEG;
use perception::calibration::{Crop, Lens};
use std::path::PathBuf;

/// The three ways to call it, of which the parser would show one.
pub const USAGE: &str =
    "lookout calibrate <DIR> --board <COLSxROWS> --square-mm <S> --out <RIG.toml> [OPTIONS]
       lookout calibrate [DIR] --live --board <COLSxROWS> --square-mm <S> --out <RIG.toml> [OPTIONS]
       lookout calibrate --from-drive <RECORDING> --out <RIG.toml> [OPTIONS]";

/// Text below the options of `--help`.
pub const HELP: &str = "Examples:
  lookout calibrate pictures --board 9x6 --square-mm 24.23 -o rig.toml
  lookout calibrate pictures --board 9x6 --square-mm 24.23 -o rig.toml --report report
  lookout calibrate pictures --board 8x5 --square-mm 30 -o rig.toml --lens radial3 --json
  lookout calibrate pictures --pattern charuco --board 10x7 --square-mm 22 --marker-mm 16.5 \\
      --dictionary 5x5_100 --lens fisheye -o rig.toml
  lookout calibrate pictures --pattern aprilgrid --board 6x6 --square-mm 88 --tag-spacing 0.3 -o rig.toml
  lookout calibrate --live --board 9x6 --square-mm 24.23 -o rig.toml        from the running daemon
  lookout calibrate --live camera -c car.toml --board 9x6 --square-mm 24.23 -o rig.toml
  lookout calibrate --from-drive RECORDING --rig rig.toml -o rig-now.toml

DIR contains two folders, left and right, with pictures of the same names (PNG, JPEG, TIFF, BMP, WebP,
PGM, PPM), or files such as left1.png and right1.png. --board counts inner corners, where four squares meet: a
board of 10 x 7 squares has 9x6. Take 10 to 30 pairs with the whole board in both pictures: near and
far, in the middle, at edges and in corners, tilted by 20 to 45 degrees to all sides. Hold the board
still, or put it on a support. Of a ChArUco board or an AprilGrid a part in each picture is enough.
lookout board makes boards to print.

--live selects pairs automatically: it keeps a pair when the board is at rest in a new position,
reports which views are still missing, and ends when the calibration would be graded good (or with
Ctrl-C, or after 40 pairs). The daemon must publish unrectified pairs: source.rectify = false.

--from-drive turns the right camera of a calibration (pitch, yaw and roll, up to about 0.5 degrees) so
that it fits to what the cameras see in a recorded drive, without a board: half a minute through a
street with texture, past things near and far. The recording has the pictures as the cameras took
them. Baseline, lenses and places of the cameras are kept: a drive does not tell them. Where the
recording has the vehicle's speed, it is compared with the speed that the cameras see.

The calibration is graded good, usable or redo, with reasons. The rig file is written atomically. If
the grade is redo it is not written, an existing file is kept, and the exit code is 1.";

#[derive(Args, Debug)]
pub struct Calibrate {
    /// Folder of the pictures; with --live: a recording, FILE.mcap, scene:NAME, or "camera" for the
    /// cameras of the configuration [default: the running daemon]
    #[arg(required_unless_present_any = ["live", "from_drive"], conflicts_with = "from_drive")]
    pub dir: Option<PathBuf>,
    /// Select pairs from a live source, keeping those with new views of the board
    #[arg(long)]
    pub live: bool,
    /// With --live: folder for the selected pictures [default: RIG.pictures]
    #[arg(long, value_name = "DIR", requires = "live")]
    pub pictures: Option<PathBuf>,
    /// Turn the right camera of a calibration by what this drive shows: a folder, FILE.mcap or
    /// scene:NAME
    #[arg(long, value_name = "RECORDING", conflicts_with_all = ["live", "report", "board", "square_mm", "cross_validate"])]
    pub from_drive: Option<PathBuf>,
    /// With --from-drive: the calibration to begin with [default: that beside the recording]
    #[arg(long, value_name = "FILE", requires = "from_drive")]
    pub rig: Option<PathBuf>,
    /// With --from-drive: use this many pairs at most [default: all; 600 of an endless scene]
    #[arg(long, value_name = "N", requires = "from_drive", value_parser = clap::value_parser!(u64).range(1..))]
    pub limit: Option<u64>,
    #[command(flatten)]
    pub config: ConfigArgs,
    #[command(flatten)]
    pub board: Option<BoardArgs>,
    /// Output: rig file
    #[arg(short, long, value_name = "RIG.toml")]
    pub out: PathBuf,
    /// Folder for an HTML report with residuals, coverage and a rectified pair; projection.csv has its maps of the
    /// uncertainty of projection, corners.vnl the corners for other programs (mrcal)
    #[arg(long, value_name = "DIR")]
    pub report: Option<PathBuf>,
    /// Distortion model: radial2 has k1 k2 p1 p2; radial3 adds k3; rational adds k3 to k6 (wide angle,
    /// needs many views); fisheye has k1 to k4 of the equidistant model (up to about 160 degrees)
    #[arg(long, value_enum, default_value_t = LensChoice::Radial2)]
    pub lens: LensChoice,
    #[command(flatten)]
    pub crop: CropArgs,
    /// The cameras expose at the same moment, by a common trigger: the board does not move between the pictures
    /// of a pair. Without this its motion is estimated, which costs some certainty
    #[arg(long, conflicts_with_all = ["from_drive", "live", "cross_validate"])]
    pub simultaneous: bool,
    /// Also solve with all pairs, without rejecting inconsistent ones, and cross-validate: calibrate on
    /// one half of the views, evaluate on the other
    #[arg(long)]
    pub cross_validate: bool,
    /// Name of the stereo camera in the rig file [default: "rig" and the time]
    #[arg(long, value_name = "TEXT")]
    pub serial: Option<String>,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum LensChoice {
    Radial2,
    Radial3,
    Rational,
    Fisheye,
}

impl From<LensChoice> for Lens {
    fn from(choice: LensChoice) -> Self {
        match choice {
            LensChoice::Radial2 => Self::Radial2,
            LensChoice::Radial3 => Self::Radial3,
            LensChoice::Rational => Self::Rational,
            LensChoice::Fisheye => Self::Fisheye,
        }
    }
}

/// What rectified images show.
#[derive(Args, Clone, Copy, Debug)]
pub struct CropArgs {
    /// Field of view of the rectified images
    ///
    /// valid shows only what both cameras see (100 degrees at most), full shows every pixel (140 degrees at
    /// most), same keeps the scale of the cameras.
    #[arg(long, value_enum, default_value_t = CropChoice::Valid)]
    pub crop: CropChoice,
    /// Horizontal field of view of the rectified images, in degrees, in place of --crop: for wide-angle
    /// lenses
    #[arg(long, value_name = "DEGREES", value_parser = degrees, conflicts_with = "crop")]
    pub fov: Option<f64>,
}

impl From<CropArgs> for Crop {
    fn from(args: CropArgs) -> Self {
        args.fov.map_or(args.crop.into(), Self::FieldOfView)
    }
}

fn degrees(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (10.0..=MAX_FIELD_OF_VIEW_DEG).contains(&value) => Ok(value),
        _ => Err(format!("give the horizontal field of view in degrees, 10 to {MAX_FIELD_OF_VIEW_DEG}")),
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum CropChoice {
    Valid,
    Full,
    Same,
}

impl From<CropChoice> for Crop {
    fn from(choice: CropChoice) -> Self {
        match choice {
            CropChoice::Valid => Self::Valid,
            CropChoice::Full => Self::Full,
            CropChoice::Same => Self::Same,
        }
    }
}

/// Width and height of a picture in px, as in `640x480`.
///
/// # Errors
/// Describes the format.
pub fn picture_size(text: &str) -> Result<(usize, usize), String> {
    pair(text).map_err(|_| "give width and height in pixels, for example 640x480".into())
}

/// Two whole numbers, as in `9x6`.
///
/// # Errors
/// Describes the format.
pub fn pair(text: &str) -> Result<(usize, usize), String> {
    let both = text.split_once(['x', 'X']).and_then(|(a, b)| Some((a.parse().ok()?, b.parse().ok()?)));
    both.ok_or_else(|| "give two whole numbers, for example 9x6".into())
}
