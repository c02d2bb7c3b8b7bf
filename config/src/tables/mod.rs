//! The tables of the configuration. A key is declared here and nowhere else.

mod alarm;
mod board;
mod bridge;
mod can_out;
mod daemon;
mod realtime;
mod recognition;
mod road;
mod soak;
mod source;
mod stereo;
mod stream;
mod vehicle;

pub use alarm::Alarm;
pub use board::{Board, Clocks, Heat};
pub use bridge::Bridge;
pub use can_out::CanOut;
pub use daemon::{Cores, Instance, Log, Supervision};
pub use realtime::{Pacing, Realtime};
pub use recognition::{Recognition, RecognitionDetector, Tracking};
pub use road::{Regions, Road};
pub use soak::Soak;
pub use source::{Camera, Source};
pub use stereo::{Calibration, Stereo};
pub use stream::Stream;
pub use vehicle::{Motion, Vehicle};

crate::table::configuration! {
    /// The whole configuration. [`Config::default`] is the profile `replay`.
    pub struct Config {
        instance: Instance,
        log: Log,
        source: Source,
        vehicle: Vehicle,
        motion: Motion,
        stereo: Stereo,
        calibration: Calibration,
        road: Road,
        regions: Regions,
        recognition: Recognition,
        tracking: Tracking,
        alarm: Alarm,
        cores: Cores,
        supervision: Supervision,
        heat: Heat,
        clocks: Clocks,
        board: Board,
        soak: Soak,
        stream: Stream,
        camera: Camera,
        realtime: Realtime,
        pacing: Pacing,
        can_out: CanOut,
        bridge: Bridge,
    }
}
