//! The matcher's threads in the process of the stage: each on its core, with the priority of the stage.

use crate::launch::Launch;
use crate::realtime;
use crate::stages::stage::SetupError;
use crate::stages::stereo::matcher::BackendError;
use crate::stages::whole_number::whole;
use messages::pipeline::Role;
use perception::stereo::Crew;

/// Starts the threads that the matcher finds when it is made by the calling thread.
///
/// # Errors
/// If the system refuses a thread.
pub fn start(launch: &Launch) -> Result<(), SetupError> {
    let threads: usize = whole(launch.config.stereo.threads);
    if threads > 1 {
        let (config, cores) = (launch.config.clone(), launch.helper_cores.clone());
        tracing::info!(threads, ?cores, "matching on several threads");
        Crew::new(threads, move |number| {
            realtime::enter_thread(
                &config,
                Role::Stereo,
                number.checked_sub(1).and_then(|helper| cores.get(helper)).copied(),
            );
        })
        .map_err(BackendError::from)?;
    }
    Ok(())
}
