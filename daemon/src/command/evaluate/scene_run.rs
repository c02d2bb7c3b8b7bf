//! Runs a synthetic scene through the stages in this process, frame by frame, with its ground truth.

use crate::command::error::CommandError;
use crate::in_process::{FrameResult, Pipeline};
use config::Config;
use messages::source_time::SourceTimeRecord;
use perception::region::PixelBox;
use perception::rig::Rig;
use sources::scene::{Scene, SceneTruth};
use sources::vehicle::VehicleReading;
use sources::{PairSource, SourceError};
use std::cell::RefCell;
use std::rc::Rc;
use tools::evaluation::scene_match::Detection;
use tools::reporting::record::ObstacleLine;

/// A scene shared by the pipeline, which reads its images, and the evaluation, which reads its truth.
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

    fn vehicle(&self, index: u64) -> VehicleReading {
        self.0.borrow().vehicle(index)
    }

    fn read(&mut self, index: u64, left: &mut [u8], right: &mut [u8]) -> Result<(), SourceError> {
        self.0.borrow_mut().read(index, left, right)
    }
}

/// A scene and the pipeline that processes it.
pub struct SceneRun {
    scene: Rc<RefCell<Scene>>,
    pipeline: Pipeline,
    /// The scene's rig.
    pub rig: Rig,
    /// Number of frames.
    pub frames: u64,
    /// Seconds between frames.
    pub period_s: f64,
    /// Description of the scene.
    pub title: String,
}

impl SceneRun {
    /// Configures the stages for a scene; at most `max_frames` of its frames are used.
    ///
    /// # Errors
    /// If a stage cannot be configured.
    pub fn new(config: &Config, scene: Scene, max_frames: u64) -> Result<Self, CommandError> {
        let no_rig = || CommandError::Other("the scene has no rig".into());
        let rig = scene.rig().ok_or_else(no_rig)?;
        let frames = scene.count().map_or(max_frames, |count| count.min(max_frames));
        let (period_s, title) = (scene.period_ns() as f64 * 1e-9, scene.title().to_owned());
        let scene = Rc::new(RefCell::new(scene));
        let pipeline = Pipeline::new(config, Box::new(Shared(Rc::clone(&scene))), rig)?;
        Ok(Self { scene, pipeline, rig, frames, period_s, title })
    }

    /// Processes frame `index`; frames have to be processed in order, because tracking has a memory.
    ///
    /// # Errors
    /// If the scene has no such frame.
    pub fn frame(&mut self, index: u64) -> Result<(SceneTruth, FrameResult<'_>), CommandError> {
        let truth = self.scene.borrow_mut().truth(index);
        Ok((truth, self.pipeline.frame(index, index)?))
    }

    /// The truth of frame `index` alone. It costs about as much as the pictures.
    pub fn truth(&self, index: u64) -> SceneTruth {
        self.scene.borrow_mut().truth(index)
    }

    /// Processes frame `index` without its truth.
    ///
    /// # Errors
    /// If the scene has no such frame.
    pub fn process(&mut self, index: u64) -> Result<FrameResult<'_>, CommandError> {
        Ok(self.pipeline.frame(index, index)?)
    }

    /// Continues with another scene, which needs the same cameras.
    pub fn change(&mut self, scene: Scene) {
        *self.scene.borrow_mut() = scene;
    }

    /// Processes frame `index` of the scene as frame `sequence` with the source time `source_ns`, without its truth.
    ///
    /// # Errors
    /// If the scene has no such frame.
    pub fn frame_at(
        &mut self,
        sequence: u64,
        index: u64,
        source_ns: u64,
    ) -> Result<FrameResult<'_>, CommandError> {
        Ok(self.pipeline.frame_at(sequence, index, source_ns)?)
    }

    /// What was wrong with the source time so far.
    pub fn source_time(&self) -> SourceTimeRecord {
        self.pipeline.source_time()
    }
}

/// What the system reports in a frame, for the comparison with the truth: box, distance and its standard deviation of each
/// confirmed obstacle.
pub fn reported(obstacles: &[ObstacleLine]) -> impl Iterator<Item = Detection> {
    obstacles.iter().filter(|o| o.confirmed).map(detection)
}

/// Box, distance and its standard deviation of an obstacle.
pub fn detection(o: &ObstacleLine) -> Detection {
    let bounds = PixelBox { x: o.x_px, y: o.y_px, width: o.width_px, height: o.height_px };
    Detection { bounds, distance_m: o.distance_m, sigma_m: o.distance_sigma_m }
}
