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

The daemon restores the clocks itself when it ends. This command is for a daemon that was killed;
the systemd service runs it after every stop. If there is nothing to restore it does nothing and
succeeds. Only the daemon's own user, and root, can restore; root refuses a folder below /tmp that
another user made, unless instance.directory names it.";

#[derive(Args, Debug)]
pub struct RestoreClocks {
    #[command(flatten)]
    pub config: ConfigArgs,
}

pub fn run(args: &RestoreClocks, log: Option<&str>) -> Result<(), CommandError> {
    let config = load(&args.config, log, "restore-clocks", Some("warn"))?;
    let instance = Instance::find(&config.instance.name, &config.instance.directory);
    // Root restores the clocks of the service, but obeys no folder that another user has laid below /tmp.
    instance.check_owner_or_root()?;
    if instance.is_running() {
        return Err(CommandError::Other(format!(
            "the daemon \"{}\" is running and restores the clocks itself when it ends",
            instance.name()
        )));
    }
    let file = clocks::state_file(instance.directory());
    match clocks::restore(&Sysfs::new(&config.board.sysfs), &file)? {
        Some(count) => {
            // Removes the folder of the killed run only if it is empty now.
            let _ = std::fs::remove_dir(instance.directory());
            say(format_args!("clocks restored: {count}"))
        }
        None => say("no clocks to restore"),
    }
}
