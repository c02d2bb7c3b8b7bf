//! `--video`: a video of a run, made from its overlays when it has ended.

use crate::command::console::{progress, say};
use crate::command::error::CommandError;
use std::path::{Path, PathBuf};
use tools::reporting::output::LINES;
use tools::reporting::video::Plan;

/// The results folder of a run, and the video that is made of it.
pub struct Film {
    plan: Option<Plan>,
    /// Results, with `--out` or for the video.
    folder: Option<PathBuf>,
    /// Whether the folder is removed when the video is made.
    is_own: bool,
}

impl Film {
    /// Prepares a video, and a folder beside it for the overlays if there is no `--out`.
    ///
    /// # Errors
    /// If the video cannot be made here, or the folder cannot be created.
    pub fn prepare(video: Option<&Path>, out: Option<&Path>) -> Result<Self, CommandError> {
        let search = std::env::var_os("PATH").unwrap_or_default();
        let plan = video.map(|path| Plan::new(path, &search)).transpose()?;
        let Some(plan) = plan else {
            return Ok(Self { plan: None, folder: out.map(Path::to_owned), is_own: false });
        };
        if let Some(out) = out {
            return Ok(Self { plan: Some(plan), folder: Some(out.to_owned()), is_own: false });
        }
        // Beside the video, which has a disk with room; /tmp may be memory.
        let folder = plan.path().with_extension("frames");
        std::fs::create_dir(&folder).map_err(|error| {
            CommandError::Other(format!(
                "{}: {error}: the overlays of --video are collected there: remove it, or give --out DIR",
                folder.display()
            ))
        })?;
        Ok(Self { plan: Some(plan), folder: Some(folder), is_own: true })
    }

    /// The folder that the run writes its results to.
    pub fn folder(&self) -> Option<&Path> {
        self.folder.as_deref()
    }

    /// Makes the video; `quiet` prints nothing.
    ///
    /// # Errors
    /// If it cannot be made.
    pub fn finish(self, quiet: bool) -> Result<(), CommandError> {
        let (Some(plan), Some(folder)) = (&self.plan, &self.folder) else { return Ok(()) };
        let count = std::fs::read_to_string(folder.join(LINES)).map(|text| text.lines().count() as u64).ok();
        let bar = progress(count, "frames of the video");
        let video = plan.write(folder, &mut |frames| bar.set_position(frames));
        bar.finish_and_clear();
        let video = video?;
        if video.left_out > 0 {
            eprintln!(
                "lookout: {}: the last {} frames are left out: a GIF ends after {} pictures; give a file that ends in \
                 .mp4",
                plan.path().display(),
                video.left_out,
                video.pictures
            );
        }
        if quiet {
            return Ok(());
        }
        let size = std::fs::metadata(plan.path()).map_or(0, |m| m.len());
        say(format_args!(
            "video in {}: {} pictures, {:.1} s, {:.1} MB",
            plan.path().display(),
            video.pictures,
            video.seconds,
            size as f64 * 1e-6
        ))
    }
}

impl Drop for Film {
    /// Best effort: a run that failed leaves no overlays of its own folder, either.
    fn drop(&mut self) {
        if let (true, Some(folder)) = (self.is_own, &self.folder) {
            let _ = std::fs::remove_dir_all(folder);
        }
    }
}
