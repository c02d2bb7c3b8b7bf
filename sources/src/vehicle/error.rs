//! Errors of the signals of a vehicle's bus.

use std::path::PathBuf;
use thiserror::Error;

/// Why the signals of the bus cannot be used. Every text names the configuration key and the remedy.
#[derive(Debug, Error)]
pub enum VehicleError {
    /// A signal cannot be used.
    #[error("vehicle.{key} = \"{value}\": {reason}")]
    Signal {
        /// The key without its table.
        key: &'static str,
        /// An excerpt of its value.
        value: String,
        /// What is wrong with file and line, and the remedy.
        reason: String,
    },
    /// Signals are named, but there is no DBC file to find them in.
    #[error(
        "vehicle.{key} = \"{value}\": names a signal of a DBC file, but vehicle.dbc is empty: name the file there, or \
         give the signal as id:start|length@order sign (factor,offset) unit"
    )]
    NoDbc {
        /// The key without its table.
        key: &'static str,
        /// An excerpt of its value.
        value: String,
    },
    /// The DBC file cannot be read.
    #[error("vehicle.dbc: {}: {source}: give the DBC file of the bus", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Cause.
        source: std::io::Error,
    },
    /// A bus without signals.
    #[error("vehicle.bus = \"{bus}\", but no signal is configured: name one with vehicle.speed_signal")]
    NoSignals {
        /// The bus.
        bus: String,
    },
    /// This build has no CAN.
    #[error(
        "vehicle.bus = \"{bus}\": this build has no CAN: build it with --features can, or leave vehicle.bus empty"
    )]
    NoCan {
        /// The bus.
        bus: String,
    },
}
