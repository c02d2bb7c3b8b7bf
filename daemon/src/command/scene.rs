//! `lookout scene`: the text of a scene, or pairs with exact ground truth.

use crate::command::console::{progress, say};
use crate::command::error::CommandError;
use clap::Args;
use sources::PairSource;
use sources::scene::{Scene, library};
use std::path::{Path, PathBuf};
use tools::evaluation::files::{KITTI_FOLDERS, KittiPair, prepare};

/// Text below the options of `--help`.
pub const HELP: &str = "Examples:
  lookout scene street > my.toml                  a start for one's own scene
  lookout scene 'random?seed=7' > seven.toml      what a seed generates
  lookout replay scene:seven.toml --out results
  lookout scene 'random?seed=7' --pairs seven     pairs with exact disparities, to score matchers
  lookout evaluate stereo seven

--pairs writes the layout of KITTI 2015: image_2 and image_3, the left and right pictures; disp_occ_0, the
true disparities of all pixels, and disp_noc_0, of those that the right camera sees, too (16 bit,
disparity x 256, 0 = unknown or infinitely far).";

#[derive(Args, Debug)]
pub struct SceneCommand {
    /// Name as in lookout replay scene:NAME, or a TOML file
    #[arg(value_name = "SCENE")]
    pub scene: String,
    /// Write pairs with their ground truth to this folder
    #[arg(long, value_name = "DIR")]
    pub pairs: Option<PathBuf>,
    /// With --pairs: their number
    #[arg(long, value_name = "N", default_value_t = 10, requires = "pairs", value_parser = clap::value_parser!(u64).range(1..=100_000))]
    pub count: u64,
    /// With --pairs: take every N-th pair
    #[arg(long, value_name = "N", default_value_t = 5, requires = "pairs", value_parser = clap::value_parser!(u64).range(1..=10_000))]
    pub every: u64,
}

pub fn run(args: &SceneCommand) -> Result<(), CommandError> {
    match &args.pairs {
        Some(folder) => write_pairs(args, folder),
        None => say(library::text(&args.scene)?.trim_end()),
    }
}

/// Writes pairs in the layout of KITTI 2015.
fn write_pairs(args: &SceneCommand, folder: &Path) -> Result<(), CommandError> {
    let mut scene = Scene::open(&args.scene)?;
    let (width, height) = scene.size();
    if let Some(frames) = scene.count().filter(|frames| (args.count - 1) * args.every >= *frames) {
        let most = (frames - 1) / args.every + 1;
        return Err(CommandError::Other(format!(
            "{}: has {frames} pairs: --count {most} is the largest with --every {}",
            args.scene, args.every
        )));
    }
    let name = |pair: u64| format!("{pair:06}");
    let pictures: Vec<PathBuf> = (0..args.count)
        .flat_map(|pair| KITTI_FOLDERS.map(|part| Path::new(part).join(format!("{}.png", name(pair)))))
        .collect();
    prepare(folder, &pictures)?;
    let bar = progress(Some(args.count), "pairs");
    for pair in 0..args.count {
        let frame = scene.frame(pair * args.every);
        // At infinity, as in the sky, a map has no value.
        let all: Vec<bool> = frame.truth.disparity_px.iter().map(|&d| d > 0.0).collect();
        let noc: Vec<bool> = all.iter().zip(&frame.truth.in_both).map(|(&all, &both)| all && both).collect();
        let pair_files = KittiPair {
            left: &frame.left,
            right: &frame.right,
            truth: &frame.truth.disparity_px,
            all: Some(&all),
            noc: Some(&noc),
            width,
            height,
        };
        pair_files.save(folder, &name(pair))?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    say(format_args!(
        "{}: {} pairs of {width}x{height} pixels with ground truth",
        folder.display(),
        args.count
    ))
}
