//! `lookout stage`: a stage process, started by the scheduler.

use crate::command::error::CommandError;
use crate::host::HostError;
use crate::launch::Launch;
use messages::pipeline::Role;
use std::io::Read;

pub fn run(role: &str) -> Result<(), CommandError> {
    let role: Role = role.parse().map_err(CommandError::Other)?;
    let mut document = String::new();
    let launch = |error: String| CommandError::Stage(HostError::Launch(error));
    std::io::stdin().read_to_string(&mut document).map_err(|e| launch(e.to_string()))?;
    let document = Launch::parse(&document).map_err(|e| launch(e.to_string()))?;
    crate::logging::start(role.name(), &document.config.log.level);
    crate::stages::run(role, document).map_err(|error| {
        tracing::error!(%error, "stage failed");
        error.into()
    })
}
