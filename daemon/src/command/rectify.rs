//! `lookout rectify`.

use crate::command::console::say;
use crate::command::disparity::read_pair;
use crate::command::error::CommandError;
use clap::Args;
use perception::image::GreyView;
use perception::rectify::Remap;
use sources::calibration_file;
use sources::rig_file::RigFile;
use std::path::PathBuf;
use tools::calibration::report::before_and_after;
use tools::reporting::picture::save_grey;

/// Text below the options of `--help`.
pub const HELP: &str = "Example:
  lookout rectify rig.toml left.png right.png -o rectified

Writes left.png and right.png, rectified, and lines.png: both images before (above) and after
rectification, with horizontal lines to check the row alignment.";

#[derive(Args, Debug)]
pub struct Rectify {
    /// Rig file with both lenses, as lookout calibrate writes it
    pub rig: PathBuf,
    /// Left image, not rectified
    pub left: PathBuf,
    /// Right image, not rectified
    pub right: PathBuf,
    /// Output folder
    #[arg(short, long, value_name = "DIR")]
    pub out: PathBuf,
}

pub fn run(args: &Rectify) -> Result<(), CommandError> {
    let (left, right, width, height) = read_pair(&args.left, &args.right)?;
    let rig = RigFile::read(&args.rig).map_err(|error| {
        let hint = if calibration_file::open_for(&args.rig, true, (width, height)).is_ok() {
            "; it is a calibration in another format: lookout rig FILE --format toml -o rig.toml converts one with lenses"
        } else {
            ""
        };
        CommandError::Other(format!("{error}{hint}"))
    })?;
    let (w, h) = rig.size();
    if (w, h) != (width, height) {
        return Err(CommandError::Other(format!(
            "{} is {width}x{height}, but {} was calibrated at {w}x{h}: give images of that size",
            args.left.display(),
            args.rig.display()
        )));
    }
    let before = [GreyView::new(&left, width, height, width)?, GreyView::new(&right, width, height, width)?];
    let mut after = Vec::new();
    for (side, view) in before.into_iter().enumerate() {
        let remap = Remap::rectifying(&rig.cameras, &rig.rectification, side);
        after.push(remap.applied(view).map_err(|e| CommandError::Other(e.to_string()))?);
    }
    let out = &args.out;
    std::fs::create_dir_all(out).map_err(|e| CommandError::Other(format!("{}: {e}", out.display())))?;
    for (name, image) in ["left.png", "right.png"].iter().zip(&after) {
        save_grey(&out.join(name), image.as_slice(), width, height)?;
    }
    before_and_after(&rig, before, [after[0].view(), after[1].view()]).save(&out.join("lines.png"))?;
    let r = &rig.rectification;
    let [x, y, w, h] = r.valid;
    say(format_args!(
        "{}: left.png, right.png, lines.png; both cameras see {w}x{h} pixels from ({x}, {y}); \
         distance in m = {:.4} / disparity in px",
        out.display(),
        r.rig.focal_px * r.rig.baseline_m
    ))
}
