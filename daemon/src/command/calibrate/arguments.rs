//! The arguments of `lookout calibrate`.

use crate::command::config_args::ConfigArgs;
use clap::{Args, ValueEnum};
use perception::calibration::{Crop, Lens};
use std::path::PathBuf;

pub const HELP: &str = "Examples:
  lookout calibrate pictures --board 9x6 --square-mm 24.23 -o rig.toml
  lookout calibrate pictures --board 9x6 --square-mm 24.23 -o rig.toml --report report
  lookout calibrate pictures --board 8x5 --square-mm 30 -o rig.toml --lens radial3 --json
  lookout calibrate --live --board 9x6 --square-mm 24.23 -o rig.toml          the running daemon
  lookout calibrate --live camera -c car.toml --board 9x6 --square-mm 24.23 -o rig.toml

DIR holds two folders, left and right, with pictures of the same names (PNG, JPEG, PGM, PPM), or
files such as left1.png and right1.png. --board counts inner corners, where four squares meet: an
ordinary board of 10 x 7 squares has 9x6. Take 10 to 30 pairs with the whole board in both pictures:
near and far, in the middle, edges and corners, tilted by 20 to 45 degrees to all sides; hold it
still, or rest it.

--live looks at the pairs as they come, keeps one by itself when the board rests where it has not been,
says what is still missing, and ends when the verdict would be good (or with Ctrl-C, or 40 pairs). A
daemon must give pairs as the cameras took them: source.rectify = false.

The verdict is good, usable or redo, with reasons. The rig file is written, whole or not at all,
unless the verdict is redo: then what is there stays, and the exit code is 1.";

#[derive(Args, Debug)]
pub struct Calibrate {
    /// Folder of the pictures; with --live a recording, FILE.mcap, scene:NAME, or camera for the cameras
    /// of the configuration [default: the running daemon]
    #[arg(required_unless_present = "live")]
    pub dir: Option<PathBuf>,
    /// Takes pairs from what runs, and keeps those that show something new
    #[arg(long)]
    pub live: bool,
    /// With --live: folder for the pictures that are kept [default: RIG.pictures]
    #[arg(long, value_name = "DIR", requires = "live")]
    pub pictures: Option<PathBuf>,
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Inner corners of the board along both sides
    #[arg(long, value_name = "COLSxROWS", value_parser = pair)]
    pub board: (usize, usize),
    /// Side of a square, measured, in mm
    #[arg(long, value_name = "S", value_parser = millimetres)]
    pub square_mm: f64,
    /// Rig file
    #[arg(short, long, value_name = "RIG.toml")]
    pub out: PathBuf,
    /// Folder for a page with residuals, coverage and a rectified pair
    #[arg(long, value_name = "DIR")]
    pub report: Option<PathBuf>,
    /// Coefficients of the lenses: k1 k2 p1 p2; k3, too; or k3 to k6 (wide angle, many views)
    #[arg(long, value_enum, default_value_t = LensChoice::Radial2)]
    pub lens: LensChoice,
    /// What the rectified pictures show: what both cameras see, everything, or the same scale
    #[arg(long, value_enum, default_value_t = CropChoice::Valid)]
    pub crop: CropChoice,
    /// Also solve with all pairs, those that contradict the others too, and print what half of the
    /// views gives for the other half
    #[arg(long)]
    pub cross_validate: bool,
    /// Name of this pair of cameras in the rig file [default: rig and the time]
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
}

impl From<LensChoice> for Lens {
    fn from(choice: LensChoice) -> Self {
        match choice {
            LensChoice::Radial2 => Self::Radial2,
            LensChoice::Radial3 => Self::Radial3,
            LensChoice::Rational => Self::Rational,
        }
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

/// Two whole numbers.
///
/// # Errors
/// Says how to write them.
pub fn pair(text: &str) -> Result<(usize, usize), String> {
    let both = text.split_once(['x', 'X']).and_then(|(a, b)| Some((a.parse().ok()?, b.parse().ok()?)));
    both.ok_or_else(|| "give two whole numbers, as in 9x6".into())
}

fn millimetres(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (0.5..=2000.0).contains(&value) => Ok(value),
        _ => Err("give the measured side of a square in mm, 0.5 to 2000".into()),
    }
}
