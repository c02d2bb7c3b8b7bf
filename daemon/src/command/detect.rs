//! `lookout detect`.

use crate::command::console::say;
use crate::command::disparity::median;
use crate::command::error::CommandError;
use crate::command::number::{number, whole};
use crate::stages::recognition::cascade;
use clap::Args;
use perception::image::GreyView;
use perception::recognition::group::Group;
use perception::recognition::{Cascade, Detector, Sizes, xml};
use serde::Serialize;
use sources::folder::read_grey;
use std::path::Path;
use std::path::PathBuf;
use tools::reporting::picture::{Colour, Picture, check_ending};

/// Text below the options of `--help`.
pub const HELP: &str = "Examples:
  lookout detect haarcascade_frontalface_default.xml people.jpg
  lookout detect vehicle.xml road.png --growth 1.3 --min-px 30 --max-px 90 --json
  lookout detect cascade.xml a.png b.png --neighbours 0     every window that passes
  lookout detect vehicle.xml road.png --overlay found.png

CASCADE is an OpenCV cascade XML file, boosted LBP or Haar, in the current or the older format.
Boxes and defaults are those of OpenCV's detectMultiScale with the same image and options.";

#[derive(Args, Debug)]
pub struct Detect {
    /// OpenCV cascade XML, or vehicle for the one that ships
    pub cascade: PathBuf,
    /// Images (PNG, JPEG, TIFF, BMP, WebP, PGM, PPM; colour is converted to grey)
    #[arg(required = true, value_name = "IMAGE")]
    pub images: Vec<PathBuf>,
    /// Scale factor from one window size to the next, OpenCV's scaleFactor
    #[arg(long, default_value_t = 1.1, value_name = "F", value_parser = growth)]
    pub growth: f64,
    /// Smallest window side, in px; 0 for no limit
    #[arg(long, default_value_t = 0, value_name = "PX")]
    pub min_px: u32,
    /// Largest window side, in px; 0 for no limit
    #[arg(long, default_value_t = 0, value_name = "PX")]
    pub max_px: u32,
    /// A detection needs more overlapping windows than this, OpenCV's minNeighbors; 0 prints every
    /// window that passes
    #[arg(long, default_value_t = 3, value_name = "N")]
    pub neighbours: u32,
    /// Run the detector this many times on each image and print its processor time
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = whole::<u32>(1, 10_000))]
    pub repeat: u32,
    /// Write the image with the boxes drawn; for a single image
    #[arg(long, value_name = "FILE")]
    pub overlay: Option<PathBuf>,
    /// Print as JSON: a list of image, x, y, width, height, score
    #[arg(long)]
    pub json: bool,
}

const RED: Colour = [255, 40, 40];

#[derive(Serialize)]
struct Found<'a> {
    image: &'a Path,
    x: i32,
    y: i32,
    width: i32,
    height: i32,
    /// Number of overlapping windows that were grouped.
    score: u32,
}

/// Reads a cascade: a file, or the name of one that ships.
///
/// # Errors
/// Names the file.
pub fn read_cascade(path: &Path) -> Result<Cascade, CommandError> {
    let text = cascade::text(path).map_err(|e| {
        CommandError::Other(format!(
            "{}: {e}: give an OpenCV cascade XML{}",
            path.display(),
            if cfg!(feature = "models") { ", or vehicle for the one that ships" } else { "" }
        ))
    })?;
    xml::read(&text).map_err(|e| {
        CommandError::Other(format!(
            "{}: {e}: give an OpenCV cascade XML as OpenCV or lookout train writes it",
            path.display()
        ))
    })
}

pub fn run(args: &Detect, log: Option<&str>) -> Result<(), CommandError> {
    crate::logging::start("detect", log.unwrap_or("info"));
    if args.overlay.is_some() && args.images.len() > 1 {
        let text = format!("--overlay takes one image, {} were given", args.images.len());
        return Err(CommandError::Other(text));
    }
    args.overlay.as_deref().map(|path| check_ending(path, false)).transpose()?;
    let cascade = read_cascade(&args.cascade)?;
    let sizes = Sizes::Range { min_px: args.min_px, max_px: args.max_px, growth: args.growth };
    let mut found = Vec::new();
    for path in &args.images {
        let (pixels, width, height) = read_grey(path)?;
        let image = GreyView::new(&pixels, width, height, width)?;
        let mut detector = Detector::new(&cascade, width, height);
        let mut groups: Vec<Group> = Vec::new();
        let mut cpu_ms = Vec::new();
        for _ in 0..args.repeat {
            let begin = messages::clock::process_cpu_ns();
            let result = detector.detect(image, sizes, args.neighbours);
            cpu_ms.push((messages::clock::process_cpu_ns() - begin) as f64 * 1e-6);
            if groups.is_empty() {
                groups.extend_from_slice(result);
            }
        }
        if let Some(path) = &args.overlay {
            let grey = |&v: &u8| [v; 3];
            let mut picture = Picture::from_pixels(pixels.iter().map(grey), width, height);
            for group in &groups {
                let w = &group.window;
                let bounds = [w.x, w.y, w.width, w.height].map(|v| u32::try_from(v).unwrap_or(0));
                picture.frame(bounds, RED, 2);
            }
            picture.save(path)?;
        }
        if args.repeat > 1 && !args.json {
            let ms = median(&mut cpu_ms);
            say(format_args!(
                "{}: {ms:.4} ms of processor time (median of {}, minimum {:.4})",
                path.display(),
                args.repeat,
                cpu_ms[0]
            ))?;
        }
        found.extend(groups.iter().map(|g| Found {
            image: path,
            x: g.window.x,
            y: g.window.y,
            width: g.window.width,
            height: g.window.height,
            score: g.hits,
        }));
    }
    if args.json {
        return say(serde_json::to_string_pretty(&found)?);
    }
    for f in &found {
        let Found { image, x, y, width, height, score } = f;
        say(format_args!("{}: {width}x{height} at {x},{y}, score {score}", image.display()))?;
    }
    if found.is_empty() {
        say("nothing found")?;
    }
    Ok(())
}

fn growth(text: &str) -> Result<f64, String> {
    number(text, 1.01, 100.0)
}
