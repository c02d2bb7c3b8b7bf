//! The stages. Each folder holds one stage: its adapter between messages and algorithms, the mapping from the
//! configuration to parameters, and its tests. [`entry`] gives the constructor for each entry of the table in
//! [`messages::pipeline`].

pub mod capture;
mod frame_loop;
pub mod motion;
pub mod recognition;
pub mod road;
pub mod stage;
pub mod stereo;
pub mod track_record;
pub mod vehicle_record;
pub mod whole_number;
pub mod writer;

use crate::host::{Host, HostError};
use crate::launch::{FrameFormat, Launch};
use config::Config;
use messages::pipeline::Role;
use stage::{FrameStage, SetupError, Stage, configure};

/// Constructor of a stage: see [`configure`].
type Configure = fn(&Config, &FrameFormat) -> Result<Box<dyn FrameStage>, SetupError>;

/// Configured stages with their roles.
type ConfiguredStages = Vec<(Role, Box<dyn FrameStage>)>;

/// How a process of the pipeline is run.
pub enum Entry {
    /// By the frame loop: one message in, one message out.
    Frames {
        /// See [`configure`].
        configure: Configure,
        /// See [`Stage::enter`].
        enter: fn(&Launch) -> Result<(), SetupError>,
        /// See [`Stage::check`].
        check: fn(&Config, &FrameFormat) -> Result<(), SetupError>,
    },
    /// By its own main loop.
    Process(fn(Host) -> Result<(), HostError>),
    /// The scheduler, which is not a stage.
    Scheduler,
}

/// The constructor of each process.
pub fn entry(role: Role) -> Entry {
    match role {
        Role::Scheduler => Entry::Scheduler,
        Role::Capture => Entry::Process(capture::run),
        Role::Stereo => frames::<stereo::StereoStage>(),
        Role::Road => frames::<road::RoadStage>(),
        Role::Recognition => frames::<recognition::RecognitionStage>(),
        Role::Writer => Entry::Process(writer::run),
    }
}

fn frames<S: Stage + 'static>() -> Entry {
    Entry::Frames { configure: configure::<S>, enter: S::enter, check: S::check }
}

/// Runs a stage until SIGTERM or SIGINT.
///
/// # Errors
/// If the stage cannot be configured, or shared memory cannot be used. The scheduler then restarts it.
pub fn run(role: Role, launch: Launch) -> Result<(), HostError> {
    let host = Host::new(role, launch)?;
    match entry(role) {
        Entry::Frames { configure, enter, .. } => {
            enter(&host.launch)?;
            let stage = configure(&host.launch.config, &host.launch.frames)?;
            frame_loop::run(host, stage)
        }
        Entry::Process(run) => run(host),
        Entry::Scheduler => Err(HostError::Launch("the scheduler is not a stage".into())),
    }
}

/// Calls [`Stage::check`] of all stages, before any of them is started.
///
/// # Errors
/// The first error.
pub fn check(config: &Config, format: &FrameFormat) -> Result<(), SetupError> {
    crate::input::vehicle::decoder(config)?;
    for role in Role::ALL {
        if let Entry::Frames { check, .. } = entry(role) {
            check(config, format)?;
        }
    }
    Ok(())
}

/// Configures all stages with one input and one output, in the order of the pipeline.
///
/// # Errors
/// If one of them cannot be configured.
pub fn configure_all(config: &Config, format: &FrameFormat) -> Result<ConfiguredStages, SetupError> {
    let mut stages = Vec::new();
    for role in Role::ALL {
        if let Entry::Frames { configure, .. } = entry(role) {
            stages.push((role, configure(config, format)?));
        }
    }
    // Distance from the source. The bound ends the loop if the table has a cycle.
    let steps = |role: Role| {
        let mut steps = 0;
        let mut input = role.spec().input;
        while let Some(service) = input.filter(|_| steps < Role::COUNT) {
            steps += 1;
            input = Role::ALL.iter().find(|r| r.spec().output == Some(service)).and_then(|r| r.spec().input);
        }
        steps
    };
    stages.sort_by_key(|(role, _)| steps(*role));
    Ok(stages)
}

#[cfg(test)]
mod tests {
    use super::*;
    use perception::rig::Rig;

    #[test]
    fn inputs_and_outputs_of_the_stages_are_those_of_the_table() {
        let config = config::parse("", std::path::Path::new("x.toml")).unwrap();
        let rig = Rig { focal_px: 500.0, baseline_m: 0.3, cx_px: 80.0, cy_px: 60.0 };
        let stages = configure_all(&config, &FrameFormat::new((160, 120), rig)).unwrap();
        for (role, stage) in &stages {
            let spec = role.spec();
            assert_eq!(spec.input.map(|s| s.kind), Some(stage.input()), "{role}");
            assert_eq!(spec.output.map(|s| s.kind), Some(stage.output()), "{role}");
        }
        let order: Vec<Role> = stages.iter().map(|(role, _)| *role).collect();
        assert_eq!(order, [Role::Stereo, Role::Road, Role::Recognition]);
    }
}
