//! Takes a scene through the rooms, frame by frame, with its truth.

use crate::command::error::CommandError;
use crate::in_process::{FrameResult, Pipeline};
use config::Config;
use messages::regions::RegionRecord;
use perception::region::PixelBox;
use perception::rig::Rig;
use sources::scene::{Scene, SceneTruth};
use sources::{PairSource, SourceError};
use std::cell::RefCell;
use std::rc::Rc;
use tools::evaluation::scene_match::Detection;

/// The scene that the pipeline draws from and the truth is asked of.
struct Shared(Rc<RefCell<Scene>>);

impl PairSource for Shared {
    fn size(&self) -> (usize, usize) {
        self.0.borrow().size()
    }

    fn rig(&self) -> Option<Rig> {
        self.0.borrow().rig()
    }

    fn count(&self) -> Option<u64> {
        self.0.borrow().count()
    }

    fn period_ns(&self) -> u64 {
        self.0.borrow().period_ns()
    }

    fn read(&mut self, index: u64, left: &mut [u8], right: &mut [u8]) -> Result<(), SourceError> {
        self.0.borrow_mut().read(index, left, right)
    }
}

/// A scene on its way through the rooms.
pub struct SceneRun {
    scene: Rc<RefCell<Scene>>,
    pipeline: Pipeline,
    /// The scene's rig.
    pub rig: Rig,
    /// Frames that there are.
    pub frames: u64,
    /// Seconds from frame to frame.
    pub period_s: f64,
    /// What the scene shows.
    pub title: String,
}

impl SceneRun {
    /// Furnishes the rooms for a scene; it is looked at for `most` frames at most.
    ///
    /// # Errors
    /// When a room cannot be used.
    pub fn new(config: &Config, scene: Scene, most: u64) -> Result<Self, CommandError> {
        let no_rig = || CommandError::Other("the scene has no rig".into());
        let rig = scene.rig().ok_or_else(no_rig)?;
        let frames = scene.count().map_or(most, |count| count.min(most));
        let (period_s, title) = (scene.period_ns() as f64 * 1e-9, scene.title().to_owned());
        let scene = Rc::new(RefCell::new(scene));
        let pipeline = Pipeline::new(config, Box::new(Shared(Rc::clone(&scene))), rig)?;
        Ok(Self { scene, pipeline, rig, frames, period_s, title })
    }

    /// Takes frame `index` through the rooms; frames come in order.
    ///
    /// # Errors
    /// When the scene has no such frame.
    pub fn frame(&mut self, index: u64) -> Result<(SceneTruth, FrameResult<'_>), CommandError> {
        let truth = self.scene.borrow_mut().truth(index);
        Ok((truth, self.pipeline.frame(index, index)?))
    }
}

/// A region as it is compared with the truth: box, distance and the distance's standard deviation.
pub fn found(region: &RegionRecord, rig: &Rig) -> Detection {
    let [x, y, width, height] = region.bounds;
    Detection {
        bounds: PixelBox { x, y, width, height },
        distance_m: region.distance_m,
        sigma_m: rig.distance_error_m(region.distance_m, region.disparity_sigma_px),
    }
}
