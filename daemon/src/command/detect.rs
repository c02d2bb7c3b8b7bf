//! `lookout detect`.

use super::disparity::median;
use super::{CommandError, say};
use crate::cli_cascade::Detect;
use perception::image::GreyView;
use perception::recognition::group::Group;
use perception::recognition::{Cascade, Detector, Sizes, xml};
use serde::Serialize;
use sources::folder::read_grey;
use std::path::Path;
use tools::reporting::picture::{Colour, Picture};

const RED: Colour = [255, 40, 40];

#[derive(Serialize)]
struct Found<'a> {
    image: &'a Path,
    x: i32,
    y: i32,
    width: i32,
    height: i32,
    /// Overlapping hits behind it.
    score: u32,
}

/// Reads a cascade; errors name the file.
pub fn read_cascade(path: &Path) -> Result<Cascade, CommandError> {
    let text = std::fs::read_to_string(path)
        .map_err(|e| CommandError::Other(format!("{}: {e}: give an OpenCV cascade XML", path.display())))?;
    xml::read(&text).map_err(|e| CommandError::Other(format!("{}: {e}", path.display())))
}

pub fn run(args: &Detect, log: Option<&str>) -> Result<(), CommandError> {
    crate::logging::start("detect", log.unwrap_or("info"));
    if args.overlay.is_some() && args.images.len() > 1 {
        let text = format!("--overlay takes one image, {} were given", args.images.len());
        return Err(CommandError::Other(text));
    }
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
                "{}: {ms:.4} ms of processor time (median of {}, least {:.4})",
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
