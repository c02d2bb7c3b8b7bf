//! `lookout restore-clocks`.

use crate::command::config_args::ConfigArgs;
use crate::command::config_args::load;
use crate::command::console::say;
use crate::command::error::CommandError;
use crate::scheduler::clocks;
use crate::scheduler::sysfs::Sysfs;
use clap::Args;
use messages::instance::Instance;

pub const HELP: &str = "Examples:
  lookout restore-clocks -c /etc/lookout/lookout.toml

The daemon puts clocks back by itself when it ends. This is for one that was killed; the service
runs it after every stop. Without anything to put back it does nothing and succeeds.";

#[derive(Args, Debug)]
pub struct RestoreClocks {
    #[command(flatten)]
    pub config: ConfigArgs,
}

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
