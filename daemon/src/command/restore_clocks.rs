//! `lookout restore-clocks`.

use super::{CommandError, load, say};
use crate::cli_board::RestoreClocks;
use crate::scheduler::clocks;
use crate::scheduler::sysfs::Sysfs;
use messages::instance::Instance;

pub fn run(args: &RestoreClocks, log: Option<&str>) -> Result<(), CommandError> {
    let config = load(&args.config, log, "restore-clocks", Some("warn"))?;
    let instance = Instance::find(&config.instance.name, &config.instance.directory);
    if instance.is_running() {
        return Err(CommandError::Other(format!(
            "the daemon \"{}\" is running and puts its clocks back itself when it ends",
            instance.name()
        )));
    }
    let file = clocks::state_file(instance.directory());
    match clocks::restore(&Sysfs::new(&config.board.sysfs), &file)? {
        Some(count) => {
            // The folder of a run that was killed is not needed any more, unless it holds more.
            let _ = std::fs::remove_dir(instance.directory());
            say(format_args!("clocks put back: {count}"))
        }
        None => say("no clocks to put back"),
    }
}
