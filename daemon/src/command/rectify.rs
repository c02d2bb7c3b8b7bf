//! `lookout rectify` and `lookout rig`.

use super::disparity::read_pair;
use super::{CommandError, say};
use crate::cli_rig::{Rectify, RigCommand};
use perception::image::GreyView;
use perception::rectify::Remap;
use sources::rig_file::{RigFile, export, import};
use tools::calibration::report::before_and_after;
use tools::reporting::picture::save_grey;

pub fn run(args: &Rectify) -> Result<(), CommandError> {
    let rig = RigFile::read(&args.rig)?;
    let (left, right, width, height) = read_pair(&args.left, &args.right)?;
    let (w, h) = rig.size();
    if (w, h) != (width, height) {
        return Err(CommandError::Other(format!(
            "{} is {width}x{height}, but {} was calibrated at {w}x{h}: give pictures of that size",
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

/// `lookout rig`: shows a calibration, or writes it in another format.
pub fn convert(args: &RigCommand) -> Result<(), CommandError> {
    let rig = import(&args.files, args.size, args.crop.into())?;
    if let (Some(out), Some(format)) = (&args.out, args.format) {
        for path in export(&rig, format.into(), out)? {
            say(path.display())?;
        }
        return Ok(());
    }
    say(rig.to_toml().map_err(CommandError::Other)?.trim_end())
}
